"""The reduced dynamics M(q) ν̇ + h(q, ν) = B(q) τ + ℓ(q, ν) of a robot whose wheels do not slip.

Forces from outside may act on its links; the ground's reactions tell what they do to it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dposv

from rpctl.arrays import Array
from rpctl.dynamics.leaning import LeaningProjector
from rpctl.dynamics.projection import Projection, Projector
from rpctl.dynamics.rolling import RollingConstraints, find_rolling
from rpctl.dynamics.symbols.leaning import MotionCode
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.robot.coordinates import ROOT_JOINT, Workspace
from rpctl.robot.leaning import KEPT_ROBOTS, LeaningRobot
from rpctl.robot.losses import Losses
from rpctl.robot.model import Robot

STATES, SEED = 3, 20070801  # at which machine code is compared with Pinocchio
SAME = 1e-9  # of the largest acceleration: what may differ


class OutsideForce(NamedTuple):
    """What forces from outside do to the tree at one state.

    Attributes:
        push: Their generalised force (nv,).
        wrench: Force and moment about the root link's origin, in its axes, (6,).
    """

    push: Array
    wrench: Array


class Reactions(NamedTuple):
    """What the ground does to a robot at K states, as :meth:`ReducedDynamics.reaction` has it."""

    v: Array  # (K, nv) S ν
    residual: Array  # (K, nv)
    wrench: Array  # (K, 6)
    energy: Array  # (K,) J, as :meth:`ReducedDynamics.energy`
    multipliers: Array  # (K, rows) λ of least norm


class ReducedDynamics:
    """Pinocchio's dynamics projected onto the quasi-velocities.

    With v = S ν the equations of motion are M ν̇ + h = B τ + ℓ, where M = Sᵀ crba(q) S,
    h = Sᵀ rnea(q, Sν, Ṡν), and B is Sᵀ times the actuators' columns. This is [MS21, Eq. 5] (its Re
    is −h) for any drive. ℓ is Sᵀ times the forces of ``robot.losses``; the paper's robot has none.
    Several threads may share the object. For a robot that leans, the class returns its subclass
    :class:`LeaningDynamics`.

    Args:
        robot: The robot.
        gliding: Joints of swivels that glide: they keep their angle, their wheels do not roll and
            have no ground forces; only their mass matters.

    Attributes:
        robot: The robot.
        columns: Map (nv, n_act) from the actuators' efforts to generalised forces of v.
    """

    def __new__(cls, robot: Robot, *, gliding: Collection[str] = ()) -> ReducedDynamics:
        """Return the dynamics of a robot, of one that leans :class:`LeaningDynamics`."""
        return object.__new__(LeaningDynamics if isinstance(robot, LeaningRobot) else cls)

    def __init__(self, robot: Robot, *, gliding: Collection[str] = ()) -> None:
        self.robot = robot
        self._model = robot.model
        self._workspace = Workspace(robot.model)
        self._projector = find_projector(robot, gliding)
        self.columns = self._projector.columns
        self._losses = robot.losses

    @property
    def rolling(self) -> RollingConstraints:
        """The rolling constraints of a robot whose root link stays level.

        Raises:
            RpctlError: The robot leans.
        """
        self.robot.require_level()
        return self._projector.rolling  # type: ignore[union-attr]

    @property
    def constant(self) -> bool:
        """Whether A and S are the same at every q."""
        return self._projector.constant is not None

    @property
    def data(self) -> pin.Data:
        """Pinocchio's workspace of this thread; the next call overwrites it."""
        return self._workspace.data

    def at(self, q: Array) -> Projection:
        """Return S, the drift Ṡν, A and B at q (nq,).

        Raises:
            SingularBasisError: At q the steering angles do not determine a unique motion; the
                message names their joints.
        """
        return self._projector.at(q)

    def basis(self, q: Array) -> Array:
        """Return S(q) (nv, dof): v = S ν, A S = 0.

        Raises:
            SingularBasisError: As :meth:`at`.
        """
        return self.at(q).S

    def basis_drift(self, q: Array, nu: Array) -> Array:
        """Return the drift Ṡν (nv,) in v̇ = S ν̇ + Ṡν, m/s² or rad/s²."""
        return self.at(q).drift(nu)

    def constraint(self, q: Array) -> Array:
        """Return A(q) (rows, nv) with A v = 0: rolling without slipping, mimic joints."""
        return self.at(q).A

    def actuation(self, q: Array) -> Array:
        """Return B(q) (dof, n_act), which maps τ to quasi-forces."""
        return self.at(q).B

    def integrate(self, q: Array, v: Array) -> Array:
        """Return q (nq,) moved along v (nv,) for a time of 1 s, with the wheels on the ground."""
        moved = np.asarray(pin.integrate(self._model, q, v))
        return self._projector.settle(moved)

    def dexpinv(self, slide: Array, v: Array) -> Array:
        """Return dexp⁻¹ of the root; see :func:`rpctl.dynamics.projection.dexpinv`."""
        return self._projector.dexpinv(slide, v)

    def twist(self, q: Array, nu: Array) -> Array:
        """Return the twist of P (3,) at ν: speed forward and left (m/s), turning rate (rad/s)."""
        return np.asarray(self.at(q).twist @ nu)

    def inertia(self, q: Array) -> Array:
        """Return M(q) (dof, dof), symmetric positive definite; kg, kg·m or kg·m²."""
        S = self.basis(q)
        M = S.T @ pin.crba(self._model, self._workspace.data, q) @ S
        return 0.5 * (M + M.T)

    def bias(self, q: Array, nu: Array) -> Array:
        """Return h(q, ν) (dof,), N or N·m: Coriolis, centrifugal and gravity terms."""
        return self._inertial(q, nu, np.zeros(self.robot.dof))

    def losses(self, q: Array, nu: Array) -> Array:
        """Return ℓ(q, ν) (dof,), N or N·m: the quasi-force of damping and friction, against ν."""
        if self._losses is None:
            return np.zeros(self.robot.dof)
        S = self.at(q).S
        return np.asarray(S.T.dot(self._losses.force(S.dot(nu))))

    def inverse(
        self, q: Array, nu: Array, nu_dot: Array, *, lossy_nu: Array | None = None
    ) -> Array:
        """Return the quasi-force M ν̇ + h − ℓ (dof,), N or N·m, that a motion needs.

        M ν̇ + h is ∂G/∂ν̇ of the Gibbs function ([MS21, Eq. 1-3]).

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            nu_dot: Their derivatives (dof,).
            lossy_nu: Quasi-velocities (dof,) at which the losses are evaluated; None: at ν. A
                controller gives the desired ones: since ℓ decreases with ν, the difference to the
                actual losses reduces the velocity error.

        Raises:
            RpctlError: The state is not finite.
        """
        force = self._inertial(q, nu, nu_dot)
        if self._losses is not None:
            force -= self.losses(q, nu if lossy_nu is None else lossy_nu)
        return force

    def _inertial(self, q: Array, nu: Array, nu_dot: Array) -> Array:
        """Return M ν̇ + h (dof,); :meth:`inverse` has the arguments."""
        at = self.at(q)
        acceleration = at.S @ nu_dot + at.drift(nu)
        force: Array = at.S.T @ pin.rnea(
            self._model, self._workspace.data, q, at.S @ nu, acceleration
        )
        if not math.isfinite(force.dot(force)):
            raise self._not_finite(q, nu)
        return force

    def forward(self, q: Array, nu: Array, tau: Array, *, outside: Array | None = None) -> Array:
        """Return ν̇ (dof,) under actuator efforts τ (n_act,), losses included.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.
            outside: Quasi-force (dof,) of external forces, N or N·m; None: zero.

        Raises:
            RpctlError: M is not positive definite at q, or the state is not finite.
        """
        M, push = self._pushed(q, nu, tau, self._losses)
        if outside is not None:
            push += outside
        _, nu_dot, info = dposv(M, push)
        if not math.isfinite(nu_dot.dot(nu_dot)):
            raise self._not_finite(q, nu)
        if info:
            raise RpctlError(f"{self.robot.name}: the reduced inertia is not positive definite")
        return np.asarray(nu_dot)

    def rates(
        self, q: Array, nu: Array, tau: Array, *, outside: Array | None = None
    ) -> tuple[Array, Array, float]:
        """Return v (nv,), ν̇ (dof,) and the power (W) of τ and ``outside``.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.
            outside: As in :meth:`forward`.
        """
        at = self.at(q)
        power = nu.dot(at.B.dot(tau)) + (0.0 if outside is None else nu.dot(outside))
        return at.S.dot(nu), self.forward(q, nu, tau, outside=outside), power

    def lossless(self, q: Array, nu: Array, tau: Array) -> tuple[Array, Array]:
        """Return M (dof, dof) and B τ − h (dof,): M ν̇ = B τ − h + ℓ.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.
        """
        return self._pushed(q, nu, tau, None)

    def _pushed(
        self, q: Array, nu: Array, tau: Array, losses: Losses | None
    ) -> tuple[Array, Array]:
        """Return M (dof, dof) and B τ − h (dof,), with the losses ℓ if given."""
        at, data = self.at(q), self._workspace.data
        S = at.S
        v = S.dot(nu)
        force = pin.rnea(self._model, data, q, v, at.drift(nu))
        if losses is not None:
            force = force - losses.force(v)
        M = S.T.dot(pin.crba(self._model, data, q).dot(S))
        return M, S.T.dot(self.columns.dot(tau) - force)

    def stepped(
        self, q: Array, nu: Array, tau: Array, dt: float
    ) -> tuple[Array, Array, float, float] | None:
        """Return q, ν, work (J) and loss (J) after a step by machine code; None without it.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.
            dt: Step, s.
        """
        return None

    def _not_finite(self, q: Array, nu: Array) -> RpctlError:
        what = "q" if not np.isfinite(q).all() else "ν" if not np.isfinite(nu).all() else "τ or ν̇"
        return RpctlError(f"{self.robot.name}: the state ({what}) is not finite, or out of range")

    def placements(self, q: Array) -> pin.Data:
        """Return Pinocchio's workspace with the placements at q (nq,), until the next call."""
        data: pin.Data = self._workspace.data
        pin.forwardKinematics(self._model, data, q)
        return data

    def jacobian(self, q: Array, link: str) -> Array:
        """Return the Jacobian J (6, dof) of a link: its velocity is J ν if wheels do not slip.

        The first three rows are the velocity of the link's origin (m/s), the last three its angular
        velocity (rad/s), along the world's axes.

        Args:
            q: Configuration (nq,).
            link: Name of the link.

        Raises:
            UnknownNameError: The link is not known.
            SingularBasisError: As :meth:`at`.
        """
        return np.asarray(self.tree_jacobian(q, link) @ self.basis(q))

    def tree_jacobian(self, q: Array, link: str) -> Array:
        """Return the Jacobian J (6, nv) of a link in the tree: its velocity is J v.

        The rows are those of :meth:`jacobian`.

        Args:
            q: Configuration (nq,).
            link: Name of the link.

        Raises:
            UnknownNameError: The link is not known.
        """
        if not self._model.existBodyName(link):
            raise UnknownNameError("link", link, self.robot.description.link)
        frame = self._model.getFrameId(link, pin.FrameType.BODY)
        return np.asarray(
            pin.computeFrameJacobian(
                self._model, self._workspace.data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
        )

    def reaction(
        self, q: Array, nu: Array, tau: Array, *, outside: OutsideForce | None = None
    ) -> tuple[Array, Array]:
        """Return the ground's forces on the robot while it moves under τ.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.
            outside: External forces; None: none.

        Returns:
            The constraints' generalised force Aᵀλ = M v̇ + h − B τ − ℓ of the whole tree (nv,), and
            the wrench through the planar root (6,): force (N), then moment (N·m) about the root
            link's origin, in the root link's axes. The wrench is the rate of the robot's momentum
            minus the part of gravity ([F08, Ch. 5]), so it contains what the planar joint hides:
            vertical force, roll and pitch moment.
        """
        at = self.at(q)
        push = None if outside is None else at.S.T @ outside.push
        acceleration = at.S @ self.forward(q, nu, tau, outside=push) + at.drift(nu)
        data = self._workspace.data
        force = pin.rnea(self._model, data, q, at.S @ nu, acceleration)
        wrench = data.f[ROOT_JOINT].vector.copy()
        residual = force - self.columns @ tau
        if self._losses is not None:
            residual -= self._losses.force(at.S @ nu)
        if outside is not None:
            residual, wrench = residual - outside.push, wrench - outside.wrench
        return residual, wrench

    def reactions(
        self, q: Array, nu: Array, tau: Array, *, outside: OutsideForce | None = None
    ) -> Reactions:
        """Return the ground's forces on the robot at K states, and its energy there.

        Args:
            q: Configurations (K, nq).
            nu: Quasi-velocities (K, dof).
            tau: Actuator efforts (K, n_act), N·m or N.
            outside: External forces, (K, nv) and (K, 6); None: none.
        """
        rows = self._projector.rows
        sizes = ((self.robot.nv,), (self.robot.nv,), (6,), (), (rows,))
        found = Reactions(*(np.empty((len(q), *size)) for size in sizes))
        for k, state in enumerate(zip(q, nu, tau, strict=True)):
            pushed = None if outside is None else OutsideForce(*(part[k] for part in outside))
            at, (residual, wrench) = self.at(q[k]), self.reaction(*state, outside=pushed)
            parts = at.S @ nu[k], residual, wrench, self.energy(q[k], nu[k])
            for column, value in zip(found, (*parts, at.multipliers @ residual), strict=True):
                column[k] = value
        return found

    def energy(self, q: Array, nu: Array) -> float:
        """Return kinetic plus potential energy, J; the latter is zero at the root link's height."""
        data = self._workspace.data
        kinetic = pin.computeKineticEnergy(self._model, data, q, self.basis(q) @ nu)
        return float(kinetic + pin.computePotentialEnergy(self._model, data, q))

    def efforts(self, q: Array, quasi_force: Array) -> Array:
        """Return τ (n_act,), N·m or N, with B τ = ``quasi_force`` (dof,).

        If there are more actuators than quasi-velocities, this is the τ of smallest norm relative
        to the actuators' limits (missing limits count as 1).

        Raises:
            ActuationError: B lacks full row rank; the message names the undriven quasi-velocities.
        """
        return np.asarray(self.at(q).allocation @ quasi_force)


def find_projector(robot: Robot, gliding: Collection[str] = ()) -> Projector | LeaningProjector:
    """Return what makes the projections of a robot, some of whose swivels may glide."""
    if isinstance(robot, LeaningRobot):
        return LeaningProjector(robot)
    return Projector(robot, find_rolling(robot, gliding))


class Required(NamedTuple):
    """What a motion takes of the actuators, and what these can give."""

    q: Array  # (nq,)
    force: Array  # (dof,) M ν̇ + h − ℓ
    B: Array  # (dof, n_act)
    twist: Array  # (3,) of the base


class LeaningDynamics(ReducedDynamics):
    """The same of a robot that leans, with machine code for what a loop asks at each sample."""

    robot: LeaningRobot

    def stepped(
        self, q: Array, nu: Array, tau: Array, dt: float
    ) -> tuple[Array, Array, float, float] | None:
        """Return q, ν, work and loss after a step of :func:`rpctl.dynamics.motion.rk4_step`."""
        code = motion_code(self.robot)
        return None if code is None else code.step(q, nu, tau, dt)

    def required(self, q: Array, way: Array, nu: Array, nu_dot: Array) -> Required:
        """Return what a motion takes; see :meth:`inverse`.

        Args:
            q: Configuration (nq,) from which it is moved, its wheels on the ground.
            way: Quasi-velocities (dof,), along which it is moved for 1 s.
            nu: Quasi-velocities there (dof,).
            nu_dot: Their derivatives (dof,).
        """
        code = motion_code(self.robot)
        found = None if code is None else code.along(q, way, nu)
        if found is None:
            q = self.integrate(q, self.basis(q) @ way)
            force = self.inverse(q, nu, nu_dot)
            return Required(q, force, self.actuation(q), self.twist(q, nu))
        force = found.M.dot(nu_dot) + found.bias
        return Required(found.q.copy(), force, found.B.copy(), found.twist.copy())


@lru_cache(maxsize=KEPT_ROBOTS)
def motion_code(robot: LeaningRobot) -> MotionCode | None:
    """Return the equations of motion as machine code; None if its numbers are not Pinocchio's."""
    code, dynamics, rng = MotionCode(robot), ReducedDynamics(robot), np.random.default_rng(SEED)
    still = np.zeros(robot.dof)
    for _ in range(STATES):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        tau = rng.normal(size=len(robot.actuators))
        found, wanted = code.along(q, still, nu, tau), dynamics.forward(q, nu, tau)
        if found is None or np.abs(found.nu_dot - wanted).max() > SAME * np.abs(wanted).max():
            return None
    return code


class LinkWrench(Protocol):
    """A force (N) and a moment (N·m) on a link, along the world's axes, at its frame's origin."""

    @property
    def link(self) -> str:
        """Name of the link."""

    @property
    def force(self) -> tuple[float, float, float]:
        """Force (3,), N."""

    @property
    def moment(self) -> tuple[float, float, float]:
        """Moment (3,), N·m."""


def quasi_force(dynamics: ReducedDynamics, q: Array, wrenches: Sequence[LinkWrench]) -> Array:
    """Return the quasi-force Σ Jᵀ (f, n) (dof,) of forces from outside at q (nq,).

    Raises:
        UnknownNameError: One is on no link.
    """
    total = np.zeros(dynamics.robot.dof)
    for each in wrenches:
        total += dynamics.jacobian(q, each.link).T @ np.array([*each.force, *each.moment])
    return total


def outside_at(dynamics: ReducedDynamics, q: Array, wrenches: Sequence[LinkWrench]) -> OutsideForce:
    """Return what forces from outside do to the tree at q (nq,).

    Raises:
        UnknownNameError: One is on no link.
    """
    push, wrench = np.zeros(dynamics.robot.nv), np.zeros(6)
    for each in wrenches:
        one = push_at(dynamics, q, each.link, np.array(each.force), np.array(each.moment))
        push += one.push
        wrench += one.wrench
    return OutsideForce(push, wrench)


def push_at(
    dynamics: ReducedDynamics, q: Array, link: str, force: Array, moment: Array
) -> OutsideForce:
    """Return what a force (3,), N, at the origin of a link's frame and a moment (3,), N·m, do.

    Both are along the world's axes.

    Raises:
        UnknownNameError: The link is not known.
    """
    model = dynamics.robot.model
    push = dynamics.tree_jacobian(q, link).T @ np.concatenate([force, moment])
    data = dynamics.placements(q)
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    root = data.oMi[ROOT_JOINT]
    arm = data.oMi[frame.parentJoint].act(frame.placement.translation) - root.translation
    wrench = root.rotation.T @ np.column_stack([force, moment + np.cross(arm, force)])
    return OutsideForce(push, wrench.T.ravel())


def pushed_efforts(
    dynamics: ReducedDynamics, q: Array, nu: Array, nu_dot: Array, push: OutsideForce
) -> Array:
    """Return the efforts τ (n_act,), N·m or N, with which a pushed robot moves as it is told.

    Raises:
        ActuationError: Nothing drives one of the quasi-velocities.
    """
    return dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot) - dynamics.basis(q).T @ push.push)
