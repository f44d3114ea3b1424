"""What a library in C prints, kept off the terminal, and at hand if it fails."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

OUT, ERR = 1, 2  # descriptors


@contextmanager
def captured() -> Iterator[list[str]]:
    """Let nothing reach the descriptors of stdout and stderr; the lines are in the list at the end.

    Python's own writing is flushed before and after, so that it is neither lost nor moved.
    """
    lines: list[str] = []
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    kept = {number: os.dup(number) for number in (OUT, ERR)}
    with tempfile.TemporaryFile() as file:
        try:
            for number in kept:
                os.dup2(file.fileno(), number)
            yield lines
        finally:
            for number, old in kept.items():
                os.dup2(old, number)
                os.close(old)
            file.seek(0)
            lines += file.read().decode(errors="replace").splitlines()
