"""A robot drives a circle faster and faster on ice, until its tyres let go.

The share of the grip that the motion needs is predicted from wheels that only roll. On tyres the
same motion takes some slip, and beyond all of the grip the robot slides out of the circle.

Usage: python demos/slipping.py [speeds in m/s, four if left out]
"""

import sys

import numpy as np

import rpctl

FRICTION, RADIUS = 0.1, 0.6  # of tyres on ice; m: no wheel is asked more than its limit
SPEEDS = (0.4, 0.5, 0.55, 0.6)  # m/s


def main(*speeds: float) -> None:
    robot = rpctl.load("paper")
    print("speed m/s   grip needed   slip of a tyre mm/s   off the circle mm   outcome")
    for speed in speeds or SPEEDS:
        rolling, slipping = (
            rpctl.track(
                robot,
                "circle",
                plant=plant,
                friction=FRICTION,
                size=RADIUS,
                speed=speed,
                duration=6.0,
                collisions=False,
            )
            for plant in ("ideal", "slipping")
        )
        needed = rpctl.summarize(rolling).ground.max_slip_ratio or 0.0
        slip = np.hypot(*slipping.log.wheel_slip.T).max()
        found = rpctl.summarize(slipping)
        print(
            f"{speed:9.2f}   {100.0 * needed:9.0f} %   {1e3 * slip:19.1f}"
            f"   {1e3 * found.final_base_error:17.1f}   {found.outcome}"
        )


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
