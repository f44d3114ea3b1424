"""What the package's modules import and define, read once however many tests ask."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import rpctl

PACKAGE = Path(rpctl.__file__).parent


@dataclass(frozen=True)
class Signature:
    """A public function or method: where it begins, its parameters and its docstring."""

    name: str
    line: int
    parameters: tuple[str, ...]
    docstring: str


@dataclass(frozen=True)
class Module:
    """A module: its file, relative to the package, and what its statements say."""

    file: Path
    imports: tuple[str, ...]  # whole modules
    names: tuple[tuple[str, str], ...]  # names imported from modules: (module, name)
    relative: bool  # whether it imports by relative names
    classes: tuple[str, ...]
    functions: tuple[Signature, ...]


@cache
def modules() -> tuple[Module, ...]:
    """Return all modules of the package, sorted by their files."""
    return tuple(map(_module, sorted(PACKAGE.rglob("*.py"))))


def statements(body: Sequence[ast.AST]) -> Iterator[ast.AST]:
    """Yield statements and those within them; expressions hold none."""
    for each in body:
        yield each
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            inner = getattr(each, part, ())
            if isinstance(inner, list):
                yield from statements(inner)


def signatures(tree: ast.Module) -> Iterator[Signature]:
    """Yield the public functions of a module, and the public methods of its public classes."""
    bodies = [tree.body]
    bodies += [
        node.body
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    for body in bodies:
        for node in body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                listed = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                names = (argument.arg for argument in listed)
                own = tuple(name for name in names if name not in ("self", "cls"))
                yield Signature(node.name, node.lineno, own, ast.get_docstring(node) or "")


def _module(file: Path) -> Module:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    every = list(statements(tree.body))
    whole = (node.names for node in every if isinstance(node, ast.Import))
    some = [node for node in every if isinstance(node, ast.ImportFrom)]
    return Module(
        file=file.relative_to(PACKAGE),
        imports=tuple(alias.name for names in whole for alias in names),
        names=tuple((str(node.module), alias.name) for node in some for alias in node.names),
        relative=any(node.level for node in some),
        classes=tuple(node.name for node in every if isinstance(node, ast.ClassDef)),
        functions=tuple(signatures(tree)),
    )
