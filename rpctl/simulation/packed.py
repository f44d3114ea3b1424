"""The samples of a run as one packed entry of an ``.npz`` file: equal columns stand there once."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from hashlib import blake2b
from math import prod
from typing import Any

import numpy as np
from numpy.lib import format as npy

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.npz import SUFFIX, Npz, NpzEntry
from rpctl.simulation.columns import column_of, release, scratch
from rpctl.simulation.kinds import EntryError, fault, many, mapping, table, whole
from rpctl.simulation.packing import PLANES, pack, unpack
from rpctl.simulation.run_schema import check_numbers

COLUMNS_ENTRY = "columns"
EXACT = "t"  # its column is the first, and never rounded
DIFFERENCES = {"e": ("joints_ref", "joints", 3)}  # from column 3 on: of the one less the other
GROUP_BYTES = 2**22  # of columns that are packed together
LAYOUT = mapping(table({"shape": many(whole), "columns": many(many(whole))}, {}))

Place = tuple[str, int]  # an entry, and one of its columns
Layout = dict[str, dict[str, Any]]


def planned(arrays: Mapping[str, Array], single: bool) -> tuple[list[Place], Layout]:
    """Return which columns are kept, and what JSON says of all.

    Args:
        arrays: By entry, ``t`` first; (K, ...) each.
        single: Whether they are rounded to single precision, but for the time.

    Returns:
        The columns that are kept; by entry the shape of a sample and for each of its columns the
        number of the one kept that it equals, or of two whose difference it is.
    """
    kept: list[Place] = []
    layout: Layout = {}
    known: dict[bytes, int] = {}
    for entry, array in arrays.items():
        numbers: list[list[int]] = []
        for k in range(prod(array.shape[1:])):
            column = _column(arrays, (entry, k), single)
            digest = _digest(column)
            pair = None if single else _difference(entry, k, column, layout, arrays)
            if digest in known:
                numbers.append([known[digest]])
            elif pair is not None:
                numbers.append(pair)
            else:
                known[digest] = len(kept)
                numbers.append([len(kept)])
                kept.append((entry, k))
        layout[entry] = {"shape": list(array.shape[1:]), "columns": numbers}
    return kept, layout


def write_columns(
    archive: zipfile.ZipFile, arrays: Mapping[str, Array], kept: Sequence[Place], single: bool
) -> None:
    """Write the columns that are kept, a group of them in memory at a time.

    Args:
        archive: The ``.npz`` file, open for writing.
        arrays: By entry; they may be larger than memory.
        kept: From :func:`planned`.
        single: As there.
    """
    head, shape = io.BytesIO(), (len(kept), PLANES, len(arrays[EXACT]))
    npy.write_array_header_1_0(head, {"descr": "|u1", "fortran_order": False, "shape": shape})
    info = zipfile.ZipInfo(COLUMNS_ENTRY + SUFFIX)
    info.compress_type = zipfile.ZIP_DEFLATED
    info.file_size = head.tell() + prod(shape)
    with archive.open(info, "w") as file:
        file.write(head.getvalue())
        for group in _groups(len(kept), shape[2]):
            columns = np.array([_column(arrays, kept[number], single) for number in group])
            file.write(pack(columns, single and group[0] > 0).data)


def shapes_of(layout: Any, entry: NpzEntry) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a file's arrays, if they make sense and are not too large.

    Args:
        layout: What JSON says of the arrays, by entry.
        entry: What is packed.

    Raises:
        EntryError: They do not, or are.
    """
    known = LAYOUT(layout, COLUMNS_ENTRY)
    if entry.kind != "|u1" or entry.fortran or len(entry.shape) != 3 or entry.shape[1] != PLANES:
        raise EntryError(
            f'entry "{COLUMNS_ENTRY}": {entry.kind} {entry.shape}, not bytes (n, 8, K)'
        )
    kept, _, rows = entry.shape
    for name, each in known.items():
        where, numbers = f"{COLUMNS_ENTRY}.{name}", each["columns"]
        if len(numbers) != prod(each["shape"]):
            raise fault(where, each["shape"], f"the shape of {len(numbers)} columns")
        for of in numbers:
            if len(of) not in (1, 2) or max(of) >= kept:
                raise fault(where, of, f"one or two of {kept} columns")
    require_room(rows, sum(len(each["columns"]) for each in known.values()))
    return {name: (rows, *each["shape"]) for name, each in known.items()}


