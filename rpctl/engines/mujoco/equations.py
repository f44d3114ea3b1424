"""The numbers of the reduced model that a MuJoCo model must reproduce: equations and limits.

A witness holds these numbers of a robot and is kept in the file. MuJoCo's free tree, projected by
the witness's S, must have the witness's M, h and B at every state, and its limits and losses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Check, worst, worst_cases
from rpctl.equivalence.contact.mujoco_body import free_inertia, mujoco_library, part_number
from rpctl.equivalence.state import draw_state
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import BASE_NV, Robot

REDUCED = "the reduced model"
EQUATIONS_TOLERANCE = 1e-10  # √(MiiMjj)-scaled; rounding of bases and quaternions leaves 1e-13
LIMIT_TOLERANCE = 1e-12  # of a number that is written and read again
ROUNDING_ROOM = 100.0  # factor by which a sum over many links may be less accurate than its terms
ROOT_NV = 6  # of a free root in MuJoCo
NO_LIMIT = 1e6  # rad, m: MuJoCo's range has two ends


# The axes of a witness's arrays: actuators, joints, speeds, coordinates of the free tree, those
# of qpos, and states.
SHAPES = {
    "effort": "a", "lower": "j", "upper": "j", "damping": "j", "friction": "j", "armature": "j",
    "qpos": "sq", "nu": "sd", "S": "scd", "drift": "sc", "M": "sdd", "h": "sd", "B": "sda",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Witness:
    """A robot's limits and losses, and its equations at some states, M ν̇ + h = B τ, v = S ν.

    Attributes:
        root: The body of the root link.
        joints: The moving joints, in the order of the columns of ``qpos``.
        speeds: Names of ν.
        actuators: Names of τ.
        effort: Limits of τ (n_act,), N·m or N; inf where there is none.
        lower: Lower limits of the joints (n_joints,), rad or m; -inf where there is none.
        upper: Upper limits (n_joints,).
        damping: N·m·s/rad or N·s/m (n_joints,).
        friction: N·m or N (n_joints,).
        armature: kg·m² or kg (n_joints,).
        qpos: At each state root x, y, z, quaternion w, x, y, z, then the joints (n, 7 + n_joints).
        nu: Quasi-velocities (n, dof).
        S: Bases (n, 6 + n_joints, dof), the root's rows first: linear in the world's axes, angular
            in the root's.
        drift: Ṡν (n, 6 + n_joints).
        M: Inertias (n, dof, dof).
        h: Biases (n, dof).
        B: Actuation (n, dof, n_act).
    """

    root: str
    joints: tuple[str, ...]
    speeds: tuple[str, ...]
    actuators: tuple[str, ...]
    effort: Array
    lower: Array
    upper: Array
    damping: Array
    friction: Array
    armature: Array
    qpos: Array
    nu: Array
    S: Array
    drift: Array
    M: Array
    h: Array
    B: Array


def take_witness(
    robot: Robot, root: str, losses: bool = True, samples: int = 3, seed: int = 0
) -> Witness:
    """Return the reduced model's numbers of a robot.

    Args:
        robot: The robot.
        root: The body of its root link.
        losses: Whether the joints in MuJoCo have the model's damping and friction.
        samples: Number of random states.
        seed: Their seed; state k is ``draw_state(robot, seed, k)``.
    """
    dynamics, joints = ReducedDynamics(robot), robot.moving_joint_names
    index = [robot.velocity_index(name) for name in joints]
    described = [robot.description.joint[name] for name in joints]
    none = np.zeros(len(joints))
    lossy = robot.losses if losses else None
    draws = [draw_state(robot, seed, sample) for sample in range(samples)]
    states = [_state(dynamics, draw.q, draw.nu, index) for draw in draws]
    return Witness(
        root=root,
        joints=joints,
        speeds=robot.quasi_velocities,
        actuators=robot.actuators,
        effort=robot.effort_limits,
        lower=np.array([-math.inf if joint.endless else joint.lower for joint in described]),
        upper=np.array([math.inf if joint.endless else joint.upper for joint in described]),
        damping=none if lossy is None else lossy.damping[index],
        friction=none if lossy is None else lossy.friction[index],
        armature=robot.armature[index],
        **{name: np.array([state[name] for state in states]) for name in states[0]},
    )


def _state(dynamics: ReducedDynamics, q: Array, nu: Array, index: list[int]) -> dict[str, Array]:
    """Return the reduced model at q (nq,) and ν (dof,), in MuJoCo's coordinates.

    Pinocchio's v of the root is along the body's axes: v_world = R v, and Ṙ v = ω ẑ × R v.
    """
    robot = dynamics.robot
    x, y, theta = read_root(q)
    cos, sin = math.cos(theta), math.sin(theta)
    T = np.zeros((ROOT_NV + len(index), robot.nv))
    T[:2, :2] = [[cos, -sin], [sin, cos]]
    T[ROOT_NV - 1, BASE_NV - 1] = 1.0
    T[ROOT_NV + np.arange(len(index)), index] = 1.0
    S, drift = dynamics.basis(q), dynamics.basis_drift(q, nu)
    speed = T @ (S @ nu)
    turning = np.zeros(len(T))
    turning[:2] = -speed[5] * speed[1], speed[5] * speed[0]
    half = 0.5 * theta
    places = [robot.joint_position(q, name) for name in robot.moving_joint_names]
    return {
        "qpos": np.array([x, y, 0.0, math.cos(half), 0.0, 0.0, math.sin(half), *places]),
        "nu": nu,
        "S": T @ S,
        "drift": T @ drift + turning,
        "M": dynamics.inertia(q),
        "h": dynamics.bias(q, nu),
        "B": dynamics.actuation(q),
    }


def compare_with_witness(
    model: Any, witness: Witness, rounding: float = 0.0, against: str = REDUCED
) -> tuple[Check, ...]:
    """Compare the equations and limits of a MuJoCo model with a witness; return the rows.

    Args:
        model: ``MjModel``.
        witness: The reduced model's numbers.
        rounding: Known relative rounding of the file's numbers.
        against: Name of the witness in the rows.

    Raises:
        RpctlError: The model lacks a body, a joint or an actuator that the witness names.
    """
    tree, room = _FreeTree(model, witness), ROUNDING_ROOM * rounding
    samples = ((sample, tree.gaps(sample)) for sample in range(len(witness.nu)))
    rows = (*worst_cases(samples), *tree.limits())
    return tuple(replace(row, against=against, limit=max(row.limit, room)) for row in rows)


class _FreeTree:
    """MuJoCo's model and the indices of the witness's coordinates in it."""

    def __init__(self, model: Any, witness: Witness) -> None:
        self._mujoco = mujoco_library()
        self._model, self._witness = model, witness
        self._data = self._mujoco.MjData(model)
        body = part_number(model, "body", witness.root)
        self._joints = [part_number(model, "joint", name) for name in witness.joints]
        self._actuators = [part_number(model, "actuator", name) for name in witness.actuators]
        free = int(model.body_jntadr[body])
        if free < 0 or int(model.jnt_type[free]) != int(self._mujoco.mjtJoint.mjJNT_FREE):
            raise RpctlError(f'body "{witness.root}" has no free joint; the root link needs one')
        own = [free, *self._joints]
        if len(set(own)) != len(own):
            raise RpctlError("two joints of the robot are one in the model")
        self._qpos = [*range(int(model.jnt_qposadr[free]), int(model.jnt_qposadr[free]) + 7),
                      *(int(model.jnt_qposadr[j]) for j in self._joints)]  # fmt: skip
        self._dofs = [*range(int(model.jnt_dofadr[free]), int(model.jnt_dofadr[free]) + ROOT_NV),
                      *(int(model.jnt_dofadr[j]) for j in self._joints)]  # fmt: skip

    def gaps(self, sample: int) -> Iterator[Check]:
        """Yield the rows of the equations at a state."""
        witness, names = self._witness, self._witness.speeds
        nu, S, M, h, B = (vars(witness)[name][sample] for name in ("nu", "S", "M", "h", "B"))
        free_M, free_h = self._terms(sample)
        size = np.sqrt(np.diag(M))
        gap = (S.T @ free_M @ S - M) / np.outer(size, size)
        yield worst("inertia M", REDUCED, gap, EQUATIONS_TOLERANCE, names)
        own_h = S.T @ (free_h + free_M @ witness.drift[sample])
        scale = size * max(float(np.sqrt(nu @ M @ nu)), 1.0)
        heavy = max(1.0, float(np.abs(h / scale).max()))
        yield worst("bias h", REDUCED, (own_h - h) / (scale * heavy), EQUATIONS_TOLERANCE, names)
        largest = max(1.0, float(np.abs(B).max(initial=0.0)))
        gap = (S.T @ self._columns() - B) / largest
        yield worst("actuation B", REDUCED, gap, EQUATIONS_TOLERANCE, names, witness.actuators)

    def _terms(self, sample: int) -> tuple[Array, Array]:
        """Return the free tree's inertia (nv, nv) and bias (nv,), as the witness orders them."""
        mujoco, model, data = self._mujoco, self._model, self._data
        mujoco.mj_resetData(model, data)
        data.qpos[self._qpos] = self._witness.qpos[sample]
        data.qvel[self._dofs] = self._witness.S[sample] @ self._witness.nu[sample]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        M = free_inertia(model, data)
        return M[np.ix_(self._dofs, self._dofs)], np.array(data.qfrc_bias)[self._dofs]

    def _columns(self) -> Array:
        """Return the generalised force per unit of control of each actuator (nv, n_act).

        The control is half of the actuator's limit, so that no range clips it.
        """
        found = np.zeros((len(self._dofs), len(self._actuators)))
        for column, actuator in enumerate(self._actuators):
            limit = float(self._witness.effort[column])
            ask = 0.5 * limit if math.isfinite(limit) and limit > 0.0 else 1.0
            self._data.ctrl[:] = 0.0
            self._data.ctrl[actuator] = ask
            self._mujoco.mj_fwdActuation(self._model, self._data)
            found[:, column] = np.array(self._data.qfrc_actuator)[self._dofs] / ask
        return found

    def limits(self) -> Iterator[Check]:
        """Yield the rows of limits, losses and rotors."""
        model, witness, joints = self._model, self._witness, self._joints
        dofs = self._dofs[ROOT_NV:]
        ranges = np.where(
            np.array(model.jnt_limited)[joints][:, None] != 0,
            np.array(model.jnt_range)[joints],
            [-np.inf, np.inf],
        ).reshape(-1, 2)
        wanted = np.column_stack([witness.lower, witness.upper])
        ended = np.asarray(np.isfinite(wanted).any(axis=1)).reshape(-1, 1)
        wanted = np.where(ended, np.clip(wanted, -NO_LIMIT, NO_LIMIT), wanted)
        yield _equal("joint ranges", ranges, wanted, witness.joints)
        bound = np.array(model.actuator_ctrllimited)[self._actuators] != 0
        control = np.array(model.actuator_ctrlrange)[self._actuators]
        control = np.where(bound[:, None], control, [-np.inf, np.inf]).reshape(-1, 2)
        efforts = np.column_stack([-witness.effort, witness.effort])
        yield _equal("effort limits", control, efforts, witness.actuators)
        for name, values in (
            ("damping", witness.damping),
            ("frictionloss", witness.friction),
            ("armature", witness.armature),
        ):
            has = np.array(getattr(model, f"dof_{name}"))[dofs]
            yield _equal(name, has.reshape(len(dofs), -1), values[:, None], witness.joints)


