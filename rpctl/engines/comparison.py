"""The comparison of an engine with the reduced model: each gap with its band, and in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.engines.engine import joint_losses
from rpctl.engines.recording import EngineRecording
from rpctl.equivalence.contact.trial import span, travelled
from rpctl.robot.model import Robot

# Mended engines stay within these bands on every robot of the catalogue, except for the rear
# casters of tiago_dual in MuJoCo, which flip over. A fault that a user sees in an animation, a few
# percent of a distance or of an angle, exceeds them.
PATH_BAND, PATH_BAND_FLOOR_M = 0.01, 3e-3  # of the way; m
HEADING_BAND, HEADING_BAND_FLOOR = 0.01, 5e-3  # of the angle turned; rad
SLIP_BAND, SLIP_BAND_FLOOR = 0.03, 5e-3  # of the largest speed; m/s
TILT_BAND = math.radians(0.5)  # rad
HEIGHT_BAND_M = 3e-3  # m that the root link may sink, or hop
CREEP_BAND_M = 3e-3  # m that a robot may move while it settles
LOAD_BAND = 0.03  # of the weight
CENTRE_BAND = 0.02  # of the distance between the outermost contacts
TURN_BAND, SLIDE_BAND_M = 0.01, 2e-3  # rad, m: of joints with a servo, or tied to another
ENERGY_BAND = 0.03  # of the work done by the efforts, without signs
STRAIGHT = 0.05  # rad: a robot that turns less goes straight
STUCK = 0.02  # of a distance or an angle: a robot that does less does nothing
LENGTH_RATIO = 0.5  # of the gap of two paths: above it the lengths of the paths differ


@dataclass(frozen=True)
class EngineGap:
    """The largest gap of one kind between what two engines did.

    Attributes:
        name: The kind.
        gap: The signed gap; infinite if an engine could not go on.
        band: Largest gap allowed.
        unit: ``"m"``, ``"rad"``, ``"m/s"``, ``"N"`` or ``"J"``.
        words: A description: ``"turns 12 % too little"``.
    """

    name: str
    gap: float
    band: float
    unit: str
    words: str

    @property
    def ratio(self) -> float:
        """The size of the gap in units of its band; infinite if it is NaN."""
        return abs(self.gap) / self.band if self.band > 0.0 and self.gap == self.gap else math.inf

    @property
    def agrees(self) -> bool:
        """Whether the gap is within the band."""
        return self.ratio <= 1.0

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON; what is infinite is None."""
        gap = self.gap if math.isfinite(self.gap) else None
        return {**asdict(self), "gap": gap, "agrees": self.agrees}


def compare(
    robot: Robot,
    contacts: Contacts,
    model: EngineRecording,
    engine: EngineRecording,
    slack: Mapping[str, float],
) -> tuple[EngineGap, ...]:
    """Return the gaps between two recordings, the largest in units of its band first.

    Args:
        robot: The robot.
        contacts: The robot's contacts with the ground.
        model: The recording of the reduced model.
        engine: The recording of the engine.
        slack: By joint name, how far dry friction may hold a joint off its servo's set point, rad
            or m: engines have different laws of friction at rest.
    """
    if engine.fault:
        return (EngineGap("run", math.inf, 1.0, "", engine.fault),)
    rows = [*_stance(robot, model, engine), *_path(model, engine), *_slip(robot, model, engine)]
    rows += [*_loads(robot, contacts, model, engine), *_joints(robot, model, engine, slack)]
    rows.append(_energy(robot, model, engine, slack))
    return tuple(sorted(rows, key=lambda row: -row.ratio))


def _largest(gaps: Array) -> float:
    """Return the gap of the largest size, with its sign."""
    return float(gaps.flat[int(np.abs(gaps).argmax())])


def _more(gap: float, more: str, less: str) -> str:
    """Return the word for a gap's sign."""
    return more if gap > 0.0 else less


