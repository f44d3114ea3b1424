"""The random states at which the derivations are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.model import Robot


@dataclass(frozen=True)
class State:
    """A random state, reproducible from a seed and an index.

    ``push`` is normal: the accelerations (rad/s² or m/s²) that each actuator alone would give its
    own joint, besides what :func:`rpctl.equivalence.forced_state.efforts` adds to hold the robot.
    """

    q: Array  # (nq,) joints inside their limits
    v: Array  # (nv,) of the free tree
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)
    push: Array  # (n_act,)


def draw_state(robot: Robot, seed: int, sample: int) -> State:
    """Return the random state that :func:`rpctl.verify` compares at a sample of a seed.

    Args:
        robot: The robot.
        seed: Seed of all samples.
        sample: Index of the sample.
    """
    rng = np.random.default_rng([seed, sample])
    q = robot.random_configuration(rng)
    v, nu, nu_dot = (rng.normal(size=n) for n in (robot.nv, robot.dof, robot.dof))
    return State(q, v, nu, nu_dot, rng.normal(size=len(robot.actuators)))
