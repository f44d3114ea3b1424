"""TIAGo as its ROS controllers take it: the base by twist, the arm by positions, at 100 Hz.

The base obeys later than the arm; each is predicted over its own dead time.

Usage: python demos/tiago_arm.py [SECONDS, 14 if left out]
"""

import sys
from pathlib import Path

from on_a_robot import Story, draw

import rpctl

BASE = rpctl.OutputGroup(
    "twist",
    lag=0.08,  # s
    dead_time=0.05,  # s
    speeds={"v": 1.0, "omega": 1.5},
    accelerations={"v": 1.0, "omega": 2.5},
    jerks={"v": 10.0, "omega": 25.0},
)
ARM = rpctl.OutputGroup(
    "position",
    lag=0.03,  # s
    dead_time=0.01,  # s
    speeds={"torso_*": 0.07, "*_[1-7]_joint": 1.0},
    accelerations={"torso_*": 0.2, "*_[1-7]_joint": 3.0},
    jerks={"torso_*": 4.0, "*_[1-7]_joint": 60.0},
)


def main(duration: float = 14.0) -> None:
    plant = rpctl.Plant(
        kind="contact",
        encoder_bits=14,
        noise=rpctl.Noise(position=0.002, heading=0.002),  # m, rad
    )
    robot = rpctl.load("tiago")
    run = rpctl.track(
        robot,
        "eight",
        output={"base": BASE, "*": ARM},
        plant=plant,
        control_period=0.01,
        initial_error=(0.1, -0.1, 0.2),
        duration=duration,
        collisions=False,
    )
    story = Story(
        "TIAGo by twist and joint positions at 100 Hz",
        (
            "MuJoCo: wheels that scrub and servos within the URDF's efforts; the base obeys after "
            "50 ms with a lag of 80 ms, the arm after 10 ms with a lag of 30 ms.",
            "Measured: pose with 2 mm and 2 mrad of noise, joints and wheels by encoders of 14 "
            "bits; rates are their differences.",
        ),
        robot,
        run,
    )
    draw(story, Path("tiago_arm.png"))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