def read_columns(npz: Npz, layout: Layout, single: bool) -> dict[str, Array]:
    """Return the arrays of a file by entry, a group of columns in memory at a time.

    Args:
        npz: The file.
        layout: What JSON says of them, as :func:`shapes_of` accepts it.
        single: Whether they were rounded to single precision.

    Raises:
        NpzError: The file is damaged.
        EntryError: The numbers are not those of a run.
    """
    entry = npz.entry(COLUMNS_ENTRY)
    kept, _, rows = entry.shape
    arrays = {name: scratch((rows, *each["shape"])) for name, each in layout.items()}
    users = _users(kept, layout)
    with np.errstate(all="ignore"):  # of a damaged file; what is not finite is told below
        for number, column in enumerate(_unpacked(npz, entry, single)):
            for (name, k), put in users[number]:
                place = arrays[name].reshape(rows, -1)[:, k]
                place[:] = put(place, column)
                release(arrays[name])
    for name, array in arrays.items():
        check_numbers(name, array)
        array.setflags(write=False)
    return arrays


def require_room(rows: int, columns: int) -> None:
    """Refuse arrays that would be larger than a run may be.

    Args:
        rows: Samples.
        columns: Numbers of a sample.

    Raises:
        EntryError: How to raise the cap is said.
    """
    size, most = 8 * rows * columns, cap("MAX_RUN_BYTES")
    if size > most:
        raise EntryError(
            f"{rows} samples of {columns} numbers take {size} bytes, over {most}; "
            f"{how_to_raise('MAX_RUN_BYTES')}"
        )


def _column(arrays: Mapping[str, Array], place: Place, single: bool) -> Array:
    """Return a copy (K,) of a column as it is kept.

    Raises:
        RpctlError: It does not fit single precision.
    """
    entry, k = place
    array = arrays[entry]
    column = column_of(array.reshape(len(array), -1), k)
    if not single or entry == EXACT:
        return column
    with np.errstate(over="ignore"):
        rounded = column.astype(np.float32).astype(np.float64)
    if (np.isinf(rounded) & np.isfinite(column)).any():
        raise RpctlError(f'"{entry}" is too large for single precision; save it in double')
    return rounded


def _difference(
    entry: str, k: int, column: Array, layout: Layout, arrays: Mapping[str, Array]
) -> list[int] | None:
    """Return the two columns that are kept of which a column is the difference, to the bit."""
    if entry not in DIFFERENCES:
        return None
    first, second, start = DIFFERENCES[entry]
    wanted = [(name, k - start) for name in (first, second)]
    if not all(0 <= at < len(layout[name]["columns"]) for name, at in wanted):
        return None
    of = [layout[name]["columns"][at] for name, at in wanted]
    less = _column(arrays, wanted[0], False) - _column(arrays, wanted[1], False)
    return [*of[0], *of[1]] if less.tobytes() == column.tobytes() else None


def _digest(column: Array) -> bytes:
    return blake2b(column.data, digest_size=32).digest()


def _groups(kept: int, rows: int) -> Iterator[range]:
    """Yield the numbers of columns that are packed together; the first, of time, is alone."""
    size = max(1, GROUP_BYTES // (8 * max(rows, 1)))
    yield range(min(1, kept))
    for first in range(1, kept, size):
        yield range(first, min(first + size, kept))


def _unpacked(npz: Npz, entry: NpzEntry, single: bool) -> Iterator[Array]:
    """Yield the columns (K,) that are kept, in their order."""
    kept, _, rows = entry.shape
    groups = list(_groups(kept, rows))
    sizes = [len(group) * PLANES * rows for group in groups]
    for group, data in zip(groups, npz.pieces(entry, sizes), strict=True):
        planes = np.frombuffer(data, np.uint8).reshape(-1, PLANES, rows)
        yield from unpack(planes, single and group[0] > 0)


def _users(kept: int, layout: Layout) -> list[list[tuple[Place, Callable[..., Array]]]]:
    """Return for each column kept the places it goes to, and how it joins what is there."""
    users: list[list[tuple[Place, Callable[..., Array]]]] = [[] for _ in range(kept)]
    for name, each in layout.items():
        for k, of in enumerate(each["columns"]):
            first, last = min(of), max(of)
            users[first].append(((name, k), lambda _, column: column))
            if len(of) == 2:  # the one that comes later may be either of the two
                users[last].append(((name, k), np.subtract if of[1] == last else _less))
    return users


def _less(there: Array, column: Array) -> Array:
    return column - there
