"""xacro: expanded by the xacro package, in a process of its own."""

from __future__ import annotations

import importlib.util
import json
import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpctl.description.packages import COMMENT, find_packages, forget
from rpctl.description.records import READ_DEFAULTS, ReadSettings
from rpctl.description.urdf.findings import excerpt
from rpctl.description.xacro.files import ENVIRONMENT, XacroFiles, check_answer
from rpctl.description.xacro.messages import (
    RUN_IT,
    XacroArgument,
    declared_arguments,
    findings_of,
    refusal,
    refuse_faults,
)
from rpctl.errors import MAX_SHOWN, DescriptionError, Finding
from rpctl.files.caps import cap, how_to_raise, read_source
from rpctl.files.confinement import open_ways
from rpctl.files.worker import Worker, WorkerError

INSTALL = "pip install xacro, or run `xacro FILE > robot.urdf` elsewhere and give that"
MAX_SAID = 4 * 2**20  # bytes of a message of the process: JSON may take 30 times as many to read
WORKER = "rpctl.description.xacro.worker"
XACRO = re.compile(  # an element of xacro, or a substitution; both mean nothing to a URDF's readers
    rb"<xacro:[A-Za-z_]|\$\((?:find|arg|env|optenv|eval|dirname)\s[^()]{0,200}\)"
)


@dataclass(frozen=True)
class Expansion:
    """What became of a file of xacro.

    Attributes:
        text: The URDF.
        findings: Warnings of xacro, and what was left out.
    """

    text: str
    findings: tuple[Finding, ...]


def is_xacro(path: Path, data: bytes) -> bool:
    """Whether a file is to be expanded, by its name or by what it holds.

    Args:
        data: Its bytes; a wide encoding holds no xacro.
    """
    if path.suffix.lower() == ".xacro":
        return True
    return (b"<xacro:" in data or b"$(" in data) and XACRO.search(
        COMMENT.sub(b"", data)
    ) is not None


def expand(path: Path, settings: ReadSettings = READ_DEFAULTS) -> Expansion:
    """Return what a file of xacro expands to.

    What it includes lies in the folders that it may use
    (:class:`rpctl.description.xacro.files.XacroFiles`) or in the packages that it finds. Such a
    file is code, and xacro does not keep its expressions from any Python. They are evaluated in a
    process that is bounded in time and memory and that Linux (seccomp, Landlock) keeps from
    opening files, starting processes and the network; what it may read is handed to it. Where the
    system lacks these measures, the "rpctl" logger says so before, and a warning among the
    findings. What the file makes of what it reads is the robot: its masses, meshes and names are
    its author's word.

    Args:
        settings: Where packages lie, and the values of the file's arguments.

    Raises:
        DescriptionError: There is no such file.
        ExpansionError: xacro is not installed, or refuses the file; packages that it includes are
            missing, or arguments; or it takes too long, or too much memory.
    """
    answer = _ask(path, settings)
    try:
        refuse_faults(path, answer, settings)
    finally:
        if answer["wants"]:
            forget()  # somebody may put the packages there before the next try
    return Expansion(answer["text"], findings_of(path, answer, settings))


def list_arguments(path: Path, settings: ReadSettings = READ_DEFAULTS) -> tuple[XacroArgument, ...]:
    """Return the arguments that a file and what it includes declare, in order.

    Args:
        path: The file; one that holds no xacro declares none.
        settings: Where packages lie, and values of arguments that choose includes.

    Raises:
        DescriptionError: There is no such file.
        ExpansionError: xacro is not installed, or takes too long.
    """
    if not is_xacro(path, read_source(path)):
        return ()
    return declared_arguments(_ask(path, settings))


def _ask(path: Path, settings: ReadSettings) -> dict[str, Any]:
    """Return the worker's answer.

    Raises:
        ExpansionError: There is none.
    """
    if importlib.util.find_spec("xacro") is None:
        raise refusal(path, f"this is xacro, and the xacro package is not installed; {INSTALL}")
    words = settings.xacro_args.items()
    request = {
        "file": str(path.absolute()),
        "arguments": {name: value for name, value in words if not name.startswith(ENVIRONMENT)},
        "environment": {
            name.removeprefix(ENVIRONMENT): value
            for name, value in words
            if name.startswith(ENVIRONMENT)
        },
        "lenient": settings.ignore_missing_packages,
    }
    packages = find_packages(path, settings.package_dirs)
    packages.index  # noqa: B018 - the search takes none of the process's time
    files = XacroFiles(path.absolute(), packages)
    seconds = cap("MAX_XACRO_SECONDS")
    try:
        with Worker(WORKER, cap("MAX_XACRO_MEMORY"), seconds) as worker:
            warning = _warn_of_what_is_open(path, worker.measures)
            worker.send(json.dumps(request).encode())
            answer = _converse(worker, files)
    except WorkerError as error:
        fault = f"its expansion stopped ({excerpt(str(error))}); {RUN_IT}"
        if error.late:
            fault = f"its expansion takes over {seconds} s; {how_to_raise('MAX_XACRO_SECONDS')}"
        raise refusal(path, fault) from None
    if answer is None:
        raise refusal(
            path,
            f"its expansion takes over {cap('MAX_XACRO_MEMORY')} bytes of memory; "
            f"{how_to_raise('MAX_XACRO_MEMORY')}",
        )
    return answer | {"open": warning}


def _converse(worker: Worker, files: XacroFiles) -> dict[str, Any] | None:
    """Give the process the files that it may have; return its answer, None: it lacks memory.

    Raises:
        WorkerError: It has ended, or speaks out of turn.
    """
    while True:
        message = worker.receive(MAX_SAID)
        try:
            verb, content = json.loads(message)
            if verb == "answer":
                answer = check_answer(content, files.known, files.missing)
                break
            reply = files.reply(verb, content)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise WorkerError("the expanding process returned invalid data") from None
        worker.send(reply)
    text = worker.receive(2 * cap("MAX_BYTES")).decode("utf-8", "replace")
    return answer | {"text": text} if text or "error" in answer else None


def _warn_of_what_is_open(path: Path, measures: Sequence[str]) -> str | None:
    """Say, before a file is expanded, what this system cannot keep from it; return that."""
    ways = open_ways(measures)
    if not ways:
        return None
    text = (
        f"this system cannot prevent the file's expressions from {' or '.join(ways)}; expand only "
        "files that you trust"
    )
    logging.getLogger("rpctl").warning("%s: warning: %s", path, text)
    return text


@contextmanager
def lines_explained(path: Path) -> Iterator[None]:
    """Say in errors of a file of xacro which text their lines are those of."""
    try:
        yield
    except DescriptionError as error:
        if not any(finding.line for finding in error.findings) or not _is_expanded(path):
            raise
        shown, rest = error.findings[: MAX_SHOWN - 1], error.findings[MAX_SHOWN - 1 :]
        raise DescriptionError(path, [*shown, explanation(path), *rest]) from None


def _is_expanded(path: Path) -> bool:
    try:
        return is_xacro(path, read_source(path))
    except DescriptionError:
        return False


def explanation(path: Path) -> Finding:
    """Return the remark on the lines of an expanded file's findings."""
    text = f"lines are those of the expanded text; `rpctl expand {path}` prints it"
    if path.suffix.lower() != ".xacro":
        text = (
            "it contains xacro, so rpctl expanded it although its name does not end in "
            f".xacro; {text}"
        )
    return Finding("info", None, text)
