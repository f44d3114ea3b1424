"""The process that expands one .xacro: hostile code may run in it, and finds nothing there.

A .xacro holds Python expressions. xacro keeps Python's builtins from them, but a function in an
expression, as ``(lambda: ...)()``, gets round that. So the process opens no file, starts nothing
and has no network: Linux holds it (:mod:`rpctl.files.confinement`). Files come over a pipe, by
leave of :mod:`rpctl.description.xacro.files`. The audit hook here says why something is refused,
and stops accidents on other systems; hostile code can switch it off.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import sys
import unicodedata  # noqa: F401 - here and below: nothing can be imported later
import warnings
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr
from typing import Any
from xml.dom import expatbuilder  # noqa: F401
from xml.parsers.expat import ExpatError

import xacro
import yaml  # noqa: F401
from xacro import substitution_args

from rpctl.description.xacro.hooks import (
    Arguments,
    Environment,
    FileScan,
    Hooks,
    NotFoundError,
    NotGivenError,
    Outside,
    constant_defaults,
    scan_all,
)
from rpctl.files.worker import Channel

FORBIDDEN_EVENTS = (  # beginnings of the audit events by which code reaches out of its process
    "open", "os.", "subprocess.", "socket.", "shutil.", "tempfile.", "glob.", "ctypes.", "mmap.",
    "fcntl.", "pty.", "signal.", "urllib.", "http.", "ftplib.", "smtplib.", "sqlite3.",
    "webbrowser.", "winreg.", "_winapi.", "msvcrt.",
)  # fmt: skip
REFUSED = "refused: no .xacro needs "
MAX_REQUEST = 2**20  # bytes
MAX_WARNING_CHARS = 2000  # characters of xacro's own messages that are passed on
FILE, PACKAGE = "file://", "package://"


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

    The request has its path, values of its arguments and of its environment, and whether the text
    is wanted although packages are missing.
    """
    file, given, lenient = request["file"], request["arguments"], request["lenient"]

    def scans() -> dict[str, FileScan]:
        return scan_all([file, *hooks.files], hooks.find_all, outside.bytes_of)

    environment = Environment(request["environment"])
    hooks = Hooks(xacro, substitution_args, outside, environment)
    hooks.install()
    arguments = Arguments(given, lambda: constant_defaults(scans()))
    answer: dict[str, Any] = {"dropped": []}
    left: set[str] = set()  # elements of what it expands to
    try:
        xacro.init_stacks(file)
        document = xacro.parse(None, file)
        xacro.process_doc(document, mappings=arguments)
        name_packages(document, hooks.found)
        if lenient and (hooks.left_out or hooks.lacks_includes):
            answer["dropped"] = drop_dangling(document)
        left = {each.tagName for each in document.getElementsByTagName("*")}
        answer["text"] = document.toprettyxml(indent="  ")
    except ExpatError as error:
        reason = str(error).partition(": line")[0]
        answer |= {"error": f"not well-formed XML: {reason}", "line": error.lineno} | _place(xacro)
    except Exception as error:  # expressions fail in every way there is
        answer |= _reason(error, hooks) | _place(xacro)
    if hooks.lacks_includes and not lenient:
        hooks.want_meshes()
    return (
        answer
        | _told(hooks, said := scans(), left)
        | {
            "early": sorted(arguments.early),
            "unused": [name for name in given if name not in arguments.used],
            "asked": sorted(environment.asked),
            "defined": [(n, *how) for n, how in said[os.path.normpath(file)].macros.items()],
        }
    )


def _told(hooks: Hooks, said: dict[str, FileScan], left: set[str]) -> dict[str, Any]:
    """Return what the files say, and what became of their includes and macros."""
    known = {
        name for scan in said.values() for name, default, _ in scan.arguments if default is not None
    }
    asked = dict.fromkeys(name for scan in said.values() for name in scan.asked)
    macros = left & {"insert_block"}.union(*(scan.macros for scan in said.values()))
    return {
        "plain": [(f, n, k) for f, s in said.items() for n, k in s.plain.items() if n in macros],
        "open_arguments": [name for name in asked if name not in known],
        "wants": hooks.wants,
        "left_out": hooks.left_out,
        "moved": hooks.moved,
        "undeclared": hooks.undeclared,
        "arguments": [(n, d, f, line) for f, s in said.items() for n, d, line in s.arguments],
        "old": [(f, *scan.old_element) for f, scan in said.items() if scan.old_element],
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
    text = str(error) or type(error).__name__
    if isinstance(cause, OSError):
        text = f"{cause.filename}: {cause.strerror}" if cause.filename else str(cause)
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


def name_packages(document: Any, folders: Mapping[str, str]) -> None:
    """Write meshes by their package, ``package://``, instead of the folder that it lies in.

    So the text does not depend on where a workspace lies.

    Args:
        document: The document, changed in place.
        folders: Folders of packages by name.
    """
    longest = sorted(folders.items(), key=lambda each: -len(each[1]))
    for mesh in document.getElementsByTagName("mesh"):
        plain = mesh.getAttribute("filename").removeprefix(FILE)
        if plain.startswith(PACKAGE):  # $(find) of a package that is not there
            mesh.setAttribute("filename", plain)
        within = [each for each in longest if plain.startswith(f"{each[1]}/")]
        for name, folder in within[:1]:
            mesh.setAttribute("filename", f"{PACKAGE}{name}{plain.removeprefix(folder)}")


def drop_dangling(document: Any) -> list[str]:
    """Remove joints to links that are not there, and what hangs on links that are not there.

    Args:
        document: The document, changed in place.

    Returns:
        What was removed, in phrases.
    """
    robot, said = document.documentElement, []
    while (found := next(_dangling(robot), None)) is not None:
        joint, child, missing = found
        _remove(joint)
        if child == missing:
            said.append(f'joint "{joint.getAttribute("name")}", whose link "{missing}" is missing')
            continue
        links = _drop_below(robot, child)
        said.append(f'{", ".join(links)}, which hang on the missing link "{missing}"')
    joints = {joint.getAttribute("name") for joint in _children(robot, "joint")}
    for transmission in _children(robot, "transmission"):
        driven = [each.getAttribute("name") for each in _children(transmission, "joint")]
        if driven and not joints.intersection(driven):
            _remove(transmission)
            said.append(f'transmission "{transmission.getAttribute("name")}"')
    return said


def _dangling(robot: Any) -> Iterator[tuple[Any, str, str]]:
    """Yield the joints to or from a link that is not there: joint, its child, the link."""
    links = {link.getAttribute("name") for link in _children(robot, "link")}
    for joint in _children(robot, "joint"):
        parent, child = _end(joint, "parent"), _end(joint, "child")
        for link in (child, parent):
            if link and link not in links:
                yield joint, child, link
                break


def _drop_below(robot: Any, link: str) -> list[str]:
    """Remove a link and all that it carries; return the links' names."""
    names, queue = [], [link]
    while queue:
        names.append(queue.pop())
        for element in _children(robot, "link"):
            if element.getAttribute("name") == names[-1]:
                _remove(element)
        for joint in _children(robot, "joint"):
            if _end(joint, "parent") == names[-1]:
                queue.append(_end(joint, "child"))
                _remove(joint)
    return names


def _end(joint: Any, tag: str) -> str:
    return next((end.getAttribute("link") for end in _children(joint, tag)), "")


def _children(element: Any, tag: str) -> list[Any]:
    return [child for child in element.childNodes if child.nodeName == tag]


def _remove(element: Any) -> None:
    element.parentNode.removeChild(element)
