"""What the model says of many states, by Pinocchio and by machine code that agrees with it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, contact_points
from rpctl.dynamics.reduced import OutsideForce, Reactions, ReducedDynamics
from rpctl.dynamics.symbols.basis import SINGULAR
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.machine_code import RowFunction
from rpctl.kernels.program import dense_function
from rpctl.robot.inspection import robot_identity

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
        reactions = self.dynamics.reactions(q, nu, tau, outside=outside)
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
        built = dof <= MOST_DOF and not self.dynamics.robot.drive.leans
        return built and each * count >= 0.5 * BUILD_S * dof**2


EQUAL = 1e-9  # of a quantity's largest entry, or of 1: rounding leaves 1e-12
PLACEMENT = 12  # numbers: three rows of axes, each with an entry of the origin


class MachineStates:
    """Computes what :class:`PinocchioStates` does, of all states in one call.

    Args:
        pinocchio: Is asked where the steering is as good as singular.
    """

    def __init__(self, pinocchio: PinocchioStates) -> None:
        self._pinocchio = pinocchio
        self._dynamics = dynamics = pinocchio.dynamics
        self._robot = robot = dynamics.robot
        moving = pinocchio.moving
        rows, n = len(dynamics.rolling.matrix.constant), len(moving.names) if moving else 0
        placement = PLACEMENT * (robot.end_effector is not None)
        inputs = robot.nq, robot.dof, robot.nv, robot.nq
        outputs = robot.nv, robot.nv, 6, 1, rows, 1, 2 * n, placement, placement
        self._columns = dynamics.columns
        self._rows = RowFunction(
            (inputs, outputs),
            ("states", robot_identity(robot), None if moving is None else moving.supports),
            lambda: self._function(inputs),
        )

    def _function(self, inputs: tuple[int, ...]) -> Any:
        dynamics, robot = SymbolicDynamics(self._robot), self._robot
        q, nu, push, wanted = symbols = [
            casadi.SX.sym(f"x{k}", size) for k, size in enumerate(inputs)
        ]
        reaction, moving = dynamics.reaction(q, nu, push), self._pinocchio.moving
        at = dynamics.at(q)
        found = [*reaction, at.multipliers(reaction.residual), at.margin]
        places = [] if moving is None else self._places(dynamics, moving, q)
        found.append(casadi.vertcat(casadi.SX(0, 1), *places))
        for each in (q, wanted):
            placement = casadi.SX(0, 1)
            if robot.end_effector is not None:
                R, p = dynamics.placement(each, robot.end_effector)
                placement = casadi.vec(casadi.horzcat(R, p).T)
            found.append(placement)
        return dense_function("states", symbols, found)

    def _places(self, dynamics: SymbolicDynamics, contacts: Contacts, q: Any) -> list[Any]:
        """Return where contacts are, x and y (2, 1) each in the root link's frame."""
        joint = self._robot.model.getJointId
        found = [(joint(w.joint), w.offset * np.array(w.axis)) for w in self._robot.drive.wheels]
        found += [(part.joint, np.array(part.point)) for part in contacts.supports.parts]
        return [dynamics.place(q, *each)[:2] for each in found]

    def __call__(
        self, q: Array, nu: Array, tau: Array, wanted: Array, outside: OutsideForce | None = None
    ) -> StateColumns:
        """Return what :class:`PinocchioStates` does."""
        push = tau @ self._columns.T
        if outside is not None:
            push = push + outside.push
        v, residual, wrench, energy, multipliers, margin, *rest = self._rows(q, nu, push, wanted)
        if outside is not None:
            wrench = wrench - outside.wrench
        reactions = Reactions(v, residual, wrench, energy[:, 0], multipliers)
        points, *poses = rest
        found = StateColumns(
            reactions,
            points.reshape(len(q), -1, 2) if points.shape[1] else None,
            *(_pose(each) if each.shape[1] else None for each in poses),
        )
        near = np.flatnonzero(~(margin[:, 0] > SINGULAR))
        if len(near):
            pushed = None if outside is None else OutsideForce(*(each[near] for each in outside))
            _put(found, near, self._pinocchio(q[near], nu[near], tau[near], wanted[near], pushed))
        return found

    def agrees(self, q: Array, nu: Array, tau: Array, wanted: Array) -> bool:
        """Return whether Pinocchio finds the same of these states."""
        states = q, nu, tau, wanted
        pairs = zip(_flat(self(*states)), _flat(self._pinocchio(*states)), strict=True)
        return all(
            np.abs(x - y).max(initial=0.0) <= EQUAL * np.abs(y).max(initial=1.0) for x, y in pairs
        )


def _pose(rows: Array) -> Array:
    """Return poses (K, 4, 4) of their first three rows (K, 12)."""
    poses = np.zeros((len(rows), 4, 4))
    poses[:, :3], poses[:, 3, 3] = rows.reshape(-1, 3, 4), 1.0
    return poses


def _flat(columns: StateColumns) -> list[Array]:
    return [each for each in (*columns.reactions, *columns[1:]) if each is not None]


def _put(columns: StateColumns, rows: NDArray[np.intp], found: StateColumns) -> None:
    for into, values in zip(_flat(columns), _flat(found), strict=True):
        into[rows] = values
