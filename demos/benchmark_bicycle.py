"""Whipple's bicycle: the linear equations that rpctl finds, beside those of the benchmark.

J. P. Meijaard, J. M. Papadopoulos, A. Ruina, A. L. Schwab, "Linearized dynamics equations for the
balance and steer of a bicycle: a benchmark and review", Proc. R. Soc. A 463, 2007. They count the
steering to the right, the robot here counts it to the left: that changes signs off the diagonals.
"""

import rpctl
from rpctl.derive.linear_form import linear_form
from rpctl.robot.leaning import LeaningRobot

PUBLISHED = {
    "M": ((80.81722, 2.31941332208709), (2.31941332208709, 0.29784188199686)),
    "C1": ((0.0, 33.86641391492494), (-0.85035641456978, 1.68540397397560)),
    "K0": ((-80.95, -2.59951685249872), (-2.59951685249872, -0.80329488458618)),
    "K2": ((0.0, 76.59734589573222), (0.0, 2.65431523794604)),
}


def main() -> None:
    robot = rpctl.load("whipple", root="free")
    assert isinstance(robot, LeaningRobot)
    matrices = linear_form(robot).matrices
    print(f"{'entry':6} {'ours':>20} {'published':>20} {'apart':>8}")
    for name, published in PUBLISHED.items():
        for i, row in enumerate(published):
            for j, theirs in enumerate(row):
                ours = float(matrices[name][i, j]) * (1.0 if i == j else -1.0) + 0.0
                entry = f"{name}_{i + 1}{j + 1}"
                print(f"{entry:6} {ours:20.14f} {theirs:20.14f} {abs(ours - theirs):8.0e}")


if __name__ == "__main__":
    main()
