"""TIAGo drives a figure-eight on which its base would hit two pillars and a wall.

Once base and arm make the detour together, and once the arm keeps the hand on its path meanwhile.
How near the base came to each obstacle is computed here from the log alone, as is how near the
eight itself would have led it.
"""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rpctl

BASE, MARGIN = 0.27, 0.03  # m: radius of TIAGo's base, and how far it keeps clear besides
PILLARS = ((1.0, 1.1, 0.15), (-1.75, 0.0, 0.2))  # x, y and radius, m
WALL = -0.95  # m: it stands at this y


def clearances(path: NDArray[np.float64]) -> dict[str, float]:
    """Return the least distance of a base on a path (n, 3) to each obstacle, m."""
    x, y = path[:, 0], path[:, 1]
    gaps = {f"pillar at ({a}, {b})": np.hypot(x - a, y - b) - radius for a, b, radius in PILLARS}
    gaps[f"wall at y = {WALL}"] = y - WALL
    return {name: float(gap.min()) - BASE for name, gap in gaps.items()}


def main() -> None:
    pillars = (rpctl.Disc(*each) for each in PILLARS)
    wall = rpctl.HalfPlane(0.0, 1.0, WALL)
    together = rpctl.Horizon(base_obstacles=(*pillars, wall), base_radius=BASE + MARGIN)
    robot, runs = rpctl.load("tiago"), []
    for name, law in (("together", together), ("hand first", rpctl.EndEffector(together))):
        run = rpctl.track(robot, "eight", kinematic=law, dynamic=rpctl.IntegralDynamic())
        summary, driven = rpctl.summarize(run), clearances(run.log.base)
        rms = summary.rms_end_effector_error or math.nan  # nan without an end effector
        print(f"{name:10} hand {1e3 * rms:3.0f} mm rms off its path")
        for obstacle, wanted in clearances(run.base_ref).items():
            print(
                f"{'':10} {obstacle:20} least clearance {1e3 * driven[obstacle]:3.0f} mm; "
                f"on the eight itself {1e3 * wanted:.0f} mm"
            )
        runs.append(run)
    folder = Path("runs/obstacles")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"open {rpctl.write_report(runs, folder / 'report.html')}")


if __name__ == "__main__":
    main()
