"""The schema of a run: the kind of each entry of its file, and how their lengths go together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import BASE_SPEEDS, Drive, Swivel, Wheel
from rpctl.errors import RpctlError
from rpctl.reference.sizing import Sizing
from rpctl.simulation.collision_facts import collision_facts
from rpctl.simulation.columns import blocks
from rpctl.simulation.config import Config
from rpctl.simulation.kinds import (
    EntryError,
    Kind,
    choice,
    digest,
    fault,
    figure,
    file,
    flag,
    free,
    limit,
    many,
    mapping,
    names,
    number,
    optional,
    path,
    plain,
    positive,
    record,
    row,
    table,
    text,
    whole,
)
from rpctl.simulation.log import MIN_SAMPLES
from rpctl.simulation.recorded import config_of

MAX_NUMBER = 1e100  # of a sample: no robot has such, and the square of a larger one may overflow
MIN_CONTACTS = 3  # that a support polygon has
POINT = row(number, number)
VECTOR = row(number, number, number)

WHEEL = record(
    Wheel,
    {"joint": text, "radius": positive, "source": text, "axis": VECTOR},
    {
        "offset": number,
        "direction": POINT,
        "driven": flag,
        "swivel": optional(text),
        "lateral": number,
        "shift": number,
        "slides": flag,
        "why": text,
    },
)
SWIVEL = record(
    Swivel,
    {
        "joint": text,
        "role": choice("steered", "follower", "mimic", "caster"),
        "pivot": POINT,
    },
    {
        "heading": number,
        "sign": number,
        "trail": number,
        "driven": flag,
        "shares": optional(text),
        "ratio": number,
        "offset": number,
        "why": text,
    },
)
DRIVE = record(
    Drive,
    {"type": choice(*BASE_SPEEDS)},
    {
        "wheels": many(WHEEL),
        "point": POINT,
        "heading": number,
        "track": number,
        "ground": number,
        "swivels": many(SWIVEL),
        "evidence": many(text),
        "doubts": many(text),
        "declared": many(text),
    },
)
CHECK = table(
    {"name": text, "against": text, "residual": optional(figure), "limit": number, "passed": flag},
    {},
    free,
)
CERTIFICATE = table(
    {
        "passed": flag,
        "checks": many(CHECK),
        "skipped": many(table({"name": text, "against": text, "note": text}, {}, free)),
    },
    {"samples": whole, "seed": whole},
    free,
)
SIZING = record(
    lambda sentence=None, **fields: Sizing(**fields),
    {
        "reference": text,
        "size": optional(number),
        "speed": optional(number),
        "laps": optional(number),
        "duration": figure,
        "reason": text,
    },
    {"arm": text, "assumed": text, "sentence": text},
)
RUN_SETTINGS = table(
    {},
    {
        "reference": path,
        "duration": positive,
        "initial_error": VECTOR,
        "control_period": positive,
        "plant_step": positive,
        "friction": number,
    },
    free,
)


def config(value: Any, where: str) -> Config:
    """Accept the tables of a configuration."""
    tables = mapping(free)(value, where)
    if "run" in tables:
        RUN_SETTINGS(tables["run"], f"{where}.run")
    try:
        return config_of(tables)
    except (RpctlError, TypeError, ValueError, KeyError, AttributeError) as error:
        raise EntryError(f'entry "{where}" is no configuration: {error}') from None


META: dict[str, Kind] = {  # entries of JSON
    "bound_limits": many(row(text, text)),
    "robot": text,
    "source": path,
    "urdf_sha256": digest,
    "locked": mapping(number),
    "drive": DRIVE,
    "density": optional(positive),
    "package_dirs": many(path),
    "xacro_args": mapping(path),
    "ignore_missing_packages": flag,
    "home": mapping(number),
    "free": many(text),
    "payloads": many(row(text, positive, VECTOR, row(VECTOR, VECTOR, VECTOR))),
    "losses": flag,
    "armature": optional(mapping(number)),
    "quasi_velocities": names,
    "actuators": names,
    "joint_names": names,
    "units": many(choice("rad", "m")),
    "effort_limits": many(limit),
    "velocity_limits": many(limit),
    "lower_limits": many(limit),
    "upper_limits": many(limit),
    "steering_names": names,
    "steering_limits": many(row(limit, limit)),
    "other_names": names,
    "other_limits": many(row(limit, limit, limit)),
    "end_effector": optional(text),
    "urdf": optional(file),
    "file_sha256": optional(digest),
    "contacts": many(text),
    "contact_points": many(POINT),
    "axles": many(many(whole)),
    "ground_notes": many(text),
    "friction": number,
    "config": config,
    "controller_model": optional(text),
    "kinematic_report": mapping(figure),
    "notes": many(text),
    "certificate": optional(plain(CERTIFICATE)),
    "wall_time": positive,
    "sizing": optional(SIZING),
    "recording": optional(plain(table({"sentence": text}, {}, free))),
    "perturbed": optional(plain(table({"sentence": text}, {}, free))),
    "collisions": collision_facts,
    "law_sentences": many(text),
}
SAME_LENGTH = (  # lists of one item each for one another's
    ("joint_names", "units"),
    ("joint_names", "lower_limits"),
    ("joint_names", "upper_limits"),
    ("actuators", "effort_limits"),
    ("actuators", "velocity_limits"),
    ("steering_names", "steering_limits"),
    ("other_names", "other_limits"),
    ("contacts", "contact_points"),
)
# Shapes of the samples' entries, without their first dimension, the samples: numbers, lists of the
# file that are as long, or entries whose last dimension they share. What a robot has not is (0,).
Size = int | str
PLANT_ARRAYS = ("root_pose", "ground_load", "wheel_slip")  # only some plants know them
ARRAYS: dict[str, tuple[Size, ...]] = {
    "t": (),
    "q": ("q",),
    "nu": ("quasi_velocities",),
    "tau": ("actuators",),
    "rates": ("actuators",),
    "nu_d": ("quasi_velocities",),
    "nu_cmd": ("quasi_velocities",),
    "nu_ref": ("quasi_velocities",),
    "base": (3,),
    "base_ref": (3,),
    "joints": ("joint_names",),
    "joints_ref": ("joint_names",),
    "steering": ("steering_names",),
    "others": ("other_names",),
    "other_rates": ("other_names",),
    "e": ("e",),
    "q_ref": ("q",),
    "ee": (3,),
    "ee_ref": (3,),
    "ee_angle": (),
    "energy": (),
    "work": (),
    "lost": (),
    "constraint_residual": (),
    "wheel_force": ("wheel_force",),
    "axle_force": ("axles",),
    "contact_load": ("contacts",),
    "zmp": (2,),
    "tip_margin": (),
    "slip_ratio": (),
    "load_range": ("contacts", 2),
    "slip_range": (2,),
    "root_pose": (7,),
    "ground_load": ("contacts",),
    "wheel_slip": ("wheel_force", 2),
    "active_limits": ("bound_limits",),
}
MAY_BE_MISSING = (  # from the samples of a robot that has no such thing; (0,) then
    "nu_cmd", "ee", "ee_ref", "contact_load", "zmp", "tip_margin", "slip_ratio", "load_range",
    "slip_range", *PLANT_ARRAYS,
)  # fmt: skip
TOGETHER = (  # an entry, and one that is not missing where it is not
    ("ee", "ee_ref"),
    ("ee_ref", "ee"),
    ("tip_margin", "zmp"),
    ("tip_margin", "contact_load"),
    ("tip_margin", "slip_ratio"),
    ("slip_range", "load_range"),
)
MAY_BE_INFINITE = ("load_range", "slip_range")  # or no number


def checked_meta(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of JSON as records hold them.

    Raises:
        EntryError: Naming the entry that is of another kind or length.
    """
    values = {name: kind(meta[name], name) for name, kind in META.items()}
    for first, second in SAME_LENGTH:
        if len(values[first]) != len(values[second]):
            raise fault(second, meta[second], f'as long as "{first}": {len(values[first])} items')
    return values


