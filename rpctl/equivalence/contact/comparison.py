"""The comparison of a contact trial: the largest gap of each kind, and the band it must keep."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.equivalence.contact.record import ContactMotion, Gap, travelled
from rpctl.equivalence.row import CONTACT_ORACLE
from rpctl.robot.model import Robot

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


def gaps(
    robot: Robot,
    contacts: Contacts,
    joints: Sequence[str],
    reduced: ContactMotion,
    engine: ContactMotion,
) -> Iterator[Gap]:
    """Yield the rows of a trial.

    Args:
        robot: The robot.
        contacts: How it stands.
        joints: Those of ``Motion.efforts``.
        reduced: What the reduced model did.
        engine: What MuJoCo did, at the same times.
    """
    weight, span = _weight(robot), _span(contacts)
    turned = float(np.abs(np.diff(engine.pose[:, 2])).sum())
    apart = np.hypot(*(reduced.pose - engine.pose)[:, :2].T)[:, None]
    way = PATH_BAND * travelled(engine.pose) + PATH_BAND_FLOOR_M
    yield _gap("path", apart, way, "m")
    turn = _wrapped(reduced.pose[:, 2:] - engine.pose[:, 2:])
    yield _gap("heading", turn, HEADING_BAND * turned + HEADING_BAND_FLOOR, "rad")
    yield _gap("force of the ground", reduced.force - engine.force, LOAD_BAND * weight, "N", AXES)
    # Seen from each side's own root link: where the robot is, is the path's row.
    balance = (reduced.zmp - reduced.pose[:, :2]) - (engine.zmp - engine.pose[:, :2])
    yield _gap("zero-moment point", balance, ZMP_BAND * span, "m", AXES)
    if contacts.determinate:
        load = reduced.load - engine.load
        yield _gap("wheel loads", load, LOAD_BAND * weight, "N", contacts.names)
    slides = np.array([robot.description.joint[name].kind == "prismatic" for name in joints], bool)
    for label, unit, kind, reach in (
        ("forces", "N", slides, weight),
        ("torques", "N·m", ~slides, weight * span),
    ):
        if kind.any():
            names = [name for name, one in zip(joints, kind, strict=True) if one]
            largest = float(np.abs(engine.efforts[:, kind]).max())
            effort = (reduced.efforts - engine.efforts)[:, kind]
            band = EFFORT_BAND * largest + EFFORT_BAND_FLOOR * reach
            yield _gap(f"joint {label}", effort, band, unit, names)
    rolling = rolling_casters(robot, contacts, engine)
    if rolling:
        swung = _wrapped(reduced.casters - engine.casters)[:, list(rolling.values())]
        yield _gap("casters", swung, CASTER_BAND, "rad", list(rolling))


def caster_names(robot: Robot) -> list[str]:
    """Return the swivels of ``Motion.casters``."""
    return [swivel.joint for swivel in robot.drive.swivels if swivel.role == "caster"]


def rolling_casters(robot: Robot, contacts: Contacts, engine: ContactMotion) -> dict[str, int]:
    """Return the casters that bear a load all the while, with their columns.

    Args:
        robot: The robot.
        contacts: Its contacts with the ground, wheels first.
        engine: What the engine's robot did, loads (K, n_contacts) in N included.
    """
    least, kept = MIN_CASTER_LOAD * _weight(robot), {}
    swivels = {swivel.joint: swivel for swivel in robot.drive.swivels}
    for column, name in enumerate(caster_names(robot)):
        wheels = list(robot.drive.carried(swivels[name]))
        if engine.load[:, wheels].sum(axis=1).min() > least:
            kept[name] = column
    return kept


def _weight(robot: Robot) -> float:
    return robot.mass * float(np.linalg.norm(robot.model.gravity.linear))


def _span(contacts: Contacts) -> float:
    points = contacts.points
    return float(np.hypot(*(points[:, None] - points[None]).T).max())


def _wrapped(angles: Array) -> Array:
    """Return differences of angles in (−π, π]; NaN stays NaN."""
    return np.asarray(np.arctan2(np.sin(angles), np.cos(angles)))


def _gap(name: str, gap: Array, band: float, unit: str, entries: Sequence[str] = ("",)) -> Gap:
    """Return the row of gaps (n, n_entries); one that is no number is infinite."""
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    at, entry = divmod(int(size.argmax()), size.shape[1])
    largest = float(size[at, entry])
    residual = largest / band if band > 0.0 else math.inf
    where = {"sample": at, "entry": entries[entry]}
    return Gap(name, CONTACT_ORACLE, residual, 1.0, **where, gap=largest, band=band, unit=unit)
