"""The referee: the same efforts and the same start through the reduced model and other engines.

If they disagree, the referee sets one switch at a time to default or mended to find the causes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.comparison import EngineGap, compare
from rpctl.engines.engine import (
    ALL_DEFAULT,
    ALL_MENDED,
    Engine,
    EngineFault,
    Mended,
    Switch,
)
from rpctl.engines.recording import EngineRecording, ReducedRun, record, referee_course
from rpctl.engines.turning import TurnVerdict, judge_turn
from rpctl.equivalence.contact.plan import (
    SERVO_BANDWIDTH,
    ContactPlan,
    plan_motion,
    standing_contacts,
)
from rpctl.robot.model import Robot

RunWith = Callable[[Mended], EngineRecording]
Compare = Callable[[EngineRecording, EngineRecording], tuple[EngineGap, ...]]
DURATION_S = 3.0  # s of the motion


@dataclass(frozen=True)
class Cause:
    """What makes an engine disagree.

    Attributes:
        switches: One switch that suffices alone, or two that suffice only together.
        gaps: The gaps beyond the bands if only these switches of the mended engine are at default.
    """

    switches: tuple[Switch, ...]
    gaps: tuple[EngineGap, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the switches."""
        return tuple(switch.name for switch in self.switches)

    def setting(self, friction: float) -> str:
        """Return the setting that mends it, with the coefficient of friction in the place of MU."""
        settings = "; ".join(switch.setting for switch in self.switches)
        return settings.replace("MU", f"{friction:g}")

    def words(self, friction: float) -> str:
        """Return the fault, what it causes alone, and the setting that mends it."""
        fault = ", and ".join(switch.fault for switch in self.switches)
        does = f" (alone: {self.gaps[0].words})" if self.gaps else " (only with the others)"
        return f"{fault}{does}; {self.setting(friction)}"

    def to_dict(self, friction: float) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {
            "switches": list(self.names),
            "fault": "; ".join(switch.fault for switch in self.switches),
            "setting": self.setting(friction),
            "alone": [gap.to_dict() for gap in self.gaps],
        }


@dataclass(frozen=True, eq=False)
class Trace:
    """How an engine's disagreement was traced.

    Attributes:
        causes: The causes, the one with the largest effect first.
        mended: What the engine does with all switches mended.
        remaining: Gaps beyond the bands between the mended engine and the model.
        cured: Gaps beyond the bands between the engine with only the causes mended and the mended
            engine; empty if the causes explain the whole disagreement.
    """

    causes: tuple[Cause, ...]
    mended: EngineRecording
    remaining: tuple[EngineGap, ...]
    cured: tuple[EngineGap, ...]

    @property
    def complete(self) -> bool:
        """Whether the causes explain the whole disagreement of the model and the engine."""
        return not (self.remaining or self.cured)


def trace(
    switches: Sequence[Switch], run: RunWith, compare: Compare, model: EngineRecording
) -> Trace:
    """Return the causes why an engine, by default, disagrees with the model.

    In the mended engine each switch alone is set back to default: it is a cause if the motion then
    leaves the bands. If no switch is a cause, pairs are tried. The default engine with the causes
    mended must do what the mended engine does; a switch that it needs for that is added.
    """
    mended = run(ALL_MENDED)
    remaining = beyond(compare(model, mended))
    if mended.fault:
        return Trace((), mended, remaining, ())

    def alone(chosen: tuple[Switch, ...]) -> tuple[EngineGap, ...]:
        return beyond(compare(mended, run(ALL_MENDED - {switch.name for switch in chosen})))

    def left(causes: Sequence[Cause]) -> tuple[EngineGap, ...]:
        known = {switch.name for switch in switches}  # others mean nothing: as the mended engine
        return beyond(compare(mended, run(ALL_MENDED - known | {*_names(causes)})))

    causes = list(_causes(combinations(switches, 1), alone))
    causes = causes or list(_causes(combinations(switches, 2), alone))
    cured = left(causes)
    while cured and len(_names(causes)) < len(switches):
        others = [switch for switch in switches if switch.name not in _names(causes)]
        tried = {switch: left([*causes, Cause((switch,), ())]) for switch in others}
        best = min(others, key=lambda switch: _worst(tried[switch]))
        if _worst(tried[best]) >= _worst(cured):
            break
        causes.append(Cause((best,), alone((best,))))
        cured = tried[best]
    if not cured:
        causes = _needed(causes, left)
    causes.sort(key=lambda cause: -_worst(cause.gaps))
    return Trace(tuple(causes), mended, remaining, cured)


