"""Plans of the horizon law: from a state and its reference to accelerations of N steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.body_clearance import body_clearance
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
from rpctl.control.horizon.cost import Cost, StateDifference, from_another_start
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.prediction import Indices, Model, PredictedMotion
from rpctl.control.horizon.qp import CondensedQp, CondensedStructure, Linearisation, stage_indices
from rpctl.control.horizon.settings import PlannerSettings
from rpctl.control.horizon.target import (
    EndEffectorKinematics,
    PaceLimits,
    Preview,
    Sample,
    Target,
    TimeScaler,
    arm_detour,
    base_detour,
    look_ahead,
)
from rpctl.control.law import Command
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.reference.motion import Reference

END_EFFECTOR_STRIDE = 5  # steps between the stages with a cost of the end effector
NEAR_STAGES = 3  # first stages that also have it among obstacles
FIRST_SQP_STEPS = 3  # QPs of the first sample, each linearised about the last one's motion
PLAN_BLEND_TIME = 0.08  # s: time constant with which plans follow the measured ν
SOFTENED_SLACK = 1e-3  # of a limit, or m: slack from which a bound counts as softened


class HorizonPlan(NamedTuple):
    """Accelerations, constant in each step, from time ``t`` and ``nu`` on."""

    t: float  # s
    dt: float  # length of a step, s
    nu: Array  # (dof,)
    nu_dot: Array  # (N, dof)

    def command(self, t: float) -> Command:
        """Return ν and ν̇ of the plan at a time (s); before it begins, those of its first step."""
        step = min(max(int((t - self.t) / self.dt), 0), len(self.nu_dot) - 1)
        before = self.dt * self.nu_dot[:step].sum(axis=0)
        nu_dot = self.nu_dot[step]
        return Command(self.nu + before + (t - self.t - step * self.dt) * nu_dot, nu_dot)

    def start_of_next(self, t: float, nu: Array) -> Array:
        """Return the initial ν (dof,) of a plan from ``t`` on: this one's, drawn to the measured.

        Planning from the measured ν alone would accept every deviation, and only the far end of the
        horizon would correct it: light joints drift off once efforts arrive 20 ms late.
        """
        planned = self.command(t).nu_d
        return np.asarray(planned + min((t - self.t) / PLAN_BLEND_TIME, 1.0) * (nu - planned))

    def shifted(self, t: float) -> Array:
        """Return the accelerations (N, dof), shifted to steps from ``t`` on; then zeros."""
        shifted = np.zeros_like(self.nu_dot)
        whole, part = divmod(max(t - self.t, 0.0) / self.dt, 1.0)
        ahead = self.nu_dot[int(whole) :]
        shifted[: len(ahead)] += (1.0 - part) * ahead
        shifted[: len(ahead[1:])] += part * ahead[1:]
        return shifted


class Planned(NamedTuple):
    """What became of a solve."""

    plan: HorizonPlan | None  # None if a QP was not solved
    slack: float = 0.0  # the largest, of a limit or m
    largest_lag: float = 0.0  # of the scaled reference time so far, s

    @property
    def softened(self) -> bool:
        """Whether a bound gave way."""
        return self.slack > SOFTENED_SLACK


class Prepared(NamedTuple):
    """A QP that waits for the measured state at a time."""

    t: float  # s
    motion: PredictedMotion
    values: Linearisation
    qp: CondensedQp


class Planner:
    """Makes the plans of one robot, one after the other."""

    def __init__(self, law: PlannerSettings, dynamics: ReducedDynamics) -> None:
        self._law, self.model = law, Model(dynamics, law.steps, law.dt)
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
        indices = stage_indices(self.model)
        self.structure = CondensedStructure(
            self.model,
            self.cost.hessian,
            self.cost.cross,
            end_effector_stages if self._kinematics else [],
            [block for bound in self._soft for block in bound.row_blocks(indices)],
        )
        self._active: Indices = np.empty(0, dtype=np.intp)  # bounds that held the last solution

    def plan(
        self, reference: Reference, t: float, q: Array, nu: Array, last: HorizonPlan | None
    ) -> Planned:
        """Return the plan from a state on.

        Args:
            last: The plan before; None without one.
        """
        try:
            target = self._target(reference, t, q)
            start = nu if last is None else last.start_of_next(t, nu)
            nu_dot = np.zeros((self.model.steps, len(nu))) if last is None else last.shifted(t)
            for _ in range(FIRST_SQP_STEPS if last is None else 1):
                motion = self.model.predict(q, start, nu_dot)
                values = self.linearise(motion, target)
                found = self._solved(t, start, nu_dot, values, CondensedQp(self.structure, values))
                if found.plan is None:
                    break
                nu_dot = found.plan.nu_dot
            return found
        except SingularBasisError:  # the plan passes through singular steering angles
            return Planned(None)

    def lag(self, t: float) -> float:
        """Return how much later than at its time (s) the reference is read, s."""
        return t - self._time_scaler.reference_time(t)

    def prepare(
        self, reference: Reference, t: float, q: Array, nu: Array, last: HorizonPlan
    ) -> Prepared | None:
        """Return the QP about the motion from a predicted state on; None where there is none.

        Args:
            last: The plan that leads there.
        """
        try:
            motion = self.model.predict(q, nu, last.shifted(t))
            values = self.linearise(motion, self._target(reference, t, q))
        except SingularBasisError:
            return None
        return Prepared(t, motion, values, CondensedQp(self.structure, values))

    def feed_back(self, prepared: Prepared, q: Array, nu: Array, last: HorizonPlan) -> Planned:
        """Return the plan from a measured state on, by a QP prepared for it.

        Args:
            prepared: The QP, about the motion from the state that was expected.
        """
        start, model = last.start_of_next(prepared.t, nu), self.model
        motion = prepared.motion
        difference = StateDifference(
            model.robot.base_pose(q) - motion.pose[0],
            model.joint_positions(q) - motion.joints[0],
            start - motion.nu[0],
        )
        values = from_another_start(self.structure, prepared.values, difference)
        return self._solved(prepared.t, start, motion.nu_dot, values, prepared.qp)

    def advanced(self, q: Array, nu: Array, nu_dot: Array, duration: float) -> tuple[Array, Array]:
        """Return q and ν after a time under constant acceleration.

        Args:
            duration: s.
        """
        model = self.model
        v = model.dynamics.basis(q) @ (nu + 0.5 * duration * nu_dot)
        return pin.integrate(model.robot.model, q, duration * v), nu + duration * nu_dot

    def linearise(self, motion: PredictedMotion, target: Target) -> Linearisation:
        """Return the values of the QP that is linearised about a motion and leads to a target."""
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
        return Linearisation(
            model.jacobian(motion),
            self.cost.gradient(sample),
            self.cost.end_effector_cost(end_effector),
            [soft for bound in self._soft for soft in bound.linearise(sample)],
            lower,
            upper,
        )

    def _target(self, reference: Reference, t: float, q: Array) -> Target:
        """Return the reference ahead, in scaled time."""
        model = self.model
        if self._preview.follow(reference):
            self._pace_limits.forget()
        time_scaling = self._time_scaler(self._preview, t, model.robot.base_pose(q))
        if self._forces.ground is not None:
            self._forces.ground.update(q)  # the scaler looked at those of the reference's postures
        return look_ahead(model, self._preview, time_scaling, model.joint_positions(q))

    def _solved(
        self, t: float, nu: Array, nu_dot: Array, values: Linearisation, qp: CondensedQp
    ) -> Planned:
        found, lag = qp.solve(values, self._active), self._time_scaler.largest_lag
        self._active, x = found.active, found.x
        if not found.solved or not np.isfinite(x).all():
            return Planned(None, 0.0, lag)
        plan = HorizonPlan(t, self.model.dt, nu, nu_dot + x[self.structure.indices.nu_dot])
        return Planned(plan, float(x[self.structure.deviations :].max(initial=0.0)), lag)


def _soft_bounds(
    law: PlannerSettings,
    model: Model,
    forces: ForceModel,
    end_effector_stages: list[int],
    radius: float,
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
    if law.body_clearance is not None:
        obstacles = law.base_obstacles, law.end_effector_obstacles
        found += body_clearance(model, law.body_clearance, *obstacles)
    return found
