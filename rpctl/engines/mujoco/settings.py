"""Contact settings of a robot in MuJoCo, and the heights of the ground that they name."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import InputError, RpctlError
from rpctl.files.caps import read_input
from rpctl.files.records import NOT_NEGATIVE, POSITIVE, OneOf, Record, Setting
from rpctl.libraries import library

WHEEL_SHAPES = ("cylinder", "crowned")
CONES = ("elliptic", "pyramidal")
MIN_CONSTANT_IN_STEPS = 20.0  # stiffer contacts chatter when they slip
KIND = "heights of a ground: a .png in grey, a .csv or a .npy of numbers"
MAX_CELLS = 4_000_000  # of a grid; a picture of 2000 by 2000
MIN_CELLS = 2  # along each side
MAX_HEIGHT = 1e3  # m
BASE = 0.5  # m of ground below the lowest point
LEAST = 1e-6  # m: MuJoCo requires some relief, even of level ground
WHITE = {"L": 255.0, "I;16": 65535.0, "I;16B": 65535.0, "I": 65535.0}  # by Pillow's mode


@dataclass(frozen=True, kw_only=True)
class ContactSettings(Record):
    """Contact settings of a robot and the ground in MuJoCo; table [plant.contact].

    Raises:
        RpctlError: ``time_constant`` is less than 20 timesteps, or ``extent`` has not two numbers.
    """

    wheel_width: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "m",
            "",
            "Width of all wheels; default: that of each wheel's shape. A wheel that turns on a "
            "contact line of this length scrubs, with a moment of about μ N width/4.",
        ),
    ] = None
    wheel_shape: Annotated[
        str,
        OneOf(WHEEL_SHAPES),
        Setting(
            "",
            "",
            "Shape of the wheels: a cylinder, or crowned, an ellipsoid that touches at one point "
            "and does not scrub.",
        ),
    ] = "cylinder"
    caster_friction: Annotated[
        float,
        NOT_NEGATIVE,
        Setting(
            "",
            "",
            "Friction coefficient of supports that cannot roll, balls and skids; casters with "
            "swivel and wheel joints have the ground's friction. 0: they slide.",
        ),
    ] = 0.0
    cone: Annotated[
        str,
        OneOf(CONES),
        Setting(
            "",
            "",
            "Friction cone: elliptic, as Coulomb's, or pyramidal, which creeps and "
            "holds less diagonally.",
        ),
    ] = "elliptic"
    timestep: Annotated[
        float,
        POSITIVE,
        Setting("s", "", "Longest step; each interval is divided into equal steps."),
    ] = 1e-3
    time_constant: Annotated[
        float,
        POSITIVE,
        Setting(
            "s",
            "",
            "Time constant of contacts, at least 20 timesteps. A shorter one is stiffer: the "
            "robot sinks by about a quarter of g times its square.",
        ),
    ] = 2e-2
    losses: Annotated[
        bool,
        Setting("", "", "Whether the joints have the robot's damping and dry friction."),
    ] = True
    heights: Annotated[
        str,
        Setting(
            "", "", "A file of heights of the ground (.png, .csv or .npy); empty: a plane at 0."
        ),
    ] = ""
    extent: Annotated[
        tuple[float, float],
        POSITIVE,
        Setting(
            "m",
            "",
            "Lengths along x and y of the ground in heights; its centre is the origin.",
        ),
    ] = (20.0, 20.0)
    relief: Annotated[
        float,
        POSITIVE,
        Setting("m", "", "Height of white in a .png, m; a factor for the heights in other files."),
    ] = 1.0
    props: Annotated[
        bool,
        Setting(
            "",
            "",
            "Whether to add four frictionless balls that hold the robot up, half a track from P, "
            "for a robot whose file has too few contacts to stand on.",
        ),
    ] = False
    body: Annotated[
        bool,
        Setting(
            "",
            "",
            "Whether all collision shapes touch the ground, not only wheels and supports.",
        ),
    ] = False

    def __post_init__(self) -> None:
        """Refuse what MuJoCo cannot take."""
        super().__post_init__()
        if self.time_constant < MIN_CONSTANT_IN_STEPS * self.timestep * (1.0 - 1e-9):
            raise RpctlError(
                f"time_constant is {self.time_constant:g} s, less than 20 timesteps of "
                f"{self.timestep:g} s; lengthen it, or shorten timestep"
            )
        if len(self.extent) != 2:
            raise RpctlError(f"extent is {self.extent}; give the lengths along x and y in m")


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
        """Return the highest point within a square, m; 0 outside the grid.

        Args:
            x: Centre of the square, m.
            y: Centre of the square, m.
            reach: Half the side of the square, m.
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
    """Return the heights in the file of the settings, or None for a plane.

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
        raise InputError(path, f"an unknown kind of file; give {KIND}")
    try:
        grid = read[suffix](data)
    except (ValueError, OSError, SyntaxError, EOFError, MemoryError) as error:
        raise InputError(path, f"{str(error) or type(error).__name__}; give {KIND}") from None
    if grid.ndim != 2 or min(grid.shape) < MIN_CELLS or grid.size > MAX_CELLS:
        raise InputError(
            path, f"its shape is {grid.shape}; give at least 2 by 2 and at most {MAX_CELLS} heights"
        )
    grid = settings.relief * grid
    if not np.abs(grid).max() <= MAX_HEIGHT:
        raise InputError(
            path, f"a height is not a number or exceeds {MAX_HEIGHT:g} m; give heights in m"
        )
    grid.setflags(write=False)
    return Heights(grid, settings.extent)


def _picture(data: bytes) -> Array:
    """Return a picture's grey values (rows, columns) in [0, 1], the lowest line first."""
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
