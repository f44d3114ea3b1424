"""A run on disk while it is simulated: what a kill or a loss of power leaves is a valid run.

A part is a folder. ``header.json`` says what a run is besides its samples, as the entry ``header``
of a run's file does; it is written anew before each of the files with samples: ``000000.npz``,
``000001.npz`` and so on, plain NumPy files of the arrays of the log by name. Each file appears
whole or not at all.

A process that writes a part holds a lock on it, which ends with the process however it ends.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, RunFileError
from rpctl.files.caps import is_file, read_input
from rpctl.files.writing import make_folder, write_atomically
from rpctl.simulation.merits.collision_facts import NOT_LOOKED_FOR
from rpctl.simulation.run.file import (
    EntryError,
    blamed,
    check_numbers,
    header_as_plain,
    read_chunk,
    read_header,
)
from rpctl.simulation.run.header import Header
from rpctl.simulation.run.log import MIN_SAMPLES

PART_FOLDER = "run.part"  # beside the files of the finished run
HEADER_FILE, LOCK_FILE = "header.json", "lock"
Content = Callable[[slice], tuple[Mapping[str, Array], Mapping[str, Any]]]
CHUNK_PATTERN = "[0-9]" * 6 + "*.npz"
CHUNK_ROWS = 2048  # of a chunk; TIAGo takes a second for them
CHUNK_SECONDS = 5.0  # s: a slow law is written as often as this
KIND = "the folder of a run that was stopped"
ENDED = 1e-6  # of a duration: a run that lacks less has ended


class PartWriter:
    """Writes the samples of one run to a folder while they are simulated.

    Use it as a context: it holds the folder's lock. If writing fails, the simulation goes on, and
    a note tells it.

    Args:
        folder: The part; made. One that an ended process left with samples is kept beside it.

    Raises:
        RpctlError: Another process is writing there, or the folder cannot be made.

    Attributes:
        folder: The part.
        notes: What became of an older part, and why writing failed, in sentences.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder, self.notes = Path(folder), tuple[str, ...]()
        self._header: dict[str, Any] = {}
        self._rows, self._chunks = 0, 0
        self._written_at, self._failed = time.perf_counter(), False
        self._made = not self.folder.parent.exists()
        make_folder(self.folder.parent)
        try:
            self._lock = self._take()
        except OSError as error:
            reason = error.strerror or str(error)
            raise RpctlError(f"{self.folder}: cannot be made: {reason}") from None

    def __enter__(self) -> PartWriter:
        """Return it."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let go of the lock; the folder stays if there are samples in it."""
        if not self._chunks:
            self.remove()
            if self._made:
                with suppress(OSError):
                    self.folder.parent.rmdir()
        os.close(self._lock)

    def _take(self) -> int:
        """Return the lock of the folder, which is empty then."""
        with suppress(FileExistsError):
            self.folder.mkdir()
        lock = _locked(self.folder)
        if chunk_files(self.folder) or not _is_ours(self.folder):
            aside = _free_name(self.folder)
            self.folder.rename(aside)  # the old lock goes along
            os.close(lock)
            self.notes = (f"{aside} holds the samples of an earlier simulation that was stopped: "
                          "view it, then remove it",)  # fmt: skip
            self.folder.mkdir()
            lock = _locked(self.folder)
        (self.folder / HEADER_FILE).unlink(missing_ok=True)
        return lock

    def begin(self, header: Header) -> None:
        """Write what the run is besides its samples."""
        self._header = header_as_plain(header)
        self._write(HEADER_FILE, json.dumps(self._header).encode())

    def is_late(self) -> bool:
        """Return whether so much time has passed that what there is should be written."""
        return time.perf_counter() - self._written_at > CHUNK_SECONDS

    def take(self, rows: int, content: Content, ends: bool = False) -> None:
        """Write the rows that have not been written, if they are many or it is time.

        Fewer rows than a run has are not written: they wait for those that follow.

        Args:
            rows: How many rows the log has.
            content: Returns what is kept of some rows, by name, and what else is known by now, by
                the header's names.
            ends: Whether no rows will follow.
        """
        count = rows - self._rows
        if self._failed or not count or rows < MIN_SAMPLES:
            return
        if not (ends or count >= CHUNK_ROWS or self.is_late()):
            return
        arrays, known = content(slice(self._rows, rows))
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        self._write(HEADER_FILE, json.dumps({**self._header, **known}).encode())
        self._write(f"{self._chunks:06d}.npz", buffer.getvalue())
        self._rows, self._chunks, self._written_at = rows, self._chunks + 1, time.perf_counter()

    def _write(self, name: str, data: bytes) -> None:
        """Write a file of the part; the first fault ends the writing."""
        if self._failed:
            return
        try:
            write_atomically(self.folder / name, data, follow_links=False)
        except RpctlError as error:
            self._failed = True
            self.notes += (f"samples could not be saved while simulating: {error}",)

    def remove(self) -> None:
        """Remove the part, because all of it is written elsewhere; files of others stay."""
        with suppress(OSError):
            (self.folder / HEADER_FILE).unlink(missing_ok=True)  # first: without it it is no part
            for chunk in chunk_files(self.folder):
                chunk.unlink()
            (self.folder / LOCK_FILE).unlink()
            self.folder.rmdir()


