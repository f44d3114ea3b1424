"""The drive file: a TOML file in which a user declares a robot's wheels."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from rpctl.drive.drive import BASE_SPEEDS
from rpctl.files import toml
from rpctl.files.records import (
    POSITIVE,
    OneOf,
    OutOfRangeError,
    Range,
    Record,
    Setting,
    read_record,
)

DRIVE_TYPES = tuple(BASE_SPEEDS)
SWIVEL_ROLES = ("steered", "caster")
STEERING_MODES = ("ackermann", "free")
ROLLER_RANGE = Range(math.nextafter(-90.0, 0.0), 90.0, "degrees between -90 and 90", below=True)
ONLY_OF = {
    "track": "skid-steer",
    "point": "skid-steer",
    "steering": "car-like",
}  # types that have it


@dataclass(frozen=True)
class WheelSpec(Record):
    """A declared wheel; None where it is to be detected."""

    joint: Annotated[str, Setting("", "joint", "The wheel's joint.")]
    radius: Annotated[float | None, POSITIVE, Setting("m", "radius", "Its radius.")] = None
    roller_deg: Annotated[
        float | None,
        ROLLER_RANGE,
        Setting("deg", "roller", "Angle from the heading to the roller on the ground (mecanum)."),
    ] = None
    driven: Annotated[bool | None, Setting("", "driven", "Whether a motor turns it.")] = None

    @property
    def roller(self) -> float | None:
        """Its roller's angle, rad."""
        return None if self.roller_deg is None else math.radians(self.roller_deg)


@dataclass(frozen=True)
class SwivelSpec(Record):
    """A declared swivel; None where it is to be detected."""

    joint: Annotated[str, Setting("", "joint", "The swivel's joint.")]
    role: Annotated[str | None, OneOf(SWIVEL_ROLES), Setting("", "role", "What it does.")] = None
    driven: Annotated[bool | None, Setting("", "driven", "Whether a motor turns it.")] = None


@dataclass(frozen=True)
class DriveSpec(Record):
    """A declared drive; None or empty where it is to be detected.

    Where any wheels are named, these are all of them.
    """

    type: Annotated[str | None, OneOf(DRIVE_TYPES), Setting("", "type", "Of the drive.")] = None
    wheel: Annotated[tuple[WheelSpec, ...], Setting("", "wheels", "The wheels.")] = ()
    swivel: Annotated[tuple[SwivelSpec, ...], Setting("", "swivels", "Swivels.")] = ()
    track: Annotated[
        float | None, POSITIVE, Setting("m", "track", "Effective track of a skid-steer drive.")
    ] = None
    point: Annotated[
        tuple[float, float] | None,
        Setting("m", "point", "Centre of rotation of a skid-steer drive in the root link's frame."),
    ] = None
    steering: Annotated[
        str,
        OneOf(STEERING_MODES),
        Setting("", "steering", "Whether the wheels' axles meet in one centre (ackermann), or each "
                "turns on its own and on average they do not slip (free)."),
    ] = STEERING_MODES[0]  # fmt: skip

    def __post_init__(self) -> None:
        """Refuse what the type of the drive does not have, and what is named twice."""
        super().__post_init__()
        faults = []
        for name, kind in ONLY_OF.items():
            if getattr(self, name) not in (None, STEERING_MODES[0]) and self.type != kind:
                faults.append(f"{name} is of {kind} drives only; leave it out")
        for name, tables in (("wheel", self.wheel), ("swivel", self.swivel)):
            joints = [each.joint for each in tables]
            twice = dict.fromkeys(joint for joint in joints if joints.count(joint) > 1)
            faults += [f'{name}: joint "{joint}" is named twice' for joint in twice]
            if tables and self.type == "fixed":
                faults.append(f"a fixed base has no {name}; leave [[{name}]] out")
        if self.type != "mecanum" and any(each.roller_deg is not None for each in self.wheel):
            faults.append("wheel: roller_deg is of mecanum drives only; leave it out")
        if faults:
            raise OutOfRangeError(faults)

    @cached_property
    def wheels(self) -> dict[str, WheelSpec]:
        """The wheels by joint."""
        return {each.joint: each for each in self.wheel}

    @cached_property
    def swivels(self) -> dict[str, SwivelSpec]:
        """The swivels by joint."""
        return {each.joint: each for each in self.swivel}


def read_drive(path: str | Path) -> DriveSpec:
    """Read a drive file.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    return toml.read(path, _drive_in, "a drive file")


def _drive_in(data: dict[str, Any], faults: list[str]) -> Any:
    if "type" not in data:
        faults.append(f"type is missing; give one of {', '.join(DRIVE_TYPES)}")
    return read_record(DriveSpec, data, "", faults)


def suggest(
    kind: str, wheels: Mapping[str, float | None], swivels: Mapping[str, str] | None = None
) -> str:
    """Return a drive file to start from.

    Args:
        wheels: Radius (m) of each joint that could carry a wheel, None where it is not known.
        swivels: Role of each joint that could be a swivel.
    """
    rolling = ""
    for joint, radius in wheels.items():
        size = 0.1 if radius is None else radius
        rolling += f"\n[[wheel]]\njoint = {_quoted(joint)}\n# radius = {size:.6g}  # m\n"
    turning = "".join(
        f'\n[[swivel]]\njoint = {_quoted(joint)}\nrole = "{role}"  # {", ".join(SWIVEL_ROLES)}\n'
        for joint, role in (swivels or {}).items()
    )
    return f'type = "{kind}"  # {", ".join(DRIVE_TYPES)}\n{rolling}{turning}'


def _quoted(name: str) -> str:
    """Return a name as a TOML string: JSON's are such."""
    return json.dumps(name, ensure_ascii=False)
