"""What the ground does: whether a logged motion would slip or tip, and what its plant felt."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.run import Run

SLIP_RATIO_SHOWN_MAX = (
    10.0  # above it only "over 10 times" is reported: the wheel then carries almost no load
)
EQUALITY_TOLERANCE = 1e-9  # relative width up to which an interval is one number
DETERMINATE_CONTACTS = 3  # contacts whose loads statics tell apart
TOLD_TILT = math.radians(1.0)  # rad: soft contacts let a robot lean by a hundredth of it
LIFTED = 1e-3  # of the weight: a contact that bears less has lifted
X, Y = 3, 4  # of a pose's quaternion x, y, z, w


@dataclass(frozen=True)
class LoadRange:
    """Least and largest load of a contact over a run and over all splits of it, N."""

    name: str
    min: float
    max: float


@dataclass(frozen=True, kw_only=True)
class GroundFigures:
    """Whether a robot would slip or tip; None is what cannot be said.

    Attributes:
        min_tip_over_margin: Least distance of the zero-moment point to the edge of the support
            polygon, m; negative outside.
        would_tip: Whether it left the polygon.
        max_slip_ratio: Largest share of the grip that the motion needs, where it is one number.
        slip_ratio_range: Least and largest share of the grip, over all splits of the load that
            statics admit while the robot does not tip; its end is inf where a wheel that pushes
            may bear nothing.
        equal_springs_slip_ratio: That share for one split, of equally stiff contacts.
        would_slip: Whether it slips for all splits.
        could_slip: Whether it slips for one at least.
        contact_loads: Of each contact.
        friction: Coefficient between wheels and ground that the shares are of.
        sentence: All of it in words; of a robot whose contacts do not hold a balance why that is.
    """

    min_tip_over_margin: float | None = None
    would_tip: bool | None = None
    max_slip_ratio: float | None = None
    slip_ratio_range: tuple[float, float] | None = None
    equal_springs_slip_ratio: float | None = None
    would_slip: bool | None = None
    could_slip: bool | None = None
    contact_loads: tuple[LoadRange, ...] | None = None
    friction: float
    sentence: str | None = None


def ground(run: Run) -> GroundFigures:
    """Return whether a robot would slip or tip, by figures and in one sentence.

    All but the friction is None where the contacts known do not hold a balance, and the sentence
    says why; a fixed base has no sentence. Of a run that logged no ranges, only what one split
    tells is not None.
    """
    log, friction = run.log, run.ground.friction
    if not log.tip_margin.size:
        sentence = run.ground.notes[0] if run.ground.notes else None
        return GroundFigures(friction=friction, sentence=sentence)
    margin, equal = float(log.tip_margin.min()), float(log.slip_ratio.max())
    slips = slip_ranges(run)
    found = GroundFigures(
        min_tip_over_margin=margin,
        would_tip=margin < 0.0,
        equal_springs_slip_ratio=equal,
        could_slip=True if slips is None and equal > 1.0 else None,
        contact_loads=_load_ranges(run),
        friction=friction,
        sentence=f"{_balance(run, margin)} and {_grip(run, slips, equal)}",
    )
    if slips is None or np.isnan(slips).all():
        return found
    least, most = np.nanmax(slips, axis=0).tolist()
    return replace(
        found,
        max_slip_ratio=most if _is_single(least, most) else None,
        slip_ratio_range=(least, most),
        would_slip=least > 1.0,
        could_slip=most > 1.0,
    )


def slip_ranges(run: Run) -> Array | None:
    """Return the range of the worst wheel's slip ratio (K, 2); None where no range was logged."""
    if run.log.slip_range.size:
        return run.log.slip_range
    if len(run.ground.contacts) > DETERMINATE_CONTACTS:
        return None
    return np.column_stack([run.log.slip_ratio, run.log.slip_ratio])


def _load_ranges(run: Run) -> tuple[LoadRange, ...] | None:
    """Return the range of each contact's load, N; None where it was not logged, or tips always."""
    loads = run.log.load_range
    if not loads.size and len(run.ground.contacts) <= DETERMINATE_CONTACTS:
        loads = run.log.contact_load[:, :, None]
    if not loads.size:
        return None
    least, most = np.fmin.reduce(loads, axis=(0, 2)), np.fmax.reduce(loads, axis=(0, 2))
    if np.isnan(least).all():
        return None
    rows = zip(run.ground.contacts, least.tolist(), most.tolist(), strict=True)
    return tuple(LoadRange(*row) for row in rows)


def _balance(run: Run, margin: float) -> str:
    if margin >= 0.0:
        return f"keeps {margin:.2g} m from tipping"
    first = run.t[int(np.argmax(run.log.tip_margin < 0.0))]
    return f"would tip over at {first:.3g} s, by {-margin:.2g} m at worst,"


def _grip(run: Run, slips: Array | None, equal: float) -> str:
    """Return what the motion needs of the grip, in words."""
    many, friction = len(run.ground.contacts), f"the grip at friction {run.ground.friction:g}"
    if slips is None:
        grip_text = _grip_needed(
            run, np.column_stack([run.log.slip_ratio, run.log.slip_ratio]), friction
        )
        return f"{grip_text} ({many} contacts, assumed equally stiff)"
    if np.isnan(slips).all():
        return "its grip cannot be computed"
    grip_text = _grip_needed(run, slips, friction)
    if _is_single(*np.nanmax(slips, axis=0).tolist()):
        return grip_text
    return f"{grip_text} ({_grip_in_words(equal)[0]} if its {many} contacts are equally stiff)"


