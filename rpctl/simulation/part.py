"""Reads the part of a run: what was on disk when its simulation was stopped, as a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rpctl.arrays import Array
from rpctl.errors import RunFileError
from rpctl.files.caps import cap
from rpctl.files.npz import Npz, NpzEntry, open_npz
from rpctl.files.opening import is_file, open_input, read_input
from rpctl.files.strict_json import read_json
from rpctl.simulation.collision_facts import NOT_LOOKED_FOR
from rpctl.simulation.columns import release, scratch
from rpctl.simulation.config import Config
from rpctl.simulation.kinds import EntryError
from rpctl.simulation.packed import require_room
from rpctl.simulation.run_file import MAX_META, blamed
from rpctl.simulation.run_schema import ARRAYS, META, check_numbers, check_shapes, checked_meta
from rpctl.simulation.spool import CHUNK_ENTRY, LATER, META_FILE, PART, chunk_files

KIND = "the folder of a run that was stopped"
ENDED = 1e-6  # of a duration: a run that lacks less has ended


class Chunk(NamedTuple):
    """A file of consecutive samples."""

    npz: Npz
    label: dict[str, Any]  # which run and which rows it is, and what else was known by then
    entries: dict[str, NpzEntry]  # its arrays, by name

    @property
    def rows(self) -> int:
        """Number of its samples."""
        return self.entries["t"].shape[0]


def is_part(path: str | Path) -> bool:
    """Return whether a path is the part of a run: a folder with samples of it."""
    folder = Path(path)
    return is_file(folder / META_FILE) and bool(chunk_files(folder))


def read_part(folder: str | Path) -> dict[str, Any]:
    """Return the entries of a run that was stopped, as records hold them; arrays are read-only.

    Args:
        folder: The part, see :mod:`rpctl.simulation.spool`.

    Raises:
        RunFileError: A file is missing, damaged, or of another run; it is named.
    """
    folder = Path(folder)
    with blamed(folder / META_FILE):
        meta = _object(read_input(folder / META_FILE, "MAX_RUN_BYTES", KIND))
        identity, chunks = meta.pop(PART, None), _all_chunks(folder)
        with _opened(chunks[-1]) as last:
            meta |= {name: last.label[name] for name in LATER}
            count = last.label["first"] + last.rows
            shapes = {name: (count, *entry.shape[1:]) for name, entry in last.entries.items()}
        if set(meta) != set(META):
            listed = ", ".join(sorted(map(repr, set(meta) ^ set(META)))[:10])
            raise EntryError(f"entries missing or not known: {listed}")
        known = checked_meta(meta)
    with blamed(chunks[-1]):
        check_shapes(shapes, known)
        require_room(count, sum(math.prod(shape[1:]) for shape in shapes.values()))
    arrays = {name: scratch(shape) for name, shape in shapes.items()}
    _fill(arrays, chunks, identity)
    with blamed(folder):
        check_numbers("t", arrays["t"])  # across chunks, too
    for array in arrays.values():
        array.setflags(write=False)
    return {**known, **_ended(known, float(arrays["t"][-1])), **arrays}


def _ended(known: dict[str, Any], t: float) -> dict[str, Any]:
    """Return the entries that say when (s) the run ended."""
    config: Config = known["config"]
    planned = config.run.duration
    if planned is None or t >= planned * (1.0 - ENDED):
        return {}
    note = f"ended early at t = {t:.4g} of {planned:.4g} s; what was simulated until then is kept"
    return {"config": config.with_run(duration=t), "notes": (*known["notes"], NOT_LOOKED_FOR, note)}


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


def _fill(arrays: dict[str, Array], chunks: list[Path], identity: object) -> None:
    """Read the samples of all chunks into arrays, chunk by chunk."""
    first = 0
    for path in chunks:
        with blamed(path), _opened(path) as chunk:
            if chunk.label[PART] != identity or chunk.label["first"] != first:
                raise EntryError("its samples are of another run, or out of order")
            rows = slice(first, first + chunk.rows)
            for name, entry in chunk.entries.items():
                found = scratch(entry.shape)
                chunk.npz.numbers(entry, found)
                check_numbers(name, found)
                space = arrays[name][rows]
                if name == "active_limits":  # one column for each limit that had bound by then
                    space = space[:, : found.shape[1]]
                if space.shape != found.shape:
                    raise EntryError(f'entry "{name}" does not fit the other chunks')
                space[...] = found
                release(arrays[name], 0, rows.stop)
            first = rows.stop
    if first != len(arrays["t"]):
        raise RunFileError(f"{chunks[-1]}: changed while it was read; try again")


@contextmanager
def _opened(path: Path) -> Iterator[Chunk]:
    """Yield a chunk, its label and the headers of its arrays checked."""
    with (
        blamed(path),
        open_input(path, "MAX_RUN_BYTES", KIND) as file,
        open_npz(file, cap("MAX_RUN_BYTES")) as npz,
    ):
        if CHUNK_ENTRY not in npz.names:
            raise EntryError(f'entry "{CHUNK_ENTRY}" is missing')
        label = _object(npz.text(CHUNK_ENTRY, MAX_META))
        if set(label) != {PART, "first", *LATER} or type(label["first"]) is not int:
            raise EntryError(f'entry "{CHUNK_ENTRY}" says other than a chunk does')
        names = [name for name in npz.names if name != CHUNK_ENTRY]
        if set(names) != set(ARRAYS):
            listed = ", ".join(sorted(map(repr, set(names) ^ set(ARRAYS)))[:10])
            raise EntryError(f"entries missing or not known: {listed}")
        entries = {name: npz.entry(name) for name in names}
        lengths = {entry.shape[:1] for entry in entries.values()}
        if len(lengths) != 1 or any(entry.kind != "<f8" for entry in entries.values()):
            raise EntryError("its arrays are of differing lengths or kinds")
        yield Chunk(npz, label, entries)


def _object(text: str | bytes) -> dict[str, Any]:
    """Return the members of an object of JSON."""
    try:
        found = read_json(text.decode() if isinstance(text, bytes) else text)
    except ValueError as error:  # also of bytes that are no text
        raise EntryError(f"no JSON of a run: {error}") from None
    if not isinstance(found, dict):
        raise EntryError("no JSON of a run")
    return found
