"""TIAGo tracks an eight that was recorded 10 times a second with 1 cm of noise.

Once the reference passes every row, once it is smoothed by as much as the noise asks for, and once
an eight driven 2.5 times as fast is smoothed and then slowed down where the robot's limits bind.

Usage: python demos/noisy_csv.py [another robot]
"""

import sys
from pathlib import Path

import numpy as np

import rpctl


def record(path: Path, duration: float) -> None:
    """Write an eight that starts and ends at rest, with noise on it."""
    t = np.arange(0.0, duration, 0.1)
    u = t / t[-1]
    angle = 2.0 * np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    rows = np.column_stack([t, 0.8 * np.sin(angle), 0.4 * np.sin(2.0 * angle)])
    rows[:, 1:] += 0.01 * np.random.default_rng(0).normal(size=(len(t), 2))
    np.savetxt(path, rows, delimiter=",", header="t,x,y", comments="")


def main(name: str = "tiago") -> None:
    folder = Path("runs/noisy-csv")
    folder.mkdir(parents=True, exist_ok=True)
    robot, slow, fast = rpctl.load(name), folder / "slow.csv", folder / "fast.csv"
    record(slow, 20.0)
    record(fast, 8.0)
    for file, smooth, retime in ((slow, None, False), (slow, "auto", False), (fast, "auto", True)):
        run = rpctl.track(robot, str(file), smooth=smooth, retime=retime)
        effort, told = rpctl.summarize(run).max_effort_ratio, run.recording or {}
        print(f"{file.name} with smooth={smooth}, retime={retime}: {told['sentence']}")
        print(f"    the largest effort is {effort:.2f} of its limit")
    print(f"open {rpctl.write_report(run, folder / 'report.html')}")


if __name__ == "__main__":
    main(*sys.argv[1:])
