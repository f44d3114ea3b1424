"""A reference in quasi-velocities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.description.records import Array
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

BASE = {0: [], 2: [0, 2], 3: [0, 1, 2]}  # entries of the twist, by the number of base speeds


class Rates(NamedTuple):
    """Quasi-velocities and their derivatives."""

    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)


def reference_rates(robot: Robot, state: ReferenceState) -> Rates:
    """Return ν and ν̇ of a reference."""
    keep = BASE[len(robot.drive.base_speeds)]
    return Rates(
        np.concatenate([state.twist[keep], state.joint_rates]),
        np.concatenate([state.twist_dot[keep], state.joint_accelerations]),
    )
