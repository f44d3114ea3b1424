"""The referee: the same efforts and the same start through the reduced model and other engines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import FRICTION, Contacts, find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.causes import Trace, beyond, trace
from rpctl.engines.comparison import EngineGap, compare
from rpctl.engines.course import RefereeCourse
from rpctl.engines.engine import Engine, EngineFault
from rpctl.engines.recording import EngineRecording, record
from rpctl.engines.reduced import ReducedRun
from rpctl.engines.switches import ALL_DEFAULT, Switches
from rpctl.engines.turning import TurnVerdict, judge_turn
from rpctl.equivalence.contact.plan import SERVO_BANDWIDTH, ContactPlan, plan_motion
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

DURATION_S = 3.0  # s of the motion


@dataclass(frozen=True, eq=False)
class EngineVerdict:
    """What the referee found of an engine.

    Attributes:
        engine: Its name.
        version: Its version.
        gaps: Between the model and the engine as a user runs it, the largest first.
        trace: Why they disagree; None where they agree.
        model: What the model did.
        recording: What the engine did by default.
        friction: Coefficient of the ground where it is mended.
        turn: How a skid-steer base turns in place there; None of others, and where it is not asked.
    """

    engine: str
    version: str
    gaps: tuple[EngineGap, ...]
    trace: Trace | None
    model: EngineRecording = field(repr=False)
    recording: EngineRecording = field(repr=False)
    friction: float = FRICTION
    turn: TurnVerdict | None = None

    @property
    def agrees(self) -> bool:
        """Whether the engine does what the model does, as a user runs it."""
        return not beyond(self.gaps)

    @property
    def traced(self) -> bool:
        """Whether it agrees, or its causes are known."""
        return self.trace is None or self.trace.complete

    def gap(self, name: str) -> EngineGap | None:
        """Return a gap by its name, or None where it was not compared."""
        return next((gap for gap in self.gaps if gap.name == name), None)

    @property
    def mended(self) -> EngineRecording | None:
        """What the engine did with all mended, or None where there was nothing to mend."""
        return None if self.trace is None else self.trace.mended

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or left out, of the model and of the engine, in sentences."""
        return tuple(dict.fromkeys((*self.model.notes, *self.recording.notes)))


class Referee:
    """A robot, its motion, and what the reduced model does.

    Args:
        robot: The robot.
        friction: Coefficient between wheels and ground where an engine's own is mended.
        duration: Of the motion, s.

    Raises:
        RpctlError: The robot has a fixed base, is not known to stand, or cannot move gently.
    """

    def __init__(
        self, robot: Robot, friction: float = FRICTION, duration: float = DURATION_S
    ) -> None:
        self.robot, self._friction, self._duration = robot, friction, duration
        if not robot.drive.wheels:
            raise RpctlError(f"{robot.name} has a fixed base: there is no ground to disagree about")
        self.dynamics = ReducedDynamics(robot)
        self._motions: dict[float, tuple[ContactPlan, EngineRecording]] = {}

    @cached_property
    def contacts(self) -> Contacts:
        """How the robot stands.

        Raises:
            RpctlError: It is not known to stand.
        """
        found = find_contacts(self.dynamics, self._friction)
        if found is None or not found.balanced:
            why = found.notes[0] if found is not None and found.notes else "it has no contacts"
            raise RpctlError(f"{self.robot.name} is not known to stand: {why}")
        return found

    def motion(self, tick: float) -> tuple[ContactPlan, EngineRecording]:
        """Return the efforts that hold for a tick (s) each, and what the model does under them."""
        if tick not in self._motions:
            course = RefereeCourse(duration=self._duration, tick=tick)
            plan = plan_motion(self.dynamics, self.contacts, course)
            run = ReducedRun(self.dynamics, self.contacts, plan.q[0])
            self._motions[tick] = plan, record(run, self.robot, plan, tick, None)
        return self._motions[tick]

    def judge(self, engine: Engine) -> EngineVerdict:
        """Return what an engine does beside the model, and why it disagrees.

        Args:
            engine: The engine.
        """
        _, model = self.motion(engine.tick)
        recording = self.run(engine, ALL_DEFAULT)
        gaps = self.compare(model, recording)
        found = None
        if beyond(gaps):
            found = trace(
                engine.switches(self.robot),
                lambda switches: self.run(engine, switches),
                self.compare,
                model,
            )
        plan, _ = self.motion(engine.tick)
        turn = judge_turn(self.robot, engine, plan, self._hold(plan), self._friction)
        return EngineVerdict(
            engine.name, engine.version, gaps, found, model, recording, self._friction, turn
        )

    def _hold(self, plan: ContactPlan) -> Array:
        """Return the efforts (n_act,) that hold the robot where a plan starts."""
        still = np.zeros(self.robot.dof)
        return self.dynamics.efforts(plan.q[0], self.dynamics.inverse(plan.q[0], still, still))

    def run(self, engine: Engine, switches: Switches) -> EngineRecording:
        """Return what an engine does with switches.

        Args:
            engine: The engine.
            switches: What is mended.
        """
        plan, model = self.motion(engine.tick)
        hold = self._hold(plan)
        try:
            run = engine.start(self.robot, plan.q[0], switches, self._friction)
        except EngineFault as fault:
            return _refused(model, str(fault))
        return record(run, self.robot, plan, engine.tick, hold)

    def compare(self, model: EngineRecording, engine: EngineRecording) -> tuple[EngineGap, ...]:
        """Return the gaps between what a robot should do and what it did, the largest first."""
        return compare(self.robot, self.contacts, model, engine, self._slack)

    @cached_property
    def _slack(self) -> dict[str, float]:
        """How far dry friction holds each joint with a servo off its place, rad or m."""
        losses = self.robot.losses
        if losses is None:
            return {}
        plan, _ = next(iter(self._motions.values()))
        stiffness = SERVO_BANDWIDTH**2 * np.diagonal(plan.inertia, axis1=1, axis2=2).min(axis=0)
        friction = [losses.friction[self.robot.velocity_index(name)] for name in plan.names]
        return dict(zip(plan.names, (friction / stiffness).tolist(), strict=True))


def referee(
    robot: Robot,
    engines: Sequence[Engine],
    friction: float = FRICTION,
    duration: float = DURATION_S,
) -> tuple[EngineVerdict, ...]:
    """Return the verdicts on engines: who moves a robot as the reduced model does, and who why not.

    Args:
        robot: The robot.
        engines: The engines.
        friction: Coefficient between wheels and ground.
        duration: Of the motion, s.

    Raises:
        RpctlError: The robot has a fixed base, is not known to stand, or cannot move gently.
    """
    judge = Referee(robot, friction, duration)
    return tuple(judge.judge(engine) for engine in engines)


def _refused(model: EngineRecording, fault: str) -> EngineRecording:
    """Return the recording of an engine that does not take the robot."""

    nothing: dict[str, Any] = {
        name: np.zeros_like(value[:1])
        for name, value in vars(model).items()
        if isinstance(value, np.ndarray)
    }
    joints = {name: np.zeros(1) for name in model.joints}
    return EngineRecording(**nothing, joints=joints, fault=fault)
