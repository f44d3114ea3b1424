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
from rpctl.simulation.compiled.scalars import cleaned

# Factors of a robot that differs in everything that may vary: no two quotients of them are alike.
RADIUS, PLACE, PIVOT, TRAIL, LATERAL, SHIFT = 1.037, 1.017, 1.013, 1.029, 1.023, 1.041


def rolling_numbers(robot: Robot, like: Robot | None = None) -> dict[str, Array]:
    """Return the constants of which S and Ṡν are made, by name.

    Args:
        robot: The robot.
        like: Robot whose equations are solved for the same unknowns; None: the robot itself.
    """
    rolling = find_rolling(robot)
    A, W = rolling.matrix, selection(robot, rolling)
    if not A.harmonics.any():
        return {"S": cleaned(basis(A.constant, W))}
    rows = None
    if like is not None:
        first = find_rolling(like)
        rows = rows_to_solve(first.matrix, selection(like, first))
    core, N, P, R, C = eliminate(A, W, rows)
    arrays = {"constant": core.constant, "harmonics": core.harmonics, "N": N, "P": P}
    arrays |= {"R": R, "C": C, "A": A.harmonics}
    arrays |= {"cosine": np.cos(core.phase), "sine": np.sin(core.phase)}
    return {name: cleaned(array) for name, array in arrays.items()}


def varied_rolling(robot: Robot) -> dict[str, NDArray[np.bool_]]:
    """Return which of the numbers change with radii, track, trails and pivots, by name.

    What is 0, as the way of a wheel's centre off the axle, stays 0.
    """
    nominal, other = rolling_numbers(robot), rolling_numbers(_otherwise(robot), robot)
    return {
        name: np.abs(other[name] - array) > 1e-6 * np.abs(array) for name, array in nominal.items()
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
