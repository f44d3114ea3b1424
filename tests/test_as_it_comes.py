"""A robot as it stands in a workspace: one call inspects it, one tracks with defaults."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rpctl.cli.app import app
from tests.workspaces import package, xacro

WHEEL = """
<xacro:macro name="wheel" params="name parent x y kind:=''">
  <link name="${name}${kind}_link">
    <visual><geometry>
      <mesh filename="package://wheels_description/meshes/wheel${kind}.stl"/>
    </geometry></visual>
    <collision><origin rpy="1.5708 0 0"/>
      <geometry><cylinder radius="0.1" length="0.05"/></geometry></collision>
    <inertial><mass value="1"/>
      <inertia ixx="0.003" iyy="0.005" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="${name}_joint" type="continuous">
    <parent link="${parent}"/><child link="${name}${kind}_link"/>
    <origin xyz="${x} ${y} 0.1"/><axis xyz="0 1 0"/>
    <limit effort="12" velocity="15"/>
  </joint>
</xacro:macro>
"""
BODY = """
<link name="base_link">
  <visual><origin xyz="0 0 0.2"/><geometry>
    <mesh filename="package://rover_description/meshes/body.dae"/></geometry></visual>
  <collision><origin xyz="0 0 0.2"/><geometry><box size="0.6 0.4 0.2"/></geometry></collision>
  <inertial><origin xyz="0 0 0.15"/><mass value="25"/>
    <inertia ixx="0.6" iyy="1" izz="1.2" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
"""
FOUR_WHEELS = """
<xacro:arg name="kind" default=""/>
<xacro:arg name="plugin" default="skid_steer_drive"/>
<xacro:include filename="$(find lidar_description)/urdf/lidar.urdf.xacro"/>
<xacro:include filename="$(find wheels_description)/urdf/wheel.xacro"/>
<link name="rocker">
  <inertial><mass value="1"/><inertia ixx="0.02" iyy="0.01" izz="0.02" ixy="0" ixz="0" iyz="0"/>
  </inertial>
</link>
<joint name="front_rocker" type="revolute">
  <parent link="base_link"/><child link="rocker"/><origin xyz="0.2 0 0"/><axis xyz="1 0 0"/>
  <limit lower="-0.1" upper="0.1" effort="0" velocity="0"/>
</joint>
<xacro:wheel name="front_left" parent="rocker" x="0" y="0.25" kind="$(arg kind)"/>
<xacro:wheel name="front_right" parent="rocker" x="0" y="-0.25" kind="$(arg kind)"/>
<xacro:wheel name="rear_left" parent="base_link" x="-0.2" y="0.25" kind="$(arg kind)"/>
<xacro:wheel name="rear_right" parent="base_link" x="-0.2" y="-0.25" kind="$(arg kind)"/>
<xacro:lidar parent="base_link"/>
<gazebo><plugin name="drive" filename="libgazebo_ros_$(arg plugin).so">
  <wheelSeparation>0.62</wheelSeparation><wheelDiameter>0.2</wheelDiameter></plugin></gazebo>
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Packages at two depths; meshes and the lidar's package are missing."""
    source = tmp_path / "ws" / "src"
    wheels = package(source / "vendor" / "parts" / "wheel_files", "wheels_description")
    xacro(wheels / "urdf" / "wheel.xacro", WHEEL)
    rover = package(source / "rover" / "rover_description")
    xacro(rover / "urdf" / "rover.urdf.xacro", BODY, FOUR_WHEELS)
    return source


def answer(*words: str) -> dict[str, Any]:
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def messages(known: dict[str, Any]) -> str:
    return "\n".join(finding["message"] for finding in known["findings"])


@pytest.mark.parametrize(
    ("words", "drive"), [((), "skid-steer"), (("kind:=_mecanum", "plugin:=planar_move"), "mecanum")]
)
@pytest.mark.slow
def test_a_rover_on_four_wheels(
    workspace: Path, tmp_path: Path, words: tuple[str, ...], drive: str
) -> None:
    path = str(workspace / "rover" / "rover_description" / "urdf" / "rover.urdf.xacro")
    call = (path, *words, "--ignore-missing-packages")
    known = answer("inspect", *call)
    assert known["drive"]["type"] == drive
    assert [wheel["radius"] for wheel in known["drive"]["wheels"]] == 4 * [0.1]
    assert known["end_effector"] is None
    assert known["locked"] == {"front_rocker": 0.0}
    told = messages(known)
    assert '"front_rocker" is a passive suspension' in told
    assert 'package "lidar_description" was not found' in told
    assert drive == "mecanum" or "0.62 m apart" in told
    if words:  # mecanum wheels track in the walk
        return
    summary = answer("track", *call, "--samples", "0", "--out", str(tmp_path / "run"))
    assert summary["outcome"] == "tracked"
    assert summary["limits_violated"] == []
    assert summary["final_base_error"] < 1e-3
