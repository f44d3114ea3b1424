"""The record of a contact trial: what both sides did, and every gap with its band."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.check import Check

JSON_STRIDE = 2  # samples between two points of the paths that JSON keeps: a hundred over a trial
SMALL_UNITS = {"m": "mm", "rad": "mrad"}  # gaps are thousandths of them


@dataclass(frozen=True, eq=False)
class ContactMotion:
    """What one side did, a row a sample; NaN from where it could not go on.

    Attributes:
        pose: x, y (m) and turn (rad) of the root link (n, 3).
        load: Vertical forces of the contacts (n, n_contacts), N.
        force: Total force of the ground (n, 3), world axes, N.
        zmp: Where the loads balance (n, 2), m.
        efforts: Of the steered and arm joints (n, n_held), N·m or N.
        casters: Positions of the casters' swivels (n, n_casters), rad.
    """

    pose: Array
    load: Array
    force: Array
    zmp: Array
    efforts: Array
    casters: Array

    def __post_init__(self) -> None:
        for values in vars(self).values():
            values.setflags(write=False)


@dataclass(frozen=True)
class Gap(Check):
    """A row of the trial: its residual is the largest gap in units of its band.

    Attributes:
        gap: Largest gap, in ``unit``.
        band: Largest gap allowed.
        unit: ``"m"``, ``"rad"``, ``"N"`` or ``"N·m"``.
        time: When it was largest, s.
    """

    gap: float = 0.0
    band: float = 0.0
    unit: str = ""
    time: float = 0.0

    def format_value(self, value: float) -> str:
        """Return a gap or a band in words, lengths in mm and angles in mrad."""
        if self.unit in SMALL_UNITS:
            return f"{1e3 * value:.3g} {SMALL_UNITS[self.unit]}"
        return f"{value:.3g} {self.unit}"

    def to_dict(self) -> dict[str, Any]:
        """Return the row as plain values for JSON; what is infinite is None."""
        return super().to_dict() | {"gap": self.gap if math.isfinite(self.gap) else None}


@dataclass(frozen=True)
class ContactTrial:
    """The outcome of :func:`rpctl.equivalence.contact.trial.contact_trial`.

    Two trials are equal where their rows are.

    Attributes:
        checks: What is compared.
        notes: What the two sides share, and what cannot be compared, in sentences.
        contacts: Names of the contacts.
        determinate: Whether each contact's load follows from statics.
        joints: Steered and arm joints, whose efforts are compared.
        slides: Which of them slide: their efforts are in N, the others' in N·m.
        footprint: Where the contacts lie at the start (n_contacts, 2), in the root link's frame, m.
        t: Times of the samples (n,), s.
        reduced: What the reduced model did.
        engine: What MuJoCo did.
    """

    checks: tuple[Gap, ...]
    notes: tuple[str, ...]
    contacts: tuple[str, ...]
    determinate: bool
    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    footprint: Array = field(repr=False, compare=False)
    t: Array = field(repr=False, compare=False)
    reduced: ContactMotion = field(repr=False, compare=False)
    engine: ContactMotion = field(repr=False, compare=False)

    @property
    def passed(self) -> bool:
        """Whether every gap stays within its band."""
        return all(check.passed for check in self.checks)

    @property
    def path(self) -> Gap:
        """The row of the two paths."""
        return next(check for check in self.checks if check.name == "path")

    @property
    def distance(self) -> float:
        """How far the root link travels in MuJoCo, m."""
        return travelled(self.engine.pose)

    def to_dict(self) -> dict[str, Any]:
        """Return the trial as plain values for JSON, a hundred points of each path."""
        paths = {"reduced": self.reduced.pose, "mujoco": self.engine.pose}
        return {
            "passed": self.passed,
            "duration": float(self.t[-1]),
            "distance": self.distance,
            "checks": [check.to_dict() for check in self.checks],
            "notes": list(self.notes),
            "t": [round(t, 6) for t in self.t[::JSON_STRIDE].tolist()],
            "paths": {side: _plain(pose[::JSON_STRIDE]) for side, pose in paths.items()},
        }


def travelled(pose: Array) -> float:
    """Return the length of the way through poses (n, 3), m."""
    return float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())


def _plain(rows: Array) -> list[list[float | None]]:
    """Return rows of numbers for JSON, to a micrometre; None where there is none."""
    return [[round(x, 6) if math.isfinite(x) else None for x in row] for row in rows.tolist()]
