"""``LoadSettings``: what a robot was loaded with and does not tell itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from rpctl.drive.drive import Drive


class Payload(NamedTuple):
    """A load fixed to a link; see :func:`rpctl.with_payload`."""

    link: str
    mass: float  # kg
    com: tuple[float, ...]  # (3,) in the link's frame, m
    inertia: tuple[tuple[float, ...], ...]  # (3, 3) about com, along the link's axes, kg·m²


@dataclass(frozen=True)
class LoadSettings:
    """Arguments of :func:`rpctl.load` that the robot itself does not tell.

    The others are resolved in the robot's ``source``, ``drive``, ``locked`` and ``end_effector``,
    and in its description's ``read_with``.

    Attributes:
        density: Density from which missing inertias were estimated, kg/m³, or None.
        home: Positions of the arm's joints at home (rad or m), by name, where they were given
            or chosen; none where they follow from the limits.
        free: Patterns of joints that are not frozen by default.
        drive: What was said of the drive: the drive, its type or a file; None: nothing.
        payloads: Loads that it carries besides, in the order in which they were put on.
        losses: Whether the damping and friction of the file count.
        armature: Inertias of rotors by pattern of joint names, which add to those that the file
            tells; None leaves out all of them.
    """

    density: float | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    drive: Drive | str | None = None
    payloads: tuple[Payload, ...] = ()
    losses: bool = True
    armature: Mapping[str, float] | None = None
