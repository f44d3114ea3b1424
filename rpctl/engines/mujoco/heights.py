"""Heights of a ground that is no plane, from a picture or a table."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import InputError
from rpctl.files.opening import read_input
from rpctl.libraries import library

KIND = "heights of a ground: a .png in grey, a .csv or a .npy of numbers"
MAX_CELLS = 4_000_000  # of a grid; a picture of 2000 by 2000
MIN_CELLS = 2  # along each side
MAX_HEIGHT = 1e3  # m
BASE = 0.5  # m of ground below the lowest point
LEAST = 1e-6  # m: MuJoCo wants some relief, of level ground too
WHITE = {"L": 255.0, "I;16": 65535.0, "I;16B": 65535.0, "I": 65535.0}  # by Pillow's mode


@dataclass(frozen=True)
class Heights:
    """A grid of heights about the origin.

    Attributes:
        grid: Heights (rows, columns), m: rows along y, columns along x, both upwards.
        extent: Lengths along x and y, m.
    """

    grid: Array
    extent: tuple[float, float]

    def highest(self, x: float, y: float, reach: float) -> float:
        """Return the highest point within a square about a place, m; 0 off the ground.

        Args:
            x: Its middle, m.
            y: Its middle, m.
            reach: Half its side, m.
        """
        spans = []
        for count, length, at in zip(self.grid.shape, self.extent[::-1], (y, x), strict=True):
            step = length / (count - 1)
            low = max(0, math.floor((at - reach + 0.5 * length) / step))
            high = min(count - 1, math.ceil((at + reach + 0.5 * length) / step))
            if low > high:
                return 0.0
            spans.append(slice(low, high + 1))
        return float(self.grid[spans[0], spans[1]].max())


def read_heights(settings: ContactSettings) -> Heights | None:
    """Return the heights that settings name, or None for a plane.

    Raises:
        InputError: The file cannot be read, or holds no heights.
    """
    path = settings.heights
    if not path:
        return None
    data = read_input(path, "MAX_BYTES", KIND)
    read = {".png": _picture, ".csv": _table, ".npy": _array}
    suffix = path[path.rfind(".") :].lower()
    if suffix not in read:
        raise InputError(path, f"no kind of file that is known; give {KIND}")
    try:
        grid = read[suffix](data)
    except (ValueError, OSError, SyntaxError, EOFError, MemoryError) as error:
        raise InputError(path, f"{str(error) or type(error).__name__}; give {KIND}") from None
    if grid.ndim != 2 or min(grid.shape) < MIN_CELLS or grid.size > MAX_CELLS:
        raise InputError(path, f"its shape is {grid.shape}; give 2 by 2 to {MAX_CELLS} heights")
    grid = settings.relief * grid
    if not np.abs(grid).max() <= MAX_HEIGHT:
        raise InputError(path, f"a height is no number up to {MAX_HEIGHT:g} m; give heights in m")
    grid.setflags(write=False)
    return Heights(grid, settings.extent)


def _picture(data: bytes) -> Array:
    """Return a picture's greys (rows, columns) in [0, 1], its lowest line first."""
    images = library("PIL.Image")
    with images.open(io.BytesIO(data), formats=["PNG"]) as image:
        if image.width * image.height > MAX_CELLS:
            raise ValueError(f"it has {image.width} by {image.height} pixels, which is too many")
        grey = image if image.mode in WHITE else image.convert("L")
        return np.asarray(grey, dtype=float)[::-1] / WHITE[grey.mode]


def _table(data: bytes) -> Array:
    return np.loadtxt(io.StringIO(data.decode("utf-8-sig")), delimiter=",", ndmin=2)


def _array(data: bytes) -> Array:
    found = np.load(io.BytesIO(data), allow_pickle=False)
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "iuf":
        raise ValueError("it holds no numbers")
    return np.asarray(found, dtype=float)
