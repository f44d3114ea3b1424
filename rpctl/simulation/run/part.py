"""A run on disk while it is simulated: what a kill or a loss of power leaves is a valid run.

A part is a folder. ``header.json`` says what a run is besides its samples, as the entry ``header``
of a run's file does. The samples follow in ``000000.npz``, ``000001.npz`` and so on, each of which
appears whole or not at all. They are plain NumPy files: the arrays of the log by name, and the
bytes ``label`` of JSON that say which run and which rows they are.

A process that writes a part holds a lock on it, which ends with the process however it ends.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import time
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, RunFileError
from rpctl.files.opening import is_file, read_input
from rpctl.files.writing import make_folder, write_atomically
from rpctl.simulation.merits.collision_facts import NOT_LOOKED_FOR
from rpctl.simulation.run.file import (
    EntryError,
    blamed,
    check_arrays,
    check_numbers,
    header_bytes,
    read_arrays,
    read_header,
    read_object,
)
from rpctl.simulation.run.header import Header
from rpctl.simulation.run.log import MIN_SAMPLES

PART_FOLDER = "run.part"  # beside the files of the finished run
HEADER_FILE, LOCK_FILE, LABEL = "header.json", "lock", "label"
IDENTITY = "part"  # the member of a label that tells one run's files from another's
LATER = ("bound_limits", "kinematic_report", "wall_time")  # members that each chunk tells anew
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
        self._id, self._rows, self._chunks = uuid.uuid4().hex, 0, 0
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
            self.notes = (f"{aside} keeps what an earlier simulation left when it was stopped: "
                          "look at it, then remove it",)  # fmt: skip
            self.folder.mkdir()
            lock = _locked(self.folder)
        (self.folder / HEADER_FILE).unlink(missing_ok=True)
        return lock

    def begin(self, header: Header) -> None:
        """Write what the run is besides its samples."""
        told = read_object(header_bytes(header).tobytes()) | {IDENTITY: self._id}
        kept = {name: value for name, value in told.items() if name not in LATER}
        self._write(HEADER_FILE, json.dumps(kept).encode())

    def is_late(self) -> bool:
        """Return whether so much time has passed that what there is should be written."""
        return time.perf_counter() - self._written_at > CHUNK_SECONDS

    def take(self, rows: int, content: Content, ends: bool = False) -> None:
        """Write the rows that have not been written, if they are many or it is time.

        Fewer rows than a run has are not written: they wait for those that follow.

        Args:
            rows: How many rows the log has.
            content: Returns what is kept of some rows, by name, and what else is known by now, by
                the names in ``LATER``.
            ends: Whether no rows will follow.
        """
        count = rows - self._rows
        if self._failed or not count or rows < MIN_SAMPLES:
            return
        if not (ends or count >= CHUNK_ROWS or self.is_late()):
            return
        arrays, known = content(slice(self._rows, rows))
        label = json.dumps({**known, IDENTITY: self._id, "first": self._rows}).encode()
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **{LABEL: np.frombuffer(label, np.uint8)}, **arrays)
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
            self.notes += (f"a kill would have lost what was simulated: {error}",)

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
    with blamed(folder / HEADER_FILE):
        plain = read_object(read_input(folder / HEADER_FILE, "MAX_RUN_BYTES", KIND))
        identity = plain.pop(IDENTITY, None)
        later, arrays = _samples(folder, identity)
        data = json.dumps({**plain, **later}).encode()
        header = read_header(data, folder / HEADER_FILE)
    with blamed(folder):
        check_arrays({name: array.shape for name, array in arrays.items()}, header, part=True)
        check_numbers("t", arrays["t"])  # across chunks, too
    return _ended(header, float(arrays["t"][-1])), arrays


def _samples(folder: Path, identity: object) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return what the last chunk tells anew, and the samples of all."""
    chunks, later, first = list[dict[str, Array]](), dict[str, Any](), 0
    for path in _all_chunks(folder):
        label, arrays = read_arrays(path, LABEL)
        with blamed(path):
            later = read_object(label)
            start, part = later.pop("first", None), later.pop(IDENTITY, None)
            if set(later) != set(LATER) or type(start) is not int:
                raise EntryError(f'entry "{LABEL}" says other than a chunk does')
            if part != identity or start != first:
                raise EntryError("its samples are of another run, or out of order")
            for name, array in arrays.items():
                fits = not chunks or array.shape[1:] == chunks[0][name].shape[1:]
                if not fits and name != "active_limits":
                    raise EntryError(f'entry "{name}" does not fit the other chunks')
        first += len(arrays["t"])
        chunks.append(arrays)
    # Each chunk has a column for each limit that had bound by then.
    widest = max(chunk["active_limits"].shape[1] for chunk in chunks)
    for chunk in chunks:
        missing = widest - chunk["active_limits"].shape[1]
        chunk["active_limits"] = np.pad(chunk["active_limits"], ((0, 0), (0, missing)))
    return later, {name: np.concatenate([each[name] for each in chunks]) for name in chunks[0]}


def _ended(header: Header, t: float) -> Header:
    """Return a header that says when (s) the run ended."""
    planned = header.config.run.duration
    if planned is None or t >= planned * (1.0 - ENDED):
        return header
    note = f"ended early at t = {t:.4g} of {planned:.4g} s; what was simulated until then is kept"
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
                f"{folder / name}: missing, but {chunk.name} is there; put it back, or remove "
                "those behind it to keep what came before"
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
            f"{folder}: another simulation is writing there; wait until it ends, or write to "
            "another folder (--out)"
        ) from None
    return lock
