"""What a log says of forces, energies and the end effector: each row follows from its own state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, GroundReactions, ground_reactions
from rpctl.dynamics.load_ranges import find_ranges
from rpctl.dynamics.many_states import ManyStates, Reactions
from rpctl.dynamics.outside import outside_at
from rpctl.dynamics.reduced import OutsideForce, ReducedDynamics
from rpctl.reference.quasi_velocities import configurations
from rpctl.robot.placements import EndEffectorFrame, aligned_tree, end_effector_frame
from rpctl.simulation.facts import other_joints
from rpctl.simulation.plants.wrench import Wrench

GROUND_COLUMNS = (
    "wheel_force",
    "axle_force",
    "contact_load",
    "zmp",
    "tip_margin",
    "slip_ratio",
    "load_range",
    "slip_range",
)


class MotionColumns:
    """Computes columns of a log from others of the same rows.

    Args:
        dynamics: The robot's dynamics.
        contacts: How it stands on the ground, or None for a fixed base.
        bias: Efforts (n_act,) that push besides the controller's, N·m or N.
        wrenches: What pushes the robot from outside.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        contacts: Contacts | None,
        bias: Array,
        wrenches: Sequence[Wrench] = (),
    ) -> None:
        self._dynamics, self._contacts, self._bias = dynamics, contacts, bias
        self._wrenches = wrenches
        robot = dynamics.robot
        self._frame: EndEffectorFrame | None = None
        if robot.end_effector is not None:
            self._frame = end_effector_frame(aligned_tree(robot))
        self._many = ManyStates(dynamics) if dynamics.constant else None
        self._other_indices = [robot.velocity_index(name) for name in other_joints(robot)]

    def of(self, columns: Mapping[str, Array]) -> dict[str, Array]:
        """Return the columns by name.

        Args:
            columns: The log's ``t``, ``q``, ``nu``, ``tau``, ``base_ref`` and ``joints_ref``, K > 0
                rows.
        """
        q, nu, push = columns["q"], columns["nu"], columns["tau"] + self._bias
        wanted = configurations(self._dynamics.robot, columns["base_ref"], columns["joints_ref"])
        outside = self._outside(columns["t"], q)
        reactions = None if self._many is None else self._many.reactions(q, nu, push, outside)
        return {
            **self._motion(q, nu, reactions),
            **_end_effector(self._frame, q, wanted),
            **self._ground(q, nu, push, reactions, outside),
        }

    def _outside(self, t: Array, q: Array) -> OutsideForce | None:
        """Return what pushes the robot from outside at times (K,) and q (K, nq), or None."""
        if not any((t < each.until).any() and (t >= each.start).any() for each in self._wrenches):
            return None
        found = OutsideForce(np.zeros((len(t), self._dynamics.robot.nv)), np.zeros((len(t), 6)))
        for k in range(len(t)):
            acting = [each for each in self._wrenches if each.acts(t[k])]
            found.push[k], found.wrench[k] = outside_at(self._dynamics, q[k], acting)
        return found

    def _motion(self, q: Array, nu: Array, reactions: Reactions | None) -> dict[str, Array]:
        """Return what velocities say: rates, energy, and how well the constraints are kept."""
        dynamics = self._dynamics
        if dynamics.constant:
            at = dynamics.at(q[0])
            v, rates = nu @ at.S.T, nu @ at.B
            slip = v @ at.A.T
        else:
            v, rates = np.empty((len(q), dynamics.robot.nv)), np.empty((len(q), len(self._bias)))
            slip = np.empty((len(q), len(dynamics.rolling.matrix.constant)))
            for k in range(len(q)):
                at = dynamics.at(q[k])
                v[k] = at.S @ nu[k]
                rates[k], slip[k] = at.B.T @ nu[k], at.A @ v[k]
        if reactions is None:
            energy = np.array([dynamics.energy(*state) for state in zip(q, nu, strict=True)])
        else:
            energy = reactions.energy
        return {
            "rates": rates,
            "other_rates": v[:, self._other_indices],
            "energy": energy,
            "constraint_residual": np.abs(slip).max(axis=1, initial=0.0),
        }

    def _ground(
        self,
        q: Array,
        nu: Array,
        push: Array,
        reactions: Reactions | None,
        outside: OutsideForce | None,
    ) -> dict[str, Array]:
        """Return what the ground does; (K, 0) where it is not defined."""
        contacts, nothing = self._contacts, np.empty((len(q), 0))
        if contacts is None:
            return dict.fromkeys(GROUND_COLUMNS, nothing)
        found = ground_reactions(self._dynamics, contacts, q, nu, push, reactions, outside)
        columns = _ground_columns(found)
        if not contacts.determinate:
            ranges = find_ranges(contacts, found)
            columns |= {"load_range": ranges.load, "slip_range": ranges.slip}
        return dict.fromkeys(GROUND_COLUMNS, nothing) | columns


def _ground_columns(reactions: GroundReactions) -> dict[str, Array]:
    """Return what the log keeps of the ground's forces, but for the ranges."""
    found = {
        "wheel_force": reactions.longitudinal,
        "axle_force": reactions.lateral,
        "contact_load": reactions.load,
        "zmp": reactions.zmp,
    }
    if reactions.tip_margin is not None:
        found["tip_margin"] = reactions.tip_margin
    if reactions.slip_ratio.size:
        found["slip_ratio"] = reactions.slip_ratio.max(axis=1)
    return found


def _end_effector(frame: EndEffectorFrame | None, q: Array, q_ref: Array) -> dict[str, Array]:
    """Return where the end effector is (K, 3), where it should be, and the angle between (K,).

    Args:
        frame: The end effector; None: there is none.
        q: Configurations (K, nq).
        q_ref: Those of the reference (K, nq).
    """
    if frame is None:
        none = np.empty((len(q), 0))
        return {"ee": none, "ee_ref": none, "ee_angle": np.zeros(len(q))}
    (axes, place), (wanted_axes, wanted) = frame.at(q), frame.at(q_ref)
    # The reference's base is turned by Δ against the robot's.
    (cos, sin), (cos_ref, sin_ref) = q[:, 2:4].T, q_ref[:, 2:4].T
    c, s = cos * cos_ref + sin * sin_ref, cos * sin_ref - sin * cos_ref
    x, y = wanted_axes[:, 0].copy(), wanted_axes[:, 1].copy()
    wanted_axes[:, 0], wanted_axes[:, 1] = c * x - s * y, s * x + c * y
    turn = np.einsum("iak,jak->ijk", axes, wanted_axes)
    twice = [turn[j, i] - turn[i, j] for i, j in ((1, 2), (2, 0), (0, 1))]
    sine, cosine = np.sqrt(sum(each * each for each in twice)), np.einsum("iik->k", turn) - 1.0
    return {"ee": place, "ee_ref": wanted, "ee_angle": np.arctan2(sine, cosine)}