def _needed(
    causes: Sequence[Cause], left: Callable[[Sequence[Cause]], tuple[EngineGap, ...]]
) -> list[Cause]:
    """Return the causes without those that may stay at default once the others are mended.

    For example, a time step that is too long for hard contacts may suit the engine's soft ones.
    """
    kept = list(causes)
    for cause in sorted(causes, key=lambda cause: _worst(cause.gaps)):
        others = [one for one in kept if one is not cause]
        if others and not left(others):
            kept = others
    return kept


def beyond(gaps: Sequence[EngineGap]) -> tuple[EngineGap, ...]:
    """Return the gaps that leave their bands."""
    return tuple(gap for gap in gaps if not gap.agrees)


def _causes(
    groups: Iterator[tuple[Switch, ...]],
    alone: Callable[[tuple[Switch, ...]], tuple[EngineGap, ...]],
) -> Iterator[Cause]:
    for group in groups:
        gaps = alone(group)
        if gaps:
            yield Cause(group, gaps)


def _names(causes: Sequence[Cause]) -> tuple[str, ...]:
    return tuple(name for cause in causes for name in cause.names)


def _worst(gaps: Sequence[EngineGap]) -> float:
    return max((gap.ratio for gap in gaps), default=0.0)


@dataclass(frozen=True, eq=False)
class EngineVerdict:
    """What the referee found out about an engine.

    Attributes:
        engine: Its name.
        version: Its version.
        gaps: Gaps between the model and the engine as a user runs it, the largest first.
        trace: Why they disagree; None if they agree.
        model: What the model did.
        recording: What the engine did by default.
        friction: Coefficient of friction of the mended engine.
        turn: How a skid-steer base turns in place; None for other bases and other engines.
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
        """Whether the engine, as a user runs it, does what the model does."""
        return not beyond(self.gaps)

    @property
    def traced(self) -> bool:
        """Whether it agrees, or its causes are known."""
        return self.trace is None or self.trace.complete

    @property
    def mended(self) -> EngineRecording | None:
        """What the engine did with all switches mended; None if there was nothing to mend."""
        return None if self.trace is None else self.trace.mended

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what the model and the engine assumed or left out."""
        return tuple(dict.fromkeys((*self.model.notes, *self.recording.notes)))

    @property
    def head(self) -> str:
        """The engine and its version."""
        return f"{self.engine} {self.version}"

    @property
    def line(self) -> str:
        """What the referee says of the engine, in one line."""
        found = self.trace
        if found is None:
            return f"{self.head}: agrees with the reduced model"
        said = f"{self.head}: {beyond(self.gaps)[0].words}"
        if found.mended.fault:
            return f"{said}; with all settings corrected it still fails: {found.mended.fault}"
        if found.causes:
            said += f": {'; also '.join(cause.words(self.friction) for cause in found.causes)}"
        if found.cured:
            said += f"; with that corrected, a gap remains: {found.cured[0].words}"
        if found.remaining:
            said += (
                "; with all settings corrected, a gap remains that no setting explains: "
                f"{found.remaining[0].words}"
            )
        return said

    @property
    def turn_line(self) -> str:
        """What the referee says about a skid-steer base's turn in place; may be empty."""
        return "" if self.turn is None else self.turn.line(self.head)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON; what is infinite is None."""
        causes, remaining = (self.trace.causes, self.trace.remaining) if self.trace else ((), ())
        return {
            "engine": self.engine,
            "version": self.version,
            "agrees": self.agrees,
            "traced": self.traced,
            "line": self.line,
            "gaps": [gap.to_dict() for gap in self.gaps],
            "causes": [cause.to_dict(self.friction) for cause in causes],
            "remaining": [gap.to_dict() for gap in remaining],
            "notes": list(self.notes),
            "turn": None if self.turn is None else self.turn.to_dict(self.head),
        }


class Referee:
    """Compares engines with the reduced model of one robot, on one motion.

    Args:
        robot: The robot.
        friction: Coefficient of friction between wheels and ground, used if the switch
            ``friction`` is mended.
        duration: Duration of the motion, s.

    Raises:
        NotGentle: The robot has a fixed base, or rpctl does not know that it stands.
    """

    def __init__(
        self, robot: Robot, friction: float = FRICTION, duration: float = DURATION_S
    ) -> None:
        self.robot, self._friction, self._duration = robot, friction, duration
        self.dynamics = ReducedDynamics(robot)
        self.contacts = standing_contacts(self.dynamics, friction)
        self._motions: dict[float, tuple[ContactPlan, EngineRecording]] = {}

    def motion(self, tick: float) -> tuple[ContactPlan, EngineRecording]:
        """Return the efforts that hold for a tick (s) each, and what the model does under them."""
        if tick not in self._motions:
            plan = plan_motion(self.dynamics, self.contacts, referee_course(self._duration, tick))
            run = ReducedRun(self.dynamics, self.contacts, plan.q[0])
            self._motions[tick] = plan, record(run, self.robot, plan, tick, settled=True)
        return self._motions[tick]

    def judge(self, engine: Engine) -> EngineVerdict:
        """Return how an engine compares with the model, and why it disagrees."""
        plan, model = self.motion(engine.tick)
        recording = self.run(engine, ALL_DEFAULT)
        gaps = self.compare(model, recording)
        found = None
        if beyond(gaps):
            found = trace(
                engine.switches(self.robot),
                lambda mended: self.run(engine, mended),
                self.compare,
                model,
            )
        turn = judge_turn(self.robot, engine, plan, self._friction)
        return EngineVerdict(
            engine.name, engine.version, gaps, found, model, recording, self._friction, turn
        )

    def run(self, engine: Engine, mended: Mended) -> EngineRecording:
        """Return the recording of an engine with some switches mended."""
        plan, model = self.motion(engine.tick)
        try:
            run = engine.start(self.robot, plan.q[0], mended, self._friction)
        except EngineFault as fault:
            return _refused(model, str(fault))
        return record(run, self.robot, plan, engine.tick)

    def compare(self, model: EngineRecording, engine: EngineRecording) -> tuple[EngineGap, ...]:
        """Return the gaps between the recordings of model and engine, the largest first."""
        return compare(self.robot, self.contacts, model, engine, self._slack)

    @cached_property
    def _slack(self) -> dict[str, float]:
        """How far dry friction can hold each joint off its servo's set point, rad or m."""
        losses = self.robot.losses
        if losses is None:
            return {}
        plan, _ = next(iter(self._motions.values()))
        stiffness = SERVO_BANDWIDTH**2 * np.diagonal(plan.inertia, axis1=1, axis2=2).min(axis=0)
        friction = [losses.friction[self.robot.velocity_index(name)] for name in plan.names]
        return dict(zip(plan.names, (friction / stiffness).tolist(), strict=True))


def _refused(model: EngineRecording, fault: str) -> EngineRecording:
    """Return the recording of an engine that refuses the robot."""

    nothing: dict[str, Any] = {
        name: np.zeros_like(value[:1])
        for name, value in vars(model).items()
        if isinstance(value, np.ndarray)
    }
    joints = {name: np.zeros(1) for name in model.joints}
    return EngineRecording(**nothing, joints=joints, fault=fault)
