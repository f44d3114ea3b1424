"""Slip and tipping predictions on trial: manoeuvres that go ever further, here and in contact."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from rpctl.dynamics.ground_reaction import FRICTION, Contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import CONTACT_ORACLE, Skipped
from rpctl.equivalence.contact.plan import NotGentle, standing_contacts
from rpctl.equivalence.contact.trial import tilt_note
from rpctl.equivalence.mujoco_engine import EngineRefused
from rpctl.equivalence.onset.measurement import RUN_S, OnsetRuns, PushedBody, measure
from rpctl.equivalence.onset.prediction import (
    SLIPS,
    TIPS,
    Manoeuvre,
    Predicted,
    SlipsFirst,
    manoeuvres,
    natural_size,
    predict,
)
from rpctl.errors import ActuationError, SingularBasisError
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

SPEED_TOLERANCE, FORCE_TOLERANCE = 0.025, 0.05  # relative: forces go with the square of the speed
WITHIN, INSIDE, SAFE, WRONG = "within", "inside the interval", "safe side", "wrong"
ASKEW = "not comparable"  # with a prediction for a robot that stands level
MAX_TILT = 2e-3  # rad: the onset of a robot half a metre high moves by a percent of its footprint
SAME = 1e-3  # relative width up to which an interval is one number


@dataclass(frozen=True)
class Onset:
    """The onset of slipping or tipping in one manoeuvre.

    Attributes:
        manoeuvre: What the robot does, in words.
        ending: ``"slips"`` or ``"tips"``.
        unit: Of the onsets: ``"m/s"`` or ``"N"``.
        friction: Coefficient between wheels and ground.
        could: Predicted onset for one split of the load at least; infinite without an onset.
        would: Predicted onset for all splits; that number again where it is one.
        equal: Predicted onset of equally stiff contacts; ``would`` where loads are determinate.
        measured: Onset in contact; infinite without one.
        tilt: How far it leans in contact before it starts, rad.
    """

    manoeuvre: str
    ending: str
    unit: str
    friction: float
    could: float
    would: float
    equal: float
    measured: float
    tilt: float = 0.0

    @property
    def tolerance(self) -> float:
        """Largest gap of a prediction, relative."""
        return SPEED_TOLERANCE if self.unit == "m/s" else FORCE_TOLERANCE

    @property
    def single(self) -> bool:
        """Whether the prediction is one number."""
        narrow = math.isfinite(self.would) and self.would - self.could <= SAME * self.would
        return narrow or self.could == self.would

    @property
    def gap(self) -> float:
        """The prediction, of equally stiff contacts, over the measured onset, less 1."""
        if self.equal == self.measured:
            return 0.0
        if math.isinf(self.measured):
            return -1.0
        return self.equal / self.measured - 1.0

    @property
    def verdict(self) -> str:
        """``"within"`` the tolerance, ``"inside the interval"``, ``"safe side"`` or ``"wrong"``.

        It is ``"not comparable"`` where the robot leans by more than :data:`MAX_TILT`.

        On the safe side of an interval, the robot holds out for longer than all of it. A number
        has no excuse to either side.
        """
        if self.tilt > MAX_TILT:
            return ASKEW
        if abs(self.gap) <= self.tolerance:
            return WITHIN
        if self.single or self.measured < self.could:
            return WRONG
        return SAFE if self.measured > self.would * (1.0 + self.tolerance) else INSIDE

    @property
    def passed(self) -> bool:
        """Whether the prediction is not wrong."""
        return self.verdict != WRONG

    def to_dict(self) -> dict[str, Any]:
        """Return the row as plain values for JSON; what is infinite is None."""
        plain = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in (asdict(self) | {"gap": self.gap}).items()
        }
        return plain | {"verdict": self.verdict, "passed": self.passed}


@dataclass(frozen=True)
class NoOnset:
    """A manoeuvre that was not tried, and why."""

    manoeuvre: str
    ending: str
    why: str


@dataclass(frozen=True)
class OnsetTrial:
    """The outcome of :func:`rpctl.equivalence.onset.trial.onset_trial`.

    Attributes:
        onsets: A row a manoeuvre.
        untried: What was not tried.
        determinate: Whether loads follow from statics, and predictions are numbers.
        notes: What else must be known of the robot in contact.
    """

    onsets: tuple[Onset, ...]
    untried: tuple[NoOnset, ...]
    determinate: bool
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no prediction is wrong."""
        return all(onset.passed for onset in self.onsets)

    def to_dict(self) -> dict[str, Any]:
        """Return the trial as plain values for JSON."""
        return {
            "passed": self.passed,
            "determinate": self.determinate,
            "onsets": [onset.to_dict() for onset in self.onsets],
            "untried": [asdict(each) for each in self.untried],
            "notes": list(self.notes),
        }


