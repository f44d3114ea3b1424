"""The horizon law: predictive control of the whole robot over N steps, within its limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.constraints import (
    ArmClearance,
    BaseClearance,
    ForceBounds,
    HardBounds,
    SoftBound,
    WheelSpeeds,
    contact_radius,
    every_nth_stage,
)
from rpctl.control.horizon.cost import Cost
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.pace import PaceLimits
from rpctl.control.horizon.prediction import Model, PredictedMotion, make_model
from rpctl.control.horizon.preview import Preview
from rpctl.control.horizon.qp import QpBuilder, QuadraticProgram, stage_indices
from rpctl.control.horizon.settings import Bounds, Weights
from rpctl.control.horizon.solver import Solver
from rpctl.control.horizon.target import (
    EndEffectorKinematics,
    Sample,
    Target,
    TimeScaler,
    arm_detour,
    base_detour,
    look_ahead,
)
from rpctl.control.law import Command, KinematicController, KinematicLaw, Rest, as_law
from rpctl.control.obstacles import Obstacle
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, SingularBasisError, require_positive
from rpctl.reference.motion import Reference

MAX_STEPS = 500  # memory grows with their square: .1 GB for a mobile manipulator
END_EFFECTOR_STRIDE = 5  # steps between the stages with a cost of the end effector
NEAR_STAGES = 3  # first stages that also have it among obstacles
FIRST_SQP_STEPS = 3  # QPs of the first sample, each linearised about the last one's motion
PLAN_BLEND_TIME = 0.08  # s: time constant with which plans follow the measured ν
TIME_ROUNDING = 1e-9  # s: rounding of a sample's time
SOFTENED_SLACK = 1e-3  # of a limit, or m: slack from which a bound counts as softened


@dataclass(frozen=True)
class Horizon:
    """Predictive control over N steps of length dt, by one sparse QP a solve.

    Every ``period`` the last plan is simulated again from the measured q, the robot is linearised
    about that motion, and a QP finds the accelerations ν̇ of the N steps that bring pose, arm, end
    effector and ν nearest to the reference (one step of sequential quadratic programming, the
    real-time iteration of [DBS05]). Until the next solve the command is the first step of the plan,
    ν_d = ν₀ + ν̇₀ (t − t₀) and ν̇_d = ν̇₀. ν₀ is the last plan's value, drawn towards the measured
    ν with a time constant of 0.08 s. Steering angles are states of the prediction as the arm's are.

    Accelerations, joint speeds and joint positions are hard bounds; wheel speeds, efforts,
    zero-moment point, grip and clearances are soft, at a price above that of tracking errors. Where
    the bounds do not let the robot follow, the reference's time is scaled
    (:class:`~rpctl.control.horizon.target.TimeScaler`). A failed solve is counted and its
    period is left to ``fallback``.

    Attributes:
        steps: Number of steps N.
        dt: Length of a step, s.
        period: Time between two solves, s; at most ``dt``.
        weights: Weights of the cost.
        bounds: Bounds beside those of the URDF.
        base_obstacles: Obstacles of the base.
        end_effector_obstacles: Obstacles of the end effector.
        base_radius: Radius of the base about P, m; None: distance of the farthest contact.
        end_effector_radius: Radius of the end effector, m.
        leash: Largest distance of the base behind the reference, m; beyond, the reference waits.
        fallback: Law of the samples without a plan.
    """

    steps: int = 20
    dt: float = 0.1
    period: float = 0.02
    weights: Weights = field(default_factory=Weights)
    bounds: Bounds = field(default_factory=Bounds)
    base_obstacles: tuple[Obstacle, ...] = ()
    end_effector_obstacles: tuple[Obstacle, ...] = ()
    base_radius: float | None = None
    end_effector_radius: float = 0.05
    leash: float = 0.3
    fallback: KinematicLaw = field(default_factory=UnifiedKinematic)

    def __post_init__(self) -> None:
        """Refuse settings that predict nothing."""
        for name in ("dt", "period", "end_effector_radius", "leash"):
            require_positive(name, getattr(self, name))
        if self.base_radius is not None:
            require_positive("base_radius", self.base_radius)
        if not 2 <= self.steps <= MAX_STEPS:
            raise RpctlError(f"steps is {self.steps}; give 2 to {MAX_STEPS}")
        if self.period > self.dt:
            raise RpctlError(
                f"period {self.period:g} s is longer than a step; give at most {self.dt:g} s"
            )

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> HorizonLaw:
        """Return the controller of one run, without a plan and with all counts at zero.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s, for the fallback: solves are :attr:`period` apart.
            rest: State before the run, for the fallback.
        """
        return HorizonLaw(self, dynamics, as_law(self.fallback).start(dynamics, period, rest))


class HorizonPlan(NamedTuple):
    """Result of a solve: accelerations, constant in each step, from time ``t`` and ``nu`` on."""

    t: float
    nu: Array  # (dof,)
    nu_dot: Array  # (N, dof)


class HorizonLaw:
    """:class:`Horizon` on one robot, with its plan and its counts.

    Args:
        law: Its settings.
        dynamics: The robot's dynamics.
        fallback: Controller of the samples without a plan.
    """

    def __init__(
        self, law: Horizon, dynamics: ReducedDynamics, fallback: KinematicController
    ) -> None:
        self._law, self._fallback = law, fallback
        self._plan: HorizonPlan | None = None
        self.solved_at = -np.inf
        self.solves = self.fallbacks = self.softened = 0
        self.model = make_model(dynamics, law.steps, law.dt)
        robot, contacts = dynamics.robot, find_contacts(dynamics, law.bounds.friction)
        end_effector_stages = every_nth_stage(law.steps, END_EFFECTOR_STRIDE)
        if law.end_effector_obstacles:  # its next steps, too
            end_effector_stages = sorted(
                {*range(min(NEAR_STAGES, law.steps)), *end_effector_stages}
            )
        self._kinematics = (
            EndEffectorKinematics(self.model, end_effector_stages) if robot.end_effector else None
        )
        self._hard_bounds = HardBounds(self.model, law.bounds)
        self._radius = law.base_radius or contact_radius(robot, contacts)
        self._forces = ForceModel(self.model, contacts, law.bounds.tip_margin, law.bounds.grip)
        self._preview = Preview(robot)
        self._pace_limits = PaceLimits(self.model, self._forces, law.bounds, self._preview)
        self._time_scaler = TimeScaler(
            self.model, self._pace_limits, law.bounds.base_acceleration, law.leash
        )
        self._soft = _soft_bounds(law, self.model, self._forces, end_effector_stages, self._radius)
        self.cost = Cost(law.weights, self.model, len(end_effector_stages))
        self.program = QpBuilder(
            self.model,
            self.cost.hessian,
            self.cost.cross,
            end_effector_stages if self._kinematics else [],
            [
                row_block
                for bound in self._soft
                for row_block in bound.row_blocks(stage_indices(self.model))
            ],
        )
        self._solver = Solver()

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command, from a new plan if it is time for one.

        Args:
            dynamics: The robot's dynamics, for the fallback.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        if t - self.solved_at >= self._law.period - TIME_ROUNDING:
            self.solved_at = t
            try:
                self._plan = self._solve(reference, t, q, self._planning_nu(t, nu))
            except SingularBasisError:  # the plan passes through singular steering angles
                self.fallbacks += 1
                self._plan = None
        if self._plan is None:
            return self._fallback(dynamics, reference, t, q, nu)
        nu_dot = self._plan.nu_dot[0]
        return Command(self._plan.nu + (t - self._plan.t) * nu_dot, nu_dot)

    def report(self) -> dict[str, float]:
        """Return the numbers of solves, of failed ones, and of those that softened a bound.

        ``largest_lag`` (s) is how far the scaled reference time fell behind.
        """
        return {
            "solves": self.solves,
            "fallbacks": self.fallbacks,
            "softened": self.softened,
            "largest_lag": self._time_scaler.largest_lag,
        }

    def build_qp(self, motion: PredictedMotion, target: Target) -> QuadraticProgram:
        """Return the QP that is linearised about a motion and leads it to a target."""
        model, law = self.model, self._law
        if model.base:
            target = base_detour(
                target,
                motion.pose[0, :2],
                law.base_obstacles,
                self._radius,
                turns=not model.robot.drive.omnidirectional,
            )
        end_effector = None
        if self._kinematics:
            end_effector = self._kinematics.end_effector(motion, target)
            end_effector = arm_detour(
                end_effector, law.end_effector_obstacles, law.end_effector_radius
            )
        sample = Sample(motion, target, end_effector)
        lower, upper = self._hard_bounds.linearise(sample)
        return self.program.build(
            model.jacobian(motion),
            self.cost.gradient(sample),
            self.cost.end_effector_cost(end_effector),
            [soft for bound in self._soft for soft in bound.linearise(sample)],
            lower,
            upper,
        )

    def _solve(self, reference: Reference, t: float, q: Array, nu: Array) -> HorizonPlan | None:
        """Return the plan from the measured state on; None if a QP was not solved.

        Args:
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities to plan from (dof,).
        """
        model = self.model
        if self._preview.follow(reference):
            self._pace_limits.forget()
        time_scaling = self._time_scaler(self._preview, t, model.robot.base_pose(q))
        target = look_ahead(model, self._preview, time_scaling, model.joint_positions(q))
        self._forces.update_contacts(q)  # the scaler looked at those of the reference's postures
        nu_dot = self._shifted_plan(t)
        self.solves += 1
        slack = 0.0
        for _ in range(FIRST_SQP_STEPS if self._plan is None else 1):
            motion = model.predict(q, nu, nu_dot)
            solution = self._solver.solve(self.build_qp(motion, target))
            if not solution.solved:
                self.fallbacks += 1
                return None
            nu_dot = motion.nu_dot + solution.x[self.program.indices.nu_dot]
            slack = self.program.slack(solution.x)
        self.softened += slack > SOFTENED_SLACK
        return HorizonPlan(t, nu, nu_dot)

    def _planning_nu(self, t: float, nu: Array) -> Array:
        """Return the initial ν (dof,) of the next plan: the last plan's, drawn to the measured one.

        Planning from the measured ν alone would accept every deviation, and only the far end of the
        horizon would correct it: light joints drift off once efforts arrive 20 ms late.
        """
        if self._plan is None:
            return nu
        elapsed = t - self._plan.t
        planned = self._plan.nu + elapsed * self._plan.nu_dot[0]
        return np.asarray(planned + min(elapsed / PLAN_BLEND_TIME, 1.0) * (nu - planned))

    def _shifted_plan(self, t: float) -> Array:
        """Return the last plan's accelerations (N, dof), shifted to steps from t on."""
        rest = np.zeros((self.model.steps, self.model.robot.dof))
        if self._plan is None:
            return rest
        whole, part = divmod((t - self._plan.t) / self.model.dt, 1.0)
        ahead = self._plan.nu_dot[int(whole) :]
        rest[: len(ahead)] += (1.0 - part) * ahead
        rest[: len(ahead[1:])] += part * ahead[1:]
        return rest


def _soft_bounds(
    law: Horizon, model: Model, forces: ForceModel, end_effector_stages: list[int], radius: float
) -> list[SoftBound]:
    """Return the soft constraints that apply to a robot."""
    bounds = law.bounds
    found: list[SoftBound] = [WheelSpeeds(model, bounds), ForceBounds(model, bounds, forces)]
    if law.base_obstacles and model.base:
        found.append(BaseClearance(law.base_obstacles, radius))
    if law.end_effector_obstacles and model.robot.end_effector:
        found.append(
            ArmClearance(law.end_effector_obstacles, law.end_effector_radius, end_effector_stages)
        )
    return found