def _stance(robot: Robot, model: EngineRecording, engine: EngineRecording) -> Iterator[EngineGap]:
    """Yield the gaps of the stance: tilt, height, hop, and creep before the robot is driven."""
    lean = _largest(engine.tilt - model.tilt)
    yield EngineGap("tilt", lean, TILT_BAND, "rad", f"leans {_degrees(lean)}")
    sunk = engine.sunk - model.sunk
    words = f"{_more(sunk, 'sinks', 'stands high by')} {_mm(sunk)}"
    yield EngineGap("height", sunk, HEIGHT_BAND_M, "m", words)
    ours, theirs = model.root[:, 2], engine.root[:, 2]
    hop = _largest(theirs - theirs[0] - (ours - ours[0]))
    yield EngineGap("hop", hop, HEIGHT_BAND_M, "m", f"rises and falls by {_mm(hop)} as it goes")
    crept = engine.crept - model.crept
    yield EngineGap(
        "creep", crept, CREEP_BAND_M, "m", f"moves by {_mm(crept)} before anything drives it"
    )


def _path(model: EngineRecording, engine: EngineRecording) -> Iterator[EngineGap]:
    apart = engine.pose - model.pose
    way, turned = travelled(model.pose), float(np.abs(np.diff(model.pose[:, 2])).sum())
    k = int(np.hypot(*apart[:, :2].T).argmax())
    gap, band = float(np.hypot(*apart[k, :2])), PATH_BAND * way + PATH_BAND_FLOOR_M
    yield EngineGap("path", gap, band, "m", _path_words(model, engine, k, gap))
    turn = _largest(apart[:, 2])
    words = f"veers {_degrees(turn)} to the {_more(turn, 'left', 'right')}"
    asked, did = float(model.pose[-1, 2]), float(engine.pose[-1, 2])
    if abs(asked) > STRAIGHT and abs(did - asked) > LENGTH_RATIO * abs(turn):
        ratio = did / asked - 1.0
        words = f"turns {_percent(ratio)} too {_more(ratio, 'much', 'little')}"
        words = "does not turn" if abs(ratio + 1.0) < STUCK else words
        words = "turns the other way" if ratio <= -1.0 - STUCK else words
    band = HEADING_BAND * turned + HEADING_BAND_FLOOR
    yield EngineGap("heading", turn, band, "rad", words)


def _path_words(model: EngineRecording, engine: EngineRecording, k: int, gap: float) -> str:
    asked, did = travelled(model.pose), travelled(engine.pose)
    if abs(did - asked) > LENGTH_RATIO * gap and asked > 0.0:
        ratio = did / asked - 1.0
        if ratio < STUCK - 1.0:
            return "does not move"
        return f"drives {_percent(ratio)} too {_more(ratio, 'far', 'short')}"
    turn = float(model.pose[k, 2])
    x, y = (engine.pose - model.pose)[k, :2]
    left = -math.sin(turn) * x + math.cos(turn) * y
    return f"leaves the path by {_mm(gap)}, to the {_more(left, 'left', 'right')}"


def _slip(robot: Robot, model: EngineRecording, engine: EngineRecording) -> Iterator[EngineGap]:
    fastest = float(np.abs(np.gradient(model.pose[:, :2], model.t, axis=0)).max(initial=0.0))
    gaps = engine.slip - model.slip
    if robot.drive.type == "skid-steer":
        gaps = gaps[..., :1]
    at = np.unravel_index(int(np.abs(gaps).argmax()), gaps.shape)
    slip, wheel = float(gaps[at]), robot.drive.wheels[int(at[1])].joint
    words = (
        f"{wheel} {'spins or drags' if at[2] == 0 else 'slides sideways'} at {abs(slip):.2g} m/s"
    )
    yield EngineGap("slip", slip, SLIP_BAND * fastest + SLIP_BAND_FLOOR, "m/s", words)


