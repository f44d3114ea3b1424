"""Exceptions: one base class, and few subclasses that carry their evidence."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, TypeGuard

MAX_SHOWN = 50  # findings that one message lists
MAX_CHOICES = 16  # names that one message lists
MAX_MESSAGE = 600  # characters of one finding; names in a file may be of any length
# Of a setting in SI units: beyond, squares and quotients of settings leave the numbers.
SMALLEST, LARGEST = 1e-12, 1e12
UNSEEN = re.compile(
    r"[\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0\ufe00-\ufe0f\U000e0100-\U000e01ef]"
)  # what Unicode calls printable, but has no ink: fillers, and selectors of variants

SEVERITIES = ("error", "warning", "info")  # of findings, the gravest first


class RpctlError(Exception):
    """Base class of all errors that rpctl raises on purpose.

    Its message names the fault, its place and a remedy. It can be pickled, with its attributes.

    Attributes:
        exit_code: Exit code of the command line for this error.
    """

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        return _blank, (type(self), self.args), vars(self)


def _blank(kind: type[RpctlError], arguments: tuple[object, ...]) -> RpctlError:
    """Return an error that has its message, and not yet its evidence.

    Subclasses are not made from their message: their constructors write it.
    """
    return kind.__new__(kind, *arguments)


@dataclass(frozen=True)
class Finding:
    """One thing noticed in a robot description.

    Attributes:
        severity: ``"error"``, ``"warning"`` or ``"info"``.
        line: Line of the file, or None where no single line is to blame.
        message: What was found, and how to mend it.
    """

    severity: str
    line: int | None
    message: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", one_line(self.message))


class DescriptionError(RpctlError):
    """A robot description, or another file that a user gives, that cannot be used.

    Attributes:
        path: The file.
        findings: All that is wrong with it, several at once.
    """

    def __init__(self, path: object, findings: Iterable[Finding]) -> None:
        self.path = str(path)
        self.findings = tuple(findings)
        lines = [format_finding(self.path, finding) for finding in self.findings[:MAX_SHOWN]]
        if len(self.findings) > MAX_SHOWN:
            lines.append(f"{self.path}: and {len(self.findings) - MAX_SHOWN} more")
        super().__init__("\n".join(lines))


def fault_at(path: object, line: int | None, fault: str) -> DescriptionError:
    """Return the error that says one fault of a file."""
    return DescriptionError(path, [Finding("error", line, fault)])


class UnknownNameError(RpctlError):
    """A name that is not among the valid choices; the nearest are suggested."""

    def __init__(self, kind: str, name: str, choices: Iterable[str]) -> None:
        self.name = name
        self.choices = tuple(choices)
        near = get_close_matches(name, self.choices, n=3, cutoff=0.5)
        hidden = len(self.choices) - MAX_CHOICES
        listed = [*self.choices[:MAX_CHOICES], *([f"{hidden} more"] if hidden > 0 else ())]
        hint = f"did you mean {' or '.join(near)}?" if near else f"one of: {', '.join(listed)}"
        super().__init__(f"{kind} {name!r} is not known; {hint}")


def require_known(kind: str, names: Iterable[str], choices: Collection[str]) -> None:
    """Refuse the first of some names that is not among the valid choices.

    Raises:
        UnknownNameError: There is one.
    """
    for name in names:
        if name not in choices:
            raise UnknownNameError(kind, name, choices)


class InputError(DescriptionError):
    """A file that cannot be opened as an input: missing, special, too long, or not readable.

    Attributes:
        fault: What is wrong, and how to mend it; without the path.
    """

    def __init__(self, path: object, fault: str) -> None:
        super().__init__(path, [Finding("error", None, fault)])
        self.fault = self.findings[0].message


class DriveError(RpctlError):
    """No drive, or more than one, was found in a description."""


class SingularBasisError(RpctlError):
    """The rolling constraints and the chosen quasi-velocities do not fix the motion here."""


class ActuationError(RpctlError):
    """Some quasi-velocity is driven by no actuator."""


class UnfitLawError(RpctlError):
    """A law cannot follow such a reference at all."""


class RunFileError(RpctlError):
    """A result file that is damaged, foreign, or of another schema."""


class EngineMissing(RpctlError):
    """A physics engine is not installed; the message has the command that installs it."""


class DivergedError(RpctlError):
    """A simulation left the finite numbers."""

    exit_code = 3


class SolverError(RpctlError):
    """A solver gave up on a problem."""

    exit_code = 3


def format_finding(path: str, finding: Finding) -> str:
    """Return ``file:line: severity: message``."""
    path = printable(path)
    place = path if finding.line is None else f"{path}:{finding.line}"
    return f"{place}: {finding.severity}: {finding.message}"


def one_line(text: str) -> str:
    """Return a text on one line of bounded length; what does not print is escaped."""
    if len(text) > MAX_MESSAGE:
        half = MAX_MESSAGE // 2
        text = f"{text[:half]} ... {text[-half:]}"
    return printable(text)


def listed(names: Collection[str], most: int) -> str:
    """Return names in words: the first ``most`` of them, the others counted."""
    more = len(names) - most
    return ", ".join([*names][:most]) + (f" and {more} more" if more > 0 else "")


def printable(text: str, keep: str = "", escape: Callable[[str], str] | None = None) -> str:
    """Return a text of others as it can be shown: what a reader would not see is escaped.

    These are signs that steer a terminal, turn the direction of writing, or take no room.

    Args:
        text: The text.
        keep: Signs that are left as they are, as line breaks between the lines of a message.
        escape: What returns the text for such a sign; by default as Python writes it, ``\\x1b``.
    """
    if text.isprintable() and not UNSEEN.search(text):
        return text
    escape = escape or (lambda sign: ascii(sign)[1:-1])
    return "".join(
        c if c in keep or (c.isprintable() and not UNSEEN.match(c)) else escape(c) for c in text
    )


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value of a file is a finite number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def require_positive(name: str, value: float) -> None:
    """Refuse a setting that is not a positive number in ``SMALLEST`` to ``LARGEST``.

    Raises:
        RpctlError: Naming the setting.
    """
    if not value > 0.0 or not math.isfinite(value):
        raise RpctlError(f"{name} is {value:g}; give a positive number")
    if not SMALLEST <= value <= LARGEST:
        raise RpctlError(f"{name} is {value:g}; give a number from {SMALLEST:g} to {LARGEST:g}")


def require_within(name: str, values: Iterable[float], largest: float = LARGEST) -> None:
    """Refuse numbers that are not finite or of a larger magnitude.

    Args:
        name: What they are, in the words of the user.
        values: The numbers.
        largest: The largest magnitude that is accepted.

    Raises:
        RpctlError: Naming them.
    """
    for value in values:
        if not abs(value) <= largest:
            raise RpctlError(f"{name} is {value:g}; give numbers from {-largest:g} to {largest:g}")


class DiffersError(RpctlError):
    """Machine code does not compute what Pinocchio does."""
