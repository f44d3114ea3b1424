"""A TurtleBot3 Burger by /cmd_vel at 20 Hz, which it obeys a tenth of a second late.

Its dimensions are those of ROBOTIS: a track of 160 mm, wheels of 33 mm, .22 m/s, 2.84 rad/s.

Usage: python demos/turtlebot.py [SECONDS, 24 if left out]
"""

import sys
from pathlib import Path

from on_a_robot import Story, draw

import rpctl

PERIOD = 0.05  # s
URDF = Path(__file__).with_name("burger.urdf")


def main(duration: float = 24.0) -> None:
    robot = rpctl.load(URDF)
    plant = rpctl.Plant(
        kind="contact",
        contact=rpctl.ContactSettings(wheel_shape="crowned"),  # narrow tyres scrub little
        lag=0.06,  # s
        dead_time=0.1,  # s
        encoder_bits=12,
        noise=rpctl.Noise(position=0.003, heading=0.005),  # m, rad
    )
    bounds = {
        "speeds": {"v": 0.2, "omega": 2.0},
        "accelerations": {"v": 0.8, "omega": 6.0},
        "jerks": {"v": 8.0, "omega": 60.0},
    }
    runs = [
        rpctl.track(
            robot,
            "eight",
            output={"base": rpctl.OutputGroup("twist", lag, dead_time, **bounds)},
            plant=plant,
            control_period=PERIOD,
            initial_error=(0.05, 0.1, 0.3),
            size=0.5,
            speed=0.16,
            duration=duration,
            collisions=False,
        )
        for lag, dead_time in ((0.06, 0.1), (0.0, 0.0))
    ]
    story = Story(
        "A TurtleBot3 Burger by twist at 20 Hz, 100 ms late",
        (
            "MuJoCo: crowned wheels roll by friction, driven by servos of speed within 1.5 N·m; a "
            "dead time of 100 ms, then a lag of 60 ms.",
            "Measured: pose with 3 mm and 5 mrad of noise, speeds from encoders of 12 bits, at "
            "20 Hz. Orange: a controller that is told of no lateness, and learns it as it drives.",
        ),
        robot,
        *runs,
    )
    draw(story, Path("turtlebot.png"))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
