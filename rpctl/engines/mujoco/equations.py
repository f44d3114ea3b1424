"""The numbers of the reduced model that a MuJoCo model must have: equations and limits.

A witness is taken of a robot, kept in the file, and asked again later: MuJoCo's free tree, held to
rolling by the witness's S, must have its M, h and B at every state, and its limits and losses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.equivalence.check import Check
from rpctl.equivalence.state import draw_state
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import BASE_NV, Robot

REDUCED = "the reduced model"
EQUATIONS_TOLERANCE = 1e-10  # √(MiiMjj)-scaled; rounding of bases and quaternions leaves 1e-13
LIMIT_TOLERANCE = 1e-12  # of a number that is written and read again
ROUNDING_ROOM = 100.0  # by how much a sum of many links' numbers may be further off than each
ROOT_NV = 6  # of a free root in MuJoCo
NO_LIMIT = 1e6  # rad, m: MuJoCo's range has two ends


@dataclass(frozen=True, eq=False)
class WitnessState:
    """The reduced model at one state, in MuJoCo's coordinates: M ν̇ + h = B τ, v = S ν.

    Attributes:
        qpos: Root x, y, z, quaternion w, x, y, z (7,), then the joints (n_joints,); m, rad.
        nu: Quasi-velocities (dof,).
        S: Basis (6 + n_joints, dof), the root's rows first: linear in the world's axes, angular in
            the root's.
        drift: Ṡν (6 + n_joints,).
        M: Inertia (dof, dof).
        h: Bias (dof,).
        B: Actuation (dof, n_act).
    """

    qpos: Array
    nu: Array
    S: Array
    drift: Array
    M: Array
    h: Array
    B: Array


@dataclass(frozen=True, eq=False)
class Witness:
    """A robot's equations at some states, and its limits and losses.

    Attributes:
        root: The body of the root link.
        joints: The moving joints, as the states' rows name them.
        speeds: Names of ν.
        actuators: Names of τ.
        effort: Limits of τ (n_act,), N·m or N; inf where there is none.
        lower: Lower limits of the joints (n_joints,), rad or m; -inf where there is none.
        upper: Upper limits (n_joints,).
        damping: N·m·s/rad or N·s/m (n_joints,).
        friction: N·m or N (n_joints,).
        armature: kg·m² or kg (n_joints,).
        states: The states.
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
    states: tuple[WitnessState, ...]


def take_witness(
    robot: Robot, root: str, losses: bool = True, samples: int = 3, seed: int = 0
) -> Witness:
    """Return what the reduced model says of a robot.

    Args:
        robot: The robot.
        root: The body of its root link.
        losses: Whether its joints lose in MuJoCo what they lose in the model.
        samples: Number of random states.
        seed: Their seed; state k is ``draw_state(robot, seed, k)``.
    """
    dynamics, joints = ReducedDynamics(robot), robot.moving_joint_names
    index = [robot.velocity_index(name) for name in joints]
    described = [robot.description.joint[name] for name in joints]
    none = np.zeros(len(joints))
    lossy = robot.losses if losses else None
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
        states=tuple(
            _state(dynamics, draw.q, draw.nu, index)
            for draw in (draw_state(robot, seed, sample) for sample in range(samples))
        ),
    )


