"""Names and docstrings: a class name is one thing, and a public function says what it takes."""

from __future__ import annotations

import ast
import re
from collections import defaultdict

from tests.package_statements import Signature, modules, signatures, statements

ENOUGH_TO_NAME = 3  # parameters from which on a sentence no longer says them all


def documented(docstring: str) -> set[str]:
    """Return the parameters that the section Args has an entry for."""
    section = re.search(r"^\s*Args:\n(.*?)(?:\n\s*\n|\Z)", docstring, re.DOTALL | re.MULTILINE)
    entries = re.findall(r"^\s*(\w[\w, ]*):", section[1], re.MULTILINE) if section else []
    return {name.strip() for entry in entries for name in entry.split(",")}


def test_parameters_are_documented() -> None:
    missing = []
    for module in modules():
        for function in module.functions:
            if len(function.parameters) < ENOUGH_TO_NAME or function.name.endswith("_command"):
                continue  # a command's help documents its parameters
            lacking = set(function.parameters) - documented(function.docstring)
            if lacking:
                where = f"{module.file}:{function.line} {function.name}"
                missing.append(f"{where}: {', '.join(sorted(lacking))}")
    assert not missing, "\n".join(missing)


def test_a_class_name_is_one_thing() -> None:
    places = defaultdict(list)
    for module in modules():
        for name in module.classes:
            places[name].append(str(module.file))
    assert not {name: files for name, files in places.items() if len(files) > 1}


def test_classes_and_functions_are_seen_wherever_they_are() -> None:
    """In conditions, handlers and classes; what is nested or private needs no document."""
    text = """
import one
class A:
    def f(self, x, /, y, *, z):
        'Doc.'
        class B: from two import b
    def _g(self): pass
try:
    with one: import three
except E:
    if one: class_ = 1
    else:
        class C: pass
match one:
    case 1:
        class D: pass
def h(cls, a):
    def nested(): pass
"""
    tree = ast.parse(text)
    found = [node.name for node in statements(tree.body) if isinstance(node, ast.ClassDef)]
    assert found == ["A", "B", "C", "D"]
    assert [*signatures(tree)] == [
        Signature("h", 17, ("a",), ""), Signature("f", 4, ("x", "y", "z"), "Doc.")]  # fmt: skip
    taken = [
        node for node in statements(tree.body) if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert [node.names[0].name for node in taken] == ["one", "b", "three"]
    assert {each.file.as_posix() for each in modules()} > {"__init__.py", "robot/model.py"}
