"""Small robots, short runs, and what the commands of a scene hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import rpctl
from rpctl import Robot, Run
from rpctl.control.obstacles import Obstacle
from tests import urdf
from tests.robots import write

BOX = urdf.shape('box size="0.5 0.3 0.1"', "visual", "0 0 0.15")
TYRE = 'cylinder radius="0.1" length="0.04"'


def _cart(visual: str, name: str, *more: str) -> str:
    """Return a cart on two wheels, without an arm."""
    parts = [urdf.link("base", urdf.inertial(10, (0.2, 0.3, 0.4), xyz="0 0 0.2"), visual)]
    for side, y in (("left", 0.2), ("right", -0.2)):
        wheel = f"{side}_wheel"
        shapes = (urdf.shape(TYRE, role, rpy="1.5707963 0 0") for role in ("visual", "collision"))
        inertia = urdf.inertial(0.5, (0.001, 0.002, 0.001))
        place = f"0 {y} 0.1"
        parts += [
            urdf.link(wheel, inertia, *shapes),
            urdf.joint(f"{wheel}_joint", "continuous", ("base", wheel), place, "0 1 0"),
        ]
    return urdf.robot(name, *parts, *more)


def write_cart(folder: Path, visual: str = BOX, name: str = "cart") -> Path:
    """Write the URDF of a cart on two wheels, without an arm."""
    return write(folder, _cart(visual, name), "cart.urdf")


def _finger(side: str, y: float, mimic: str = "") -> tuple[str, str]:
    finger = f"{side}_finger"
    box = urdf.shape('box size="0.2 0.02 0.06"', "visual", "0.1 0 0")
    more = urdf.limit(-1, 1.2, 5, 2) + mimic
    ends, place, turn = ("lift", finger), f"0.05 {y} 0.02", "0.1 -0.2 0.3"
    return (
        urdf.link(finger, urdf.inertial(0.2, (0.001, 0.002, 0.002), xyz="0.1 0 0"), box),
        urdf.joint(f"{finger}_joint", "revolute", ends, place, "0 0.6 0.8", more, turn),
    )


def write_gripper(folder: Path) -> Path:
    """Write the URDF of the cart with a lift and a gripper, one finger of which follows."""
    box = urdf.shape('box size="0.1 0.1 0.3"', "visual")
    ends, limit = ("base", "lift"), urdf.limit(-0.1, 0.5, 100, 1)
    mimic = '<mimic joint="left_finger_joint" multiplier="-0.5" offset="0.1"/>'
    parts = [
        urdf.link("lift", urdf.inertial(1, (0.01, 0.01, 0.01)), box),
        urdf.joint("lift_joint", "prismatic", ends, "0.1 0 0.4", "0 0 1", limit, "0 0.3 0"),
        *_finger("left", 0.06),
        *_finger("right", -0.06, mimic),
    ]
    return write(folder, _cart(BOX, "gripper", *parts), "cart.urdf")


def mesh_visual(filename: str, scale: str = "1 1 1") -> str:
    return urdf.shape(f'mesh filename="{filename}" scale="{scale}"', "visual")


def short_run(robot: Robot, duration: float = 3.0) -> Run:
    based = "omega" in robot.quasi_velocities
    error = (0.15, 0.2, 0.3) if based else (0.0, 0.0, 0.0)
    return rpctl.track(robot, "eight", duration=duration, initial_error=error)


DISC = rpctl.Disc(1.0, 0.5, 0.25)
WALL = rpctl.HalfPlane(0.0, 2.0, -1.0)
PILLAR = rpctl.Disc(0.5, -0.5, 0.1)


def with_obstacles(run: Run, *base: Obstacle, tip: tuple[Obstacle, ...] = ()) -> Run:
    """Return a run as if its law had kept base and end effector clear of obstacles."""
    law = rpctl.Horizon(base_obstacles=base, end_effector_obstacles=tip)
    return replace(run, config=replace(run.config, kinematic=law))


def unpack(command: bytes) -> dict[str, Any]:
    import umsgpack

    return dict(umsgpack.unpackb(command))


def numbers(array: Any, dtype: str = "float32") -> np.ndarray[Any, Any]:
    """Return the numbers of a typed array as it was sent."""
    return np.frombuffer(array.data, dtype=dtype)
