"""What a robot's model says of many states, one after the other, by Pinocchio."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, contact_points
from rpctl.dynamics.reduced import OutsideForce, Reactions, ReducedDynamics

# s: what a state takes here, where S is constant and where it turns, and what machine code takes to
# build, by the square of the quasi-velocities. Half of that counts: the next run finds it on disk.
STATE_S, TURNING_STATE_S, BUILD_S = 8e-5, 2.5e-4, 4e-3
MOST_DOF = 30  # quasi-velocities; with more, building takes longer than their square says


class StateColumns(NamedTuple):
    """What follows from K states.

    Attributes:
        reactions: What the ground does.
        points: Places of the contacts (K, n, 2) in the root link's frame, m; None where nobody
            asks: they keep them, or hold no balance.
        pose: Pose (K, 4, 4) of the end effector in the world; None without one.
        wanted: Likewise, on the reference.
    """

    reactions: Reactions
    points: Array | None
    pose: Array | None
    wanted: Array | None


class PinocchioStates:
    """Computes what follows from states.

    Args:
        dynamics: The robot's.
        contacts: How it stands on the ground; None: its base is fixed.
    """

    def __init__(self, dynamics: ReducedDynamics, contacts: Contacts | None) -> None:
        self.dynamics = dynamics
        moves = contacts is not None and contacts.balanced and contacts.stance is None
        self.moving = contacts if moves else None  # contacts whose places are asked for

    def __call__(
        self, q: Array, nu: Array, tau: Array, wanted: Array, outside: OutsideForce | None = None
    ) -> StateColumns:
        """Return what follows from K states.

        Args:
            q: Configurations (K, nq).
            nu: Quasi-velocities (K, dof).
            tau: Actuator efforts (K, n_act), N·m or N.
            wanted: Configurations (K, nq) of the reference.
            outside: What pushes the robot besides, (K, nv) and (K, 6); None: nothing.

        Raises:
            RpctlError: The steering fixes no one motion, or a state is not finite.
        """
        robot, points = self.dynamics.robot, None
        reactions = self.dynamics.reactions(q, nu, tau, outside)
        if self.moving is not None:
            supports = self.moving.supports
            points = np.array([contact_points(self.dynamics, supports, each) for each in q])
        if robot.end_effector is None:
            return StateColumns(reactions, points, None, None)
        pose, there = (robot.end_effector_poses(each) for each in (q, wanted))
        return StateColumns(reactions, points, pose, there)

    def are_many(self, count: int) -> bool:
        """Return whether so many states are worth the time that machine code takes to build."""
        dof = self.dynamics.robot.dof
        each = STATE_S if self.dynamics.constant else TURNING_STATE_S
        return dof <= MOST_DOF and each * count >= 0.5 * BUILD_S * dof**2
