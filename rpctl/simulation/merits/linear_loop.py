"""The linear loop about a run's reference motion: its poles, as the sampled laws place them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic, IntegralDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.fragment import LawFragment, law_fragment, settings_of
from rpctl.control.registry import name_of
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.derivatives import linear_dynamics
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.kernels.program import Buffer, Call
from rpctl.reference.motion import ReferenceState, row_of
from rpctl.robot.model import BASE_NV, Robot
from rpctl.simulation.run.run import Run

INSTANTS = 8  # at which a run's loop is linearised
MOVING = 0.5  # of the reference's largest speed: where it is slower, its base has no error to steer
STILL = 1e-3  # 1/s; a pole nearer to 0 says that an error stays


@dataclass(frozen=True)
class LoopPoles:
    """Poles of the linear loop along a run.

    Attributes:
        t: Instants (K,), s.
        poles: Of the sampled loop (K, n) as rates s = ln z/T, 1/s: complex.
    """

    t: Array
    poles: Array

    @property
    def decay(self) -> Array:
        """The slowest decay rate at each instant (K,), 1/s; negative where the loop diverges."""
        return -self.poles.real.max(axis=1)

    @property
    def damping(self) -> Array:
        """The least damping ratio of an oscillation at each instant (K,); 1 where there is none."""
        size = np.maximum(np.abs(self.poles), STILL)
        swinging = np.abs(self.poles.imag) > STILL
        return np.where(swinging, -self.poles.real / size, 1.0).min(axis=1)


def loop_poles(run: Run, robot: Robot, instants: int = INSTANTS) -> LoopPoles:
    """Return the poles of the linear loop about a run's reference motion.

    The state beside the reference is the base's pose, the positions of steered joints and of the
    arm, and ν; wheels' angles and free casters follow from it. The formulas of plant and laws are
    differentiated at each instant: the plant's is :mod:`rpctl.dynamics.derivatives`, and the laws,
    τ = K x, are those of where no limit binds, at their start. Efforts are held for a control
    period T, so the loop is x⁺ = (Φ + Γ K) x, and with z its eigenvalues the poles are ln z/T.
    Integral action adds its own, −k for each ν, which the model's motion does not excite. Poles of
    frozen instants describe a motion that changes slowly beside them; they prove nothing of one
    that does not.

    Args:
        run: The run.
        robot: Its robot.
        instants: At how many instants, among those at which the reference moves.

    Raises:
        RpctlError: The laws cannot be linearised, or at the reference they fail.
    """
    kinematic, dynamic, gains = _laws(run, robot)
    loop = LinearLoop(robot, kinematic, dynamic, run.config.run.control_period)
    chosen = _instants(run, robot, instants)
    found = [
        np.append(loop.poles(_state(run, robot, k), run.log.q_ref[k], run.log.nu_ref[k]), -gains)
        for k in chosen
    ]
    return LoopPoles(run.t[chosen], np.array(found))


class LinearLoop:
    """The linear models of a closed loop.

    Args:
        robot: The robot.
        kinematic: Its kinematic law.
        dynamic: Its dynamic law; none that remembers anything.
        period: Control period T, s.
    """

    def __init__(self, robot: Robot, kinematic: BaseLaw, dynamic: Any, period: float) -> None:
        self._dynamics, self._period = ReducedDynamics(robot), period
        self._plant = linear_dynamics(robot)
        known = self._plant.dynamics
        self._settings = settings_of(kinematic, dynamic, self._dynamics, period)
        law = law_fragment(kinematic, dynamic, known, period)
        buffers = law.q, law.nu, law.reference, law.settings
        at = {buffer: casadi.SX.sym(buffer.name, buffer.size) for buffer in buffers}
        inputs, delta = list(at.values()), casadi.SX.sym("delta", robot.nv)
        tau = _efforts(law, {**at, law.q: known.integrate(at[law.q], delta)})
        K = casadi.jacobian(tau, casadi.vertcat(delta, at[law.nu]))
        found = casadi.substitute([tau, K], [delta], [casadi.SX.zeros(robot.nv, 1)])
        self._laws = casadi.Function("laws", inputs, found)

    def poles(self, state: ReferenceState, q: Array, nu: Array) -> Array:
        """Return ln z/T of the sampled loop's eigenvalues z.

        Args:
            state: The reference.
            q: Its configuration (nq,).
            nu: Its quasi-velocities (dof,).

        Raises:
            RpctlError: The laws fail there.
        """
        robot = self._dynamics.robot
        tau, K = (x.full() for x in self._laws(q, nu, row_of(state), self._settings))
        if not np.isfinite(K).all():
            raise RpctlError("the laws return no finite efforts on the reference")
        spread, rows = _coordinates(self._dynamics, q)
        A, B = self._plant(q, nu, tau[:, 0])
        nv, dof, size = robot.nv, len(nu), len(rows) + len(nu)
        wide = np.zeros((nv + dof, size))
        wide[:nv, : len(rows)], wide[nv:, len(rows) :] = spread, np.eye(dof)
        kept = [*rows, *range(nv, nv + dof)]
        held = np.zeros((size + B.shape[1],) * 2)
        held[:size] = self._period * np.hstack([A[kept] @ wide, B[kept]])
        step = expm(held)[:size]
        z = np.linalg.eigvals(step[:, :size] + step[:, size:] @ K @ wide).astype(complex)
        return np.asarray(np.log(np.where(z == 0.0, np.finfo(float).tiny, z)) / self._period)


def _efforts(law: LawFragment, values: dict[Buffer, Any]) -> Any:
    """Return the efforts (n_act, 1) of laws where no limit binds, at the values of buffers."""
    for call in (*law.command, law.answer[0]):
        assert isinstance(call, Call)  # what follows is done where a limit binds
        inputs = [values.get(buffer, casadi.SX.zeros(buffer.size, 1)) for buffer in call.inputs]
        values |= dict(zip(call.outputs, call.function.call(inputs), strict=True))
    return values[law.tau]


def _coordinates(dynamics: ReducedDynamics, q: Array) -> tuple[Array, list[int]]:
    """Return the tangents (nv, n) along which a robot can stand beside q, and their own entries.

    Of the base they are all three; of a steered joint or one of the arm, its own, with the joints
    that follow it.
    """
    robot, S = dynamics.robot, dynamics.basis(q)
    base = list(range(BASE_NV if robot.drive.base_speeds else 0))
    steered = [swivel.joint for swivel in robot.drive.steered]
    rows = [*base, *(robot.velocity_index(name) for name in (*steered, *robot.joint_names))]
    first = len(robot.drive.base_speeds) - len(steered)
    spread = np.zeros((len(S), len(rows)))
    spread[base, base] = 1.0
    spread[:, len(base) :] = S[:, first:]
    rolling = [wheel.joint for wheel in robot.drive.wheels]
    rolling += [swivel.joint for swivel in robot.drive.swivels if swivel.trails]
    spread[:BASE_NV, len(base) :] = 0.0
    spread[[robot.velocity_index(name) for name in rolling], len(base) :] = 0.0
    return spread, rows


def _laws(run: Run, robot: Robot) -> tuple[BaseLaw, Any, Array]:
    """Return the run's laws but for what they remember, and what integral action adds."""
    law, efforts, gains = run.config.kinematic, run.config.dynamic, np.zeros(0)
    if run.config.output is not None:
        raise RpctlError(
            "the controller commands speeds, which the robot's own loop turns into efforts"
        )
    if not isinstance(law, BaseLaw):
        raise RpctlError(
            f"the law {name_of(law)} plans ahead or has memory, so it has no linear form"
        )
    if isinstance(efforts, IntegralDynamic):
        gains = efforts.gains(ReducedDynamics(robot), run.config.run.control_period)
        efforts = efforts.inner
    if not isinstance(efforts, PaperDynamic | BoundedDynamic):
        raise RpctlError(f"rpctl does not linearise the law {name_of(efforts)}")
    return law, efforts, gains


