"""Every kind of drive: how exactly its dynamics are known, and how well it runs a figure-eight.

The residual is the largest of the certificate's checks over 20 random states, but for those that
take differences; errors are the base's over one lap of 20 s, which starts 0.14 m and 0.1 rad off. A
fixed base moves its arm alone: there the errors are those of the end effector.

Usage: python demos/drive_table.py [drives, all if left out]
"""

import sys

import rpctl
from rpctl.drive.drive import BASE_SPEEDS
from rpctl.equivalence.certificate import DIFFERENCE_TOLERANCE
from rpctl.robot.catalog import ENTRIES

OFF = (0.1, -0.1, 0.1)  # m, m, rad
START = (0.0, 0.0, 0.0)


def main(*drives: str) -> None:
    robots = [rpctl.load(entry.name) for entry in ENTRIES if entry.own]
    print(f"{'drive':15} {'robot':13} {'residual':8} {'rms':>9} {'final':>12}")
    for drive in drives or BASE_SPEEDS:
        for robot in (robot for robot in robots if robot.drive.type == drive):
            checks = rpctl.verify(robot, samples=20).checks
            residual = max(check.residual for check in checks if check.limit < DIFFERENCE_TOLERANCE)
            part = "base" if robot.drive.wheels else "end_effector"
            off = OFF if robot.drive.wheels else START
            run = rpctl.track(robot, "eight", initial_error=off, collisions=False)
            figures = rpctl.summarize(run)
            rms, final = (
                1e3 * getattr(figures, f"{when}_{part}_error") for when in ("rms", "final")
            )
            print(f"{drive:15} {robot.name:13} {residual:8.0e} {rms:6.1f} mm {final:9.4f} mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
