"""The contact trial: the reduced model against the robot itself, rolling on a plane in MuJoCo.

Both get the same efforts from the same plan. One side integrates M ν̇ + h = B τ, in which rolling
is an equation; on the other the wheels roll because friction lets them. Their paths, the ground's
forces and the efforts of steered and arm joints must agree within bands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, GroundReaction, ground_reaction
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import CONTACT_ORACLE, Check, Skipped
from rpctl.equivalence.contact.model import ContactModel
from rpctl.equivalence.contact.plan import (
    TICK_S,
    ContactPlan,
    NotGentle,
    ReducedRobot,
    plan_motion,
    standing_contacts,
)
from rpctl.equivalence.mujoco_engine import EngineRefused
from rpctl.errors import ActuationError, RpctlError, SingularBasisError
from rpctl.robot.coordinates import read_root, write_root
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

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


# What soft contacts and steps of .5 ms leave of the catalogue, at worst: 0.8 mm over 1.1 m,
# 0.6 mrad over 0.8 rad, 0.04 % of the weight, 0.03 % of the span, 0.15 % of the efforts, 1 mrad of
# a caster. The bands are three to fifteen times that, and a fault of a few percent breaks them.
PATH_BAND, PATH_BAND_FLOOR_M = 2.5e-3, 1e-3  # of the distance travelled; m
HEADING_BAND, HEADING_BAND_FLOOR = 2.5e-3, 1e-3  # of the angle turned; rad
LOAD_BAND = 5e-3  # of the weight
ZMP_BAND = 5e-3  # of the distance between the outermost contacts
EFFORT_BAND = 0.01  # of the largest effort of its kind, N or N·m
EFFORT_BAND_FLOOR = (
    1e-6  # of the weight, and of its moment over the outermost contacts: soft contacts
)
CASTER_BAND = 0.02  # rad: a caster turns by as much in a millimetre of its way
MIN_CASTER_LOAD = 0.01  # of the weight: a caster that bears less does not roll
AXES = ("x", "y", "z")
CHECK_NAME = "motion on the ground"
SETTLING_S = 0.3  # s in which the robot sinks into its contacts: 150 of their time constants
MAX_TILT = 2e-3  # rad; soft contacts let a robot lean by a tenth of it
TICKS_PER_SAMPLE = 5  # ticks between two samples


def gaps(
    robot: Robot,
    contacts: Contacts,
    joints: Sequence[str],
    reduced: ContactMotion,
    engine: ContactMotion,
) -> Iterator[Gap]:
    """Yield the rows of a trial."""
    whole, width = weight(robot), span(contacts)
    turned = float(np.abs(np.diff(engine.pose[:, 2])).sum())
    apart = np.hypot(*(reduced.pose - engine.pose)[:, :2].T)[:, None]
    way = PATH_BAND * travelled(engine.pose) + PATH_BAND_FLOOR_M
    yield gap_row("path", apart, way, "m")
    turn = wrapped(reduced.pose[:, 2:] - engine.pose[:, 2:])
    yield gap_row("heading", turn, HEADING_BAND * turned + HEADING_BAND_FLOOR, "rad")
    yield gap_row("force of the ground", reduced.force - engine.force, LOAD_BAND * whole, "N", AXES)
    # Seen from each side's own root link: where the robot is, is the path's row.
    balance = (reduced.zmp - reduced.pose[:, :2]) - (engine.zmp - engine.pose[:, :2])
    yield gap_row("zero-moment point", balance, ZMP_BAND * width, "m", AXES)
    if contacts.determinate:
        load = reduced.load - engine.load
        yield gap_row("wheel loads", load, LOAD_BAND * whole, "N", contacts.names)
    slides = np.array([robot.description.joint[name].kind == "prismatic" for name in joints], bool)
    for label, unit, kind, reach in (
        ("forces", "N", slides, whole),
        ("torques", "N·m", ~slides, whole * width),
    ):
        if kind.any():
            names = [name for name, one in zip(joints, kind, strict=True) if one]
            largest = float(np.abs(engine.efforts[:, kind]).max())
            effort = (reduced.efforts - engine.efforts)[:, kind]
            band = EFFORT_BAND * largest + EFFORT_BAND_FLOOR * reach
            yield gap_row(f"joint {label}", effort, band, unit, names)
    rolling = rolling_casters(robot, contacts, engine)
    if rolling:
        swung = wrapped(reduced.casters - engine.casters)[:, list(rolling.values())]
        yield gap_row("casters", swung, CASTER_BAND, "rad", list(rolling))


def caster_names(robot: Robot) -> list[str]:
    """Return the swivels of ``Motion.casters``."""
    return [swivel.joint for swivel in robot.drive.swivels if swivel.trails]


def rolling_casters(robot: Robot, contacts: Contacts, engine: ContactMotion) -> dict[str, int]:
    """Return the casters that bear a load all the while, with their columns.

    Args:
        robot: The robot.
        contacts: Its contacts with the ground, wheels first.
        engine: What the engine's robot did, loads (K, n_contacts) in N included.
    """
    least, kept = MIN_CASTER_LOAD * weight(robot), {}
    swivels = {swivel.joint: swivel for swivel in robot.drive.swivels}
    for column, name in enumerate(caster_names(robot)):
        wheels = list(robot.drive.carried(swivels[name]))
        if engine.load[:, wheels].sum(axis=1).min() > least:
            kept[name] = column
    return kept


def weight(robot: Robot) -> float:
    """Return a robot's weight, N."""
    return robot.mass * float(np.linalg.norm(robot.model.gravity.linear))


