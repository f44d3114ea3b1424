"""Rolling of many robots that differ in their wheels' radii and their track, as columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.scaled_wheels import contact_laterals, scale_radii, scale_track
from rpctl.dynamics.rolling import find_rolling
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.symbols.rolling_numbers import rolling_numbers, solved_rows


def rolling_columns(robot: Robot, radii: Array, track: Array) -> dict[str, Array]:
    """Return the numbers of rolling of which S is made, stacked (K, ...).

    Where S is constant, a wheel's rate is that of its contact over its radius. Elsewhere the
    rows are eliminated robot by robot, once for each pair of radii and track.

    Args:
        robot: The robot.
        radii: Of its wheels (K, n_wheels), m.
        track: Scales of its track (K,).
    """
    rolling, drive, tree = find_rolling(robot), robot.drive, robot.tree
    if rolling.matrix.harmonics.any():
        return _eliminated(robot, radii, track)
    S = rolling_numbers(robot)["S"]
    found = np.tile(S, (len(radii), 1, 1))
    moved = (track[:, None] - 1.0) * contact_laterals(drive, tree)
    left = np.array([-np.sin(drive.heading), np.cos(drive.heading)])
    for k, wheel in enumerate(drive.wheels):
        index, row = robot.velocity_index(wheel.joint), rolling.along[k]
        forward = np.array(wheel.direction) @ np.array([-left[1], left[0]])
        turning = forward / rolling.matrix.constant[row, index]
        rates = S[index] - turning * moved[:, k, None] * S[2]
        found[:, index] = rates * (wheel.radius / radii[:, k, None])
    return {"S": found}


def _eliminated(robot: Robot, radii: Array, track: Array) -> dict[str, Array]:
    drive, tree = robot.drive, robot.tree
    rows, known = solved_rows(robot), dict[bytes, dict[str, Array]]()
    keys = []
    for own, scale in zip(radii, track.tolist(), strict=True):
        key = np.append(own, scale).tobytes()
        keys.append(key)
        if key not in known:
            scales = {
                wheel.joint: radius / wheel.radius
                for wheel, radius in zip(drive.wheels, own.tolist(), strict=True)
            }
            other = scale_track(scale_radii(drive, tree, scales), tree, scale)
            known[key] = rolling_numbers(replace(robot, drive=other), rows)
    names = known[keys[0]]
    return {name: np.stack([known[key][name] for key in keys]) for name in names}
