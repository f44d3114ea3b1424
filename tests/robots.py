"""Small URDFs written for tests: a platform of known parameters, with more parts on demand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf.reader import read
from rpctl.drive.detect import detect
from rpctl.drive.drive import DriveSpec
from rpctl.robot.load import load
from rpctl.robot.model import Robot
from rpctl.robot.vary import with_losses
from tests import urdf


def free_caster(*shapes: str) -> str:
    """Return a caster on the base: a fork that swivels and its roller, of these shapes."""
    parts = [
        urdf.link("fork", urdf.inertial(0.4, (0.001, 0.001, 0.0012), xyz="-0.03 0 0")),
        urdf.joint("swivel", "continuous", ("base", "fork"), "0.5 0.02 0.1", "0 0 1"),
        urdf.link("roller", urdf.inertial(0.3, (0.0003, 0.0005, 0.0003)), *shapes),
        urdf.joint("roller_joint", "continuous", ("fork", "roller"), "-0.06 0 -0.05", "0 1 0"),
    ]
    return "\n".join(parts)


def ball(
    x: float,
    y: float = 0.0,
    z: float = 0.05,
    name: str = "ball",
    role: str = "collision",
    parent: str = "base",
) -> str:
    """Return a massless support of radius 5 cm, its centre at (x, y, z) in its parent, m."""
    sphere = urdf.link(name, urdf.shape('sphere radius="0.05"', role))
    return f"{sphere}\n{urdf.joint(f'{name}_joint', 'fixed', (parent, name), (x, y, z))}"


def cargo(mass: float, x: float, y: float, z: float) -> str:
    """Return a point mass (kg) fixed to the base at (x, y, z), m."""
    point = urdf.link("cargo", urdf.inertial(mass, (0, 0, 0)))
    return f"{point}\n{urdf.joint('cargo_joint', 'fixed', ('base', 'cargo'), (x, y, z))}"


def wheel(
    name: str, place: tuple[float, float], sign: int, parameters: Mapping[str, float]
) -> tuple[str, str]:
    """Return a platform's wheel (link and joint) at a place (x, y), m, its axis to the left or not.

    Its link is called ``NAME_wheel``, its joint ``NAME_joint``; see :func:`platform`.
    """
    m_w, I_s, I_d, r = (parameters[key] for key in ("m_w", "I_s", "I_d", "r"))
    tyre = urdf.shape(f'cylinder radius="{r}" length="0.04"', rpy=urdf.ROUND)
    ends = "base", f"{name}_wheel"
    return (
        urdf.link(ends[1], urdf.inertial(m_w, (I_d, I_s, I_d)), tyre),
        urdf.joint(f"{name}_joint", "continuous", ends, (*place, r), (0, sign, 0)),
    )


def platform(parameters: Mapping[str, float], *, right_sign: int = 1, extra: str = "") -> str:
    """Return a differential-drive platform: symbols as in the design's closed form."""
    d, m_c, I_c, b = (parameters[key] for key in ("d", "m_c", "I_c", "b"))
    return urdf.robot(
        "platform",
        urdf.link("base", urdf.inertial(m_c, (I_c, I_c, I_c), xyz=(d, 0, 0.2))),
        *wheel("left", (0, b), 1, parameters),
        *wheel("right", (0, -b), right_sign, parameters),
        extra,
    )


def four_wheels(folder: Path, kind: str) -> Robot:
    """Return a robot on four fixed wheels: a skid-steer or a mecanum drive, with an arm joint."""
    b = SET_A["b"]
    inertia = urdf.inertial(3, (0.1, 0.1, 0.1), (0.01, 0, 0), "0.2 0.1 0.3")
    limit = urdf.limit(-2, 2, 30, 2)
    ends, place, turn = ("base", "arm"), "0.1 0.05 0.4", "0.3 0.2 0"
    parts = [
        *wheel("rear_left", (-0.9, b), 1, SET_A),
        *wheel("rear_right", (-0.9, -b), 1, SET_A),
        urdf.link("arm", inertia),
        urdf.joint("arm_joint", "revolute", ends, place, "0 0 1", limit, turn),
    ]
    path = write(folder, platform(SET_A, right_sign=-1, extra="\n".join(parts)), f"{kind}.urdf")
    return load(path, drive=detect(FrozenTree(read(path)), DriveSpec(kind)))


SET_A = {"m_c": 30.0, "I_c": 15.625, "d": 0.3, "m_w": 1.0, "I_s": 0.005, "I_d": 0.0025}
SET_A |= {"b": 0.75, "r": 0.15}
SET_B = {"m_c": 16.0, "I_c": 0.0537, "d": 0.05, "m_w": 0.25, "I_s": 0.0011, "I_d": 0.0023}
SET_B |= {"b": 0.24, "r": 0.095}


def write(folder: Path, text: str, name: str = "robot.urdf") -> Path:
    """Write a URDF into a folder and return its path."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def add_losses(robot: Robot, damping: Mapping[str, float], friction: Mapping[str, float]) -> Robot:
    """Return a robot with more damping (N·m·s/rad, N·s/m) and friction (N·m, N) by joint."""
    known = np.zeros((2, robot.nv))
    if robot.losses is not None:
        known += robot.losses.damping, robot.losses.friction
    for row, added in zip(known, (damping, friction), strict=True):
        for name, more in added.items():
            row[robot.velocity_index(name)] += more
    return with_losses(robot, *known)
