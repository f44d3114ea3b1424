"""The README's pictures: four robots on their figure-eights, drawn in headless Chromium.

They go to the folder that is given (``make pictures`` gives ``demos``), or to ``runs/pictures``.
"""

import sys
from pathlib import Path

import rpctl
from rpctl.view.film import require_browser, write_still

SIZE = (960, 540)
TIMES = {"tiago": 18.4, "paper": 20.0, "mecanum": 13.0, "tiago_pro": 70.0}  # s


def main(folder: Path) -> None:
    try:
        require_browser()
    except rpctl.RpctlError as missing:
        print(f"no pictures: {missing}")
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name, time in TIMES.items():
        robot, off = rpctl.load(name), (0.1, -0.1, 0.1)  # m, m, rad
        run = rpctl.track(robot, "eight", initial_error=off, collisions=False)
        picture = write_still(run, folder / f"{name}.png", size=SIZE, time=time)
        print(f"wrote {picture}")


if __name__ == "__main__":
    main(Path(*sys.argv[1:] or ["runs/pictures"]))
