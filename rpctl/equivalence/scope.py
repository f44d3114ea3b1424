"""The scope of a certificate: what its rows prove, and what they take for granted of this robot.

What is taken for granted and can be void (that it stands, that its motors hold its joints) has rows
that fail; the rest no row can question, and it is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.standing import Standing, holding_at_home
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.file_drive import FileReading
from rpctl.errors import listed
from rpctl.robot.model import Robot

STANDS, HOLDS = "stands at home", "holds its joints at home"
GRAVITY = "gravity"
ROLLING = "equations of motion under rolling without slipping on a plane"
FIXED = "equations of motion on a fixed base"
MESH_SOURCE = "bounds of"  # so begins the source of a radius that a mesh tells
SWIVELS = {  # by role
    "steered": "steered",
    "follower": "following",
    "caster": "casters",
    "trailer": "trailers",
}
MAX_NAMES = 4  # that the line lists of a phrase


@dataclass(frozen=True)
class Condition(Check):
    """A row of what a robot has to fulfil for the equations to hold; its residual is a ratio.

    Attributes:
        value: What was found, in words.
        bound: What it has to be, in words.
    """

    value: str = ""
    bound: str = ""


@dataclass(frozen=True)
class Scope:
    """What a certificate covers.

    Attributes:
        proves: What its rows prove.
        assumes: What they take for granted of this robot, in phrases.
        shared: Further inputs that all derivations share and none checks, in phrases.
        margin: How far inside its support polygon the robot's centre of mass is at home, m; None
            where that is not known, or on a fixed base.
    """

    proves: str
    assumes: tuple[str, ...]
    shared: tuple[str, ...]
    margin: float | None

    @property
    def line(self) -> str:
        """All of it in one line, of many names the first."""
        phrases = [*map(_shortened, self.assumes), *self.shared]
        return f"{self.proves}; assumptions: {'; '.join(phrases)}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self).items()}


def find_scope(robot: Robot, reading: FileReading, standing: Standing | None) -> Scope:
    """Return the scope of a robot's certificate."""
    proves, margin = (FIXED, None) if standing is None else (ROLLING, standing.margin)
    lossy = robot.losses is not None and (robot.losses.damping.any() or robot.losses.friction.any())
    assumes = (
        *_standing(robot, standing),
        *_roles(robot),
        *([f"held: {', '.join(robot.locked)}"] if robot.locked else []),
        "losses as in the file" if lossy else "no losses in joints",
    )
    return Scope(proves, assumes, tuple(_shared(robot, reading)), margin)


def conditions(dynamics: ReducedDynamics, standing: Standing | None) -> Iterator[Condition]:
    """Yield the rows of what may be void: whether the robot stands, and holds its joints."""
    robot = dynamics.robot
    if standing is not None and not standing.unknown:
        margin, least = standing.margin, standing.least
        value = "-" if margin is None else f"{margin:.3g} m"
        where = standing.fault or f"{standing.weakest} carries least,  {standing.load:.3g} N"
        ratio = math.inf if standing.fault or margin is None else least / margin
        bound = "" if margin is None else f"≥ {least:.2g} m"
        yield Condition(STANDS, GRAVITY, ratio, 1.0, entry=where, value=value, bound=bound)
    holding = holding_at_home(dynamics)
    arm = [k for k, name in enumerate(robot.actuators) if name in robot.joint_names]
    if holding is None or not arm:
        return
    ratio, k = max((abs(holding[k]) / robot.effort_limits[k], k) for k in arm)
    name, limit = robot.actuators[k], robot.effort_limits[k]
    unit = "N" if robot.description.joint[name].kind == "prismatic" else "N·m"
    value, bound = f"{abs(holding[k]):.3g} {unit}", f"{limit:.3g} {unit}"
    bound = bound if math.isfinite(limit) else "-"
    yield Condition(HOLDS, GRAVITY, float(ratio), 1.0, entry=name, value=value, bound=bound)


def _shortened(phrase: str) -> str:
    """Return "label: a, b, c" with the first names alone, another phrase as it is."""
    label, colon, names = phrase.partition(": ")
    listing = colon and "," not in label
    return f"{label}: {listed(names.split(', '), MAX_NAMES)}" if listing else phrase


def _standing(robot: Robot, standing: Standing | None) -> Iterator[str]:
    if standing is None:
        return
    if standing.fault:
        yield f"it stands, which is not true: {standing.fault}"
    elif robot.drive.leans:
        yield "both wheels press on the ground"
    elif standing.margin is None:
        yield "it stands, or something holds it upright: unknown"
    else:
        yield f"it stands, {standing.margin:.3g} m from tipping at home"


def _roles(robot: Robot) -> Iterator[str]:
    """Yield which joints are wheels, driven, steered, free to swivel, or slide."""
    drive = robot.drive
    wheels = drive.wheels
    for label, names in (
        ("wheels on the ground", [wheel.joint for wheel in wheels]),
        ("driven wheels", [wheel.joint for wheel in wheels if wheel.driven]),
        ("undriven joints of the arm", [joint.name for joint in robot.joints if not joint.effort]),
        ("sliding", [wheel.joint for wheel in wheels if wheel.slides]),
        *(
            (label, [s.joint for s in drive.swivels if s.role == role])
            for role, label in SWIVELS.items()
        ),
    ):
        if label == "driven wheels" and wheels and len(names) in (0, len(wheels)):
            yield f"{label}: {'all' if names else 'none'}"
        elif names:
            yield f"{label}: {', '.join(names)}"


def _shared(robot: Robot, reading: FileReading) -> Iterator[str]:
    """Yield the inputs that all derivations share and none checks, as phrases."""
    drive = robot.drive
    yield from (f"doubtful, {doubt}" for doubt in drive.doubts)
    if robot.description.expanded:
        given = robot.description.read_with.xacro_args
        words = "".join(f" {name}:={value}" for name, value in given.items())
        yield "the expansion of the xacro" + (f" with{words}" if words else "")
    if robot.losses is not None and robot.losses.friction.any():
        yield "the rate below which dry friction is smoothed"
    if robot.loaded_with.rotors:
        yield f"declared armature of {', '.join(robot.loaded_with.rotors)}"
    if robot.description.estimated_links:
        yield f"estimated mass and inertia of {', '.join(robot.description.estimated_links)}"
    if "drive" in drive.declared:
        yield "the drive, which the user gave"
    elif drive.declared:
        yield f"declared {', '.join(drive.declared)}"
    meshes = [wheel.joint for wheel in drive.wheels if wheel.source.startswith(MESH_SOURCE)]
    if meshes:
        yield f"the triangles of the meshes of {', '.join(meshes)}"
    if reading.shapeless:
        yield f"radius of {', '.join(reading.shapeless)}, which have no shape"
