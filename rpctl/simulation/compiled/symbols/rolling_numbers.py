"""The numbers of the rolling geometry of which S and Ṡν are made, and which of them may differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.basis import basis, selection
from rpctl.dynamics.projection import eliminate, rows_to_solve
from rpctl.dynamics.rolling import find_rolling
from rpctl.robot.model import Robot

# Factors of a robot that differs in everything that may vary: no two quotients of them are alike.
RADIUS, PLACE, PIVOT, TRAIL, LATERAL, SHIFT = 1.037, 1.017, 1.013, 1.029, 1.023, 1.041
CHANGED = 1e-9  # of an array's largest entry: less is rounding


def rolling_numbers(robot: Robot, solved: NDArray[np.intp] | None = None) -> dict[str, Array]:
    """Return the constants of which S and Ṡν are made, by name.

    Args:
        robot: The robot.
        solved: Rows that are solved first, see :func:`solved_rows`; None: the robot's own.
    """
    rolling = find_rolling(robot)
    A, W = rolling.matrix, selection(robot, rolling)
    if not A.harmonics.any():
        return {"S": basis(A.constant, W)}
    core, N, P, R, C = eliminate(A, W, solved)
    arrays = {"constant": core.constant, "harmonics": core.harmonics, "N": N, "P": P}
    arrays |= {"R": R, "C": C, "A": A.harmonics}
    return arrays | {"cosine": np.cos(core.phase), "sine": np.sin(core.phase)}


def solved_rows(robot: Robot) -> NDArray[np.intp]:
    """Return the rows of [A; W] that are solved before a configuration is known."""
    rolling = find_rolling(robot)
    return rows_to_solve(rolling.matrix, selection(robot, rolling))


def varied_rolling(robot: Robot) -> dict[str, NDArray[np.bool_]]:
    """Return which of the numbers change with radii, track, trails and pivots, by name.

    What is 0, as the way of a wheel's centre off the axle, stays 0.
    """
    rows = solved_rows(robot)
    nominal, other = rolling_numbers(robot, rows), rolling_numbers(_otherwise(robot), rows)
    return {
        name: np.abs(other[name] - array) > CHANGED * np.abs(array).max()
        for name, array in nominal.items()
    }


def _otherwise(robot: Robot) -> Robot:
    """Return a robot of another rolling geometry."""
    drive, model = robot.drive, robot.model.copy()
    for name in (*(w.joint for w in drive.wheels), *(s.joint for s in drive.swivels)):
        placement = model.jointPlacements[model.getJointId(name)]
        placement.translation = PLACE * placement.translation
    wheels = (
        replace(
            wheel,
            radius=RADIUS * wheel.radius,
            lateral=LATERAL * wheel.lateral,
            shift=SHIFT * wheel.shift,
        )
        for wheel in drive.wheels
    )
    swivels = (
        replace(
            swivel,
            pivot=(PIVOT * swivel.pivot[0], PIVOT * swivel.pivot[1]),
            trail=TRAIL * swivel.trail,
        )
        for swivel in drive.swivels
    )
    other = replace(drive, wheels=tuple(wheels), swivels=tuple(swivels))
    return replace(robot, drive=other, model=model)
