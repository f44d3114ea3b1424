"""The process that expands one .xacro: hostile code may run in it, and finds nothing there.

A .xacro holds Python expressions. xacro keeps Python's builtins from them, but a function in an
expression, as ``(lambda: ...)()``, gets round that. So the process opens no file, starts nothing
and has no network: Linux holds it (:mod:`rpctl.files.confinement`). Files come over a pipe, by
leave of :mod:`rpctl.description.xacro_files`. The audit hook here says why something is refused,
and stops accidents on other systems; hostile code can switch it off.
"""

from __future__ import annotations

import errno
import io
import json
import re
import sys
import unicodedata  # noqa: F401 - here and below: nothing can be imported later
import warnings
from contextlib import redirect_stderr
from typing import Any
from xml.dom import expatbuilder  # noqa: F401
from xml.parsers.expat import ExpatError

import xacro
import yaml  # noqa: F401
from xacro import substitution_args

from rpctl.description.xacro_cleaning import drop_dangling, name_packages
from rpctl.description.xacro_hooks import Hooks, NotFoundError
from rpctl.description.xacro_inputs import Arguments, Environment, NotGivenError, Outside
from rpctl.description.xacro_scan import FileScan, constant_defaults, scan_all
from rpctl.files.worker import Channel

FORBIDDEN_EVENTS = (  # beginnings of the audit events by which code reaches out of its process
    "open", "os.", "subprocess.", "socket.", "shutil.", "tempfile.", "glob.", "ctypes.", "mmap.",
    "fcntl.", "pty.", "signal.", "urllib.", "http.", "ftplib.", "smtplib.", "sqlite3.",
    "webbrowser.", "winreg.", "_winapi.", "msvcrt.",
)  # fmt: skip
REFUSED = "refused: no .xacro needs "
MAX_REQUEST = 2**20  # bytes
MAX_WARNING_CHARS = 2000  # characters of xacro's own messages that are passed on


def main(channel: Channel) -> None:
    """Answer one request with the text, or ``error`` and where it is.

    An empty text without an error is a lack of memory. What else there is to say of the file comes
    along: packages that it wants and that are not found, arguments that it declares.
    """
    request = json.loads(channel.receive(MAX_REQUEST))
    warnings.simplefilter("ignore")  # of Python, on expressions
    captured = io.StringIO()
    sys.addaudithook(_refuse)
    try:
        with redirect_stderr(captured):
            answer = _expand(request, Outside(channel))
    except MemoryError:
        answer = {}
    answer["told"] = captured.getvalue()[:MAX_WARNING_CHARS]
    text = answer.pop("text", "")
    channel.send(json.dumps(("answer", answer)).encode())
    channel.send(text.encode("utf-8", "backslashreplace"))


def _expand(request: dict[str, Any], outside: Outside) -> dict[str, Any]:
    """Return what became of a file.

    Args:
        request: The file's path, values of its arguments and of its environment, and whether the
            text is wanted although packages are missing.
        outside: Reads files and finds packages.
    """
    file, given, lenient = request["file"], request["arguments"], request["lenient"]

    def scans() -> dict[str, FileScan]:
        return scan_all([file, *hooks.files], hooks.find_all, outside.bytes_of)

    environment = Environment(request["environment"])
    hooks = Hooks(xacro, substitution_args, outside, environment)
    hooks.install()
    arguments = Arguments(given, lambda: constant_defaults(scans()))
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
        "asked": sorted(environment.asked),
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
    if isinstance(cause, NotGivenError):
        said["variable"] = str(cause)
        said["line"] = hooks.lines(rf"env\b[\s('\"]*{re.escape(str(cause))}\b")[0]
    if type(cause).__name__ == "ArgException":  # of $(arg NAME)
        name = said["argument"] = str(cause)
        said["line"] = hooks.lines(rf"\barg\s+{re.escape(name)}\s*\)")[0]
    return said


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse, as an audit hook, what leads out of the process."""
    if event.startswith(FORBIDDEN_EVENTS):
        path = arguments[0] if event == "open" and isinstance(arguments[0], str) else None
        raise PermissionError(errno.EACCES, REFUSED + event, path)


def _place(xacro: Any) -> dict[str, Any]:
    """Return the file and the macros where xacro is."""
    macros = [macro.body.getAttribute("name") for macro in xacro.macrostack or () if macro.body]
    files = [file for file in xacro.filestack or () if file]
    return {"file": files[-1] if files else None, "macros": macros}
