"""Plans of the horizon law: from a state and its reference to accelerations of N steps."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.body_clearance import body_clearance
from rpctl.control.horizon.constraints import (
    Cost,
    ForceBounds,
    HardBounds,
    SoftBound,
    WheelSpeeds,
    arm_clearance,
    base_clearance,
    contact_radius,
    every_nth_stage,
)
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.plan import Feedback, Follower, HorizonPlan, Planned
from rpctl.control.horizon.prediction import Indices, Model, PredictedMotion
from rpctl.control.horizon.qp import (
    CondensedQp,
    CondensedStructure,
    Linearisation,
    LinearRows,
)
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
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.reference.motion import Reference

END_EFFECTOR_STRIDE = 5  # steps between the stages with a cost of the end effector
NEAR_STAGES = 3  # first stages that also have it among obstacles
EXPECTED_STEP = 0.01  # s: steps in which the state is expected at which a plan begins
FIRST_SQP_STEPS = 3  # QPs of the first sample, each linearised about the last one's motion


class Asked(NamedTuple):
    """What a plan is asked for that is computed beside the samples."""

    t: float  # s, of the measured state
    q: Array  # (nq,)
    nu: Array  # (dof,)
    delay: float  # s until the plan is expected: it begins then
    beside: Array  # (dof,) by how much ν_d is off the plan before
    sees: bool = True  # whether what is measured corrects what is commanded


class Problem(NamedTuple):
    """A QP, linearised about a motion from a time on."""

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
        self._forces = ForceModel(self.model, contacts, law.bounds)
        self._preview = Preview(robot)
        self._pace_limits = PaceLimits(self.model, self._forces, law.bounds, self._preview)
        self._time_scaler = TimeScaler(
            self.model, self._pace_limits, law.bounds.base_acceleration, law.leash
        )
        self._soft = _soft_bounds(law, self.model, self._forces, self._radius)
        self.cost = Cost(law.weights, self.model, len(end_effector_stages))
        self.structure = CondensedStructure(self.model, self.cost.hessian, self.cost.cross)
        self._largest = law.bounds.accelerations(self.model)
        self._problem: Problem  # the QP of the last plan
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
                found = self._solved(self._about(t, q, start, nu_dot, target))
                if found.plan is None:
                    break
                nu_dot = found.plan.nu_dot
            return found
        except SingularBasisError:  # the plan passes through singular steering angles
            return Planned(None)

    def expected(self, asked: Asked, last: HorizonPlan | None) -> tuple[Array, Array, Array]:
        """Return q, ν and ν_d less the last plan's (dof,) where the delay ends.

        Until then the robot follows the last plan, and comes back to it from beside it: a plan that
        did not know would correct once more what is corrected by then.
        """
        t, q, nu, delay, beside, sees = asked
        follower, steps = Follower(self.model.robot), math.ceil(delay / EXPECTED_STEP)
        if last is None:
            return q, nu, np.zeros_like(nu)
        follower.begin(t, -beside)
        for k in range(steps):
            at, length = t + k * delay / steps, delay / steps
            nu_dot = follower(last, at, q if sees else None).nu_d_dot
            q, nu = self.advanced(q, nu, nu_dot, length)
        follower(last, t + delay, q if sees else None)
        return q, nu, follower.beside

    def lag(self, t: float) -> float:
        """Return how much later than at its time (s) the reference is read, s."""
        return t - self._time_scaler.reference_time(t)

    def _about(self, t: float, q: Array, nu: Array, nu_dot: Array, target: Target) -> Problem:
        """Return the QP about the motion from a state on, under given accelerations."""
        motion = self.model.predict(q, nu, nu_dot)
        values = self.linearise(motion, target)
        return Problem(t, motion, values, CondensedQp(self.structure, values))

    def feedback(self, plan: HorizonPlan, beside: Array) -> Feedback | None:
        """Return where the last plan leads, and what keeps a robot on it.

        Args:
            beside: By how much ν_d is off the plan before at its start (dof,).
        """
        model, problem = self.model, self._problem
        q = problem.motion.start
        try:
            motion = model.predict(q, plan.nu, plan.nu_dot)
            vx, vy, omega = model.dynamics.twist(q, plan.nu)
        except SingularBasisError:
            return None
        cos, sin = np.cos(motion.pose[0, 2]), np.sin(motion.pose[0, 2])
        start = [cos * vx - sin * vy, sin * vx + cos * vy, omega]
        change = np.diff(motion.pose, axis=0)
        rates = np.vstack([start, 0.5 * (change[:-1] + change[1:]) / plan.dt])
        bends = (change - rates * plan.dt) / plan.dt**2
        nu, joints = motion.nu[:-1, model.base :], plan.nu_dot[:, model.base :]
        coefficients = (
            [motion.pose[:-1], motion.joints[:-1], motion.nu[:-1]],
            [rates, nu, plan.nu_dot],
            [bends, 0.5 * joints, np.zeros_like(plan.nu_dot)],
        )
        along = np.stack([np.hstack(each) for each in coefficients])
        gain = problem.qp.gain(problem.values, self._active)
        return Feedback(along, gain, self._largest, beside)

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
        places, extra = list[LinearRows](), list[LinearRows]()
        if self._kinematics:
            places = [self._kinematics(motion)]
            goals, obstacles = self._kinematics(target).value, law.end_effector_obstacles
            goals = arm_detour(goals, places[0].value[0], obstacles, law.end_effector_radius)
            extra = [self.cost.end_effector_errors(places[0], goals)]
        sample = Sample(motion, target, places)
        lower, upper = self._hard_bounds.linearise(sample)
        soft = [rows for bound in self._soft for rows in bound(sample)]
        errors = self.cost.errors(sample)
        return Linearisation(motion.jacobian, errors, extra, soft, lower, upper)

    def _target(self, reference: Reference, t: float, q: Array) -> Target:
        """Return the reference ahead, in scaled time."""
        model = self.model
        if self._preview.follow(reference):
            self._pace_limits.forget()
        time_scaling = self._time_scaler(self._preview, t, model.robot.base_pose(q))
        self._forces.update(q)  # the scaler looked at those of the reference's postures
        return look_ahead(model, self._preview, time_scaling, model.joint_positions(q))

    def _solved(self, problem: Problem) -> Planned:
        """Return the plan of a QP, from its motion's start on."""
        found, self._problem = problem.qp.solve(problem.values, self._active), problem
        self._active, x, lag = found.active, found.x, self._time_scaler.largest_lag
        if not found.solved or not np.isfinite(x).all():
            return Planned(None, 0.0, lag)
        motion, structure = problem.motion, self.structure
        nu_dot = motion.nu_dot + x[structure.indices.nu_dot]
        slack = float(x[structure.deviations :].max(initial=0.0))
        plan = HorizonPlan(problem.t, self.model.dt, motion.nu[0], nu_dot)
        return Planned(plan, slack, lag, self.lag(problem.t))


