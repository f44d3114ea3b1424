"""Small robots, short runs, and what the commands of a scene hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import rpctl
from rpctl import Robot, Run
from rpctl.control.obstacles import Obstacle

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


FINGER = """
  <link name="{side}_finger">
    <inertial><origin xyz="0.1 0 0"/><mass value="0.2"/><inertia ixx="0.001" iyy="0.002"
      izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.02 0.06"/></geometry></visual>
  </link>
  <joint name="{side}_finger_joint" type="revolute">
    <parent link="lift"/><child link="{side}_finger"/>
    <origin xyz="0.05 {y} 0.02" rpy="0.1 -0.2 0.3"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-1" upper="1.2" effort="5" velocity="2"/>{mimic}
  </joint>
"""
LIFT = """
  <link name="lift">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"
      ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.1 0.1 0.3"/></geometry></visual>
  </link>
  <joint name="lift_joint" type="prismatic">
    <parent link="base"/><child link="lift"/><origin xyz="0.1 0 0.4" rpy="0 0.3 0"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="0.5" effort="100" velocity="1"/>
  </joint>
"""
MIMIC = '<mimic joint="left_finger_joint" multiplier="-0.5" offset="0.1"/>'
GRIPPER = (
    LIFT
    + FINGER.format(side="left", y=0.06, mimic="")
    + FINGER.format(side="right", y=-0.06, mimic=MIMIC)
)


def write_gripper(folder: Path) -> Path:
    """Write the URDF of the cart with a lift and a gripper, one finger of which follows."""
    path = write_cart(folder, name="gripper")
    path.write_text(path.read_text().replace("</robot>", GRIPPER + "</robot>"))
    return path


def mesh_visual(filename: str, scale: str = "1 1 1") -> str:
    return f'<visual><geometry><mesh filename="{filename}" scale="{scale}"/></geometry></visual>'


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