def _instants(run: Run, robot: Robot, count: int) -> Array:
    """Return indices of samples, evenly among those at which the reference moves."""
    base = len(robot.drive.base_speeds)
    speed = np.abs(run.log.nu_ref[:, :base]).max(axis=1, initial=0.0)
    moving = np.flatnonzero(speed >= MOVING * speed.max())
    return np.unique(moving[np.linspace(0, len(moving) - 1, count).astype(int)])


def _state(run: Run, robot: Robot, k: int) -> ReferenceState:
    """Return the reference of a run at a sample, from its log."""
    log, t = run.log, run.t
    around = slice(max(k - 1, 0), k + 2)
    rate = np.zeros(robot.dof)
    if len(t[around]) > 1:
        rate = np.asarray((log.nu_ref[around][-1] - log.nu_ref[around][0]) / np.ptp(t[around]))
    dynamics = ReducedDynamics(robot)
    q, nu = log.q_ref[k], log.nu_ref[k]
    at = dynamics.at(q)
    twist = robot.point_velocity @ (at.S @ nu)[:BASE_NV]
    twist_dot = robot.point_velocity @ (at.S @ rate + at.drift(nu))[:BASE_NV]
    first = robot.dof - len(robot.joints)
    direction = None
    if math.hypot(*twist) > 0.0:
        direction = np.array([twist, twist_dot, np.zeros(BASE_NV)])
    return ReferenceState(
        log.base_ref[k], twist, twist_dot, log.joints_ref[k], nu[first:], rate[first:], direction
    )
