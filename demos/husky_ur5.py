"""A Husky with a UR5 on its deck: the base by twist, the arm by positions, at 50 Hz.

The base is drawn here with the dimensions that its maker publishes; the arm is the catalogue's UR5,
joined to it. A skid-steer base scrubs, and turns as on a wider track: 2.2 times as wide in this
contact, which is declared.

Usage: python demos/husky_ur5.py [SECONDS, 16 if left out]
"""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from on_a_robot import Story, draw

import rpctl
from rpctl.robot.catalog import find

TRACK, WHEELBASE, RADIUS = 0.5708, 0.512, 0.1651  # m
TURNS_AS = 2.2 * TRACK  # m
DRIVE = f"""
type = "skid-steer"
track = {TURNS_AS}
"""
BASE = """
<robot name="husky_ur5">
  <link name="husky_base">
    <inertial><origin xyz="-0.01 0 0.16"/><mass value="46"/>
      <inertia ixx="0.73" ixy="0" ixz="0" iyy="1.66" iyz="0" izz="2.03"/></inertial>
    <visual><origin xyz="0 0 0.12"/><geometry><box size="0.99 0.42 0.25"/></geometry></visual>
  </link>
  <joint name="deck_joint" type="fixed">
    <parent link="husky_base"/><child link="base_link"/><origin xyz="0.05 0 0.3"/></joint>
</robot>
"""
WHEEL = f"""
<parts>
  <link name="wheel_{{name}}">
    <inertial><mass value="2.6"/>
      <inertia ixx="0.025" ixy="0" ixz="0" iyy="0.044" iyz="0" izz="0.025"/></inertial>
    <collision><origin rpy="1.5707963 0 0"/>
      <geometry><cylinder radius="{RADIUS}" length="0.114"/></geometry></collision>
  </link>
  <joint name="wheel_{{name}}_joint" type="continuous">
    <parent link="husky_base"/><child link="wheel_{{name}}"/>
    <origin xyz="{{x}} {{y}} 0.033"/><axis xyz="0 1 0"/><limit effort="60" velocity="8"/>
  </joint>
</parts>
"""
TWIST = rpctl.OutputGroup(
    "twist",
    lag=0.1,  # s
    dead_time=0.06,  # s
    speeds={"v": 0.8, "omega": 1.2},
    accelerations={"v": 1.5, "omega": 3.0},
    jerks={"v": 20.0, "omega": 40.0},
)
ARM = rpctl.OutputGroup(
    "position",
    lag=0.02,  # s
    dead_time=0.02,  # s
    speeds={"*": 1.0},
    accelerations={"*": 3.0},
    jerks={"*": 60.0},
)
HOME = {"shoulder_lift_joint": -1.9, "elbow_joint": 1.9, "wrist_1_joint": -1.2,
        "wrist_2_joint": -1.4, "wrist_3_joint": 0.3}  # rad  # fmt: skip


def husky() -> rpctl.Robot:
    """Return the robot: the base, its wheels, and the links and joints of the arm's file."""
    robot = ElementTree.fromstring(BASE)
    for name, ahead, left in (("fl", 1, 1), ("fr", 1, -1), ("rl", -1, 1), ("rr", -1, -1)):
        x, y = 0.5 * ahead * WHEELBASE, 0.5 * left * TRACK
        robot.extend(ElementTree.fromstring(WHEEL.format(name=name, x=x, y=y)))
    file = find("ur5").path
    for part in ElementTree.parse(file).getroot():
        if part.tag in ("link", "joint") and part.get("name") not in ("world", "world_joint"):
            robot.append(part)
    with tempfile.TemporaryDirectory() as folder:
        whole, drive = Path(folder, "husky_ur5.urdf"), Path(folder, "drive.toml")
        ElementTree.ElementTree(robot).write(whole)
        drive.write_text(DRIVE)
        return rpctl.load(whole, drive=drive, home=HOME, package_dirs=[str(file.parents[4])])


def main(duration: float = 16.0) -> None:
    robot = husky()
    plant = rpctl.Plant(
        kind="contact",
        contact=rpctl.ContactSettings(wheel_shape="crowned"),
        encoder_bits=14,
        noise=rpctl.Noise(position=0.004, heading=0.003),  # m, rad
    )
    run = rpctl.track(
        robot,
        "eight",
        output={"base": TWIST, "*": ARM},
        plant=plant,
        control_period=0.02,
        initial_error=(0.1, 0.15, 0.2),
        size=2.0,
        speed=0.45,
        duration=duration,
        collisions=False,
    )
    story = Story(
        "A Husky with a UR5 by twist and joint positions at 50 Hz",
        (
            "MuJoCo: four crowned wheels that scrub in every bend, as on 2.2 times the track; "
            "the base obeys after 60 ms with a lag of 100 ms, the arm after 20 ms with 20 ms.",
            "Measured: pose with 4 mm and 3 mrad of noise, joints and wheels by encoders of 14 "
            "bits; rates are their differences.",
        ),
        robot,
        run,
    )
    draw(story, Path("husky_ur5.png"))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