TRIAL_NAME = "onset of slipping and tipping"
HIGH_GRIPS = (
    2.0,
    5.0,
    20.0,
    100.0,
)  # frictions for tipping: the least at which it does not slip before


def onset_trial(robot: Robot, friction: float = FRICTION) -> OnsetTrial | Skipped:
    """Predict where a robot slips and tips, and let it do so in MuJoCo.

    Each manoeuvre is tried until it slips, at ``friction``, and until it tips, at a higher one.
    Joints lose nothing on either side, and motors are as strong as it takes.

    Args:
        robot: The robot.
        friction: Coefficient between wheels and ground.

    Returns:
        The trial, or the row that says why there is none.
    """
    robot.require_level()
    robot = without_losses(robot)
    dynamics = ReducedDynamics(robot)
    try:
        contacts = standing_contacts(dynamics, friction)
        rows = [
            _tried(dynamics, contacts, manoeuvre)
            for ending in (SLIPS, TIPS)
            for manoeuvre in manoeuvres(dynamics, contacts, RUN_S, ending)
        ]
    except (NotGentle, EngineRefused) as reason:
        return Skipped(TRIAL_NAME, CONTACT_ORACLE, str(reason))
    onsets = tuple(row for row in rows if isinstance(row, Onset))
    untried = tuple(row for row in rows if isinstance(row, NoOnset))
    tilt = max((onset.tilt for onset in onsets), default=0.0)
    notes = tuple(tilt_note(tilt)) if tilt > MAX_TILT else ()
    return OnsetTrial(onsets, untried, contacts.determinate, notes)


def _tried(dynamics: ReducedDynamics, contacts: Contacts, manoeuvre: Manoeuvre) -> Onset | NoOnset:
    """Return a manoeuvre's onsets, predicted and measured, or why it was not tried."""
    try:
        grip, predicted = _predicted(dynamics, contacts, manoeuvre)
    except (ActuationError, SingularBasisError, SlipsFirst) as reason:
        return NoOnset(manoeuvre.name, manoeuvre.ending, str(reason))
    body = PushedBody(dynamics.robot, grip.friction)
    guess = predicted.equal if math.isfinite(predicted.equal) else natural_size(dynamics, manoeuvre)
    runs = OnsetRuns(dynamics, grip, manoeuvre, body)
    return Onset(
        manoeuvre=manoeuvre.name,
        ending=manoeuvre.ending,
        unit=manoeuvre.unit,
        friction=grip.friction,
        could=predicted.could,
        would=predicted.would,
        equal=predicted.equal,
        measured=measure(runs, guess),
        tilt=runs.tilt,
    )


def _predicted(
    dynamics: ReducedDynamics, contacts: Contacts, manoeuvre: Manoeuvre
) -> tuple[Contacts, Predicted]:
    """Return the contacts with the friction that the manoeuvre takes, and where it ends."""
    if manoeuvre.ending == SLIPS:
        return contacts, predict(dynamics, contacts, manoeuvre)
    *lower, highest = (replace(contacts, friction=friction) for friction in HIGH_GRIPS)
    for grip in lower:
        with suppress(SlipsFirst):
            return grip, predict(dynamics, grip, manoeuvre)
    return highest, predict(dynamics, highest, manoeuvre)
