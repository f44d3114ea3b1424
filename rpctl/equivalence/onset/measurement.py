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
from rpctl.equivalence.contact.model import MIN_LOAD_N, SOLREF, ContactModel
from rpctl.equivalence.contact.mujoco_body import UP, vertical_inverse_masses
from rpctl.equivalence.contact.plan import TICK_S, rest_plan
from rpctl.equivalence.mujoco_engine import NAME_PREFIX
from rpctl.equivalence.onset.prediction import SLIPS, Instant, Manoeuvre, bisected, instant
from rpctl.robot.model import Robot

# MuJoCo lifts a contact that slides at v by 2 μ d T v, T its time constant and d its impedance.
# Where it stands on the ground by less than that it hops, and what hops holds less than Coulomb's
# friction. So contacts are soft here and sink by (1 − d) g T², .08 mm. What moves on a circle
# creeps by ½ d T a at an acceleration a, as MuJoCo leaves the turning of contacts out, some mm/s.
TIME_CONSTANT_S = 4e-3  # T, s
IMPEDANCE = 0.5  # d
IMPRATIO = 100.0  # how much stiffer friction is than the load: its own creep is .1 mm/s
MIN_LOAD = 5e-3  # of the weight, that a wheel bears
BRAKE = 1e6  # N·m: more than any wheel passes on
HARD = 0.9999  # impedance of a brake
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


class PushedBody(ContactModel):
    """A robot as a free body on a plane, which starts in motion and may be pushed."""

    def __init__(self, robot: Robot, friction: float, softness: float = 1.0) -> None:
        super().__init__(robot, friction)
        model = self.mjm
        shapes = model.geom_contype == 0  # all but the plane
        model.geom_solref[shapes] = softness * TIME_CONSTANT_S, 1.0
        model.geom_solimp[shapes, :2] = IMPEDANCE
        model.opt.impratio = IMPRATIO
        bodies = model.geom_bodyid[list(self.owner)]
        level = vertical_inverse_masses(model, self.owner).mean()
        model.body_invweight0[bodies, 0] = level  # equally stiff, as predictions assume
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        wheels = robot.drive.wheels
        self._wheels = [(int(model.geom(NAME_PREFIX + w.joint).id), w) for w in wheels]
        self._settled: Array = np.zeros(0)

    def brake(self) -> None:
        """Lock the wheels that have motors: friction in their joints holds them from now on."""
        for wheel in self.robot.drive.wheels:
            if wheel.driven:
                dof = self.dofs[wheel.joint]
                self.mjm.dof_frictionloss[dof] = BRAKE
                self.mjm.dof_solref[dof], self.mjm.dof_solimp[dof, :2] = SOLREF, HARD

    def keep(self) -> None:
        """Remember where the robot stands now, for :meth:`set_moving`."""
        self._settled = np.array(self.data.qpos)

    def set_moving(self, v: Array) -> None:
        """Put the robot where it was kept, upright in the plane, with velocities v (nv,).

        Args:
            v: Pinocchio's velocity: of the root link in its own axes, then of the joints.
        """
        self.mujoco.mj_resetData(self.mjm, self.data)
        self.data.qpos[:] = self._settled
        turn = self.planar[2]
        cos, sin = np.cos(turn), np.sin(turn)
        self.data.qvel[:2] = cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]
        self.data.qvel[5] = v[2]
        for name, dof in self.dofs.items():
            self.data.qvel[dof] = v[self.robot.velocity_index(name)]
        self.mujoco.mj_forward(self.mjm, self.data)

    def push(self, force: Array, moment: Array) -> None:
        """Push the root link from now on.

        Args:
            force: At the origin of its frame (3,), world axes, N.
            moment: (3,), world axes, N·m.
        """
        self.data.xfrc_applied[:] = 0.0
        self.push_body(self.root, self.data.xpos[self.root], force, moment)

    def slip(self) -> Array:
        """Return how fast each wheel slides over the ground (n_wheels, 2), m/s.

        It is the velocity of the wheel's material point that lies lowest, in the wheel's plane and
        along its axle, which turn with the wheel; their signs are those of its shape. Of a roller,
        and of a wheel that may slide sideways, the first is the speed in the direction that the
        ground holds, and the other is 0. A wheel without a motor that bears nothing to speak of
        slides nowhere.
        """
        model, data = self.mjm, self.data
        slips, kind = np.zeros((len(self._wheels), 2)), self.mujoco.mjtObj.mjOBJ_XBODY
        idle = self.loads()[: len(slips)] < MIN_LOAD * self._weight
        for row, (geom, wheel), lifted in zip(slips, self._wheels, idle, strict=True):
            if lifted and not wheel.driven:
                continue
            body = int(model.geom_bodyid[geom])
            twist = self.twist(kind, body)
            lowest = data.geom_xpos[geom] - wheel.radius * UP
            lever = lowest - data.xpos[body] - 0.5 * min(lowest[2], 0.0) * UP  # amid what sinks
            velocity = twist[:3] + np.cross(twist[3:], lever)
            if geom in self.rolling:
                row[0] = self.held(wheel) @ velocity
                continue
            x, y, _ = data.geom_xmat[geom].reshape(3, 3)[:, 2]  # the axle
            row[:] = np.array([[y, -x], [x, y]]) @ velocity[:2] / np.hypot(x, y)
        return slips


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
        self._dynamics, self._manoeuvre, self._body = dynamics, manoeuvre, body
        still = instant(dynamics, manoeuvre, 0.0)
        self._stance = stance_at(dynamics, contacts, still.q)
        self._rest = rest_plan(dynamics, still.q)
        if manoeuvre.height:
            body.brake()
        body.start(still.q)
        for _ in range(round(SETTLING_S / TICK_S)):
            self._rest.drive(body, 0, planned=still.unforced)
        body.keep()
        self.tilt = body.tilt
        self._start = self._margins(body.loads())

    def ends(self, value: float) -> bool:
        """Return whether the robot slips, or all but tips, at a speed (m/s) or force (N)."""
        at, body = instant(self._dynamics, self._manoeuvre, value), self._body
        body.set_moving(self._dynamics.basis(at.q) @ at.nu)
        level, slips = body.tilt, self._manoeuvre.ending == SLIPS
        slipped, load = np.zeros_like(body.slip()), np.zeros(len(body.contacts))
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
                load += body.loads()
        return not slips and bool((self._margins(load) <= WAY_LEFT * self._start).any())

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
        stance = self._stance
        place = stance.statics[1:] @ load / max(float(load.sum()), MIN_LOAD_N)
        return np.asarray(stance.inward @ place + stance.offset)

    def _push(self, at: Instant, share: float) -> None:
        """Advance by a tick with a share of the motion's efforts and push, smoothed."""
        share *= share * (3.0 - 2.0 * share)
        self._body.push(share * at.force, share * at.moment)
        planned = at.unforced + share * (at.tau - at.unforced)
        self._rest.drive(self._body, 0, planned=planned)


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
    return runs.extrapolated(bisected(runs.ends, low, high, RESOLUTION))
