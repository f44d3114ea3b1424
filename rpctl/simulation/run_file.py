"""The file of a run: an ``.npz`` of JSON and packed samples, checked before it is believed.

It has two entries. ``meta`` is a text of JSON; ``columns`` are the bytes (n, 8, K) of n columns of
K numbers, packed by :mod:`rpctl.simulation.packing`. ``meta["columns"]`` tells what each array is
of them: a sample's shape, and for each of its numbers the column that holds it, or two of which
they are the difference. NumPy alone reads it::

    with np.load("run.npz") as file:
        meta, planes = json.loads(str(file["meta"])), file["columns"]
    codes = planes.transpose(0, 2, 1).copy().view("<i8")[:, :, 0]
    codes = (codes >> 1) & (2**63 - 1) ^ -(codes & 1)  # differences of ranks, coarse to fine
    rank = lambda x: x.view("i8") ^ ((x.view("i8") >> 63) & (2**63 - 1))  # and its own inverse
    columns, at, step = np.zeros(codes.shape), 1, 1 << (codes.shape[1] - 1).bit_length() >> 1
    columns[:, 0] = rank(codes[:, :1].copy()).view("f8")[:, 0]
    while step:
        known, k = columns[:, :: 2 * step], np.arange(columns[:, step :: 2 * step].shape[1])
        guess = np.zeros((len(columns), len(k)))
        for i, weight in enumerate((39690, -8820, 2268, -405, 35)):
            left, right = np.maximum(k - i, 0), np.minimum(k + 1 + i, known.shape[1] - 1)
            guess = guess + weight / 65536 * (known[:, left] + known[:, right])
        if meta["precision"] == "single":
            guess[1:] = guess[1:].astype("f4")
        guess[~np.isfinite(guess)] = 0
        code = codes[:, at : at + len(k)] + rank(guess)
        columns[:, step :: 2 * step] = rank(code).view("f8")
        at, step = at + len(k), step // 2
    of = meta["columns"]["q"]  # or any other array
    q = [columns[n[0]] - (columns[n[1]] if len(n) > 1 else 0) for n in of["columns"]]
    q = np.array(q).T.reshape(codes.shape[1], *of["shape"])
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import InputError, RunFileError, UnknownNameError, one_line
from rpctl.files.caps import cap
from rpctl.files.npz import SUFFIX, Npz, NpzError, open_npz
from rpctl.files.opening import open_input
from rpctl.files.strict_json import read_json
from rpctl.files.writing import writing
from rpctl.simulation.columns import release, scratch
from rpctl.simulation.kinds import EntryError, free, mapping, number, table
from rpctl.simulation.older_laws import tables_up_to_5
from rpctl.simulation.packed import (
    COLUMNS_ENTRY,
    EXACT,
    planned,
    read_columns,
    require_room,
    shapes_of,
    write_columns,
)
from rpctl.simulation.recorded import tables_of_settings
from rpctl.simulation.run_schema import (
    ARRAYS,
    META,
    PLANT_ARRAYS,
    check_numbers,
    check_shapes,
    checked_meta,
)

SCHEMA = 6
PACKED_SCHEMAS = (5, SCHEMA)  # older ones hold an entry for each array, see _completed
OLDER_SCHEMAS = (2, 3, 4)
META_ENTRY = "meta"  # the one entry of the file that is text: JSON
PRECISIONS = ("double", "single")
MAX_META = 10 * 2**20  # characters: a URDF of 4 MB, its quotes escaped, and 2 MB besides
FIX = "it is damaged or was made up; track the robot again"
SINCE_6: dict[str, Any] = {  # missing in older files, and what stands for it
    "recording": None,
    "collisions": None,
    "losses": False,
    "armature": None,
    "law_sentences": [],
}
LATER_ENTRIES: dict[str, Any] = {  # likewise, before 5
    **SINCE_6,
    "xacro_args": {},
    "ignore_missing_packages": False,
    "home": {},
    "free": [],
    "payloads": [],
    "sizing": None,
    "perturbed": None,
    "urdf": None,
    "file_sha256": None,
}
ARRAY_ENTRIES = frozenset(ARRAYS)
OLDER_SETTINGS = table({}, {"plant": mapping(free)}, free)
EMPTY_ARRAYS = ("nu_cmd", *PLANT_ARRAYS)  # likewise, nothing
LATER_ARRAYS = (*EMPTY_ARRAYS, "load_range", "slip_range")  # likewise, before 5
ZERO_ARRAYS = ("lost",)  # likewise, a number a sample


def write_run_file(
    path: str | Path,
    meta: Mapping[str, Any],
    arrays: Mapping[str, Array],
    precision: str = "double",
) -> Path:
    """Write the file of a run; it is there whole or not at all.

    Args:
        path: The file.
        meta: What JSON says of the run, by the names of the file's entries.
        arrays: The samples, by the names of the file's entries; they may be larger than memory.
        precision: ``"double"`` keeps every bit; ``"single"`` rounds all but the time to 24 bits.

    Returns:
        The path.

    Raises:
        RpctlError: The file cannot be written, or a number does not fit single precision.
    """
    if precision not in PRECISIONS:
        raise UnknownNameError("precision", precision, PRECISIONS)
    single = precision == "single"
    arrays = {EXACT: arrays[EXACT], **arrays}  # the first
    kept, layout = planned(arrays, single)
    head = {"schema": SCHEMA, "precision": precision, **meta, COLUMNS_ENTRY: layout}
    text = np.array(json.dumps(head, ensure_ascii=False, default=lambda number: number.tolist()))
    with writing(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = io.BytesIO()
        npy.write_array(entry, text, allow_pickle=False)
        archive.writestr(
            zipfile.ZipInfo(META_ENTRY + SUFFIX), entry.getvalue(), zipfile.ZIP_DEFLATED
        )
        write_columns(archive, arrays, kept, single)
    return Path(path)


def read_run_file(path: str | Path) -> dict[str, Any]:
    """Return the entries of the file of a run, as records hold them; arrays are read-only.

    Raises:
        RunFileError: The file is missing, is no run, is damaged, or has another schema. The entry
            that is to blame is named.
    """
    with (
        blamed(path),
        open_input(path, "MAX_RUN_BYTES", "a run.npz") as file,
        open_npz(file, cap("MAX_RUN_BYTES")) as npz,
    ):
        if META_ENTRY not in npz.names:
            raise RunFileError(f"{path}: not a run of rpctl; give a run.npz that it wrote")
        meta = _meta_of(npz)
        schema = meta.pop("schema", None)
        if isinstance(schema, int) and schema in PACKED_SCHEMAS:
            return _read_packed(npz, meta, older=schema < SCHEMA)
        if isinstance(schema, int) and schema in OLDER_SCHEMAS:
            return _read_older(npz, meta, schema)
    known = ", ".join(map(str, (*OLDER_SCHEMAS, *PACKED_SCHEMAS[:-1])))
    raise RunFileError(
        f"{path}: schema {one_line(repr(schema)[:40])}, this rpctl reads {known} and {SCHEMA}; "
        "track the robot again"
    )


@contextmanager
def blamed(path: str | Path) -> Iterator[None]:
    """Turn what is wrong with an entry into what is wrong with a file."""
    try:
        yield
    except InputError as error:
        raise RunFileError(f"{path}: {error.fault}") from None
    except NpzError as error:
        raise RunFileError(f"{path}: damaged or not a run of rpctl: {error}") from None
    except EntryError as error:
        raise RunFileError(f"{path}: {error}; {FIX}") from None


def _meta_of(npz: Npz) -> dict[str, Any]:
    """Return what JSON says."""
    try:
        meta = read_json(npz.text(META_ENTRY, MAX_META))
    except ValueError as error:
        raise EntryError(
            f'entry "{META_ENTRY}" is no JSON of a run: {one_line(str(error))}'
        ) from None
    if not isinstance(meta, dict):
        raise EntryError(f'entry "{META_ENTRY}" is no JSON of a run')
    return meta


def _read_packed(npz: Npz, meta: dict[str, Any], older: bool) -> dict[str, Any]:
    """Return the entries of a file of today, or of schema 5; all is checked before any sample."""
    layout, precision = meta.pop(COLUMNS_ENTRY, None), meta.pop("precision", None)
    if precision not in PRECISIONS:
        raise EntryError(f'entry "precision" must be one of {", ".join(PRECISIONS)}')
    _require_names(npz.names, (META_ENTRY, COLUMNS_ENTRY))
    meta = _with_laws_up_to_5({**SINCE_6, **meta}) if older else meta
    _require_names(meta, META)
    known = checked_meta(meta)
    shapes = shapes_of(layout, npz.entry(COLUMNS_ENTRY))
    zero = _zero_arrays(shapes, PLANT_ARRAYS, ())
    if older:
        zero = _zero_arrays(shapes, EMPTY_ARRAYS, ZERO_ARRAYS)
    _require_names([*shapes, *zero], ARRAYS)
    check_shapes(shapes | {name: array.shape for name, array in zero.items()}, known)
    return {**known, **zero, **read_columns(npz, layout, precision == "single")}


def _zero_arrays(
    shapes: Mapping[str, tuple[int, ...]], empty: Sequence[str], zeros: Sequence[str]
) -> dict[str, Array]:
    """Return the arrays that an older file lacks and that stand for zeros or nothing, by name.

    Args:
        shapes: Those that it has.
        empty: Which may stand for nothing.
        zeros: Which may stand for zeros.
    """
    rows = shapes.get("t", (0,))[:1]
    zero = {name: np.zeros(rows) for name in zeros if name not in shapes}
    zero |= {name: np.zeros((*rows, 0)) for name in empty if name not in shapes}
    for array in zero.values():
        array.setflags(write=False)
    return zero


def _read_older(npz: Npz, meta: dict[str, Any], schema: int) -> dict[str, Any]:
    """Return the entries of an older file: each of its arrays is an entry of plain numbers."""
    found = [name for name in npz.names if name != META_ENTRY]
    meta, lacking = _completed(schema, meta)
    _require_names(meta, META)
    _require_names({*found, *lacking, *ZERO_ARRAYS}, ARRAYS)
    known, headers = checked_meta(meta), {name: npz.entry(name) for name in found}
    for name, header in headers.items():
        if header.kind != "<f8" or not header.shape:
            raise EntryError(f'entry "{name}" holds other than finite numbers')
    rows = headers["t"].shape[0] if "t" in headers else 0
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(ZERO_ARRAYS, (rows,))
    shapes |= dict.fromkeys(lacking, (rows, 0))
    shapes |= {name: header.shape for name, header in headers.items()}
    check_shapes(shapes, known)
    require_room(rows, sum(header.nbytes for header in headers.values()) // (8 * rows))
    arrays = {name: scratch(shape) for name, shape in shapes.items()}
    for name, array in arrays.items():
        if name in headers:
            npz.numbers(headers[name], array, release)
        check_numbers(name, array)
        array.setflags(write=False)
    return {**known, **arrays}


def _require_names(found: Collection[str], known: Collection[str]) -> None:
    """Refuse entries that are missing or not known."""
    if wrong := set(found) ^ set(known):
        listed = ", ".join(one_line(name) for name in sorted(wrong)[:10])
        raise EntryError(f"entries missing or not known: {listed}")


def _completed(schema: int, meta: dict[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what an older file says as files of today do, and the arrays that it may lack.

    Schema 3 has settings by class names instead of a configuration. Schema 2 lacks besides what
    others than the arm's joints do, and the notes; they are empty then.
    """
    meta = {**LATER_ENTRIES, **meta}
    if schema < 4 and "settings" in meta:
        meta |= _from_settings(meta.pop("settings"), meta.get("friction", FRICTION))
    meta = _with_laws_up_to_5(meta)
    if schema > 2:
        return meta, LATER_ARRAYS
    nothing: dict[str, Any] = {"other_names": [], "other_limits": [], "notes": []}
    return {**nothing, **meta}, (*LATER_ARRAYS, "others", "other_rates")


def _with_laws_up_to_5(meta: dict[str, Any]) -> dict[str, Any]:
    """Return what a file of schema 5 or less says, its laws with all that they stood for."""
    tables = meta.get("config")
    return meta | {"config": tables_up_to_5(tables)} if isinstance(tables, dict) else meta


def _from_settings(settings: Any, friction: Any) -> dict[str, Any]:
    """Return the entries of today that settings by class names stand for."""
    found = OLDER_SETTINGS(settings, "settings")
    return {
        "config": tables_of_settings(found, number(friction, "friction")),
        "kinematic_report": found.get("kinematic_report", {}),
        "controller_model": found.get("plant", {}).get("believed"),
    }
