"""The record of a trial of onsets: what was predicted, what was measured, and the verdicts."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

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
