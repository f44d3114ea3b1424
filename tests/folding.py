"""A small mobile base whose two-link arm can reach the ground, its own base and what is around."""

from __future__ import annotations

from pathlib import Path

import rpctl
from rpctl import Robot
from tests import urdf
from tests.robots import write

FREE = urdf.limit(-3.1, 3.1, 60, 3)
HOME = {"shoulder": -0.3, "elbow": 0.6}  # rad: the arm points ahead and up, bent


def link(name: str, mass: float, *shapes: str, xyz: str = "") -> str:
    """Return a link of this mass (kg), centre and shapes."""
    return urdf.link(name, urdf.inertial(mass, (0.02, 0.03, 0.03), xyz=xyz), *shapes)


def folding(
    folder: Path, *more: str, forearm: str = 'capsule radius="0.03" length="0.3"', **home: float
) -> Robot:
    """Return the robot: upper arm and forearm pitch, 0.4 m each, from 0.4 m above the ground.

    Args:
        folder: Where to write its URDF.
        more: Further parts.
        forearm: Geometry of the forearm, along z about its middle.
        home: Of further joints, rad or m.
    """
    along = "0 1.5707963267948966 0"
    tyre = urdf.shape('cylinder radius="0.1" length="0.03"', rpy=urdf.ROUND)
    wheels = [
        part
        for wheel, y in (("left_wheel", 0.18), ("right_wheel", -0.18))
        for part in (
            link(wheel, 1.0, tyre),
            urdf.joint(f"{wheel}_joint", "continuous", ("base", wheel), (0, y, 0.1), "0 1 0"),
        )
    ]
    arm = 'capsule radius="0.03" length="0.3"'
    text = urdf.robot(
        "folding",
        link("base", 20.0, urdf.shape('box size="0.5 0.3 0.16"', xyz="0 0 0.15"), xyz="-0.1 0 0.1"),
        *wheels,
        link("caster", 0.2, urdf.shape('sphere radius="0.03"')),
        urdf.joint("caster_joint", "fixed", ("base", "caster"), (-0.2, 0, 0.03)),
        link("column", 1.0, urdf.shape('cylinder radius="0.05" length="0.15"', xyz="0 0 0.3")),
        urdf.joint("column_joint", "fixed", ("base", "column")),
        link("upper", 1.5, urdf.shape(arm, xyz="0.2 0 0", rpy=along), xyz="0.2 0 0"),
        urdf.joint("shoulder", "revolute", ("base", "upper"), (0, 0, 0.4), "0 1 0", FREE),
        link("forearm", 1.0, urdf.shape(forearm, xyz="0.2 0 0", rpy=along), xyz="0.2 0 0"),
        urdf.joint("elbow", "revolute", ("upper", "forearm"), (0.4, 0, 0), "0 1 0", FREE),
        *more,
    )
    return rpctl.load(write(folder, text, "folding.urdf"), home={**HOME, **home})