def _state(dynamics: ReducedDynamics, q: Array, nu: Array, index: list[int]) -> WitnessState:
    """Return the reduced model at q (nq,) and ν (dof,), in MuJoCo's coordinates.

    Of the root, Pinocchio's v is along the body's axes: v_world = R v, and Ṙ v = ω ẑ × R v.
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
    return WitnessState(
        qpos=np.array([x, y, 0.0, math.cos(half), 0.0, 0.0, math.sin(half), *places]),
        nu=np.array(nu),
        S=T @ S,
        drift=T @ drift + turning,
        M=dynamics.inertia(q),
        h=dynamics.bias(q, nu),
        B=dynamics.actuation(q),
    )


def compare_with_witness(
    model: Any, witness: Witness, rounding: float = 0.0, against: str = REDUCED
) -> tuple[Check, ...]:
    """Return the rows of a MuJoCo model's equations and limits against a witness's.

    Args:
        model: ``MjModel``.
        witness: What the reduced model says.
        rounding: By how much the file's numbers are known to be rounded, relative.
        against: What the witness is called in the rows.

    Raises:
        RpctlError: The model lacks a body, a joint or an actuator that the witness names.
    """
    tree, room = _FreeTree(model, witness), ROUNDING_ROOM * rounding
    worst: dict[str, Check] = {}
    for sample, state in enumerate(witness.states):
        for name, residual, entry in tree.gaps(state):
            limit = max(EQUATIONS_TOLERANCE, room)
            check = Check(name, against, residual, limit, sample, entry)
            if name not in worst or check.residual > worst[name].residual:
                worst[name] = check
    limits = (replace(row, against=against, limit=max(row.limit, room)) for row in tree.limits())
    return (*worst.values(), *limits)


class _FreeTree:
    """MuJoCo's model and where in it the witness's coordinates are."""

    def __init__(self, model: Any, witness: Witness) -> None:
        self._mujoco = mujoco_library()
        self._model, self._witness = model, witness
        self._data = self._mujoco.MjData(model)
        kinds = self._mujoco.mjtObj
        body = self._find(kinds.mjOBJ_BODY, "body", witness.root)
        self._joints = [self._find(kinds.mjOBJ_JOINT, "joint", name) for name in witness.joints]
        self._actuators = [
            self._find(kinds.mjOBJ_ACTUATOR, "actuator", name) for name in witness.actuators
        ]
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

    def gaps(self, state: WitnessState) -> Iterator[tuple[str, float, str]]:
        """Yield the name of a row, the largest gap at a state, and the entry where it is."""
        witness, names = self._witness, self._witness.speeds
        M, bias = self._terms(state)
        own_M = state.S.T @ M @ state.S
        own_h = state.S.T @ (bias + M @ state.drift)
        own_B = state.S.T @ self._columns()
        size = np.sqrt(np.diag(state.M))
        yield _worst("inertia M", (own_M - state.M) / np.outer(size, size), names, names)
        rate = float(np.sqrt(state.nu @ state.M @ state.nu))
        scale = size * max(rate, 1.0)
        heavy = max(1.0, float(np.abs(state.h / scale).max()))
        yield _worst("bias h", ((own_h - state.h) / (scale * heavy))[:, None], names, ("",))
        largest = max(1.0, float(np.abs(state.B).max(initial=0.0)))
        yield _worst("actuation B", (own_B - state.B) / largest, names, witness.actuators)

    def _terms(self, state: WitnessState) -> tuple[Array, Array]:
        """Return the free tree's inertia (nv, nv) and bias (nv,), as the witness orders them."""
        mujoco, model, data = self._mujoco, self._model, self._data
        mujoco.mj_resetData(model, data)
        data.qpos[self._qpos] = state.qpos
        data.qvel[self._dofs] = state.S @ state.nu
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        M = np.zeros((model.nv, model.nv))
        for row, unit in zip(M, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, row, unit)
        return M[np.ix_(self._dofs, self._dofs)], np.array(data.qfrc_bias)[self._dofs]

    def _columns(self) -> Array:
        """Return what each actuator does to each coordinate (nv, n_act) by a unit of control.

        Half of its limit is asked, so that no range cuts it.
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

    def _find(self, kind: Any, word: str, name: str) -> int:
        index = int(self._mujoco.mj_name2id(self._model, kind, name))
        if index < 0:
            raise RpctlError(f'there is no {word} "{name}", which the robot has')
        return index


def _worst(
    name: str, gap: Array, rows: tuple[str, ...], columns: tuple[str, ...]
) -> tuple[str, float, str]:
    """Return the name, the largest of gaps (n_rows, n_columns), and where it is."""
    if not gap.size:
        return name, 0.0, ""
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    row, column = divmod(int(size.argmax()), size.shape[1])
    entry = f"{rows[row]}, {columns[column]}" if columns[column] else rows[row]
    return name, float(size[row, column]), entry


def _equal(name: str, has: Array, wanted: Array, rows: tuple[str, ...]) -> Check:
    """Return the row of numbers (n, k) that must be those of the robot; infinities, too."""
    with np.errstate(invalid="ignore"):
        gap = np.abs(has - wanted) / np.maximum(1.0, np.abs(wanted))
    gap = np.where(has == wanted, 0.0, np.where(np.isfinite(gap), gap, np.inf))
    _, largest, entry = _worst(name, gap, rows, ("",) * gap.shape[1] if gap.size else ("",))
    return Check(name, REDUCED, largest, LIMIT_TOLERANCE, 0, entry)


def as_plain(witness: Witness) -> dict[str, Any]:
    """Return a witness as plain values for JSON; an infinite limit is None."""
    found: dict[str, Any] = {}
    for name, value in vars(witness).items():
        if name == "states":
            found[name] = [
                {key: array.tolist() for key, array in vars(state).items()} for state in value
            ]
        elif isinstance(value, np.ndarray):
            found[name] = [each if math.isfinite(each) else None for each in value.tolist()]
        else:
            found[name] = list(value) if isinstance(value, tuple) else value
    return found


def from_plain(plain: Mapping[str, Any]) -> Witness:
    """Return the witness that plain values are.

    Raises:
        ValueError: They are none.
    """
    infinite = {"effort": math.inf, "upper": math.inf, "lower": -math.inf}
    fields: dict[str, Any] = {"root": str(plain["root"])}
    for name in ("joints", "speeds", "actuators"):
        fields[name] = tuple(str(each) for each in plain[name])
    for name in ("effort", "lower", "upper", "damping", "friction", "armature"):
        numbers = [infinite.get(name) if each is None else each for each in plain[name]]
        fields[name] = np.array(numbers, dtype=float)
    size = {"n": ROOT_NV + len(fields["joints"]), "d": len(fields["speeds"]),
            "a": len(fields["actuators"]), "q": ROOT_NV + 1 + len(fields["joints"])}  # fmt: skip
    shapes = {"qpos": "q", "nu": "d", "S": "nd", "drift": "n", "M": "dd", "h": "d", "B": "da"}
    fields["states"] = tuple(
        WitnessState(**{
            key: _array(state[key], tuple(size[letter] for letter in shape))
            for key, shape in shapes.items()
        })
        for state in plain["states"]
    )  # fmt: skip
    for name, count in (("effort", "actuators"), *((k, "joints") for k in
                        ("lower", "upper", "damping", "friction", "armature"))):  # fmt: skip
        if fields[name].shape != (len(fields[count]),):
            raise ValueError(f"{name} is not as long as {count}")
    return Witness(**fields)


def _array(value: Any, shape: tuple[int, ...]) -> Array:
    found: Array = np.array(value, dtype=float).reshape(shape)
    if not np.isfinite(found).all():
        raise ValueError("a number is not finite")
    return found
