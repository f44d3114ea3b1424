"""Small arms on a fixed base, for what hangs on their ends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rpctl
from rpctl import Robot
from tests import urdf

AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")  # of an arm, from its base on
LENGTH_M = 0.3
BEND = urdf.limit(-2.5, 2.5, 50, 2)
GRASP = urdf.limit(0.0, 0.04, 20, 0.1)


def body(name: str, mass: float, length: float = 0.05, shape: bool = True) -> str:
    """Return a link, a rod along x (kg, m)."""
    moments = (1e-3 * mass, mass * length**2 / 3.0, mass * length**2 / 3.0)
    middle = (0.5 * length, 0.0, 0.0)
    box = urdf.shape(f'box size="{length} 0.04 0.04"', xyz=middle) if shape else ""
    return urdf.link(name, urdf.inertial(mass, moments, xyz=middle), box)


def limb(
    name: str,
    parent: str,
    axis: urdf.Numbers,
    more: str = GRASP,
    kind: str = "prismatic",
    xyz: urdf.Numbers = "",
    size: tuple[float, float] = (0.05, 0.05),
) -> str:
    """Return a link and the joint that moves it, called ``NAME_joint``.

    Args:
        name: Its name.
        parent: The link that carries it.
        axis: Of the joint.
        more: Its limit and mimic.
        kind: Of the joint.
        xyz: Where it is on its parent, m.
        size: Mass, kg, and length, m.
    """
    joint = urdf.joint(f"{name}_joint", kind, (parent, name), xyz, axis, more)
    return f"{body(name, *size)}\n{joint}"


def arm(prefix: str = "", axes: Sequence[str] = AXES[:3], base: str = "base") -> str:
    """Return rods that turn about axes, one at the end of the other, and the palm on the last."""
    parts, parent, xyz = [], base, "0 0 0.3"
    for index, axis in enumerate(axes):
        name = f"{prefix}rod_{index + 1}"
        parts.append(limb(name, parent, axis, BEND, "revolute", xyz, (1.0, LENGTH_M)))
        parent, xyz = name, f"{LENGTH_M} 0 0"
    parts.append(body(f"{prefix}palm", 0.3))
    parts.append(urdf.joint(f"{prefix}palm_joint", "fixed", (parent, f"{prefix}palm"), xyz))
    return "\n".join(parts)


def write(folder: Path, *parts: str) -> Path:
    """Write a robot of a base and these parts, and return its file."""
    path = folder / "arm.urdf"
    path.write_text(urdf.robot("arm", body("base", 10.0, 0.4), *parts), encoding="utf-8")
    return path


def load(folder: Path, *parts: str, free: Sequence[str] = ()) -> Robot:
    """Load a robot of a base that is fixed and these parts."""
    return rpctl.load(write(folder, *parts), drive="fixed", free=free)


def mimic(joint: str, multiplier: float = 1.0) -> str:
    """Return the element by which a joint follows another one."""
    return f'<mimic joint="{joint}" multiplier="{multiplier}"/>'
