"""The one-file form of a run: an ``.npz`` of its log's arrays and one entry of JSON, no pickle."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import RunFileError
from rpctl.files.writing import write_atomically
from rpctl.simulation.log import Log
from rpctl.simulation.recorded import tables_of_settings

SCHEMA = 4
OLDER_SCHEMAS = (2, 3)  # see _completed
META_ENTRY = "meta"  # the one entry of the file that is text: JSON
OPTIONAL_ENTRIES = (
    "load_range",
    "slip_range",
)  # missing in older files; they may hold NaN or inf
LATER_ENTRIES: dict[str, Any] = {  # missing in older files, and what they stand for there
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
ARRAY_ENTRIES = {item.name for item in fields(Log)} - {"bound_limits"}


def write_run_file(path: str | Path, meta: Mapping[str, Any], arrays: Mapping[str, Array]) -> Path:
    """Write the file of a run; it is there whole or not at all.

    Args:
        path: The file.
        meta: What JSON says of the run, by the names of the file's entries.
        arrays: The samples, by the names of the file's entries.

    Returns:
        The path.
    """
    text = json.dumps({"schema": SCHEMA, **meta}, default=lambda number: number.tolist())
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **{META_ENTRY: text}, **arrays)
    return write_atomically(path, buffer.getvalue())


def read_run_file(path: str | Path) -> dict[str, Any]:
    """Return the entries of the file of a run, JSON and read-only arrays, as files of today hold.

    Raises:
        RunFileError: The file is missing, is no run, is damaged, or has another schema.
    """
    try:
        with Path(path).open("rb") as file:
            stored = np.load(file, allow_pickle=False)
            if not isinstance(stored, NpzFile) or META_ENTRY not in stored:
                raise RunFileError(f"{path}: not a run of rpctl; give a run.npz that it wrote")
            meta = json.loads(str(stored[META_ENTRY]))
            arrays = {name: stored[name] for name in stored if name != META_ENTRY}
    except OSError as error:
        raise RunFileError(f"{path}: {error.strerror or error}; give a run.npz") from None
    except (ValueError, EOFError, zipfile.BadZipFile, KeyError) as error:
        raise RunFileError(f"{path}: damaged or not a run of rpctl ({error})") from None
    schema = meta.pop("schema", None) if isinstance(meta, dict) else None
    if schema not in (*OLDER_SCHEMAS, SCHEMA):
        raise RunFileError(
            f"{path}: schema {schema}, this rpctl reads "
            f"{', '.join(map(str, OLDER_SCHEMAS))} and {SCHEMA}; track the robot again"
        )
    entries = {**meta, **arrays}
    if schema != SCHEMA:
        entries = _completed(schema, entries)
    for name in OPTIONAL_ENTRIES:
        entries.setdefault(name, np.empty((np.size(entries.get("t", ())), 0)))
    return {**LATER_ENTRIES, **entries}


def _completed(schema: int, entries: dict[str, Any]) -> dict[str, Any]:
    """Return what an older file holds as files of today do.

    Schema 3 has settings by class names instead of a configuration. Schema 2 lacks besides what
    others than the arm's joints do, and the notes; they are empty then.
    """
    if isinstance(settings := entries.pop("settings", None), dict):
        entries["config"] = tables_of_settings(settings, entries.get("friction", FRICTION))
        entries["kinematic_report"] = settings.get("kinematic_report", {})
        entries["controller_model"] = settings.get("plant", {}).get("believed")
    if schema == SCHEMA - 1:
        return entries
    nothing = np.empty((np.size(entries.get("t", ())), 0))
    lists: dict[str, list[Any]] = {"other_names": [], "other_limits": [], "notes": []}
    return {"others": nothing, "other_rates": nothing.copy(), **lists, **entries}


def check_arrays(path: str | Path, entries: Mapping[str, Any]) -> None:
    """Refuse arrays of other kinds, lengths or shapes than a log's; make the others read-only.

    Raises:
        RunFileError: Naming the entry.
    """
    lengths = {len(v) for v in entries.values() if isinstance(v, np.ndarray) and v.ndim}
    if len(lengths) != 1:
        raise RunFileError(f"{path}: arrays of differing lengths {sorted(lengths)}")
    for name, value in entries.items():
        if (name in ARRAY_ENTRIES) != isinstance(value, np.ndarray):
            raise RunFileError(f'{path}: entry "{name}" is of the wrong kind')
        if isinstance(value, np.ndarray):
            finite = name in OPTIONAL_ENTRIES or np.isfinite(value).all()
            if value.dtype != np.float64 or not finite:
                raise RunFileError(f'{path}: entry "{name}" holds other than finite numbers')
            value.setflags(write=False)
    columns = {
        "nu": "quasi_velocities",
        "tau": "actuators",
        "rates": "actuators",
        "joints": "joint_names",
        "others": "other_names",
        "other_rates": "other_names",
        "active_limits": "bound_limits",
    }
    for array, labels in columns.items():
        if entries[array].ndim != 2 or entries[array].shape[1] != len(entries[labels]):
            raise RunFileError(f'{path}: "{array}" does not fit its names')
    contacts = len(entries["contacts"])
    shapes = {"contact_load": (contacts,), "load_range": (contacts, 2), "slip_range": (2,)}
    for name, shape in shapes.items():
        if entries[name].size and entries[name].shape[1:] != shape:
            raise RunFileError(f'{path}: "{name}" does not fit its names')