class Planning:
    """Plan after plan of one robot, each from where the one before leads while it is computed."""

    def __init__(self, planner: Planner) -> None:
        self._planner, self.dt = planner, planner.model.dt
        self._last: HorizonPlan | None = None

    def __call__(self, reference: Reference, asked: Asked) -> Planned:
        """Return the next plan, with what keeps a robot on it."""
        planner, last = self._planner, self._last
        q, nu, beside = planner.expected(asked, last)
        if last is not None:
            last = last._replace(nu=last.nu + beside)
        planned = planner.plan(reference, asked.t + asked.delay, q, nu, last)
        if planned.plan is not None:
            feedback = planner.feedback(planned.plan, beside)
            planned = planned._replace(plan=planned.plan._replace(feedback=feedback))
        self._last = planned.plan
        return planned


def _soft_bounds(
    law: PlannerSettings, model: Model, forces: ForceModel, radius: float
) -> list[SoftBound]:
    """Return the soft constraints that apply to a robot."""
    found: list[SoftBound] = [WheelSpeeds(model, law.bounds), ForceBounds(model, forces)]
    if law.base_obstacles and model.base:
        found.append(partial(base_clearance, model, law.base_obstacles, radius))
    if law.end_effector_obstacles:
        tip = law.end_effector_obstacles, law.end_effector_radius
        found.append(partial(arm_clearance, *tip))
    if law.body_clearance is not None:
        obstacles = law.base_obstacles, law.end_effector_obstacles
        found += body_clearance(model, law.body_clearance, *obstacles)
    return found
