"""Classes of a user's own Python file, named as ``own.py:MyLaw``.

The file is run, as ``python own.py`` would run it. So it is read only where the user names it: on
the command line, in Python, in a configuration or a study. Neither a run nor a page names code.
"""

from __future__ import annotations

import sys
from hashlib import sha256
from importlib.abc import InspectLoader
from importlib.util import module_from_spec, spec_from_loader
from traceback import extract_tb
from typing import Any

from rpctl.errors import UnknownNameError, fault_at
from rpctl.files.caps import read_text

MARK = ".py:"  # between the file, without its suffix, and the class


class OwnFile(InspectLoader):
    """The one file of a module: its path as the user gave it, and its text when it was read."""

    def __init__(self, path: str, text: str) -> None:
        self.path, self.text = path, text
        self.digest = sha256(f"{path}\0{text}".encode()).hexdigest()[:16]

    def get_source(self, fullname: str) -> str:
        """Return the text."""
        return self.text

    def get_code(self, fullname: str) -> Any:
        """Return the code, whose tracebacks name the file."""
        return self.source_to_code(self.text, self.path)


def own_thing(name: str, kind: str) -> Any:
    """Return what a user's file calls by a name: of ``own.py:MyLaw`` the class.

    Args:
        name: File and name.
        kind: What to give instead of a file that cannot be read, in words.

    Raises:
        RpctlError: There is no such file, it cannot be run, or has no such name.
    """
    path, _, word = name.rpartition(":")
    return thing_of_text(path, read_text(path, "MAX_TOML_BYTES", kind), word)


def thing_of_text(path: str, text: str, name: str) -> Any:
    """Return what a file's text calls by a name; a text is run once.

    Args:
        path: What messages call the file, which need not be on this machine.
        text: The text.
        name: The name.

    Raises:
        RpctlError: It cannot be run, or has no such name.
    """
    file = OwnFile(path, text)
    module_name = f"own_code_{file.digest}"
    if module_name not in sys.modules:
        spec = spec_from_loader(module_name, file)
        assert spec is not None
        module = sys.modules[module_name] = module_from_spec(spec)  # where dataclasses look
        try:
            file.exec_module(module)
        except BaseException as error:
            del sys.modules[module_name]
            if not isinstance(error, Exception):
                raise
            raise fault_at(path, _line(error, path), f"{type(error).__name__}: {error}") from error
    names = vars(sys.modules[module_name])
    if name not in names:
        own = [k for k, x in names.items() if getattr(x, "__module__", "") == module_name]
        raise UnknownNameError(f"{path}: class", name, own)
    return names[name]


def _line(error: Exception, path: str) -> int | None:
    """Return the line of a file where running it failed."""
    if isinstance(error, SyntaxError):
        return error.lineno
    lines = [each.lineno for each in extract_tb(error.__traceback__) if each.filename == path]
    return lines[-1] if lines else None


def own_file(kind: type) -> OwnFile | None:
    """Return the file of a class that was named by it; None of all other classes."""
    loader = getattr(sys.modules.get(kind.__module__), "__loader__", None)
    return loader if isinstance(loader, OwnFile) else None


def sent(thing: object) -> Any:
    """Return how another process makes a class of a user's file: of the text.

    It is a pickler's ``reducer_override``; all else is ``NotImplemented``.
    """
    file = own_file(thing) if isinstance(thing, type) else None
    if file is None:
        return NotImplemented
    return thing_of_text, (file.path, file.text, thing.__name__)  # type: ignore[attr-defined]
