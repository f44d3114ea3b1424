"""Whether a robot would have slipped or tipped: figures of a run, and one sentence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run import Run

SLIP_RATIO_SHOWN_MAX = (
    10.0  # times the grip: beyond, a wheel is all but in the air, and the figure says no more
)
EQUALITY_TOLERANCE = 1e-9  # relative width up to which an interval is one number
DETERMINATE_CONTACTS = 3  # contacts whose loads statics tell apart
GROUND_KEYS = (
    "min_tip_over_margin",
    "would_tip",
    "max_slip_ratio",
    "slip_ratio_range",
    "equal_springs_slip_ratio",
    "would_slip",
    "could_slip",
    "contact_loads",
)


def ground(run: Run) -> dict[str, Any]:
    """Return whether a robot would slip or tip, by figures and in one sentence.

    ``min_tip_over_margin`` is in m. ``slip_ratio_range`` holds the least and the largest share of
    the grip at ``friction`` that the motion needs, over all splits of the load that statics admit
    while the robot does not tip; its end is inf where a wheel that pushes may bear nothing.
    ``max_slip_ratio`` is that share where it is one number, else None, and
    ``equal_springs_slip_ratio`` that of one split, of equally stiff contacts. ``would_slip`` tells
    of all splits, ``could_slip`` of at least one. ``contact_loads`` has the ``name``, ``min`` and
    ``max`` of each contact's load over the run and over all splits, N.

    All are None where the contacts known do not hold a balance, and the sentence says why; a fixed
    base has no sentence. Of a run that logged no ranges, only what one split tells is not None.
    """
    if not run.log.tip_margin.size:
        sentence = run.ground.notes[0] if run.ground.notes else None
        return {**dict.fromkeys(GROUND_KEYS), "friction": run.ground.friction, "ground": sentence}
    margin, equal = float(run.log.tip_margin.min()), float(run.log.slip_ratio.max())
    slips = _slips(run)
    found: dict[str, Any] = {
        **dict.fromkeys(GROUND_KEYS),
        "min_tip_over_margin": margin,
        "would_tip": margin < 0.0,
        "equal_springs_slip_ratio": equal,
        "could_slip": True if slips is None and equal > 1.0 else None,
        "contact_loads": _load_ranges(run),
        "friction": run.ground.friction,
        "ground": f"{_balance(run, margin)} and {_grip(run, slips, equal)}",
    }
    if slips is None or np.isnan(slips).all():
        return found
    least, most = np.nanmax(slips, axis=0).tolist()
    return found | {
        "max_slip_ratio": most if _is_single(least, most) else None,
        "slip_ratio_range": [least, most],
        "would_slip": least > 1.0,
        "could_slip": most > 1.0,
    }


def _slips(run: Run) -> Array | None:
    """Return the range of the worst wheel's slip ratio (K, 2); None where no range was logged."""
    if run.log.slip_range.size:
        return run.log.slip_range
    if len(run.ground.contacts) > DETERMINATE_CONTACTS:
        return None
    return np.column_stack([run.log.slip_ratio, run.log.slip_ratio])


def _load_ranges(run: Run) -> list[dict[str, Any]] | None:
    """Return the range of each contact's load, N; None where it was not logged, or tips always."""
    loads = run.log.load_range
    if not loads.size and len(run.ground.contacts) <= DETERMINATE_CONTACTS:
        loads = run.log.contact_load[:, :, None]
    if not loads.size or np.isnan(loads).all():
        return None
    least, most = np.nanmin(loads, axis=(0, 2)).tolist(), np.nanmax(loads, axis=(0, 2)).tolist()
    rows = zip(run.ground.contacts, least, most, strict=True)
    return [{"name": name, "min": low, "max": high} for name, low, high in rows]


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
        return f"{grip_text} ({many} contacts, taken as equally stiff)"
    if np.isnan(slips).all():
        return "nothing can be said of its grip"
    grip_text = _grip_needed(run, slips, friction)
    if _is_single(*np.nanmax(slips, axis=0).tolist()):
        return grip_text
    return f"{grip_text} ({_grip_in_words(equal)[0]} if its {many} contacts are equally stiff)"


def _grip_needed(run: Run, slips: Array, friction: str) -> str:
    """Return from when on a robot slips, for sure or maybe, and the share of the grip it needs."""
    least, most = np.nanmax(slips, axis=0).tolist()
    if _is_single(least, most):
        amount, of = _grip_in_words(most)
        amount = f"up to {amount}" if 1.0 < most < SLIP_RATIO_SHOWN_MAX else amount
    elif math.isinf(most):
        amount, of = _grip_in_words(least)
        amount = f"at least {amount}"
        friction += ", without an upper bound, as a wheel that pushes may bear nothing"
    else:
        (low, _), (amount, of) = _grip_in_words(least), _grip_in_words(most)
        if low != amount:  # in the figures that are shown
            amount = f"{low.removesuffix(' %') if of else low} to {amount}"
        friction += ", as the load splits"
    worst = least if math.isinf(most) else most  # an endless range tells of no instant
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