def check_shapes(shapes: Mapping[str, tuple[int, ...]], meta: Mapping[str, Any]) -> None:
    """Refuse samples of other shapes than their names say.

    Args:
        shapes: Of the arrays by entry, the samples' dimension first.
        meta: The entries of JSON.

    Raises:
        EntryError: Naming the entry.
    """
    lengths = sorted({shape[0] if shape else 0 for shape in shapes.values()})
    if len(lengths) != 1:
        raise EntryError(f"arrays of differing lengths {lengths}")
    if lengths[0] < MIN_SAMPLES:
        raise EntryError(f'entry "t" has {lengths[0]} samples; a run has {MIN_SAMPLES} or more')
    wheels = min(shapes["wheel_force"][-1], len(meta["contacts"]))  # the first of the contacts
    free_sizes = {"q": shapes["q"][-1], "e": 3 + len(meta["joint_names"]), "wheel_force": wheels}
    for name, sizes in ARRAYS.items():
        wanted = tuple(
            size if isinstance(size, int) else free_sizes.get(size, len(meta.get(size, ())))
            for size in sizes
        )
        if shapes[name][1:] != wanted and not (
            name in MAY_BE_MISSING and _is_missing(shapes[name])
        ):
            found = shapes[name][1:]
            raise EntryError(f'entry "{name}" does not fit its names: {found}, not {wanted}')
    for name, other in TOGETHER:
        if not _is_missing(shapes[name]) and _is_missing(shapes[other]):
            raise EntryError(f'entry "{other}" has no samples, but "{name}" has')
    if any(wheel >= wheels for axle in meta["axles"] for wheel in axle):
        raise fault("axles", meta["axles"], f"of the {wheels} wheels on the ground")
    if not _is_missing(shapes["tip_margin"]) and len(meta["contacts"]) < MIN_CONTACTS:
        raise fault("contacts", meta["contacts"], f"of {MIN_CONTACTS} or more to tip over")


def _is_missing(shape: tuple[int, ...]) -> bool:
    return shape[1:] == (0,)


def check_numbers(name: str, numbers: Array) -> None:
    """Refuse numbers that are not finite where they must be, and time that does not run.

    Args:
        name: Of the entry.
        numbers: All samples; they may be larger than memory.

    Raises:
        EntryError: Naming the entry.
    """
    before = -np.inf
    for (block,) in blocks(numbers):
        if name not in MAY_BE_INFINITE and not (np.abs(block) <= MAX_NUMBER).all():
            raise EntryError(f'entry "{name}" holds other than finite numbers up to {MAX_NUMBER:g}')
        if name != "t":
            continue
        if not (block[0] > before and (np.diff(block) > 0.0).all()):
            raise EntryError('entry "t" does not run: each time must be later than the one before')
        before = block[-1]
