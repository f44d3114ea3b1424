"""Small URDFs written for tests: a platform of known parameters, with more parts on demand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf import read
from rpctl.drive.detect import detect
from rpctl.drive.drive_file import DriveSpec
from rpctl.robot.load import load
from rpctl.robot.model import Robot

WHEEL = """
  <link name="{side}_wheel">
    <inertial>
      <mass value="{m_w}"/>
      <inertia ixx="{I_d}" ixy="0" ixz="0" iyy="{I_s}" iyz="0" izz="{I_d}"/>
    </inertial>
    <collision>
      <origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="{r}" length="0.04"/></geometry>
    </collision>
  </link>
  <joint name="{side}_joint" type="continuous">
    <parent link="base"/><child link="{side}_wheel"/>
    <origin xyz="0 {y} {r}"/><axis xyz="0 {sign} 0"/>
  </joint>"""

CASTER = """
  <link name="fork">
    <inertial><origin xyz="-0.03 0 0"/><mass value="0.4"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.0012"/></inertial>
  </link>
  <joint name="swivel" type="continuous">
    <parent link="base"/><child link="fork"/><origin xyz="0.5 0.02 0.1"/><axis xyz="0 0 1"/>
  </joint>
  <link name="roller">
    <inertial><mass value="0.3"/>
      <inertia ixx="0.0003" ixy="0" ixz="0" iyy="0.0005" iyz="0" izz="0.0003"/></inertial>
  </link>
  <joint name="roller_joint" type="continuous">
    <parent link="fork"/><child link="roller"/>
    <origin xyz="-0.06 0 -0.05"/><axis xyz="0 1 0"/>
  </joint>"""

BALL = """
  <link name="{name}">
    <{role}><geometry><sphere radius="0.05"/></geometry></{role}>
  </link>
  <joint name="{name}_joint" type="fixed">
    <parent link="{parent}"/><child link="{name}"/><origin xyz="{x} {y} {z}"/>
  </joint>"""


def ball(
    x: float,
    y: float = 0.0,
    z: float = 0.05,
    name: str = "ball",
    role: str = "collision",
    parent: str = "base",
) -> str:
    """Return a massless support of radius 5 cm, its centre at (x, y, z) in its parent, m."""
    return BALL.format(x=x, y=y, z=z, name=name, role=role, parent=parent)


def cargo(mass: float, x: float, y: float, z: float) -> str:
    """Return a point mass fixed to the base."""
    return f"""
  <link name="cargo">
    <inertial><mass value="{mass}"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>
  </link>
  <joint name="cargo_joint" type="fixed">
    <parent link="base"/><child link="cargo"/><origin xyz="{x} {y} {z}"/>
  </joint>"""


def platform(parameters: Mapping[str, float], *, right_sign: int = 1, extra: str = "") -> str:
    """Return a differential-drive platform: symbols as in the design's closed form."""
    wheels = "".join(
        WHEEL.format(side=side, y=y, sign=sign, **parameters)
        for side, y, sign in (("left", parameters["b"], 1), ("right", -parameters["b"], right_sign))
    )
    d, m_c, I_c = (parameters[key] for key in ("d", "m_c", "I_c"))
    return f"""<robot name="platform">
  <link name="base">
    <inertial>
      <origin xyz="{d} 0 0.2"/><mass value="{m_c}"/>
      <inertia ixx="{I_c}" ixy="0" ixz="0" iyy="{I_c}" iyz="0" izz="{I_c}"/>
    </inertial>
  </link>{wheels}{extra}
</robot>
"""


def four_wheels(folder: Path, kind: str) -> Robot:
    """Return a robot on four fixed wheels: a skid-steer or a mecanum drive, with an arm joint."""
    rear = platform(SET_A)
    rear = rear[rear.index('<link name="left_wheel">') : rear.index("</robot>")]
    rear = rear.replace("left_", "rear_left_").replace("right_", "rear_right_")
    rear = rear.replace('origin xyz="0 ', 'origin xyz="-0.9 ')
    arm = """<link name="arm"><inertial><origin xyz="0.2 0.1 0.3"/><mass value="3"/>
      <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
      <joint name="arm_joint" type="revolute"><parent link="base"/><child link="arm"/>
      <origin xyz="0.1 0.05 0.4" rpy="0.3 0.2 0"/><axis xyz="0 0 1"/>
      <limit lower="-2" upper="2" effort="30" velocity="2"/></joint>"""
    path = write(folder, platform(SET_A, right_sign=-1, extra=rear + arm), f"{kind}.urdf")
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
