"""Columns of a log that may be larger than memory: anonymous if small, else a file without a name.

The file is unlinked before it is used, so that nothing is left behind whatever ends the process.
Its pages are the operating system's to write out; :func:`release` takes those that are finished
from the process's memory, and reading them again brings them back.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError

IN_MEMORY_BYTES = 2**21  # of a column: a larger one is a file; a log has some thirty columns
BLOCK_BYTES = 2**23  # of a column, that are looked at together
DISK_FOLDER = Path("/var/tmp")  # for large files; /tmp often is memory itself


def scratch(shape: tuple[int, ...]) -> Array:
    """Return zeros to be filled, in memory if they are few, else in an unlinked temporary file.

    Raises:
        RpctlError: There is no room for the file; how to get along with less is said.
    """
    size = 8 * math.prod(shape)
    if size <= IN_MEMORY_BYTES:
        return np.zeros(shape)
    folder = _folder()
    try:
        with tempfile.TemporaryFile(dir=folder, prefix="rpctl-") as file:
            _reserve(file.fileno(), size)
            mapping = mmap.mmap(file.fileno(), size)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RpctlError(
            f"{folder}: no {size / 2**20:.0f} MB for a column of the log ({reason}); log fewer "
            "samples (log_every), simulate for less long, or set TMPDIR to a folder with room"
        ) from None
    return np.frombuffer(mapping, dtype=np.float64).reshape(shape)


def release(column: Array, first: int = 0, last: int | None = None) -> None:
    """Take rows of a column from the process's memory, if they are in a file; they keep.

    Args:
        column: From :func:`scratch`, or rows and columns of it from the first on.
        first: The first of the rows.
        last: The row behind the last of them; None: all that follow.
    """
    mapping = _mapping(column)
    if mapping is None or not hasattr(mapping, "madvise"):
        return
    row = column.strides[0]
    start = first * row // mmap.PAGESIZE * mmap.PAGESIZE
    end = min(len(column) if last is None else last, len(column)) * row
    if end > start:
        mapping.madvise(mmap.MADV_DONTNEED, start, end - start)


def blocks(*columns: Array) -> Iterator[tuple[Array, ...]]:
    """Yield blocks of rows of columns of one length, in order; what was looked at is released.

    Args:
        columns: They may be in memory or in files.
    """
    widest = max(abs(column.strides[0]) for column in columns)
    rows = max(1, BLOCK_BYTES // max(widest, 1))
    for first in range(0, len(columns[0]), rows):
        yield tuple(column[first : first + rows] for column in columns)
        for column in columns:
            release(column, first, first + rows)


def column_of(array: Array, k: int) -> Array:
    """Return a copy (K,) of a column of an array (K, n), however large that is."""
    column, first = np.empty(len(array)), 0
    for (block,) in blocks(array):
        column[first : first + len(block)] = block[:, k]
        first += len(block)
    return column


def split(array: Array) -> Iterator[Array]:
    """Yield copies (K,) of the columns of an array (K, n), one in memory at a time."""
    return (column_of(array, k) for k in range(array.shape[1]))


def _folder() -> str:
    """Return where large temporary files go: where the user says, else on a disk if there is."""
    said = any(os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP"))
    if not said and DISK_FOLDER.is_dir() and os.access(DISK_FOLDER, os.W_OK | os.X_OK):
        return str(DISK_FOLDER)
    return tempfile.gettempdir()


def _reserve(file: int, size: int) -> None:
    """Give an open file its size, and room on the disk: a full one would kill the process later."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.ftruncate(file, size)


def _mapping(column: Array) -> mmap.mmap | None:
    """Return the file that a column is in, or None."""
    base: object = column
    while isinstance(base, np.ndarray):
        base = base.base
    base = base.obj if isinstance(base, memoryview) else base
    return base if isinstance(base, mmap.mmap) else None
