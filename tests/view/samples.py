"""Small robots, short runs, and what the commands of a scene hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import rpctl
from rpctl import Robot, Run

WHEEL = """
  <link name="{side}_wheel">
    <inertial><mass value="0.5"/><inertia ixx="0.001" iyy="0.002" izz="0.001"
      ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin rpy="1.5707963 0 0"/><geometry><cylinder radius="0.1" length="0.04"/>
      </geometry></visual>
    <collision><origin rpy="1.5707963 0 0"/><geometry><cylinder radius="0.1" length="0.04"/>
      </geometry></collision>
  </link>
  <joint name="{side}_wheel_joint" type="continuous">
    <parent link="base"/><child link="{side}_wheel"/><origin xyz="0 {y} 0.1"/>
    <axis xyz="0 1 0"/>
  </joint>
"""
CART = (
    """<robot name="{name}">
  <link name="base">
    <inertial><origin xyz="0 0 0.2"/><mass value="10"/><inertia ixx="0.2" iyy="0.3" izz="0.4"
      ixy="0" ixz="0" iyz="0"/></inertial>
    {visual}
  </link>
"""
    + WHEEL.format(side="left", y=0.2)
    + WHEEL.format(side="right", y=-0.2)
    + "</robot>"
)
BOX = '<visual><origin xyz="0 0 0.15"/><geometry><box size="0.5 0.3 0.1"/></geometry></visual>'


def write_cart(folder: Path, visual: str = BOX, name: str = "cart") -> Path:
    """Write the URDF of a cart on two wheels, without an arm."""
    path = folder / "cart.urdf"
    path.write_text(CART.format(visual=visual, name=name))
    return path


def mesh_visual(filename: str, scale: str = "1 1 1") -> str:
    return f'<visual><geometry><mesh filename="{filename}" scale="{scale}"/></geometry></visual>'


def short_run(robot: Robot, duration: float = 3.0) -> Run:
    based = "omega" in robot.quasi_velocities
    error = (0.15, 0.2, 0.3) if based else (0.0, 0.0, 0.0)
    return rpctl.track(robot, "eight", duration=duration, initial_error=error)


def unpack(command: bytes) -> dict[str, Any]:
    import umsgpack

    return dict(umsgpack.unpackb(command))


def numbers(array: Any, dtype: str = "float32") -> np.ndarray[Any, Any]:
    """Return the numbers of a typed array as it was sent."""
    return np.frombuffer(array.data, dtype=dtype)
