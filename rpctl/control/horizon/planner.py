"""Plans of the horizon law: accelerations of N steps, who makes them, and who follows them."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.constraints import (
    Cost,
    ForceBounds,
    HardBounds,
    SoftBound,
    WheelSpeeds,
    arm_clearance,
    base_clearance,
    body_clearance,
    contact_radius,
    every_nth_stage,
)
from rpctl.control.horizon.forces import ForceModel
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
from rpctl.control.law import Command
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot

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
    # by how much ν_d is off the plan before (dof,); of a robot that leans, efforts (periods, n_act)
    # that were sent and do not act yet, less those of the steady motion
    beside: Array
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
        return Linearisation(motion.jacobian, self.cost.errors(sample), extra, soft, lower, upper)

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


def start_planning(law: PlannerSettings, dynamics: ReducedDynamics) -> Planning:
    """Return what plans for a robot."""
    return Planning(Planner(law, dynamics))


def _soft_bounds(
    law: PlannerSettings, model: Model, forces: ForceModel, radius: float
) -> list[SoftBound]:
    """Return the soft constraints that apply to a robot."""
    found: list[SoftBound] = [WheelSpeeds(model, law.bounds), ForceBounds(model, forces)]
    if law.base_obstacles and model.base:
        found.append(partial(base_clearance, model, law.base_obstacles, radius))
    if law.end_effector_obstacles:
        found.append(partial(arm_clearance, law.end_effector_obstacles, law.end_effector_radius))
    if law.body_clearance is not None:
        found += body_clearance(
            model, law.body_clearance, law.base_obstacles, law.end_effector_obstacles
        )
    return found


PLAN_BLEND_TIME = 0.08  # s: time constant with which plans follow the measured ν
SOFTENED_SLACK = 1e-3  # of a limit, or m: slack from which a bound counts as softened


class Feedback(NamedTuple):
    """Where a plan leads, and how its first ν̇ would differ had it begun beside its start.

    The state x is pose, joints and ν (3 + n_joints + dof,): x = c₀ + c₁ s + c₂ s² at s (s) after
    the start of a step.
    """

    motion: Array  # (3, N, 3 + n_joints + dof): c₀, c₁ and c₂ of each step
    gain: Array  # (dof, 3 + n_joints + dof)
    largest: Array  # (dof,) |ν̇|
    beside: Array  # (dof,) ν_d less that of the plan before, as foreseen at the start


class HorizonPlan(NamedTuple):
    """Accelerations, constant in each step, from time ``t`` and ``nu`` on."""

    t: float  # s
    dt: float  # length of a step, s
    nu: Array  # (dof,)
    nu_dot: Array  # (N, dof)
    feedback: Feedback | None = None

    @property
    def ends(self) -> float:
        """When nothing is planned any more, s."""
        return self.t + len(self.nu_dot) * self.dt

    def step(self, t: float) -> tuple[int, float]:
        """Return the step at a time (s), and for how long it has lasted; the first before that."""
        step = min(max(int((t - self.t) / self.dt), 0), len(self.nu_dot) - 1)
        return step, t - self.t - step * self.dt

    def command(self, t: float) -> Command:
        """Return ν and ν̇ of the plan at a time (s); before it begins, those of its first step."""
        step, since = self.step(t)
        before = self.dt * self.nu_dot[:step].sum(axis=0)
        nu_dot = self.nu_dot[step]
        return Command(self.nu + before + since * nu_dot, nu_dot)

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

    plan: Any  # HorizonPlan, or that of a robot that leans; None if a QP was not solved
    slack: float = 0.0  # the largest, of a limit or m
    largest_lag: float = 0.0  # of the scaled reference time so far, s
    lag: float = 0.0  # of it at the plan's start, s
    fault: str = ""  # what stopped it

    @property
    def softened(self) -> bool:
        """Whether a bound gave way."""
        return self.slack > SOFTENED_SLACK


class Follower:
    """Keeps a robot on its plan: ν̇ = ν̇_plan + K δ, with ν_d its integral.

    δ is what pose, joints and ν_d are off the plan by, and K the derivative of the QP's solution by
    the state that it starts from, with the bounds held that hold it: what a solve at each sample
    would make of δ, to first order.

    Attributes:
        beside: By how much ν_d is off the plan's (dof,).
    """

    def __init__(self, robot: Robot) -> None:
        self._pose = robot.base_pose
        steered = [swivel.joint for swivel in robot.drive.steered]
        self._places = [robot.entries[name].read for name in (*steered, *robot.joint_names)]
        self.beside = np.zeros(robot.dof)
        self._t = 0.0  # s, of the last sample

    def begin(self, t: float, beside: Array) -> None:
        """Follow another plan from a time (s) on.

        Args:
            beside: By how much it is foreseen that ν_d is off the plan before (dof,).
        """
        self.beside, self._t = self.beside - beside, t

    def __call__(self, plan: HorizonPlan, t: float, q: Array | None) -> Command:
        """Return the command at a time (s).

        Args:
            q: Configuration (nq,); None where it tells nothing of the plan.
        """
        at, elapsed, self._t = plan.feedback, min(t - self._t, plan.dt), t
        if at is None or q is None:
            nu, nu_dot = plan.command(t)
            return Command(nu + self.beside, nu_dot)
        k, since = plan.step(t)
        first, rate, bend = at.motion[:, k]
        planned, own = first + since * (rate + since * bend), -len(plan.nu)
        entries: Any = q.tolist()  # floats are quicker than NumPy's
        off = np.array([*self._pose(entries), *(place(entries) for place in self._places)])
        off -= planned[:own]
        off[2:] -= math.tau * np.rint(off[2:] / math.tau)  # a joint that moves in m is never so far
        nu_dot = rate[own:] + at.gain @ np.concatenate([off, self.beside])
        nu_dot = np.maximum(np.minimum(nu_dot, at.largest), -at.largest)
        command = Command(planned[own:] + self.beside, nu_dot)
        self.beside = self.beside + elapsed * (nu_dot - rate[own:])
        return command
