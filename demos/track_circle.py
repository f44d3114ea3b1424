"""A skewed arm on an off-centre base follows a circle; the result is one HTML file."""

import math
from pathlib import Path

import rpctl


def main() -> None:
    robot = rpctl.load("mixed_chain")
    run = rpctl.track(robot, "circle", duration=15.0, initial_error=(0.1, 0.1, 0.2))
    folder = Path("runs/mixed_chain-circle")
    folder.mkdir(parents=True, exist_ok=True)
    run.save(folder / "run.npz")
    report = rpctl.write_report(run, folder / "report.html")
    figures = rpctl.summarize(run)
    print(f"base {1e3 * figures.final_base_error:.3f} mm, ", end="")
    tip = figures.final_end_effector_error or math.nan  # nan without an end effector
    print(f"end effector {1e3 * tip:.3f} mm from the reference")
    print(f"open {report}")


if __name__ == "__main__":
    main()