def _grip_needed(run: Run, slips: Array, friction: str) -> str:
    """Return the slip ratio in words and, above 1, when the robot would or could slip first."""
    least, most = np.nanmax(slips, axis=0).tolist()
    if _is_single(least, most):
        amount, of = _grip_in_words(most)
        amount = f"up to {amount}" if 1.0 < most < SLIP_RATIO_SHOWN_MAX else amount
    elif math.isinf(most):
        amount, of = _grip_in_words(least)
        amount = f"at least {amount}"
        friction += ", with no upper bound, as a wheel that drives may carry no load"
    else:
        (low, _), (amount, of) = _grip_in_words(least), _grip_in_words(most)
        if low != amount:  # in the figures that are shown
            amount = f"{low.removesuffix(' %') if of else low} to {amount}"
        friction += ", depending on how the contacts share the load"
    worst = least if math.isinf(most) else most  # an infinite end has no first instant
    if worst <= 1.0:
        return f"uses {amount} {of}{friction}"
    slipping, how = (0, "would") if least > 1.0 else (1, "could")
    first = run.t[int(np.argmax(slips[:, slipping] > 1.0))]
    return f"{how} slip at {first:.3g} s, needing {amount} {of}{friction}"


def _is_single(least: float, most: float) -> bool:
    """Return whether an interval is one number."""
    return least == most or most - least <= EQUALITY_TOLERANCE * least


def _grip_in_words(slip: float) -> tuple[str, str]:
    """Return a share of the grip in words, and the word before "the grip"."""
    return (
        (f"over {SLIP_RATIO_SHOWN_MAX:.0f} times", "")
        if slip >= SLIP_RATIO_SHOWN_MAX
        else (f"{100.0 * slip:.0f} %", "of ")
    )


@dataclass(frozen=True)
class FeltGround:
    """What the plant says of the ground; None is what it does not know.

    Attributes:
        max_wheel_slip: Largest velocity of a wheel's contact point over the ground, m/s; that of a
            wheel in the air does not count.
        slipping_wheel: The wheel.
        slip_time: When, s.
        min_load: Least load of a contact, N.
        lifted: Contacts that bore nothing for a while.
        max_tilt: Largest angle between the root link and the level, rad.
        hanging: Those of them that bore nothing where the robot stood, before it moved.
    """

    max_wheel_slip: float | None
    slipping_wheel: str | None
    slip_time: float | None
    min_load: float | None
    lifted: tuple[str, ...]
    max_tilt: float
    hanging: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        said = []
        if self.max_wheel_slip:
            said.append(
                f"{self.slipping_wheel} slipped most, {1e3 * self.max_wheel_slip:.3g} mm/s at "
                f"{self.slip_time:.3g} s"
            )
        if self.hanging:
            said.append(
                f"{', '.join(self.hanging)} carried no load from the start: the other wheels "
                "carry the robot"
            )
        if later := [name for name in self.lifted if name not in self.hanging]:
            said.append(f"{', '.join(later)} lifted")
        if not self.lifted and self.min_load is not None:
            said.append(f"the least load of a contact was {self.min_load:.3g} N")
        if self.max_tilt > TOLD_TILT:
            said.append(f"it leaned {math.degrees(self.max_tilt):.2g}° at most")
        return "; ".join(said)


def felt_ground(run: Run) -> FeltGround | None:
    """Return what the plant of a run says of the ground; None of one whose wheels roll."""
    log = run.log
    if not log.root_pose.size:
        return None
    load, lifted, hanging = None, tuple[str, ...](), tuple[str, ...]()
    touches: NDArray[np.bool_] = np.ones(log.wheel_slip.shape[:2], dtype=bool)
    if log.ground_load.size:
        load = float(log.ground_load.min())
        floor = LIFTED * float(log.ground_load[0].sum())
        lifted = _named(run, log.ground_load.min(axis=0) < floor)
        hanging = _named(run, log.ground_load[0] < floor)
        wheels_load = log.ground_load[:, : touches.shape[1]]  # they come first among the contacts
        touches = np.asarray(wheels_load >= floor)
    slip, wheel, time = None, None, None
    if log.wheel_slip.size:
        speed = np.where(touches, np.linalg.norm(log.wheel_slip, axis=2), 0.0)
        row, column = np.unravel_index(int(speed.argmax()), speed.shape)
        slip, time = float(speed[row, column]), float(run.t[row])
        wheel = run.robot.drive.wheels[int(column)].joint
    return FeltGround(slip, wheel, time, load, lifted, float(tilts(log).max()), hanging)


def _named(run: Run, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the names of the contacts that are chosen (n_contacts,)."""
    return tuple(name for name, yes in zip(run.ground.contacts, chosen, strict=True) if yes)


def tilts(log: Log) -> Array:
    """Return the angle between the root link and the level (K,), rad."""
    lean = np.hypot(log.root_pose[:, X], log.root_pose[:, Y])
    return np.asarray(2.0 * np.arcsin(np.minimum(lean, 1.0)))
