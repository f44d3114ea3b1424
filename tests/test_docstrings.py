"""Docstrings of what `rpctl` exports: each says what it is, and what it takes."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import rpctl

ENOUGH_TO_NAME = 3  # parameters from which on a sentence no longer says them all


def documented(docstring: str) -> set[str]:
    """Return the parameters that the section Args has an entry for."""
    section = re.search(r"^\s*Args:\n(.*?)(?:\n\s*\n|\Z)", docstring, re.DOTALL | re.MULTILINE)
    entries = re.findall(r"^\s*\**(\w[\w, ]*):", section[1], re.MULTILINE) if section else []
    return {name.strip() for entry in entries for name in entry.split(",")}


def callables(exported: Any) -> Iterator[Callable[..., Any]]:
    """Yield a function, or the public methods that a class of ours defines."""
    if not inspect.isclass(exported):
        yield exported
        return
    for name, member in vars(exported).items():
        method = getattr(member, "__func__", member)
        if inspect.isfunction(method) and not name.startswith("_"):
            yield method


def lacking(function: Callable[..., Any]) -> set[str]:
    parameters = {*inspect.signature(function).parameters} - {"self", "cls"}
    few = len(parameters) < ENOUGH_TO_NAME
    return set() if few else parameters - documented(function.__doc__ or "")


@pytest.mark.parametrize("name", rpctl.__all__)
def test_an_exported_name_is_documented(name: str) -> None:
    exported = getattr(rpctl, name)
    assert exported.__doc__
    missing = {each.__qualname__: lacking(each) for each in callables(exported)}
    assert not {method: names for method, names in missing.items() if names}


def test_a_parameter_that_is_not_documented_is_seen() -> None:
    def f(a: int, b: int, c: int) -> None:
        """Do.

        Args:
            a, b: Two.
        """

    assert lacking(f) == {"c"}
