"""Robots of the wild: URDFs in parts, and a folder to load them from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.errors import DescriptionError, DriveError, UnknownNameError
from tests.robots import write
from tests.vehicles import Parts, rear_axle

TRANSMISSION = """<transmission name="{0}_drive"><type>simple</type><joint name="{0}"/>
  <actuator name="{0}_motor"/></transmission>"""


@dataclass(frozen=True)
class Files:
    """A folder for URDFs and drive files."""

    folder: Path

    def load(self, parts: Parts | str, drive: str = "", **options: object) -> Robot:
        xml = (
            parts if isinstance(parts, str) else f'<robot name="wild">{"".join(parts.xml)}</robot>'
        )
        path = write(self.folder, xml)
        drive_source = write(self.folder, drive, "drive.toml") if "=" in drive else drive or None
        return rpctl.load(path, drive=drive_source, **options)  # type: ignore[arg-type]

    def refusal(self, parts: Parts | str, drive: str = "", **options: object) -> str:
        with pytest.raises((DriveError, DescriptionError, UnknownNameError)) as caught:
            self.load(parts, drive, **options)
        return str(caught.value)


def body(z: float = 0.25, height: float = 0.3) -> Parts:
    """Return a base with a box for a body, without an arm; the ground is at z = 0."""
    parts = Parts([])
    shape = f'<collision><origin xyz="0 0 {z}"/><geometry><box size="0.6 0.4 {height}"/>'
    parts.link("base", 25.0, f"{shape}</geometry></collision>")
    return parts


def meshed(parts: Parts, name: str, xyz: str, axis: str = "0 1 0") -> None:
    """Add a wheel that only a mesh tells of, which is not there."""
    shape = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
    parts.link(f"{name}_link", 1.0, shape)
    parts.joint(name, "continuous", ("base", f"{name}_link"), xyz, axis)


def xml(parts: Parts) -> str:
    return f'<robot name="wild">{"".join(parts.xml)}</robot>'


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