def _equal(name: str, has: Array, wanted: Array, rows: tuple[str, ...]) -> Check:
    """Return the row for numbers (n, k) that must equal the robot's, infinities included."""
    with np.errstate(invalid="ignore"):
        gap = np.abs(has - wanted) / np.maximum(1.0, np.abs(wanted))
    gap = np.where(has == wanted, 0.0, gap)
    return worst(name, REDUCED, gap.max(axis=1, initial=0.0), LIMIT_TOLERANCE, rows)


def as_plain(witness: Witness) -> dict[str, Any]:
    """Return a witness as plain values for JSON; an infinite limit is a string."""
    plain: dict[str, Any] = dict(vars(witness))
    for name in SHAPES:
        value = plain[name]
        plain[name] = np.where(np.isfinite(value), value.astype(object), value.astype(str)).tolist()
    return plain


def from_plain(plain: Mapping[str, Any]) -> Witness:
    """Return the witness that plain values describe.

    Raises:
        ValueError: They do not describe a witness.
    """
    texts: dict[str, Any] = {
        key: tuple(map(str, plain[key])) for key in ("joints", "speeds", "actuators")
    }
    joints, states = len(texts["joints"]), len(plain["nu"])
    size = {"a": len(texts["actuators"]), "j": joints, "d": len(texts["speeds"]),
            "c": ROOT_NV + joints, "q": ROOT_NV + 1 + joints, "s": states}  # fmt: skip
    arrays: dict[str, Any] = {}
    for key, axes in SHAPES.items():
        arrays[key] = np.array(plain[key], dtype=float)
        wanted = tuple(size[axis] for axis in axes)
        if arrays[key].shape != wanted:
            raise ValueError(f"{key} has the shape {arrays[key].shape}, not {wanted}")
        if "s" in axes and not np.isfinite(arrays[key]).all():
            raise ValueError("a number is not finite")
    return Witness(root=str(plain["root"]), **texts, **arrays)
