"""Slip and tipping predictions on trial: manoeuvres that go ever further, here and in contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

from rpctl.dynamics.ground_reaction import FRICTION, Contacts, find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.check import CONTACT_ORACLE, Skipped
from rpctl.equivalence.contact.trial import tilt_note
from rpctl.equivalence.mujoco_model import EngineRefused
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
from rpctl.equivalence.onset.record import MAX_TILT, NoOnset, Onset, OnsetTrial
from rpctl.errors import ActuationError, SingularBasisError
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

TRIAL_NAME = "onset of slipping and tipping"
HIGH_GRIPS = (
    2.0,
    5.0,
    20.0,
    100.0,
)  # frictions for tipping: the least at which it does not slip before


def onset_trial(
    robot: Robot,
    friction: float = FRICTION,
    progress: Callable[[int], object] | None = None,
) -> OnsetTrial | Skipped:
    """Predict where a robot slips and tips, and let it do so in MuJoCo.

    Each manoeuvre is tried until it slips, at ``friction``, and until it tips, at a higher one.
    Joints lose nothing on either side, and motors are as strong as it takes.

    Args:
        robot: The robot.
        friction: Coefficient between wheels and ground.
        progress: Called with the number of manoeuvres done.

    Returns:
        The trial, or the row that says why there is none.
    """
    if not robot.drive.wheels:
        return Skipped(TRIAL_NAME, CONTACT_ORACLE, "a fixed base neither slips nor tips")
    robot = without_losses(robot)
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics, friction)
    if contacts is None or not contacts.balanced:
        why = contacts.notes[0] if contacts is not None else "it has no contacts"
        return Skipped(TRIAL_NAME, CONTACT_ORACLE, f"not known to stand: {why}")
    onsets: list[Onset] = []
    untried: list[NoOnset] = []
    try:
        for done, found in enumerate(_rows(dynamics, contacts), start=1):
            if isinstance(found, Onset):
                onsets.append(found)
            else:
                untried.append(found)
            if progress is not None:
                progress(done)
    except EngineRefused as refusal:
        return Skipped(TRIAL_NAME, CONTACT_ORACLE, str(refusal))
    tilt = max((onset.tilt for onset in onsets), default=0.0)
    notes = tuple(tilt_note(tilt)) if tilt > MAX_TILT else ()
    return OnsetTrial(tuple(onsets), tuple(untried), contacts.determinate, notes)


def _rows(dynamics: ReducedDynamics, contacts: Contacts) -> Iterator[Onset | NoOnset]:
    """Yield a row a manoeuvre and ending."""
    for ending in (SLIPS, TIPS):
        for manoeuvre in manoeuvres(dynamics, contacts, RUN_S, ending):
            yield _tried(dynamics, contacts, manoeuvre)


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
