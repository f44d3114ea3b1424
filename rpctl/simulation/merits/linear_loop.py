"""The linear loop about a run's reference motion: its poles, as the sampled laws place them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import expm

from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.integral import IntegralDynamic
from rpctl.control.law import DynamicController, KinematicController, as_efforts
from rpctl.control.registry import name_of
from rpctl.control.twist_law import BaseController, BaseLaw
from rpctl.dynamics.derivatives import linear_model
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import BASE_NV, Robot
from rpctl.simulation.run.run import Run

INSTANTS = 8  # at which a run's loop is linearised
STEP = 1e-6  # of the laws' central differences, m or rad, m/s or rad/s
MOVING = 0.5  # of the reference's largest speed: where it is slower, its base has no error to steer
STILL = 1e-3  # 1/s; a pole nearer to 0 says that an error stays: differences make about 1e-6


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
    arm, and ν; wheels' angles and free casters follow from it. The plant's linear model is that of
    :mod:`rpctl.dynamics.derivatives`; the laws', τ = K x, are central differences, from a start
    at each instant. Efforts are held for a control period T, so the loop is x⁺ = (Φ + Γ K) x, and
    with z its eigenvalues the poles are ln z/T. Integral action adds its own, −k for each ν, which
    the model's motion does not excite. Poles of frozen instants describe a motion that changes
    slowly beside them; they prove nothing of one that does not.

    Args:
        run: The run.
        robot: Its robot.
        instants: At how many instants, among those at which the reference moves.

    Raises:
        RpctlError: The laws cannot be linearised, or at the reference they fail.
    """
    dynamics = ReducedDynamics(robot)
    kinematic, dynamic, gains = _controllers(run, dynamics)
    chosen = _instants(run, robot, instants)
    found = []
    for k in chosen:
        loop = _Loop(dynamics, kinematic, dynamic, _state(run, robot, k))
        z = loop.poles(run.log.q_ref[k], run.log.nu_ref[k], run.config.run.control_period)
        found.append(np.concatenate([z, -gains]))
    return LoopPoles(run.t[chosen], np.array(found))


class _Loop:
    """The closed loop at one instant.

    Args:
        dynamics: The robot's dynamics.
        kinematic: Its kinematic controller.
        dynamic: Its dynamic controller.
        state: The reference.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        kinematic: KinematicController,
        dynamic: DynamicController,
        state: ReferenceState,
    ) -> None:
        self._dynamics, self._kinematic, self._dynamic = dynamics, kinematic, dynamic
        self._reference: Callable[[float], ReferenceState] = lambda t: state

    def poles(self, q: Array, nu: Array, period: float) -> Array:
        """Return ln z/T of the sampled loop's eigenvalues z.

        Args:
            q: Configuration of the reference (nq,).
            nu: Its quasi-velocities (dof,).
            period: T, s.
        """
        model, nv = self._dynamics.robot.model, len(self._dynamics.basis(q))
        spread, rows = _coordinates(self._dynamics, q)
        A, B = linear_model(self._dynamics, q, nu, self.efforts(q, nu))
        dof, size = len(nu), len(rows) + len(nu)
        wide = np.zeros((nv + dof, size))
        wide[:nv, : len(rows)], wide[nv:, len(rows) :] = spread, np.eye(dof)
        kept = [*rows, *range(nv, nv + dof)]
        K = np.empty((B.shape[1], size))
        for column, x in zip(K.T, wide.T, strict=True):
            ahead, behind = (
                self.efforts(pin.integrate(model, q, h * x[:nv]), nu + h * x[nv:])
                for h in (STEP, -STEP)
            )
            column[:] = (ahead - behind) / (2.0 * STEP)
        if not np.isfinite(K).all():
            raise RpctlError("at the reference the laws return no finite efforts")
        held = np.zeros((size + B.shape[1],) * 2)
        held[:size] = period * np.hstack([A[kept] @ wide, B[kept]])
        step = expm(held)[:size]
        z = np.linalg.eigvals(step[:, :size] + step[:, size:] @ K).astype(complex)
        return np.asarray(np.log(np.where(z == 0.0, np.finfo(float).tiny, z)) / period)

    def efforts(self, q: Array, nu: Array) -> Array:
        """Return the efforts (n_act,) that the laws ask for at a state."""
        command = self._kinematic(self._dynamics, self._reference, 0.0, q, nu)
        return as_efforts(self._dynamic(self._dynamics, q, nu, command)).tau


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
    rolling += [swivel.joint for swivel in robot.drive.swivels if swivel.role == "caster"]
    spread[:BASE_NV, len(base) :] = 0.0
    spread[[robot.velocity_index(name) for name in rolling], len(base) :] = 0.0
    return spread, rows


def _controllers(
    run: Run, dynamics: ReducedDynamics
) -> tuple[KinematicController, DynamicController, Array]:
    """Return controllers of the run's laws that remember nothing, and what integral action adds."""
    law, efforts = run.config.kinematic, run.config.dynamic
    period, gains = run.config.run.control_period, np.zeros(0)
    if run.config.output is not None:
        raise RpctlError("its output are speeds, which another's loop turns into efforts")
    if not isinstance(law, BaseLaw):
        raise RpctlError(f"the law {name_of(law)} plans or remembers, which has no linear form")
    if isinstance(efforts, IntegralDynamic):
        gains, efforts = np.full(dynamics.robot.dof, efforts.gain), efforts.inner
    if not isinstance(efforts, PaperDynamic | BoundedDynamic):
        raise RpctlError(f"the law {name_of(efforts)} is not one that is linearised")
    kinematic = BaseController(law, dynamics, law.joint_horizons(dynamics, period))
    return kinematic, efforts.start(dynamics, period), gains


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
