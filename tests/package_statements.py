"""What the package's modules import, read once however many tests ask."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import rpctl

PACKAGE = Path(rpctl.__file__).parent


@dataclass(frozen=True)
class Module:
    """A module: its file, relative to the package, and what its statements say."""

    file: Path
    imports: tuple[str, ...]  # whole modules
    names: tuple[tuple[str, str], ...]  # names imported from modules: (module, name)
    relative: bool  # whether it imports by relative names


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
    )