def chunk_files(folder: Path) -> list[Path]:
    """Return the chunks of a part, in order."""
    return sorted(folder.glob(CHUNK_PATTERN), key=lambda chunk: (len(chunk.name), chunk.name))


def is_part(path: str | Path) -> bool:
    """Return whether a path is the part of a run: a folder with samples of it."""
    folder = Path(path)
    return is_file(folder / HEADER_FILE) and bool(chunk_files(folder))


def read_part(folder: str | Path) -> tuple[Header, dict[str, Array]]:
    """Return the header and the arrays of a run that was stopped; its notes say when it ended.

    Raises:
        RunFileError: A file is missing, damaged, or of another run; it is named.
    """
    folder = Path(folder)
    path, chunks = folder / HEADER_FILE, list[dict[str, Array]]()
    files = _all_chunks(folder)
    with blamed(path):
        header = read_header(read_input(path, "MAX_RUN_BYTES", KIND), path)
    for chunk in files:
        arrays = read_chunk(chunk, header)
        missing = len(header.bound_limits) - arrays["active_limits"].shape[1]
        arrays["active_limits"] = np.pad(arrays["active_limits"], ((0, 0), (0, missing)))
        chunks.append(arrays)
    with blamed(folder):
        shapes = {name: {each[name].shape[1:] for each in chunks} for name in chunks[0]}
        if differing := [name for name in shapes if len(shapes[name]) > 1]:
            raise EntryError(f'entry "{differing[0]}" is missing in some files')
        arrays = {name: np.concatenate([each[name] for each in chunks]) for name in chunks[0]}
        check_numbers("t", arrays["t"])  # across files, too
    return _ended(header, float(arrays["t"][-1])), arrays


def _ended(header: Header, t: float) -> Header:
    """Return a header that says when (s) the run ended."""
    planned = header.config.run.duration
    if planned is None or t >= planned * (1.0 - ENDED):
        return header
    note = f"ended early at t = {t:.4g} of {planned:.4g} s; the samples until then are kept"
    notes = (*header.notes, NOT_LOOKED_FOR, note)
    return replace(header, config=header.config.with_run(duration=t), notes=notes)


def _all_chunks(folder: Path) -> list[Path]:
    """Return the chunks of a part, none missing."""
    chunks = chunk_files(folder)
    if not chunks:
        raise RunFileError(f"{folder}: no samples were written before the simulation was stopped")
    for k, chunk in enumerate(chunks):
        if chunk.name != (name := f"{k:06d}.npz"):
            raise RunFileError(
                f"{folder / name}: missing, but {chunk.name} is there; restore it, or remove the "
                "files after it to keep the samples before"
            )
    return chunks


def _is_ours(folder: Path) -> bool:
    """Return whether a folder holds nothing but what a part without samples does."""
    names = {each.name for each in folder.iterdir()}
    return all(name in (HEADER_FILE, LOCK_FILE) or name.startswith(".") for name in names)


def _free_name(folder: Path) -> Path:
    """Return the first name beside a folder, with a number, that nothing has."""
    number = 1
    while os.path.lexists(aside := folder.with_name(f"{folder.name}-{number}")):
        number += 1
    return aside


def _locked(folder: Path) -> int:
    """Return the open lock of a folder.

    Raises:
        RpctlError: Another process holds it.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    lock = os.open(folder / LOCK_FILE, flags, 0o666)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise RpctlError(
            f"{folder}: another simulation writes to this folder; wait until it ends, or give "
            "another folder (--out)"
        ) from None
    return lock