def span(contacts: Contacts) -> float:
    """Return the largest distance between two contacts, m."""
    points = contacts.points
    return float(np.hypot(*(points[:, None] - points[None]).T).max())


def wrapped(angles: Array) -> Array:
    """Return differences of angles in (−π, π]; NaN stays NaN."""
    return np.asarray(np.arctan2(np.sin(angles), np.cos(angles)))


def gap_row(
    name: str,
    gap: Array,
    band: float,
    unit: str,
    entries: Sequence[str] = ("",),
    against: str = CONTACT_ORACLE,
) -> Gap:
    """Return the row of gaps (n, n_entries); one that is no number is infinite."""
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    at, entry = divmod(int(size.argmax()), size.shape[1])
    largest = float(size[at, entry])
    residual = largest / band if band > 0.0 else math.inf
    where = {"sample": at, "entry": entries[entry]}
    return Gap(name, against, residual, 1.0, **where, gap=largest, band=band, unit=unit)


def contact_trial(robot: Robot) -> ContactTrial | Skipped:
    """Let a robot roll on a plane in MuJoCo, and compare it with the reduced model.

    Wheels get their efforts open loop, the same numbers on both sides; steered and arm joints
    have one servo law, each side on its own measured state, for under efforts alone an arm falls.
    MuJoCo starts settled in its contacts, the reduced model where MuJoCo then stands. Joints lose
    nothing on either side: it is the ground that is compared.

    Returns:
        The trial, or the row that says why there is none.
    """
    robot = without_losses(robot)
    dynamics = ReducedDynamics(robot)
    try:
        contacts = standing_contacts(dynamics)
        plan, model = plan_motion(dynamics, contacts), ContactModel(robot)
    except (NotGentle, ActuationError, SingularBasisError, EngineRefused) as reason:
        return Skipped(CHECK_NAME, CONTACT_ORACLE, str(reason))
    engine = _motion(plan, _settled(plan, model))
    reduced = _motion(plan, _Reduced(dynamics, contacts, plan, engine.pose[0]))
    times: Array = TICKS_PER_SAMPLE * TICK_S * np.arange(len(engine.pose), dtype=float)
    times.setflags(write=False)
    rows = gaps(robot, contacts, plan.names, reduced, engine)
    return ContactTrial(
        checks=tuple(replace(row, time=float(times[row.sample])) for row in rows),
        notes=(*model.notes, *tilt_note(model.tilt), *_notes(robot, contacts, engine)),
        contacts=contacts.names,
        determinate=contacts.determinate,
        joints=plan.names,
        slides=tuple(robot.description.joint[n].kind == "prismatic" for n in plan.names),
        footprint=contacts.points,
        t=times,
        reduced=reduced,
        engine=engine,
    )