def _loads(
    robot: Robot, contacts: Contacts, model: EngineRecording, engine: EngineRecording
) -> Iterator[EngineGap]:
    """Yield the gap of the loads; if statics do not determine them, of their sum and centre."""
    band = LOAD_BAND * robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
    gaps, bearers = engine.load - model.load, [f"{name} bears" for name in contacts.names]
    if not contacts.determinate:
        gaps, bearers = gaps.sum(axis=1, keepdims=True), ["wheels and supports bear"]
    _, bearer = np.unravel_index(int(np.abs(gaps).argmax()), gaps.shape)
    gap = _largest(gaps)
    words = f"{bearers[bearer]} {abs(gap):.3g} N too {_more(gap, 'much', 'little')}"
    yield EngineGap("load", gap, band, "N", words)
    if not contacts.determinate:
        shift = float(np.hypot(*(_centre(contacts, engine) - _centre(contacts, model)).T).max())
        band = CENTRE_BAND * span(contacts)
        yield EngineGap(
            "load centre", shift, band, "m", f"the centre of the loads is off by {_mm(shift)}"
        )


def _centre(contacts: Contacts, recording: EngineRecording) -> Array:
    """Return the centre of the loads (n, 2), m, with the contacts where they are at the start."""
    total = np.maximum(recording.load.sum(axis=1), contacts.floor)
    return np.asarray(recording.load @ contacts.points / total[:, None])


def _joints(
    robot: Robot, model: EngineRecording, engine: EngineRecording, slack: Mapping[str, float]
) -> Iterator[EngineGap]:
    """Yield the gap of the joint that is farthest off relative to its band, wheels left out."""
    casters = {swivel.joint for swivel in robot.drive.swivels if swivel.trails}
    free = casters | {wheel.joint for wheel in robot.drive.wheels}
    rows = []
    for name in robot.moving_joint_names:
        if name in free:
            continue
        slides = robot.description.joint[name].kind == "prismatic"
        gap = _largest(engine.joints[name] - model.joints[name])
        unit, band = ("m", SLIDE_BAND_M) if slides else ("rad", TURN_BAND)
        size = _mm(gap) if slides else _degrees(gap)
        band += slack.get(name, 0.0)
        rows.append(EngineGap("joint", gap, band, unit, f"{name} is off by {size}"))
    if rows:
        yield max(rows, key=lambda row: row.ratio)


def _energy(
    robot: Robot, model: EngineRecording, engine: EngineRecording, slack: Mapping[str, float]
) -> EngineGap:
    """Return the energy that is created, or lost beyond what the model loses.

    A joint that friction may hold off its place takes another path: that energy is allowed for.
    """
    made = (engine.energy - engine.energy[0] - engine.work) - (
        model.energy - model.energy[0] - model.work
    )
    gap, band = _largest(made), ENERGY_BAND * float(np.abs(np.diff(model.work)).sum())
    words = f"{_more(gap, 'creates', 'loses')} {abs(gap):.2g} J"
    for name in slack:
        band += abs(_lost(robot, name, engine) - _lost(robot, name, model))
    return EngineGap("energy", gap, band, "J", words)


def _lost(robot: Robot, name: str, recording: EngineRecording) -> float:
    """Return the energy that a joint's friction and damping dissipate, J."""
    damping, friction = joint_losses(robot, name)
    turns, times = np.diff(recording.joints[name]), np.diff(recording.t)
    return float(friction * np.abs(turns).sum() + (damping * turns**2 / times).sum())


READ_IN = {"m": ("mm", 1e3), "rad": ("°", math.degrees(1.0))}  # units that gaps are read in


def gap_text(value: float, unit: str) -> str:
    """Return a gap or a band as text for a table; a dash if an engine could not go on."""
    if not math.isfinite(value):
        return "–"
    word, scale = READ_IN.get(unit, (unit, 1.0))
    size = scale * value
    return f"{size:.0f} {word}" if abs(size) >= 100.0 else f"{size:.2g} {word}"


def _degrees(angle: float) -> str:
    return f"{math.degrees(abs(angle)):.2g}°"


def _mm(length: float) -> str:
    return f"{1e3 * abs(length):.3g} mm"


def _percent(ratio: float) -> str:
    percent = 100.0 * abs(ratio)
    return f"{percent:.0f} %" if percent > 9.5 else f"{percent:.2g} %"
