"""Where the reduced model predicts that a manoeuvre ends: a number, or an interval.

Tipping is a matter of the zero-moment point and the support polygon alone, and so one number for
any number of contacts. So is slipping of a robot on three contacts. With more, the split of the
load decides: from the first number the robot slips for one split at least (it could), from the
second for all of them (it would).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.grip import WheelForces, missing_grip, wheel_forces
from rpctl.dynamics.ground_reaction import Contacts, GroundReactions, ground_reactions, stance_at
from rpctl.dynamics.push import pushed_reaction
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.onset.manoeuvre import SLIPS, Manoeuvre, instant
from rpctl.errors import RpctlError

SMALLEST, LARGEST = 1e-3, 64.0  # of the natural size: where an onset is looked for
RESOLUTION = 1e-4  # relative, of a predicted onset
ALMOST = 0.98  # of the value at which it tips: up to there its wheels must not slip
SLIPS_FIRST = "the wheels that have to push bear nothing where it would tip: it slips before"
LOAD_RESOLUTION = 1e-9  # of the weight: a smaller load is rounding


class SlipsFirst(RpctlError):
    """A robot does not tip that way: whatever the friction, it slips before."""


@dataclass(frozen=True)
class Predicted:
    """An onset as predicted, in the manoeuvre's unit; infinite where there is none.

    Attributes:
        could: From here on it slips for one split of the load at least; tips.
        would: From here on it slips for all of them; tips. The same number where it is one.
        equal: That of equally stiff contacts: ``would`` where loads are determinate.
    """

    could: float
    would: float
    equal: float


def predict(dynamics: ReducedDynamics, contacts: Contacts, manoeuvre: Manoeuvre) -> Predicted:
    """Return where a manoeuvre ends.

    Args:
        dynamics: The robot's reduced dynamics.
        contacts: How it stands, and its friction.
        manoeuvre: The manoeuvre.
    """
    size = natural_size(dynamics, manoeuvre)

    def first(ends: Callable[[_Balance], bool]) -> float:
        return find_onset(lambda value: ends(_balance(dynamics, contacts, manoeuvre, value)), size)

    if manoeuvre.ending != SLIPS:
        tips = first(_tips)
        if math.isfinite(tips):
            end, before = (
                _balance(dynamics, contacts, manoeuvre, share * tips) for share in (1.0, ALMOST)
            )
            held = contacts.friction * end.equal[: len(end.forces.least)].sum()
            if held < end.push or _slips(before, contacts.friction, before.equal):
                raise SlipsFirst(SLIPS_FIRST)
        return Predicted(tips, tips, tips)
    equal = first(lambda at: _slips(at, contacts.friction, at.equal))
    if contacts.determinate:
        return Predicted(equal, equal, equal)
    would = first(lambda at: _slips(at, contacts.friction, None))
    could = first(lambda at: any(_slips(at, contacts.friction, load) for load in at.corners()))
    return Predicted(min(could, equal), would, equal)


def natural_size(dynamics: ReducedDynamics, manoeuvre: Manoeuvre) -> float:
    """Return the size around which an onset lies: the weight, or the speed with it for an inertia.

    Args:
        dynamics: The robot's reduced dynamics.
        manoeuvre: The manoeuvre.
    """
    g = float(np.linalg.norm(dynamics.robot.model.gravity.linear))
    if manoeuvre.unit == "m/s":
        return math.sqrt(g / abs(manoeuvre.twist[2]))
    return dynamics.robot.mass * g


def find_onset(ends: Callable[[float], bool], size: float) -> float:
    """Return the number from which on a manoeuvre ends: 0 if any ends it, infinite if none does.

    Args:
        ends: Whether it ends at a number; once it does it does for all larger ones.
        size: Around which it lies.
    """
    high = SMALLEST * size
    if ends(high):
        return 0.0
    while not ends(high):
        high *= 2.0
        if high > LARGEST * size:
            return math.inf
    low = 0.5 * high
    while high - low > RESOLUTION * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if ends(middle) else (middle, high)
    return 0.5 * (low + high)


@dataclass(frozen=True, eq=False)
class _Balance:
    """What the ground would have to do at one instant of a manoeuvre."""

    forces: WheelForces
    statics: Array
    moments: Array
    ground: GroundReactions

    @property
    def equal(self) -> Array:
        """Loads of equally stiff contacts (n,), N."""
        return self.ground.load[0]

    @property
    def push(self) -> float:
        """Size of the ground's horizontal force, N."""
        return float(np.hypot(*self.ground.force[0, :2]))

    def corners(self) -> list[Array]:
        """Return the loads (n,) of all triples of contacts that can bear the robot, N."""
        found = []
        for triple in combinations(range(self.statics.shape[1]), 3):
            part = self.statics[:, triple]
            if np.linalg.svd(part, compute_uv=False)[-1] < LOAD_RESOLUTION:
                continue
            load = np.linalg.solve(part, self.moments)
            if load.min() >= -LOAD_RESOLUTION * self.moments[0]:
                whole = np.zeros(self.statics.shape[1])
                whole[list(triple)] = load
                found.append(whole)
        return found


def _balance(
    dynamics: ReducedDynamics, contacts: Contacts, manoeuvre: Manoeuvre, value: float
) -> _Balance:
    at = instant(dynamics, manoeuvre, value)
    reactions = pushed_reaction(dynamics, at.q, at.nu, at.tau, at.pushed)
    rows = at.q[None], at.nu[None], at.tau[None]
    f, z = reactions.wrench[0], dynamics.robot.drive.ground
    return _Balance(
        forces=wheel_forces(dynamics, contacts, at.q, reactions, manoeuvre.height > 0.0),
        statics=stance_at(dynamics, contacts, at.q).statics,
        moments=np.array([f[2], z * f[0] - f[4], z * f[1] + f[3]]),
        ground=ground_reactions(dynamics, contacts, *rows, reactions),
    )


def _tips(at: _Balance) -> bool:
    margin = at.ground.tip_margin
    return margin is not None and bool(margin[0] < 0.0)


def _slips(at: _Balance, friction: float, load: Array | None) -> bool:
    if load is not None and load.min() < -LOAD_RESOLUTION * at.moments[0]:
        return True  # it tips before
    return missing_grip(at.forces, at.statics, at.moments, friction, load) > 0.0
