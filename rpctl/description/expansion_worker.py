"""The process that expands one .xacro: confined to declared folders, bounded in memory.

A .xacro holds Python expressions. xacro keeps Python's builtins from them; beyond that, this
process reads no file outside the folders it is told, writes none, and starts nothing. That stops
accidents and stray includes. It is no jail: expand only what you trust.
"""

from __future__ import annotations

import errno
import io
import json
import os
import sys
import warnings
from collections.abc import Callable
from contextlib import redirect_stderr, suppress
from typing import Any
from xml.dom import expatbuilder  # noqa: F401 - before the confinement: minidom imports it late
from xml.parsers.expat import ExpatError

from rpctl.description.packages import DECLARE, Packages, inside

READ_EVENTS = ("open", "os.listdir", "os.scandir")  # audit events whose first argument is a path
FORBIDDEN_EVENTS = (  # beginnings of the events by which code reaches out of its process
    "os.", "subprocess.", "socket.", "shutil.", "tempfile.", "ctypes.", "mmap.", "fcntl.", "pty.",
    "signal.", "urllib.", "http.", "ftplib.", "smtplib.", "sqlite3.", "webbrowser.", "winreg.",
    "_winapi.", "msvcrt.",
)  # fmt: skip
WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
MAX_WARNING_CHARS = 2000  # characters of xacro's own messages that are passed on


class NotFound(Exception):
    """No folder of a package's name is known."""


def main() -> None:
    """Answer one request, JSON from stdin to stdout: ``text``, or ``error`` and where it is.

    An error without words is a lack of memory.
    """
    request = json.load(sys.stdin)
    sys.path[:] = request["path"]
    warnings.simplefilter("ignore")  # of Python, on expressions
    captured = io.StringIO()
    _limit(request["memory"], request["seconds"])
    try:
        with redirect_stderr(captured):
            packages = Packages(*map(tuple, request["packages"]))
            answer = _expand(request["file"], packages, request["arguments"])
    except MemoryError:
        answer = {"error": None}
    answer["told"] = captured.getvalue()[:MAX_WARNING_CHARS]
    sys.stdout.write(json.dumps(answer))


def _limit(memory: int, seconds: int) -> None:
    """Bound this process's memory (bytes) and processor time (s), where the system can."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def _expand(file: str, packages: Packages, arguments: dict[str, str]) -> dict[str, Any]:
    import xacro
    from xacro import substitution_args

    late_imports = os.path.dirname(os.__file__)  # noqa: PTH120 - as Packages': texts
    roots = [*packages.roots, os.path.realpath(file), late_imports]

    def find(name: str) -> str:
        folders = packages.find(name)
        if not folders:
            raise NotFound(f'package "{name}" was not found; {DECLARE}')
        roots.append(folders[0])
        return folders[0]

    # xacro looks for packages in an installed ROS only.
    substitution_args._eval_find = find
    substitution_args._eval_dict["find"] = find
    sys.addaudithook(_confinement(roots))
    try:
        xacro.init_stacks(file)
        document = xacro.parse(None, file)
        xacro.process_doc(document, mappings=arguments)
        return {"text": document.toprettyxml(indent="  ")}
    except ExpatError as error:
        reason = str(error).partition(": line")[0]
        return {"error": f"not well-formed XML: {reason}", "line": error.lineno} | _place(xacro)
    except Exception as error:  # expressions fail in every way there is
        return {"error": _reason(error)} | _place(xacro)


def _reason(error: Exception) -> str:
    """Return why xacro gave up, each fact once.

    Raises:
        MemoryError: That is why.
    """
    cause: Any = error
    while getattr(cause, "exc", None) is not None:
        cause = cause.exc
    if isinstance(cause, MemoryError):
        raise cause
    if isinstance(cause, OSError):
        text = f"{cause.filename}: {cause.strerror}" if cause.filename else str(cause)
    else:
        text = str(cause if isinstance(cause, NotFound) else error) or type(error).__name__
    return " ".join(text.split())


def _confinement(roots: list[str]) -> Callable[[str, tuple[Any, ...]], None]:
    """Return an audit hook that refuses to leave the folders; ``roots`` may grow meanwhile."""

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        if event not in READ_EVENTS:
            if event.startswith(FORBIDDEN_EVENTS):
                raise PermissionError(f"refused: no .xacro needs {event}")
            return
        path = arguments[0]
        if isinstance(path, int):
            return
        flags = arguments[2] if event == "open" else 0
        if flags & WRITE_FLAGS or not inside(os.path.realpath(os.fsdecode(path)), tuple(roots)):
            reason = f"refused: it lies outside the folders that the file may use; {DECLARE}"
            raise PermissionError(errno.EACCES, reason, os.fsdecode(path))

    return audit


def _place(xacro: Any) -> dict[str, Any]:
    """Return the file and the macros where xacro is."""
    macros = [macro.body.getAttribute("name") for macro in xacro.macrostack or () if macro.body]
    files = [file for file in xacro.filestack or () if file]
    return {"file": files[-1] if files else None, "macros": macros}
