"""The outcome of a run in one word: tracked, or what became of it instead.

Each is told from what was logged: where a point of the robot was, where its reference was, and how
far the point was from the reference's path (``path_error.py``). Errors are the largest of the last
tenth of the run, lags the median of its last quarter, and sentences say so.

What makes a run impossible comes before all but the first two (``impossible.py``): the robot
**tips** or **slips** for certain, or **fell**, a trailer has **jack-knifed**, a joint is thrown off
its reference, which its motor **cannot hold**, the robot is **lost** as its controller tells it
(:class:`rpctl.control.safeguards.Watchdog`), or efforts **chatter**.

- **collided**: a link ran into an obstacle, the ground or another link
  (:mod:`rpctl.simulation.merits.collisions`), or the body that a law guards into an obstacle;
- **diverging**: the mean path error grew beyond what it was in the first half, and the point still
  moves in the last tenth of the run; or it is not finite;
- **stuck**: the point stands while its reference moves on or is elsewhere, or it moves along beside
  the path and its error stays;
- **late**: it is on its path and behind its reference, or still on its way to that path after the
  time in which the error of a start dies, or the run was too short to tell;
- **tracked**: it is at its reference, or on its path and less than that behind it.

The worst of base and end effector counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.merits.collision_facts import NO_COLLISIONS, CollisionFacts
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, shape_text
from rpctl.simulation.merits.path_error import PathTrace, length, trace_path

TRACKED, LATE, STUCK, DIVERGING, COLLIDED = "tracked", "late", "stuck", "diverging", "collided"
CHATTERS, CANNOT_HOLD, SLIPS, TIPS = "chatters", "cannot-hold", "slips", "tips"
JACK_KNIFED, LOST, FELL = "jack-knifed", "lost", "fell"
OUTCOMES = (  # from good to bad
    *(TRACKED, LATE, STUCK, DIVERGING),
    *(CHATTERS, LOST, CANNOT_HOLD, SLIPS, TIPS, FELL, JACK_KNIFED, COLLIDED),
)
SUCCESSES = (TRACKED, LATE)  # a law that slows down to keep limits is late, and does well

ON_PATH_M = 0.05  # m: at its reference, or on its path; what is left beside a robot in a doorway
LATE_S = 0.5  # s: more than the laws' horizons, .4 s, within which a lag is the law's own
GROWTH_RATIO = 1.5  # of the largest path error of the first half: beyond it the error has grown
FALL_RATIO = 0.9  # of the mean path error of the second quarter: below it the error falls
STANDING_RATIO = 0.05  # of the way that there was to go: a point that moves less stands
EVIDENCE_S = 2.0  # s: starting from rest takes about one, so a shorter run shows nothing steady
DECAY_S = 5.0  # s: references start softly for 3 s, and the error of a start dies in two more
TOUCH_M = 0.005  # m: the horizon law keeps clear at its steps and along straight lines, to 5 mm
TURNING_ARM_M = 0.5  # m from P: where the heading of a base that turns on the spot is looked at
NEAR_TURN_RAD = 0.5  # a reference turning by 1 rad/s is as far ahead in LATE_S
HEADING = "heading"  # beside BASE and TIP
POINT_NAMES = {
    BASE: "base",
    TIP: "end effector",
    HEADING: f"heading, {TURNING_ARM_M:g} m from P,",
}


class Outcome(NamedTuple):
    """What became of a run: one of ``OUTCOMES``, and why, in words."""

    name: str
    sentence: str


@dataclass(frozen=True, eq=False)
class TracedPoint:
    """A point of the robot that has a reference.

    Attributes:
        name: What it is called.
        actual: Where it was (K, d), m.
        reference: Where its reference was (K, d), m.
        trace: Its motion beside the path of the reference.
    """

    name: str
    actual: Array
    reference: Array
    trace: PathTrace


def trace_points(
    t: Array, base: Array, base_ref: Array, ee: Array, ee_ref: Array
) -> dict[str, TracedPoint]:
    """Return the points of a robot that have a reference, by name: P and the end effector.

    Where all that is asked of the base is to turn on the spot, its heading counts too, as a point
    that turns about P; by a whole turn it is not off.

    Args:
        t: Time (K,), s.
        base: Pose of P (K, 3): x, y in m, heading in rad.
        base_ref: Its reference (K, 3).
        ee: Position of the end effector (K, 3), m; (K, 0) where there is none.
        ee_ref: Its reference, likewise.
    """
    moved = {BASE: (base[:, :2], base_ref[:, :2])}
    if ee.shape[1]:
        moved[TIP] = ee, ee_ref
    if np.ptp(base_ref[:, :2], axis=0).max() <= ON_PATH_M:
        wanted = base_ref[:, 2:]
        heading = base[:, 2:] + _whole_turns(wanted - base[:, 2:])
        moved[HEADING] = TURNING_ARM_M * heading, TURNING_ARM_M * wanted
    return {key: TracedPoint(POINT_NAMES[key], *pair, trace_path(t, *pair))
            for key, pair in moved.items()}  # fmt: skip


def _whole_turns(ahead: Array) -> float:
    """Return the whole turns (rad) that a heading's reference is ahead without being so.

    A law does not see them: a base that starts across its reference may come to it the other way
    round. One that lags goes on to fall back, and is within no half radian of a whole turn for all
    of the last quarter.

    Args:
        ahead: By how much the reference is turned from the heading (K, 1), full turns counted, rad.
    """
    last = ahead[3 * len(ahead) // 4 :]
    turns = 2.0 * math.pi * float(np.round(np.median(last) / (2.0 * math.pi)))
    return turns if (np.abs(last - turns) < NEAR_TURN_RAD).all() else 0.0


def outcome(
    t: Array,
    points: Mapping[str, TracedPoint],
    obstacles: Iterable[AvoidedObstacle] = (),
    bodies: CollisionFacts = NO_COLLISIONS,
    impossible: Outcome | None = None,
) -> Outcome:
    """Return the outcome of a motion.

    Args:
        t: Time (K,), s.
        points: The points of the robot that have a reference.
        obstacles: What they should keep clear of.
        bodies: What its links ran into or are near to in the end.
        impossible: What makes the motion impossible; None if nothing does.
    """
    if bodies.collisions:
        deepest, *others = bodies.collisions
        more = f"; {len(others)} more did" if others else ""
        return Outcome(COLLIDED, deepest.sentence + more)
    collision = _collision(t, points, obstacles)
    if collision is not None:
        return collision
    found = [_outcome_of(t, point) for point in points.values()]
    worst = max(found, key=lambda each: OUTCOMES.index(each.name))  # the first of them
    if impossible is not None and (worst.name != DIVERGING or impossible.name in (LOST, FELL)):
        return impossible
    if worst.name == STUCK and bodies.ahead:
        return Outcome(STUCK, f"{worst.sentence}; {' and '.join(bodies.ahead)}")
    return worst


def _collision(
    t: Array, points: Mapping[str, TracedPoint], obstacles: Iterable[AvoidedObstacle]
) -> Outcome | None:
    """Return the outcome of a motion into an obstacle: that which it went deepest into."""
    deepest, found = -TOUCH_M, None
    for obstacle in obstacles:
        if obstacle.body not in points:
            continue  # the end effector's, of a robot without one
        clearance = obstacle.clearance(points[obstacle.body].actual)
        least = float(np.fmin.reduce(clearance))
        if least < deepest:
            when = float(t[int(np.argmax(clearance < -TOUCH_M))])
            text = (
                f"{POINT_NAMES[obstacle.body]} ran into the {shape_text(obstacle.shape)}"
                f" at {when:.3g} s, {length(-least)} deep at worst"
            )
            deepest, found = least, Outcome(COLLIDED, text)
    return found


def _outcome_of(t: Array, point: TracedPoint) -> Outcome:
    """Return the outcome of one point."""
    count, name, off = len(t), point.name, point.trace.error
    ahead = np.linalg.norm(point.reference - point.actual, axis=1)
    if not np.isfinite(off).all():
        return Outcome(DIVERGING, f"the motion of {name} has infinite or undefined numbers")
    last = slice(3 * count // 4, None)
    end = slice(9 * count // 10, None)
    error, beside = float(ahead[end].max()), float(off[end].max())
    lag, gap = (
        float(np.median(values[last])) for values in (point.trace.lag, point.trace.lag_distance)
    )
    start = float(off[: max(count // 2, 1)].max())
    to_go = max(_reach(point.reference[last]), float(ahead[last].max()))
    stands = _reach(point.actual[last]) <= STANDING_RATIO * to_go
    rests = _reach(point.actual[end]) <= STANDING_RATIO * to_go
    grown = beside > max(ON_PATH_M, GROWTH_RATIO * start)
    if grown and not rests:
        return Outcome(DIVERGING, f"{name} is up to {length(beside)} off its path in the last "
                                  f"tenth of the run, and at most {length(start)} in the first "
                                  "half")  # fmt: skip
    if error <= ON_PATH_M:
        return Outcome(TRACKED, f"{name} is within {length(error)} of its reference in the last "
                       "tenth of the run")  # fmt: skip
    run = float(t[-1] - t[0])
    short = Outcome(LATE, f"the run is too short to judge: {name} is up to {length(error)} from "
                    "its reference in its last tenth")  # fmt: skip
    if run < EVIDENCE_S:
        return short
    if stands or grown:
        return Outcome(STUCK, f"{name} stands {length(error)} from its reference")
    falls = beside < FALL_RATIO * float(off[count // 4 : count // 2].mean())
    if beside > ON_PATH_M and not falls:
        return short if run < DECAY_S else Outcome(
            STUCK, f"{name} moves on, up to {length(beside)} off its path in the last tenth of "
            "the run, and the error does not decay")  # fmt: skip
    where = (
        "on its path" if beside <= ON_PATH_M else f"up to {length(beside)} off its path and nearing"
    )
    when = f"{abs(lag):.2g} s ({length(abs(gap))}) {'behind' if lag >= 0.0 else 'ahead of'}"
    under_way = beside > ON_PATH_M and run >= DECAY_S
    return Outcome(LATE if lag > LATE_S or under_way else TRACKED,
                   f"{name} is {where}, {when} its reference (last quarter)")  # fmt: skip


def _reach(places: Array) -> float:
    """Return how far (m) places (K, d) lead from the first of them."""
    return float(np.linalg.norm(places - places[0], axis=1).max())
