"""Marks: the digest of a run in each file that is made from it, wherever its format has room."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from rpctl.files.opening import open_input

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
