"""TIAGo drives a figure-eight on which it would hit a pillar and a wall.

Once only its base keeps clear, as a disc, and the arm that reaches beyond it hits both; once all
its links do. How near its links came is looked for afterwards with their collision shapes; how
near the eight itself would have led the base is computed here.

Usage: python demos/obstacles.py [SECONDS, 29.5 if left out]
"""

import sys
from pathlib import Path

import numpy as np

import rpctl

BASE, MARGIN = 0.27, 0.03  # m: radius of TIAGo's base, and how far it keeps clear besides
X, Y, RADIUS = 1.0, 1.1, 0.15  # m: the pillar
WALL = -0.95  # m: it stands at this y
DURATION = 29.5  # s: a lap, and on until the wall is behind it


def main(duration: float = DURATION) -> None:
    around = rpctl.Disc(X, Y, RADIUS), rpctl.HalfPlane(0.0, 1.0, WALL)
    robot, runs = rpctl.load("tiago"), []
    for name, clearance in (("base", None), ("links", MARGIN)):
        law = rpctl.Horizon(
            base_obstacles=around, base_radius=BASE + MARGIN, body_clearance=clearance
        )
        run = rpctl.track(robot, "eight", kinematic=law, duration=duration)
        summary = rpctl.summarize(run)
        print(f"{name:5} keep clear: {summary.outcome}, {len(summary.collisions)} collisions")
        for near in summary.clearances:
            if near.to.startswith("the disc") or near.to.startswith("the half-plane"):
                print(f"      {1e3 * near.distance:4.0f} mm from {near.to} ({near.link})")
        runs.append(run)
    x, y = runs[0].base_ref[:, 0], runs[0].base_ref[:, 1]
    gaps = np.hypot(x - X, y - Y) - RADIUS - BASE, y - WALL - BASE
    print(f"on the eight itself the base: {', '.join(f'{1e3 * gap.min():.0f} mm' for gap in gaps)}")
    folder = Path("runs/obstacles")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"open {rpctl.write_report(runs, folder / 'report.html')}")


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
