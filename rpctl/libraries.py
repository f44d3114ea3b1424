"""Libraries that are imported only where they are needed, and how to install missing ones."""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module, metadata
from typing import Any, NamedTuple

from rpctl.files.signals import held_signals

REQUIREMENT = re.compile(r"([\w.-]+)(?:\[[^\]]*\])?([^;]*)(?:;(.*))?")
EXTRA = re.compile(r"extra == ['\"](\w+)")


class Requirement(NamedTuple):
    """A package that rpctl needs, as rpctl's installed metadata names it.

    Attributes:
        name: Name of the package.
        versions: The versions that rpctl was tested with, ``<2,>=1.12``.
        marker: The condition under which it is needed, ``python_version < '3.11'``, or empty.
        extra: The extra that needs it; empty if rpctl itself does.
    """

    name: str
    versions: str
    marker: str
    extra: str


def requirements() -> Iterator[Requirement]:
    """Yield what the installed rpctl needs; nothing if rpctl runs without being installed."""
    with suppress(metadata.PackageNotFoundError):
        for text in metadata.requires("rpctl") or ():
            if match := REQUIREMENT.match(text):
                name, versions, marker = match[1], match[2].strip(), match[3] or ""
                extra = EXTRA.search(marker)
                yield Requirement(name, versions, marker, extra[1] if extra else "")


def install_command(wanted: str) -> str:
    """Return the command that installs the packages of an extra, or one that rpctl always needs.

    The command names these packages and not rpctl: pip does not find ``rpctl[EXTRA]`` if rpctl
    comes from a checkout or from a wheel.

    Args:
        wanted: The extra, or the package.
    """
    packages = [f"'{r.name}{r.versions}'" for r in requirements() if wanted == (r.extra or r.name)]
    return " ".join(["pip install", *packages]) if packages else f"pip install '.[{wanted}]'"


def library(name: str) -> Any:
    """Return a library; a Ctrl-C while it is imported waits until it is.

    Trimesh, and with it yourdfpy, takes every exception of an optional import for its absence: a
    Ctrl-C that came just then would be lost.
    """
    with held_signals():
        return import_module(name)


@cache
def lean_library(name: str, own: tuple[str, ...], without: tuple[str, ...]) -> Any:
    """Return a library of one's own that has not imported what it can do without.

    The process forgets that it was imported: who imports it next gets it whole.

    Args:
        name: The library.
        own: Packages that are imported for it and forgotten with it; itself is one.
        without: Modules that it and they find absent, if nobody has imported them yet.
    """
    known = set(sys.modules)
    try:
        with _absent(without):
            found = library(name)
    except ImportError:  # a release that can no longer do without
        return library(name)
    for module in set(sys.modules) - known:
        if module.partition(".")[0] in own:
            del sys.modules[module]
    return found


@contextmanager
def _absent(names: Collection[str]) -> Iterator[None]:
    """Let this thread's imports of some modules fail, other threads' succeed."""
    finder = _AbsentFinder(names)
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


class _AbsentFinder:
    """Finds no module of some names, and leaves all others to Python's own finders."""

    def __init__(self, names: Collection[str]) -> None:
        self._names, self._thread = frozenset(names), threading.get_ident()

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """Raise for an absent module; any other is not found here."""
        if name in self._names and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(f"{name} is left out", name=name)
