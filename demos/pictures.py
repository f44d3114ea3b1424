"""The pictures of the README and of the manual's gallery, drawn in headless Chromium.

``make pictures`` draws them all. Without arguments one goes to ``runs/pictures``.
"""

import sys
from pathlib import Path

from PIL import Image

import rpctl
from rpctl.robot.catalog import ENTRIES
from rpctl.view.film import require_browser, write_film, write_still

SIZE, FILM_SIZE = (640, 360), (640, 360)  # pixels
COLOURS = 128  # of a still's palette: a third of its bytes
RATE = 10  # pictures a second of the film, which covers the whole lap: 1.9 MB
START = (0.1, -0.1, 0.1)  # m, m, rad off the reference
LONGEST = 12.0  # s
REFERENCES = {"arm": "ee-square", "whipple": "circle"}


def draw(folder: Path, name: str) -> None:
    """Draw a robot of the catalogue on its way."""
    robot, reference = rpctl.load(name), REFERENCES.get(name, "eight")
    start = START if reference == "eight" else (0.0, 0.0, 0.0)
    run = rpctl.track(robot, reference, initial_error=start, duration=LONGEST, collisions=False)
    path = write_still(run, folder / f"{name}.png", size=SIZE, time=0.6 * float(run.t[-1]))
    with Image.open(path) as still:
        still.convert("RGB").quantize(COLOURS).save(path, optimize=True)
    print(f"wrote {path}")


def main(film: Path | None = None, gallery: Path = Path("runs/pictures")) -> None:
    try:
        require_browser()
    except rpctl.RpctlError as missing:
        print(f"no pictures: {missing}")
        return
    gallery.mkdir(parents=True, exist_ok=True)
    if film is None:
        draw(gallery, "paper")
        return
    for entry in ENTRIES:
        if entry.own:
            draw(gallery, entry.name)
    run = rpctl.track(rpctl.load("tiago"), "eight", initial_error=START)
    write_film(run, film / "tiago.gif", size=FILM_SIZE, rate=RATE)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
