"""Names as legends show them: without what they share."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from os.path import commonprefix
from pathlib import Path

from rpctl.errors import printable
from rpctl.files.caps import open_input

SEPARATORS = "_/.: -"
SUFFIX = "_joint"
FITTING_LENGTH = 14  # characters of a name that fits into every legend; such names stay whole
ELLIPSIS = "…"


@dataclass(frozen=True)
class ShortNames:
    """Names without what they share.

    Attributes:
        names: The short names, in the order of the names, and as distinct as they are.
        shared: What was left out around each, such as ``"arm_…_joint"``, for a legend to say once;
            empty where all names begin as they did.
    """

    names: tuple[str, ...]
    shared: str = ""


def shorten(names: Sequence[str]) -> ShortNames:
    """Return names without their suffix ``_joint`` and without the words that all begin with.

    The suffix is dropped where the names stay distinct without it. The prefix is dropped where
    there are two names or more, one of which is too long for a legend; it ends at a separator. A
    name keeps a letter, as a bare number names nothing.

    Args:
        names: Of one legend.
    """
    cut = [name.removesuffix(SUFFIX) for name in names]
    stems = [stem if _says_something(stem) else name for stem, name in zip(cut, names, strict=True)]
    if len(set(stems)) < len(set(names)):
        stems = list(names)
    prefix = _common_words(stems)
    if not prefix or max(map(len, stems)) <= FITTING_LENGTH:
        return ShortNames(tuple(stems))
    suffixed = all(stem != name for stem, name in zip(stems, names, strict=True))
    return ShortNames(
        tuple(stem.removeprefix(prefix) for stem in stems),
        f"{prefix}{ELLIPSIS}{SUFFIX if suffixed else ''}",
    )


def fold(name: str, length: int) -> str:
    """Return a name in lines of at most ``length`` characters, broken at separators if it can."""
    lines = [""]
    for word in re.findall(f"[^{SEPARATORS}]*[{SEPARATORS}]?", name):
        if lines[-1] and len(lines[-1]) + len(word) > length:
            lines.append("")
        lines[-1] += word
        while len(lines[-1]) > length:
            lines[-1:] = [lines[-1][:length], lines[-1][length:]]
    return "\n".join(line.strip() for line in lines)


def capital(text: str) -> str:
    """Return a text that begins with a capital; what follows stays."""
    return text[:1].upper() + text[1:]


def literal(text: str) -> str:
    """Return a text of others that Matplotlib draws as it is: no formula, and never left out.

    It leaves labels that begin with a low line out of a legend.
    """
    text = printable(text, keep="\n").replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def _common_words(names: Sequence[str]) -> str:
    """Return the longest prefix of all names that may go; empty where there is none."""
    if len(set(names)) < 2:
        return ""
    shared = commonprefix(names)  # noqa: RUF071 - no paths: letter by letter is meant
    ends = [k + 1 for k, sign in enumerate(shared) if sign in SEPARATORS]
    fitting = (end for end in ends if all(_says_something(name[end:]) for name in names))
    return shared[: max(fitting, default=0)]


def _says_something(name: str) -> bool:
    """Return whether a name has a letter: a bare number names nothing."""
    return any(map(str.isalpha, name))


MARK = "rpctl-run"  # key of the digest, or what stands before it and a colon
JSON_KEY = "run_sha256"
FORMS = re.compile(rb'(?:rpctl-run[\0:]|rpctl-run" content="|"run_sha256": ")([0-9a-f]{64})')
ENDS = 2**20  # bytes at either end of a file that are searched for its mark
CHUNK = 2**20  # bytes that are digested at once


def digest(path: Path) -> str:
    """Return the SHA-256 digest of a file, in hexadecimal digits.

    Raises:
        RpctlError: It cannot be read.
    """
    found = hashlib.sha256()
    with open_input(path, "MAX_SHOWN_BYTES", "a run.npz") as file:
        while piece := file.read(CHUNK):
            found.update(piece)
    return found.hexdigest()


def mark_of(path: Path) -> str | None:
    """Return the digest of the run that a file is made from; None where it does not say.

    Raises:
        RpctlError: It cannot be read.
    """
    with open_input(path, "MAX_SHOWN_BYTES", "a file of a run's folder") as file:
        head = file.read(ENDS)
        file.seek(max(file.seek(0, 2) - ENDS, 0))
        found = FORMS.search(head) or FORMS.search(file.read(ENDS))
    return found[1].decode() if found else None


def comment(run: str | None) -> str:
    """Return the mark as the comment of a film or figure; nothing where the run is not known."""
    return f"{MARK}:{run}" if run else ""
