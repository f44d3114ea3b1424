"""Where a manoeuvre ends in MuJoCo's contacts, by bisection over runs of a second.

A run starts in the motion, on settled contacts; efforts and push rise to their size within a tenth
of a second, and then they hold. Wheels get theirs as functions of time; the arm and the steering
are held by a servo, as in the contact trial; brakes hold the wheels of a robot that is pushed.

The robot slips if one of its wheels slides over the ground by :data:`SLIPPED` in the rest of the
run. Soft contacts creep below the onset, too, by a few millimetres; beyond it, a robot that lacks
a share ε of its grip has slid by ½ ε μ g t². It tips where its loads, averaged over the end of the
run, balance on an edge of the support polygon; runs go to :data:`WAY_LEFT` of the way to it, for
beyond, wheels that bear next to nothing begin to spin. Both tell an onset within half a percent.
"""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, stance_at
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.contact.model import MIN_LOAD_N, STEP_S
from rpctl.equivalence.contact.plan import SERVO_BANDWIDTH, TICK_S, felt_inertia
from rpctl.equivalence.onset.body import PushedBody
from rpctl.equivalence.onset.manoeuvre import SLIPS, Instant, Manoeuvre, instant

SETTLING_S = 0.3  # s in which the robot sinks into its contacts
RISE_S = 0.1  # s in which efforts and push rise: 25 time constants of the contacts
RUN_S = 1.0  # s of a run
ENDING_S = 0.3  # s at its end over which loads are averaged
SLIPPED = 0.01  # m
FALLEN = 0.03  # rad: there is no way back
WAY_LEFT = 0.05  # of the way from rest to an edge of the support polygon
RESOLUTION = 2e-3  # relative, of a measured onset
WIDER = 1.3  # factor by which the bracket grows until it holds the onset
MOST_BRACKETS = 12  # tries: beyond, there is no onset within a factor of twenty


class OnsetRuns:
    """Runs of a manoeuvre in contact.

    Args:
        dynamics: The reduced dynamics, which say what motion it is and what efforts it takes.
        contacts: How the robot stands.
        manoeuvre: The manoeuvre.
        body: The robot in MuJoCo.

    Attributes:
        tilt: How far it leans out of the level once it has settled, rad.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        contacts: Contacts,
        manoeuvre: Manoeuvre,
        body: PushedBody,
    ) -> None:
        robot = dynamics.robot
        self._dynamics, self._manoeuvre, self._body = dynamics, manoeuvre, body
        self._servoed = [k for k, n in enumerate(robot.actuators) if n in robot.quasi_velocities]
        self._names = tuple(robot.actuators[k] for k in self._servoed)
        still = instant(dynamics, manoeuvre, 0.0)
        self._stance = stance_at(dynamics, contacts, still.q)
        self._inertia = felt_inertia(dynamics, still.q, self._names)
        self._targets = np.array([robot.joint_position(still.q, name) for name in self._names])
        if manoeuvre.height:
            body.brake()
        body.start(still.q)
        for _ in range(round(SETTLING_S / TICK_S)):
            self._tick(still.unforced)
        body.keep()
        self.tilt = body.tilt
        self._order = [body.names.index(name) for name in contacts.names]
        self._rest = self._margins(body.load())

    def ends(self, value: float) -> bool:
        """Return whether the robot slips, or all but tips, at a speed (m/s) or force (N)."""
        at, body = instant(self._dynamics, self._manoeuvre, value), self._body
        body.set_moving(self._dynamics.basis(at.q) @ at.nu)
        level, slips = body.tilt, self._manoeuvre.ending == SLIPS
        slipped, load = np.zeros_like(body.slip()), np.zeros(len(body.names))
        for tick in range(1, round(RUN_S / TICK_S) + 1):
            t = tick * TICK_S
            self._push(at, min(1.0, t / RISE_S))
            if body.tilt - level > FALLEN:
                return True
            if slips and t > RISE_S:
                slipped += TICK_S * body.slip()
                if np.hypot(*slipped.T).max() > SLIPPED:
                    return True
            elif t > RUN_S - ENDING_S:
                load += body.load()
        return not slips and bool((self._margins(load) <= WAY_LEFT * self._rest).any())

    def extrapolated(self, value: float) -> float:
        """Return the onset that follows from where runs begin to end.

        Inertial forces grow with the force, or with the square of the speed, and the point where
        loads balance moves with them: what is left of its way to the edge is in proportion.
        """
        if self._manoeuvre.ending == SLIPS:
            return value
        return value / (1.0 - WAY_LEFT) ** (0.5 if self._manoeuvre.unit == "m/s" else 1.0)

    def _margins(self, load: Array) -> Array:
        """Return how far inside each edge of the polygon loads (n,) balance (n_edges,), m."""
        stance, order = self._stance, self._order
        place = stance.statics[1:] @ load[order] / max(float(load.sum()), MIN_LOAD_N)
        return np.asarray(stance.inward @ place + stance.offset)

    def _push(self, at: Instant, share: float) -> None:
        """Advance by a tick with a share of the motion's efforts and push, smoothed."""
        share *= share * (3.0 - 2.0 * share)
        self._body.push(share * at.force, share * at.moment)
        self._tick(at.unforced + share * (at.tau - at.unforced))

    def _tick(self, planned: Array) -> None:
        """Advance by a tick with planned efforts (n_act,) and the servo."""
        tau = np.array(planned)
        if self._servoed:
            measured = np.array([self._body.joint(name) for name in self._names])
            gap = (self._targets - measured[:, 0] + math.pi) % (2.0 * math.pi) - math.pi
            pull = SERVO_BANDWIDTH * (SERVO_BANDWIDTH * gap - 2.0 * measured[:, 1])
            tau[self._servoed] += self._inertia @ pull
        efforts = dict(zip(self._dynamics.robot.actuators, tau.tolist(), strict=True))
        self._body.advance(efforts, round(TICK_S / STEP_S))


def measure(runs: OnsetRuns, guess: float) -> float:
    """Return the measured onset, infinite if there is none near the guess or beyond.

    Args:
        runs: The runs.
        guess: Where to begin to look; it decides how many runs it takes, not what they find.
    """
    low = high = guess
    for _ in range(MOST_BRACKETS):
        if runs.ends(high):
            break
        low, high = high, WIDER * high
    else:
        return math.inf
    for _ in range(MOST_BRACKETS):
        if low != high and not runs.ends(low):
            break
        low, high = low / WIDER, low
    while high - low > RESOLUTION * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if runs.ends(middle) else (middle, high)
    return runs.extrapolated(0.5 * (low + high))
