"""The drive file: a TOML file in which a user declares a robot's wheels."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

from rpctl.drive.drive import BASE_SPEEDS
from rpctl.errors import is_number
from rpctl.files import toml

DRIVE_TYPES = tuple(BASE_SPEEDS)
SWIVEL_ROLES = ("steered", "caster")
STEERING_MODES = ("ackermann", "free")
DRIVE_KEYS = ("type", "track", "point", "steering", "wheel", "swivel")


@dataclass(frozen=True)
class WheelSpec:
    """A declared wheel: its radius (m), its roller's angle (rad), whether it is driven."""

    radius: float | None = None
    roller: float | None = None
    driven: bool | None = None


@dataclass(frozen=True)
class SwivelSpec:
    """A declared swivel: ``"steered"`` or ``"caster"``, and whether it is driven."""

    role: str | None = None
    driven: bool | None = None


@dataclass(frozen=True)
class DriveSpec:
    """A declared drive; None or empty where it is to be detected.

    Attributes:
        type: Its type.
        wheels: The wheels, by joint: all of them, where any are named.
        swivels: Swivels, by joint.
        track: Effective track of a skid-steer drive, m.
        point: Centre of rotation of a skid-steer drive in the root link's frame (x, y), m.
        steering: ``"ackermann"``: the wheels' axles meet in one centre; ``"free"``: each steered
            wheel of an axle turns on its own, and on average they do not slip.
    """

    type: str | None = None
    wheels: Mapping[str, WheelSpec] = field(default_factory=dict)
    swivels: Mapping[str, SwivelSpec] = field(default_factory=dict)
    track: float | None = None
    point: tuple[float, float] | None = None
    steering: str = "ackermann"


def read_drive(path: str | Path) -> DriveSpec:
    """Read a drive file.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    return toml.read(path, lambda data, faults: _Reader(faults).drive(data), "a drive file")


class _Reader:
    """Reads a drive file's tables, and collects their faults."""

    def __init__(self, faults: list[str]) -> None:
        self.faults = faults

    def drive(self, data: dict[str, Any]) -> DriveSpec:
        self._known(data, DRIVE_KEYS, "", "a drive file")
        kind = self._choice(data, "type", DRIVE_TYPES, "")
        if "type" not in data:
            self.faults.append(f"type is missing; use one of {', '.join(DRIVE_TYPES)}")
        track, point = self._length(data, "track", ""), data.get("point")
        for name in ("track", "point"):
            if name in data and kind != "skid-steer":
                self.faults.append(f"{name} is of skid-steer drives only; leave it out")
        if point is not None and not _pair(point):
            self.faults.append(f"point is {point!r}; give [x, y] in m")
        for name in ("wheel", "swivel"):
            if name in data and kind == "fixed":
                self.faults.append(f"a fixed base has no {name}; leave [[{name}]] out")
        if "steering" in data and kind != "car-like":
            self.faults.append("steering is of car-like drives only; leave it out")
        return DriveSpec(
            type=kind,
            wheels={
                name: self._wheel(where, t, kind) for where, name, t in self._tables(data, "wheel")
            },
            swivels={
                name: self._swivel(where, t) for where, name, t in self._tables(data, "swivel")
            },
            track=track,
            point=(float(point[0]), float(point[1])) if _pair(point) else None,
            steering=self._choice(data, "steering", STEERING_MODES, "") or STEERING_MODES[0],
        )

    def _wheel(self, where: str, table: dict[str, Any], kind: str | None) -> WheelSpec:
        self._known(table, ("joint", "radius", "roller_deg", "driven"), where, "a wheel")
        roller = table.get("roller_deg")
        if roller is not None and kind != "mecanum":
            self.faults.append(f"{where}roller_deg is of mecanum drives only; leave it out")
        if roller is not None and not (is_number(roller) and abs(roller) < 90.0):
            self.faults.append(f"{where}roller_deg is {roller!r}; give degrees between -90 and 90")
            roller = None
        return WheelSpec(
            radius=self._length(table, "radius", where),
            roller=None if roller is None else math.radians(roller),
            driven=self._flag(table, "driven", where),
        )

    def _swivel(self, where: str, table: dict[str, Any]) -> SwivelSpec:
        self._known(table, ("joint", "role", "driven"), where, "a swivel")
        return SwivelSpec(
            self._choice(table, "role", SWIVEL_ROLES, where), self._flag(table, "driven", where)
        )

    def _tables(self, data: dict[str, Any], key: str) -> Iterable[tuple[str, str, dict[str, Any]]]:
        """Yield the tables of an array: what to call each, its joint, and itself."""
        tables = data.get(key, [])
        if not isinstance(tables, list):
            self.faults.append(f"{key} is one table; write [[{key}]] before each")
            return
        seen = set()
        for number, table in enumerate(tables, start=1):
            where = f"{key} {number}"
            if not isinstance(table, dict):
                self.faults.append(f"{where} is not a table; write [[{key}]] before it")
                continue
            joint = table.get("joint")
            if not isinstance(joint, str) or not joint:
                self.faults.append(f'{where} has no joint; write joint = "NAME"')
                continue
            if joint in seen:
                self.faults.append(f'{where}: joint "{joint}" is named twice')
            seen.add(joint)
            yield f"{where}: ", joint, table

    def _known(self, table: dict[str, Any], keys: Collection[str], where: str, what: str) -> None:
        listed = ", ".join(keys)
        self.faults += [
            f'{where}"{key}" is not known; {what} has {listed}' for key in table if key not in keys
        ]

    def _choice(
        self, table: dict[str, Any], key: str, choices: Collection[str], where: str
    ) -> str | None:
        value = table.get(key)
        if value is not None and value not in choices:
            self.faults.append(f"{where}{key} is {value!r}; use one of {', '.join(choices)}")
            return None
        return value

    def _length(self, table: dict[str, Any], key: str, where: str) -> float | None:
        value = table.get(key)
        if value is None:
            return None
        if not is_number(value) or value <= 0:
            self.faults.append(f"{where}{key} is {value!r}; give a positive number of metres")
            return None
        return float(value)

    def _flag(self, table: dict[str, Any], key: str, where: str) -> bool | None:
        value = table.get(key)
        if value is not None and not isinstance(value, bool):
            self.faults.append(f"{where}{key} is {value!r}; give true or false")
            return None
        return value


def _pair(value: Any) -> TypeGuard[list[float]]:
    return isinstance(value, list) and len(value) == 2 and all(map(is_number, value))


def suggest(
    kind: str, wheels: Mapping[str, float | None], swivels: Mapping[str, str] | None = None
) -> str:
    """Return a drive file to start from.

    Args:
        kind: Type of the drive.
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
