"""What a log says besides what is kept of its samples: each row follows from its own state."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.grip import find_ranges
from rpctl.dynamics.ground_reaction import find_contacts, ground_reactions
from rpctl.dynamics.reduced import OutsideForce, ReducedDynamics, outside_at
from rpctl.dynamics.rolling import constraint
from rpctl.errors import DivergedError
from rpctl.reference.motion import configurations
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.run.facts import other_joints, reference_wheels, steered_joints
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.states import MachineStates, PinocchioStates, StateColumns

TURN = 2.0 * math.pi
PLACES = ("base", "joints", "steering", "others", "e", "q_ref")
CHECKED = 3  # states, of which machine code has to say what Pinocchio does
BLOCK = 1024  # rows whose forces are computed at once
NOT_FINITE = ("load_range", "slip_range")  # arrays in which NaN and inf have a meaning
GROUND_COLUMNS = (
    "wheel_force", "axle_force", "contact_load", "zmp", "tip_margin", "slip_ratio", "load_range",
    "slip_range",
)  # fmt: skip


class Derivation:
    """Computes what follows from a log's states.

    Args:
        dynamics: Of the robot, without what the plant adds.
        config: Plant and friction.

    Attributes:
        dynamics: Those of the simulated robot.
        robot: It.
        contacts: How the simulated robot stands on the ground, or None for a fixed base.
    """

    def __init__(self, dynamics: ReducedDynamics, config: Config) -> None:
        self.dynamics = dynamics = config.plant.simulated_dynamics(dynamics)
        self.robot = robot = dynamics.robot
        self.contacts = find_contacts(dynamics, config.run.friction)
        self._bias, self._wrenches = config.plant.bias(robot), config.plant.wrenches
        self._other_indices = [robot.velocity_index(name) for name in other_joints(robot)]
        self._states: PinocchioStates | MachineStates = PinocchioStates(dynamics, self.contacts)

    def __call__(self, log: Log, name: str) -> Mapping[str, Array]:
        """Return the arrays of a log that are computed with one of them, by name.

        Raises:
            DivergedError: The motion left the finite numbers.
        """
        if name in PLACES:
            return self._places(log)
        found: dict[str, Array] = {}
        if isinstance(self._states, PinocchioStates) and self._states.are_many(len(log.t)):
            self._states = self._compiled(self._states, log)
        for first in range(0, len(log.t), BLOCK):
            rows = slice(first, min(first + BLOCK, len(log.t)))
            with np.errstate(all="ignore"):  # what is not finite is refused below
                block = self.forces(log, rows)
            _require_finite(log.t[rows], block)
            for each, values in block.items():
                if each not in found:
                    found[each] = np.empty((len(log.t), *values.shape[1:]))
                found[each][rows] = values
        return found

    def _places(self, log: Log) -> dict[str, Array]:
        """Return where the robot and its reference are."""
        robot, q = self.robot, log.q
        base = robot.base_poses(q)
        joints = _positions(robot, q, robot.joint_names)
        return {
            "base": base + TURN * log.turns[:, None] * [0.0, 0.0, 1.0],
            "joints": joints,
            "steering": _positions(robot, q, steered_joints(robot)),
            "others": _positions(robot, q, other_joints(robot)),
            "e": _tracking_errors(robot, base, joints, log),
            "q_ref": reference_configurations(robot, log.base_ref, log.joints_ref, log.wheels_ref),
        }

    def _compiled(self, states: PinocchioStates, log: Log) -> PinocchioStates | MachineStates:
        """Return what computes what follows from states as machine code, if it agrees."""
        compiled = MachineStates(states)
        some = slice(None, None, max(1, len(log.t) // CHECKED))
        return compiled if compiled.agrees(*self._of(log, some)) else states

    def _of(self, log: Log, rows: slice) -> tuple[Array, Array, Array, Array]:
        """Return q, ν, efforts with the hidden ones, and q of base and arm on the reference."""
        wanted = configurations(self.robot, log.base_ref[rows], log.joints_ref[rows])
        return log.q[rows], log.nu[rows], log.tau[rows] + self._bias, wanted

    def forces(self, log: Log, rows: slice) -> dict[str, Array]:
        """Return what velocities, forces and the end effector say, of some rows."""
        q, nu, tau, wanted = self._of(log, rows)
        found = self._states(q, nu, tau, wanted, self._outside(log.t[rows], q))
        return {
            **self._motion(q, found.reactions.v),
            "energy": found.reactions.energy,
            **_end_effector(found.pose, found.wanted, len(q)),
            **self._ground(q, found),
        }

    def _outside(self, t: Array, q: Array) -> OutsideForce | None:
        """Return what pushes the robot from outside at times (K,) and q (K, nq), or None."""
        if not any((t < each.until).any() and (t >= each.start).any() for each in self._wrenches):
            return None
        found = OutsideForce(np.zeros((len(t), self.robot.nv)), np.zeros((len(t), 6)))
        for k in range(len(t)):
            acting = [each for each in self._wrenches if each.acts(t[k])]
            found.push[k], found.wrench[k] = outside_at(self.dynamics, q[k], acting)
        return found

    def _motion(self, q: Array, v: Array) -> dict[str, Array]:
        """Return what velocities (K, nv) say: rates, and how well the constraints are kept."""
        if self.robot.drive.leans:
            slip = np.array([self.dynamics.constraint(a) @ b for a, b in zip(q, v, strict=True)])
        else:
            slip = np.matvec(constraint(self.dynamics.rolling, q), v)
        return {
            "rates": v @ self.dynamics.columns,
            "other_rates": v[:, self._other_indices],
            "constraint_residual": np.abs(slip).max(axis=1, initial=0.0),
        }

    def _ground(self, q: Array, states: StateColumns) -> dict[str, Array]:
        """Return what the ground does; (K, 0) where it is not defined."""
        contacts, nothing = self.contacts, np.empty((len(q), 0))
        if contacts is None:
            return dict.fromkeys(GROUND_COLUMNS, nothing)
        found = ground_reactions(self.dynamics, contacts, q, states.reactions, states.points)
        columns = {
            "wheel_force": found.longitudinal,
            "axle_force": found.lateral,
            "contact_load": found.load,
            "zmp": found.zmp,
        }
        if found.tip_margin is not None:
            columns["tip_margin"] = found.tip_margin
        if found.slip_ratio.size:
            columns["slip_ratio"] = found.slip_ratio.max(axis=1)
        if not contacts.determinate:
            ranges = find_ranges(contacts, found)
            columns |= {"load_range": ranges.load, "slip_range": ranges.slip}
        return dict.fromkeys(GROUND_COLUMNS, nothing) | columns


def reference_configurations(robot: Robot, pose: Array, joints: Array, wheels: Array) -> Array:
    """Return q (K, nq) of the reference robot.

    Args:
        robot: The robot.
        pose: Poses of P (K, 3), m and rad.
        joints: Positions of the arm (K, n_joints), rad or m.
        wheels: Positions of what :func:`reference_wheels` names (K, n), rad.
    """
    steered = len(robot.drive.steered)
    q = configurations(robot, pose, joints, wheels[:, :steered])
    for name, positions in zip(reference_wheels(robot)[steered:], wheels.T[steered:], strict=True):
        robot.entries[name].write_all(q, positions)
    return q


def _positions(robot: Robot, q: Array, names: tuple[str, ...]) -> Array:
    """Return the positions (K, n) of joints at q (K, nq), rad or m."""
    found = np.empty((len(q), len(names)))
    for column, name in enumerate(names):
        entry = robot.entries.get(name)
        found[:, column] = robot.locked[name] if entry is None else entry.read_all(q)
    return found


def _tracking_errors(robot: Robot, base: Array, joints: Array, log: Log) -> Array:
    """Return e (K, 3 + n_joints), as :func:`rpctl.control.error.tracking_error` has it."""
    x, y, heading = (log.base_ref - base).T
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    ahead = log.joints_ref - joints
    for column, joint in zip(ahead.T, robot.joints, strict=True):
        if joint.kind == "continuous":
            column[:] = wrap(column)
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, wrap(heading), ahead])


def wrap(angles: Array) -> Array:
    """Return angles in (−π, π]."""
    return np.asarray(math.pi - np.mod(math.pi - angles, TURN))


def _end_effector(pose: Array | None, wanted: Array | None, count: int) -> dict[str, Array]:
    """Return where the end effector is (K, 3), where it should be, and the angle between (K,).

    Args:
        pose: Its poses (K, 4, 4) in the world; None without one.
        wanted: Those of the reference (K, 4, 4).
        count: K.
    """
    if pose is None or wanted is None:
        none = np.empty((count, 0))
        return {"ee": none, "ee_ref": none, "ee_angle": np.zeros(count)}
    turn = np.swapaxes(pose[:, :3, :3], 1, 2) @ wanted[:, :3, :3]
    twice = [turn[:, j, i] - turn[:, i, j] for i, j in ((1, 2), (2, 0), (0, 1))]
    sine = np.sqrt(sum(each * each for each in twice))
    cosine = np.einsum("kii->k", turn) - 1.0
    ends = {"ee": pose[:, :3, 3].copy(), "ee_ref": wanted[:, :3, 3].copy()}
    return ends | {"ee_angle": np.arctan2(sine, cosine)}


def _require_finite(t: Array, block: Mapping[str, Array]) -> None:
    """Refuse rows that are not finite.

    Raises:
        DivergedError: When the motion left the finite numbers.
    """
    for name, values in block.items():
        finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if name not in NOT_FINITE and not finite.all():
            raise left(float(t[int(np.argmin(finite))]))


def left(t: float) -> DivergedError:
    """Return the error of a motion that left the finite numbers at a time, s."""
    return DivergedError(
        f"the motion diverged at t = {t:g} s; shorten the control period or lengthen the horizons"
    )
