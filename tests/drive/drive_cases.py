"""Robots of the wild: URDFs in parts, and a folder to load them from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.errors import DescriptionError, DriveError, UnknownNameError
from tests import urdf
from tests.robots import write
from tests.vehicles import Parts, rear_axle

TRANSMISSION = """<transmission name="{0}_drive"><type>simple</type><joint name="{0}"/>
  <actuator name="{0}_motor"/></transmission>"""


@dataclass(frozen=True)
class Files:
    """A folder for URDFs and drive files; robots load with a level root."""

    folder: Path

    def load(self, parts: Parts | str, drive: str = "", **options: object) -> Robot:
        path = write(self.folder, parts if isinstance(parts, str) else xml(parts))
        drive_source = write(self.folder, drive, "drive.toml") if "=" in drive else drive or None
        options = {"root": "planar"} | options
        return rpctl.load(path, drive=drive_source, **options)  # type: ignore[arg-type]

    def refusal(self, parts: Parts | str, drive: str = "", **options: object) -> str:
        with pytest.raises((DriveError, DescriptionError, UnknownNameError)) as caught:
            self.load(parts, drive, **options)
        return str(caught.value)


def body(z: float = 0.25, height: float = 0.3) -> Parts:
    """Return a base with a box for a body, without an arm; the ground is at z = 0."""
    parts = Parts([])
    parts.link("base", 25.0, urdf.shape(f'box size="0.6 0.4 {height}"', xyz=(0, 0, z)))
    return parts


def meshed(parts: Parts, name: str, xyz: str, axis: str = "0 1 0") -> None:
    """Add a wheel that only a mesh tells of, which is not there."""
    parts.link(f"{name}_link", 1.0, urdf.shape('mesh filename="gone.stl"', "visual"))
    parts.joint(name, "continuous", ("base", f"{name}_link"), xyz, axis)


def xml(parts: Parts) -> str:
    return parts.text("wild")


def tricycle() -> Parts:
    parts = body()
    rear_axle(parts)
    parts.swivel("steer", "0.6 0 0.3", "revolute")
    parts.wheel("front", "steer_fork", "0 0 -0.2")
    return parts


def hubs(mimic: str) -> Parts:
    parts = body()
    rear_axle(parts)
    for name, y, more in (("left", 0.25, mimic), ("right", -0.25, mimic)):
        parts.swivel(f"{name}_hub", f"0.7 {y} 0.1", "revolute", more=more)
        parts.wheel(f"front_{name}", f"{name}_hub_fork", "0 0 0")
    parts.link("cabin_wheel", 0.5)
    parts.joint("cabin_joint", "revolute", ("base", "cabin_wheel"), "0.3 0 0.6", "0.6 0 0.8")
    return parts


def axles(*places: float) -> Parts:
    parts = body()
    for k, x in enumerate(places):
        axle = Parts([])
        rear_axle(axle, x=x)
        parts.xml += [part.replace("rear", f"axle{k}") for part in axle.xml]
    return parts


def rolling_speeds(robot: Robot, nu: list[float]) -> dict[str, float]:
    """Return φ̇ r (m/s) of each wheel, forward positive."""
    S = ReducedDynamics(robot).basis(robot.configuration())
    signs = {w.joint: float(np.sign(w.axis[1])) for w in robot.drive.wheels}
    return {
        w.joint: signs[w.joint] * w.radius * float(S[robot.velocity_index(w.joint)] @ nu)
        for w in robot.drive.wheels
    }
