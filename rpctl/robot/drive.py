"""Wheels and drives: what touches the ground, and which speeds of the base are free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

BASE_SPEEDS = {
    "differential": ("v", "omega"),
    "skid-steer": ("v", "omega"),
    "mecanum": ("vx", "vy", "omega"),
    "fixed": (),
}


@dataclass(frozen=True)
class Wheel:
    """A wheel on the ground.

    Attributes:
        joint: Name of its joint.
        radius: m.
        source: Where the radius came from.
        axis: Unit axle (3,) in the wheel joint's frame.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m.
        direction: Direction (x, y) in the root link's frame along which the contact point stands
            still: forward for an ordinary wheel, along the roller for a mecanum wheel.
    """

    joint: str
    radius: float
    source: str
    axis: tuple[float, float, float]
    offset: float = 0.0
    direction: tuple[float, float] = (1.0, 0.0)


@dataclass(frozen=True)
class Drive:
    """How a robot meets the ground.

    Attributes:
        type: ``"differential"``, ``"skid-steer"``, ``"mecanum"`` or ``"fixed"``.
        wheels: The wheels, front before rear and left before right.
        point: P (x, y) in the root link's frame, m: the midpoint of the fixed-wheel axle, of a
            skid-steer drive its centre of rotation.
        heading: Angle of the forward direction in the root link's frame, rad.
        track: Distance between the left and the right wheels' contact points, m.
        ground: Height of the ground in the root link's frame, m.
    """

    type: str
    wheels: tuple[Wheel, ...] = ()
    point: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    track: float = 0.0
    ground: float = 0.0

    @property
    def base_speeds(self) -> tuple[str, ...]:
        """Names of the quasi-velocities of the base."""
        return BASE_SPEEDS[self.type]

    @property
    def has_axle(self) -> bool:
        """Whether P moves along the heading only."""
        return self.base_speeds == ("v", "omega")

    @property
    def holonomic(self) -> bool:
        """Whether the base can be asked to move to any side."""
        return self.base_speeds == ("vx", "vy", "omega")

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Drive:
        """Return the drive that ``dataclasses.asdict`` took apart, lists for tuples or not."""
        wheels = (
            Wheel(**{**w, "axis": tuple(w["axis"]), "direction": tuple(w["direction"])})
            for w in values["wheels"]
        )
        return Drive(**{**values, "wheels": tuple(wheels), "point": tuple(values["point"])})


FIXED = Drive("fixed")