class _Reduced(ReducedRobot):
    """The reduced model as :class:`ContactModel` is asked, at rest at a pose (3,) of the root link.

    Attributes:
        ground: What the ground did at the start of the last advance.
    """

    ground: GroundReaction

    def __init__(
        self, dynamics: ReducedDynamics, contacts: Contacts, plan: ContactPlan, pose: Array
    ) -> None:
        super().__init__(dynamics, plan.q[0])
        self._contacts = contacts
        write_root(self.q, *pose)

    @property
    def planar(self) -> Array:
        """The root link's x, y (m) and heading (rad) (3,)."""
        return np.array(read_root(self.q))

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        self.ground = ground_reaction(self.dynamics, self._contacts, self.q, self.nu, tau)
        super().advance(tau, dt)


def _settled(plan: ContactPlan, model: ContactModel) -> ContactModel:
    """Return MuJoCo's robot where it has settled at the start of the plan."""
    model.start(plan.q[0])
    for _ in range(round(SETTLING_S / TICK_S)):
        plan.drive(model, -1)
    return model


def _motion(plan: ContactPlan, model: ContactModel | _Reduced) -> ContactMotion:
    """Return what one side does from where it is.

    A wrong model may run into a posture that is singular; from there on its rows are NaN.
    """
    casters, rows = caster_names(model.robot), list[tuple[Array, ...]]()
    try:
        for tick in range(len(plan.tau) + 1):
            pose, (swung, _) = model.planar, model.measured(casters)
            tau = plan.drive(model, tick)
            if tick % TICKS_PER_SAMPLE == 0:
                ground, efforts = model.ground, tau[list(plan.servoed)]
                rows.append((pose, ground.load, ground.force, ground.zmp, efforts, swung))
    except RpctlError:
        if not rows:
            raise
    lost = tuple(np.full_like(part, np.nan) for part in rows[0])
    rows += [lost] * (1 + len(plan.tau) // TICKS_PER_SAMPLE - len(rows))
    return ContactMotion(*(np.array(column) for column in zip(*rows, strict=True)))


def tilt_note(tilt: float) -> Iterator[str]:
    """Yield a note if a robot settles at a larger tilt (rad) than soft contacts explain."""
    if tilt > MAX_TILT:
        yield (
            f"it stands {math.degrees(tilt):.2g}° tilted: its wheels and supports do not end at "
            "one height in the file, as the reduced model assumes; correct their origins or "
            "sizes"
        )


def _notes(robot: Robot, contacts: Contacts, engine: ContactMotion) -> Iterator[str]:
    """Yield what the two sides share, and what is not compared."""
    drive = robot.drive
    if drive.type == "skid-steer":
        yield (
            "straight ahead only: a skid-steer base turns by scrubbing, which the reduced model "
            "replaces by an effective track"
        )
    if drive.type in ("mecanum", "omni"):
        yield (
            "rollers are friction along the roller's axle and none across it; their angle on the "
            "wheel is the drive's"
        )
    if any(wheel.slides for wheel in drive.wheels):
        yield "wheels that nothing holds sideways have friction along their rolling only"
    if drive.followers:
        names = ", ".join(swivel.joint for swivel in drive.followers)
        yield f"stiff tie rods hold {names} to the common centre of rotation"
    if not contacts.determinate:
        count = len(contacts.names)
        yield f"{count} contacts: statics fix their sum and its centre, not each load"
    rolling = rolling_casters(robot, contacts, engine)
    lifted = [name for name in caster_names(robot) if name not in rolling]
    if lifted:
        yield f"{', '.join(lifted)} carry no load throughout: their swing is not compared"
