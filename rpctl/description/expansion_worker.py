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
import re
import sys
import warnings
from collections.abc import Callable
from contextlib import redirect_stderr, suppress
from typing import Any
from xml.dom import expatbuilder  # noqa: F401 - before the confinement: minidom imports it late
from xml.parsers.expat import ExpatError

from rpctl.description.packages import DECLARE, Packages, inside
from rpctl.description.xacro_cleaning import drop_dangling, name_packages
from rpctl.description.xacro_hooks import Arguments, Hooks, NotFoundError, read_bytes
from rpctl.description.xacro_scan import FileScan, constant_defaults, scan_all

READ_EVENTS = ("open", "os.listdir", "os.scandir")  # audit events whose first argument is a path
FORBIDDEN_EVENTS = (  # beginnings of the events by which code reaches out of its process
    "os.", "subprocess.", "socket.", "shutil.", "tempfile.", "ctypes.", "mmap.", "fcntl.", "pty.",
    "signal.", "urllib.", "http.", "ftplib.", "smtplib.", "sqlite3.", "webbrowser.", "winreg.",
    "_winapi.", "msvcrt.",
)  # fmt: skip
WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
MAX_WARNING_CHARS = 2000  # characters of xacro's own messages that are passed on


def main() -> None:
    """Answer one request, JSON from stdin to stdout: ``text``, or ``error`` and where it is.

    An error without words is a lack of memory. What else there is to say of the file comes along:
    packages that it wants and that are not found, arguments that it declares.
    """
    request = json.load(sys.stdin)
    sys.path[:] = request["path"]
    warnings.simplefilter("ignore")  # of Python, on expressions
    captured = io.StringIO()
    _limit(request["memory"], request["seconds"])
    try:
        with redirect_stderr(captured):
            packages = Packages.from_dict(request["packages"])
            answer = _expand(request["file"], packages, request["arguments"], request["lenient"])
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


def _expand(file: str, packages: Packages, given: dict[str, str], lenient: bool) -> dict[str, Any]:
    """Return what became of a file.

    Args:
        file: Its path.
        packages: Where packages lie.
        given: Values of its arguments.
        lenient: Whether the text is wanted although packages are missing.
    """
    import xacro

    late_imports = os.path.dirname(os.__file__)  # noqa: PTH120 - as Packages': texts
    roots = [*packages.roots, os.path.realpath(file), late_imports]

    def find(name: str) -> tuple[str, ...]:
        folders = packages.find(name)
        roots.extend(folders[:1])
        return folders

    def scans() -> dict[str, FileScan]:
        return scan_all([file, *hooks.files], hooks.find_all, read_bytes)

    hooks = Hooks(xacro, find)
    hooks.install()
    arguments = Arguments(given, lambda: constant_defaults(scans()))
    sys.addaudithook(_confinement(roots))
    answer: dict[str, Any] = {"dropped": []}
    try:
        xacro.init_stacks(file)
        document = xacro.parse(None, file)
        xacro.process_doc(document, mappings=arguments)
        name_packages(document, hooks.found)
        if lenient and (hooks.left_out or hooks.lacks_includes):
            answer["dropped"] = drop_dangling(document)
        answer["text"] = document.toprettyxml(indent="  ")
    except ExpatError as error:
        reason = str(error).partition(": line")[0]
        answer |= {"error": f"not well-formed XML: {reason}", "line": error.lineno} | _place(xacro)
    except Exception as error:  # expressions fail in every way there is
        answer |= _reason(error, hooks) | _place(xacro)
    if hooks.lacks_includes and not lenient:
        hooks.want_meshes()
    said = scans()
    return answer | {
        "wants": hooks.wants,
        "left_out": hooks.left_out,
        "moved": hooks.moved,
        "undeclared": hooks.undeclared,
        "arguments": [(n, d, f, line) for f, s in said.items() for n, d, line in s.arguments],
        "old": [(f, *scan.old_element) for f, scan in said.items() if scan.old_element],
        "early": sorted(arguments.early),
        "unused": [name for name in given if name not in arguments.used],
    }


def _reason(error: Exception, hooks: Hooks) -> dict[str, Any]:
    """Return why xacro gave up, each fact once: ``error``, and ``argument`` where one is missing.

    Raises:
        MemoryError: That is why.
    """
    cause: Any = error
    while getattr(cause, "exc", None) is not None:
        cause = cause.exc
    if isinstance(cause, MemoryError):
        raise cause
    if isinstance(cause, NotFoundError):
        hooks.wants.append((str(cause), hooks.file, None, "file"))
    if isinstance(cause, OSError):
        text = f"{cause.filename}: {cause.strerror}" if cause.filename else str(cause)
    else:
        text = str(error) or type(error).__name__
    said: dict[str, Any] = {"error": " ".join(text.split())}
    if isinstance(cause, FileNotFoundError):
        said["no_file"] = str(cause.filename)
    if type(cause).__name__ == "ArgException":  # of $(arg NAME)
        name = said["argument"] = str(cause)
        said["line"] = hooks.lines(rf"\barg\s+{re.escape(name)}\s*\)")[0]
    return said


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
