"""``.xacro`` files: expanded by the xacro package, in a process of their own."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import Any

from rpctl.description.findings import excerpt
from rpctl.description.packages import find_packages
from rpctl.description.read_settings import READ_DEFAULTS, ReadSettings
from rpctl.errors import MAX_SHOWN, DescriptionError, Finding, RpctlError, format_finding
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.opening import read_source

INSTALL = "pip install 'rpctl[xacro]', or run `xacro FILE > robot.urdf` elsewhere and give that"
WARNING_PREFIX = "warning: "  # how xacro begins one; the lines after it tell the place
WORKER_GRACE_S = 5  # s that the worker outlives its time, should nobody be left to end it
# rpctl itself would load Pinocchio; the worker needs but three files of its.
BOOT = """import sys, types
rpctl = sys.modules["rpctl"] = types.ModuleType("rpctl")
rpctl.__path__ = [sys.argv[1]]
from rpctl.description.expansion_worker import main
main()"""


class ExpansionError(RpctlError):
    """A .xacro that cannot be expanded."""


def is_xacro(path: Path) -> bool:
    """Whether a file is to be expanded, by its name."""
    return path.suffix.lower() == ".xacro"


def expand(path: Path, settings: ReadSettings = READ_DEFAULTS) -> tuple[str, tuple[Finding, ...]]:
    """Return the text that a .xacro expands to, and the warnings of xacro.

    What it includes lies in the folders that it may use
    (:class:`rpctl.description.packages.Packages`) or in the packages that it finds. A .xacro is
    code: its expressions are evaluated by Python, so it has to be trusted.

    Args:
        path: The file.
        settings: Where packages lie, and the values of the file's arguments.

    Raises:
        DescriptionError: There is no such file.
        ExpansionError: xacro is not installed, or refuses the file; or it takes too long, or too
            much memory.
    """
    read_source(path)
    if importlib.util.find_spec("xacro") is None:
        raise _refusal(path, f"this is xacro, and the xacro package is not installed; {INSTALL}")
    answer = _ask(path, settings)
    if "error" in answer:
        if answer["error"] is None:
            most = cap("MAX_XACRO_MEMORY")
            fault = f"its expansion takes over {most} bytes of memory"
            raise _refusal(path, f"{fault}; {how_to_raise('MAX_XACRO_MEMORY')}")
        place = Path(answer.get("file") or path)
        macros = answer.get("macros")
        within = f' (in macro "{excerpt(macros[-1])}")' if macros else ""
        fault = f"xacro: {answer['error']}{within}; correct it, or run `xacro` on the file yourself"
        raise _refusal(place, fault, answer.get("line"))
    lines = answer["told"].splitlines()
    warnings = [
        line.removeprefix(WARNING_PREFIX) for line in lines if line.startswith(WARNING_PREFIX)
    ]
    return answer["text"], tuple(Finding("warning", None, f"xacro: {line}") for line in warnings)


def _ask(path: Path, settings: ReadSettings) -> dict[str, Any]:
    """Return the worker's answer."""
    seconds = cap("MAX_XACRO_SECONDS")
    request = {
        "file": str(path.absolute()),
        "packages": astuple(find_packages(path, settings.package_dirs)),
        "arguments": dict(settings.xacro_args),
        "path": [entry for entry in sys.path if entry],
        "memory": cap("MAX_XACRO_MEMORY"),
        "seconds": seconds + WORKER_GRACE_S,
    }
    command = [sys.executable, "-I", "-X", "utf8", "-c", BOOT, str(Path(__file__).parents[1])]
    try:
        done = subprocess.run(
            command, input=json.dumps(request), capture_output=True, encoding="utf-8",
            errors="replace", timeout=seconds, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        fault = f"its expansion takes over {seconds} s; {how_to_raise('MAX_XACRO_SECONDS')}"
        raise _refusal(path, fault) from None
    except OSError as error:
        fault = f"no process to expand it in could be started ({error.strerror}); {INSTALL}"
        raise _refusal(path, fault) from None
    try:
        answer: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        last = done.stderr.strip().rpartition("\n")[2] or f"exit code {done.returncode}"
        raise _refusal(
            path, f"its expansion broke off ({last}); run `xacro` on the file yourself"
        ) from None
    return answer


def _refusal(path: Path, fault: str, line: int | None = None) -> ExpansionError:
    return ExpansionError(format_finding(str(path), Finding("error", line, fault)))


@contextmanager
def lines_explained(path: Path) -> Iterator[None]:
    """Say in errors of a .xacro which text their lines are those of."""
    try:
        yield
    except DescriptionError as error:
        if not is_xacro(path) or not any(finding.line for finding in error.findings):
            raise
        shown, rest = error.findings[: MAX_SHOWN - 1], error.findings[MAX_SHOWN - 1 :]
        raise DescriptionError(path, [*shown, explanation(path), *rest]) from None


def explanation(path: Path) -> Finding:
    """Return the remark on the lines of a .xacro's findings."""
    text = f"lines are those of the expanded text; `rpctl expand {path}` prints it"
    return Finding("info", None, text)
