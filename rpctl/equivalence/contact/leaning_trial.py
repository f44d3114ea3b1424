"""The contact trial of robots that lean; see :mod:`rpctl.equivalence.contact.trial`.

Under efforts alone both sides fall over, and a gap grows as the fall does. So one regulator holds
up both, each by its own tilt, joints and speeds. Where a robot is, it does not know: a wheel that
is too large shows in the path. The efforts that each side takes are compared, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.dynamics.derivatives import linearize
from rpctl.dynamics.reduced import LeaningDynamics
from rpctl.equivalence.certificate import CONTACT_ORACLE, Skipped
from rpctl.equivalence.contact.leaning_body import LeaningBody, half_width
from rpctl.equivalence.contact.model import Builder, Contact, ContactModel, Tyre
from rpctl.equivalence.contact.plan import BASE_TURN, DURATION_S, TICK_S, Course, ReducedRobot
from rpctl.equivalence.contact.trial import (
    AXES,
    CHECK_NAME,
    EFFORT_BAND,
    EFFORT_BAND_FLOOR,
    HEADING_BAND,
    HEADING_BAND_FLOOR,
    LOAD_BAND,
    PATH_BAND,
    PATH_BAND_FLOOR_M,
    SETTLING_S,
    TICKS_PER_SAMPLE,
    ZMP_BAND,
    ContactMotion,
    ContactTrial,
    Gap,
    gap_row,
    travelled,
    weight,
    wrapped,
)
from rpctl.equivalence.mujoco_engine import EngineRefused
from rpctl.errors import RpctlError
from rpctl.robot.leaning import FREE_NQ, MAX_DRAWN_TILT, LeaningRobot
from rpctl.robot.vary import without_losses

BICYCLE_SPEED, FASTER, LEAN = 3.0, 1.0, 0.1  # m/s from the start, and more at the end; rad
SMALL, SLOW, GENTLE = 0.1, 0.3, 10.0  # rad, rad/s or m/s, and rates of these that cost alike
STIFF = 3e-3  # rad, of legs: where they part, friction holds each wheel aside, rolling their mean
REDUNDANT = 1e-6  # of the largest cost: that of efforts which work against each other
TILT_BAND = 1e-3  # rad: soft contacts leave .3 mrad of a bicycle, far less of others
NOTE = "one regulator holds up both sides, each by its own tilt, joints and speeds"
STIFF_LEGS = (
    "legs were held stiff: on soft ones that part in a turn both sides differ, as the model holds "
    "the mean of both wheels sideways and friction each"
)


class Regulator:
    """Holds a robot up about its motion straight ahead, while it gets faster and turns.

    Args:
        dynamics: The robot's.

    Attributes:
        robot: The robot.
        q: Where it starts (nq,): its centre of mass above its wheels.
        nu: Its quasi-velocities there (dof,).

    Raises:
        RpctlError: No tilt balances it, or no efforts hold it up.
    """

    def __init__(self, dynamics: LeaningDynamics) -> None:
        self.robot = robot = dynamics.robot
        self._first = 1 if robot.rolls_sideways else 2  # of the tilt's rate
        self._course = Course()
        self.q, self.nu = _balanced(robot), np.zeros(robot.dof)
        self.nu[0] = BICYCLE_SPEED * robot.rolls_sideways
        self._start = self._seen(self.q, self.nu)
        B, force = dynamics.actuation(self.q), dynamics.bias(self.q, self.nu)
        self._tau = np.array(np.linalg.lstsq(B, force, rcond=None)[0], dtype=float)
        model, nv = linearize(robot, self.q, self.nu, self._tau), robot.nv
        n, m, count = len(self._start), len(self._tau), len(self._start) - robot.dof
        whole = np.zeros((n + m, n + m))  # of tilt and joints, ν, efforts
        whole[:count, n - count : n] = np.eye(count)
        whole[count:n, :count] = model.A[nv:, :nv] @ dynamics.basis(self.q)[:, self._first :]
        whole[count:n, count:n], whole[count:n, n:] = model.A[nv:, nv:], model.B[nv:]
        F, G = np.split(expm(TICK_S * whole)[:n], [n], axis=1)
        R = model.B[nv:].T @ model.B[nv:] / GENTLE**2
        R += REDUNDANT * np.diag(R).max() * np.eye(m)
        legs = [STIFF if name in robot.legs else SMALL for name in robot.joint_names]
        alike = [SMALL] * (count - len(legs)) + legs + [SLOW] * robot.dof
        Q = np.diag(np.array(alike) ** -2.0)
        try:
            P = solve_discrete_are(F, G, Q, R)
        except (np.linalg.LinAlgError, ValueError):
            raise RpctlError("no efforts hold it up") from None
        self._K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)

    def efforts(self, t: float, q: Array, nu: Array) -> Array:
        """Return efforts (n_act,) at a time (s) and a state; N·m or N."""
        size, rising = np.zeros(len(nu)), np.arange(len(nu)) == 0
        size[0] = FASTER
        size[1] = 0.5 * LEAN * self._course.duration if self._first == 1 else BASE_TURN
        faster, _ = self._course.speeds(t, size, rising)
        wanted = self._start.copy()
        wanted[-len(nu)] += faster[0]
        wanted[0 if self._first == 1 else 1 - len(nu)] += faster[1]
        return np.asarray(self._tau - self._K @ (self._seen(q, nu) - wanted))

    def _seen(self, q: Array, nu: Array) -> Array:
        """Return tilt, steering and joints, and ν."""
        robot = self.robot
        steering = [robot.joint_position(q, swivel.joint) for swivel in robot.drive.steered]
        return np.array([robot.tilt(q), *steering, *robot.joint_positions(q), *nu])


def _balanced(robot: LeaningRobot) -> Array:
    """Return q (nq,) at the origin with the arm at home and the centre of mass above the wheels."""

    def beside(tilt: float) -> float:
        """Return how far it is out of balance, m, to where it would fall by leaning more."""
        q = robot.configuration_at(np.zeros(3), robot.home, tilt=tilt)
        x, y, _ = pin.centerOfMass(robot.model, data, q)
        return float(-y if robot.rolls_sideways else x)

    data = robot.model.createData()
    ends = -MAX_DRAWN_TILT, MAX_DRAWN_TILT
    if beside(ends[0]) * beside(ends[1]) >= 0.0:
        raise RpctlError("no tilt brings its centre of mass above its wheels")
    tilt = float(brentq(beside, *ends))
    return robot.configuration_at(np.zeros(3), robot.home, tilt=tilt)


class _Builder(Builder):
    """Sets the bodies of a robot that leans on a ground."""

    def tread(self, wheel: Wheel) -> Tyre:
        """Return a wheel's tread, whose profile is its tyre's section."""
        return replace(super().tread(wheel), half_width=half_width(wheel))


class LeaningModel(LeaningBody, ContactModel):
    """MuJoCo's model of a robot that leans, on the ground; see :class:`ContactModel`."""

    builder = _Builder

    def __init__(self, dynamics: LeaningDynamics) -> None:
        super().__init__(dynamics.robot)
        self._dynamics = dynamics

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,)."""
        return np.asarray(self._dynamics.at(self.q).W @ self.v)


class _Reduced(ReducedRobot):
    """The reduced model as :class:`LeaningModel` is asked."""

    dynamics: LeaningDynamics
    ground: Contact

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        dynamics, q = self.dynamics, self.q
        push, wrench = dynamics.reaction(q, self.nu, tau)
        found, *_ = np.linalg.lstsq(dynamics.constraint(q).T, push, rcond=None)
        load = np.array(found[-2:], dtype=float)
        force = pin.XYZQUATToSE3(q[:FREE_NQ]).rotation @ wrench[:3]
        self.ground = Contact(load, force, load @ dynamics.robot.contacts(q) / load.sum())
        super().advance(tau, dt)


@dataclass(frozen=True, eq=False)
class LeaningContactMotion(ContactMotion):
    """What one side did, its pose that of P.

    Attributes:
        tilt: Its pitch, or a bicycle's roll (n, 1), rad.
    """

    tilt: Array


def leaning_trial(robot: LeaningRobot) -> ContactTrial | Skipped:
    """Let a robot that leans roll on a plane in MuJoCo, and compare it with the reduced model.

    MuJoCo starts settled in its contacts, the reduced model where MuJoCo then is.

    Returns:
        The trial, or the row that says why there is none.
    """
    dynamics = LeaningDynamics(without_losses(robot))
    robot = dynamics.robot
    try:
        regulator, model = Regulator(dynamics), LeaningModel(dynamics)
    except (RpctlError, EngineRefused) as reason:
        return Skipped(CHECK_NAME, CONTACT_ORACLE, str(reason))
    model.start(regulator.q)
    model.launch(dynamics.basis(regulator.q) @ regulator.nu)
    for _ in range(round(SETTLING_S / TICK_S)):
        model.advance(regulator.efforts(0.0, model.q, model.nu), TICK_S)
    rolling = _Reduced(dynamics, dynamics.integrate(model.q, np.zeros(robot.nv)))
    rolling.nu = model.nu
    reduced, engine = _motion(regulator, rolling), _motion(regulator, model)
    times: Array = TICKS_PER_SAMPLE * TICK_S * np.arange(len(engine.pose), dtype=float)
    footprint = robot.contacts(regulator.q)
    for values in (times, footprint):
        values.setflags(write=False)
    rows = _gaps(robot, math.dist(*footprint), reduced, engine)
    return ContactTrial(
        checks=tuple(replace(row, time=float(times[row.sample])) for row in rows),
        notes=(*model.notes, NOTE, *([STIFF_LEGS] if robot.legs else [])),
        contacts=model.contacts,
        determinate=True,
        joints=robot.actuators,
        slides=tuple(robot.description.joint[n].kind == "prismatic" for n in robot.actuators),
        footprint=footprint,
        t=times,
        reduced=reduced,
        engine=engine,
    )


def _motion(regulator: Regulator, side: _Reduced | LeaningModel) -> LeaningContactMotion:
    """Return what one side does from where it is; NaN from where it cannot go on."""
    rows, ticks, robot = list[tuple[Array, ...]](), round(DURATION_S / TICK_S), regulator.robot
    try:
        for tick in range(ticks + 1):
            q = side.q
            tau = regulator.efforts(TICK_S * tick, q, side.nu)
            side.advance(tau, TICK_S)
            if tick % TICKS_PER_SAMPLE == 0:
                ground, seen = side.ground, np.array(robot.seen(q))
                rows.append(
                    (seen[:3], ground.load, ground.force, ground.zmp, tau, seen[4:], seen[3:])
                )
    except RpctlError:
        if not rows:
            raise
    lost = tuple(np.full_like(part, np.nan) for part in rows[0])
    rows += [lost] * (1 + ticks // TICKS_PER_SAMPLE - len(rows))
    return LeaningContactMotion(*(np.array(column) for column in zip(*rows, strict=True)))


def _gaps(
    robot: LeaningRobot, width: float, reduced: LeaningContactMotion, engine: LeaningContactMotion
) -> Iterator[Gap]:
    """Yield the rows of a trial; the contacts are a ``width`` (m) apart."""
    whole, turned = weight(robot), float(np.abs(np.diff(engine.pose[:, 2])).sum())
    apart = np.hypot(*(reduced.pose - engine.pose)[:, :2].T)[:, None]
    way = PATH_BAND * travelled(engine.pose) + PATH_BAND_FLOOR_M
    yield gap_row("path", apart, way, "m")
    turn = wrapped(reduced.pose[:, 2:] - engine.pose[:, 2:])
    yield gap_row("heading", turn, HEADING_BAND * turned + HEADING_BAND_FLOOR, "rad")
    yield gap_row("tilt", reduced.tilt - engine.tilt, TILT_BAND, "rad")
    yield gap_row("force of the ground", reduced.force - engine.force, LOAD_BAND * whole, "N", AXES)
    balance = (reduced.zmp - reduced.pose[:, :2]) - (engine.zmp - engine.pose[:, :2])
    yield gap_row("zero-moment point", balance, ZMP_BAND * width, "m", AXES)
    wheels = [wheel.joint for wheel in robot.drive.wheels]
    yield gap_row("wheel loads", reduced.load - engine.load, LOAD_BAND * whole, "N", wheels)
    most = EFFORT_BAND * float(np.abs(engine.efforts).max())
    most += EFFORT_BAND_FLOOR * whole * width
    yield gap_row("efforts", reduced.efforts - engine.efforts, most, "N·m", robot.actuators)
