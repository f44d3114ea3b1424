"""Names and docstrings: a class name is one thing, and a public function says what it takes."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import rpctl

PACKAGE = Path(rpctl.__file__).parent
ENOUGH_TO_NAME = 3  # parameters from which on a sentence no longer says them all


def functions(tree: ast.Module) -> Iterator[tuple[ast.FunctionDef, list[str]]]:
    """Yield the public functions and methods of a module with their parameters' names."""
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
                names = [argument.arg for argument in listed]
                yield node, [name for name in names if name not in ("self", "cls")]


def documented(docstring: str) -> set[str]:
    """Return the parameters that the section Args has an entry for."""
    section = re.search(r"^\s*Args:\n(.*?)(?:\n\s*\n|\Z)", docstring, re.DOTALL | re.MULTILINE)
    entries = re.findall(r"^\s*(\w[\w, ]*):", section[1], re.MULTILINE) if section else []
    return {name.strip() for entry in entries for name in entry.split(",")}


def test_parameters_are_documented() -> None:
    missing = []
    for file in sorted(PACKAGE.rglob("*.py")):
        for node, names in functions(ast.parse(file.read_text(encoding="utf-8"))):
            if len(names) < ENOUGH_TO_NAME or node.name.endswith("_command"):
                continue  # a command's help documents its parameters
            lacking = set(names) - documented(ast.get_docstring(node) or "")
            if lacking:
                where = f"{file.relative_to(PACKAGE)}:{node.lineno} {node.name}"
                missing.append(f"{where}: {', '.join(sorted(lacking))}")
    assert not missing, "\n".join(missing)


def test_a_class_name_is_one_thing() -> None:
    places = defaultdict(list)
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(str(file.relative_to(PACKAGE)))
    assert not {name: files for name, files in places.items() if len(files) > 1}
