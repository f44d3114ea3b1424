"""TIAGo draws a level square of 1.5 m with its end effector; nobody says where the base goes.

The square is too large for the arm, so the base's path is planned: it drives smoothly, never
sideways, and cuts the corners that the arm then makes good.
"""

import math

import rpctl


def main() -> None:
    robot = rpctl.load("tiago")
    run = rpctl.track(robot, "ee-square")
    figures = rpctl.summarize(run)
    sides = (run.log.ee.max(axis=0) - run.log.ee.min(axis=0))[:2]
    print(f"sides of {sides[0]:.3f} m and {sides[1]:.3f} m, drawn in {run.t[-1]:.1f} s")
    rms = figures.rms_end_effector_error or math.nan  # nan without an end effector
    print(f"end effector {1e3 * rms:.2f} mm rms off its reference")
    print(f"limits broken: {len(figures.limits_violated)}")


if __name__ == "__main__":
    main()
