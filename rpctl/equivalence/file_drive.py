"""The robot's file, read again for the independent derivations, and the names they share.

The bytes are the user's (a .xacro's are its expansion). Links and joints come from yourdfpy, or,
where it cannot read the file, from :mod:`rpctl.equivalence.raw_file`. The drive is measured on the
file's own shapes, apart from ``robot/`` and its detection. Its names and roles are the drive's:
which joints are wheels, which swivels steer, follow or trail. Every number is taken from the user's
bytes, with all joints at 0 or where they are locked, by these conventions:

- wheels are placed as :mod:`rpctl.equivalence.file_wheels` says.
- forward is across the mean of the axles that the root link holds and that do not slide.
- P is the middle between the outermost wheels of an axle; of several axles the mean.
- a swivel's pivot is its origin, or, where its axis leans, where that meets its wheels' ground.
- a swivel heads across the axle of its first wheel, towards forward; where all wheels swivel, as
  the first that does not trail. Its trail is how far its wheels' contact lies ahead, and 0 if that
  is less than 2 mm where several swivels share one centre of rotation.
- the roller on the ground of a mecanum wheel lies as the file has it, or else at 45° to forward,
  those on top form an X; an omni wheel's lies across its axle.
"""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.meshes.paths import MeshPaths
from rpctl.drive.drive import Drive, Swivel, Wheel
from rpctl.equivalence.file_wheels import PlacedWheel, leftward, on_the_ground, place, wheel_size
from rpctl.equivalence.raw_file import RawFile, read_file
from rpctl.libraries import lean_library
from rpctl.robot.model import Robot

YOURDFPY = ("yourdfpy", "trimesh")  # it takes trimesh along
# Trimesh imports them if they are there, which takes long; to read links and joints needs none.
UNUSED = (
    "networkx", "PIL", "shapely", "rtree", "jsonschema",
    "scipy.spatial", "scipy.optimize", "scipy.sparse", "scipy.ndimage",
)  # fmt: skip


@dataclass(frozen=True)
class FileReading:
    """A robot's file as the derivations read it.

    Attributes:
        raw: Names, frames and shapes by the minimal reader.
        links: Links with ``name`` and ``inertial``, as yourdfpy has them.
        joints: Joints with ``name``, ``type``, ``parent``, ``child``, ``origin``, ``axis`` and
            ``mimic``.
        yourdfpy: Whether yourdfpy read the links and joints; else the minimal reader did.
        measured: The drive with its geometry measured on the file's shapes.
        drive: The same with the numbers that the user declared.
        shapeless: Wheels without a shape, whose radius is the record's.
    """

    raw: RawFile
    links: tuple[Any, ...]
    joints: tuple[Any, ...]
    yourdfpy: bool
    measured: Drive
    drive: Drive
    shapeless: tuple[str, ...]


def read(robot: Robot) -> FileReading:
    """Return a robot's file, read anew.

    Args:
        robot: The robot; of it only its bytes, names, roles and locked positions are used, and
            what the scope's ``shared`` lists.
    """
    data = robot.description.raw
    raw = read_file(data)
    parsed = _by_yourdfpy(data, raw)
    measured, shapeless = measure(robot, raw)
    return FileReading(
        raw=raw,
        links=raw.links if parsed is None else tuple(parsed.links),
        joints=raw.joints if parsed is None else tuple(parsed.joints),
        yourdfpy=parsed is not None,
        measured=measured,
        drive=with_declared(measured, robot.drive),
        shapeless=shapeless,
    )


def rotor_inertias(robot: Robot, raw: RawFile) -> dict[str, float]:
    """Return the inertia of each rotor that counts, seen from its joint, by name; kg·m² or kg.

    Args:
        robot: The robot; its locked joints and what the user said of rotors are used.
    """
    given = robot.loaded_with.rotors
    if given is None:
        return {}
    found, free = dict(raw.rotors), [joint.name for joint in raw.moving(robot.locked)]
    for pattern, inertia in given.items():
        found |= {name: inertia for name in free if fnmatchcase(name, pattern)}
    return {name: inertia for name, inertia in found.items() if inertia and name in free}


def _by_yourdfpy(data: bytes, raw: RawFile) -> Any:
    """Return the robot as yourdfpy reads it, or None where it cannot.

    It drops what it does not understand without a word, so the names must be all there.
    """
    quiet = logging.getLogger("yourdfpy")
    before, quiet.disabled = quiet.disabled, True
    try:
        parsed = lean_library("yourdfpy", YOURDFPY, UNUSED).URDF.load(
            io.BytesIO(data), build_scene_graph=False, load_meshes=False
        ).robot  # fmt: skip
    except Exception:  # it raises whatever its reading runs into
        return None
    finally:
        quiet.disabled = before
    links = {link.name: link.inertial is not None for link in parsed.links}
    joints = {joint.name: (joint.type, joint.parent, joint.child) for joint in parsed.joints}
    whole = links == {link.name: link.inertial is not None for link in raw.links} and joints == {
        joint.name: (joint.type, joint.parent, joint.child) for joint in raw.joints
    }
    return parsed if whole else None


MAX_AXLE_OFFSET = (
    0.02  # wheels are on one axle if their centres are apart by less, of their distance
)
SHARED_TRAIL_ROUNDING_M = (
    2e-3  # m; a smaller trail of wheels that share a centre of rotation is a file's rounding
)
UPRIGHT_ROUNDING = 0.02  # sine of a smaller lean, which is a file's rounding
LENGTH_ROUNDING_M = 1e-9  # m; a smaller trail is that of numbers
ROLLER_ANGLE = 0.25 * math.pi  # rad, between a mecanum wheel's roller and the forward direction
# What a drive's records hold of geometry.
WHEEL_FIELDS = ("radius", "offset", "direction", "lateral", "shift")
SWIVEL_FIELDS = ("pivot", "heading", "sign", "trail")
DRIVE_FIELDS = ("point", "heading", "ground")


def measure(robot: Robot, raw: RawFile) -> tuple[Drive, tuple[str, ...]]:
    """Return the robot's drive with its geometry measured anew, and the wheels without a shape.

    The radius of a wheel without a shape is the record's.

    Args:
        robot: The robot; the names, roles and order of its drive are used, no number but those.
    """
    drive, poses = robot.drive, raw.poses(robot.locked)
    paths = MeshPaths(robot.description.path, robot.description.read_with.package_dirs)
    placed, shapeless = {}, []
    for wheel in drive.wheels:
        size = wheel_size(raw, raw.joint[wheel.joint], robot.locked, paths)
        if size is None:
            shapeless.append(wheel.joint)
        radius, offset = (wheel.radius, wheel.offset) if size is None else size[:2]
        placed[wheel.joint] = place(raw.joint[wheel.joint], poses, radius, offset)
    heading = _heading(drive, placed)
    forward = _forward(drive, raw, placed, heading)
    swivels = tuple(_swivel(drive, each, raw, poses, placed, forward) for each in drive.swivels)
    found = replace(
        drive,
        point=_point(drive, placed, heading),
        heading=heading if drive.has_axle else 0.0,
        ground=float(np.mean([p.centre[2] - p.radius for p in placed.values()] or [0.0])),
        swivels=swivels,
    )
    lying = {w.joint: on_the_ground(raw, raw.joint[w.joint], robot.locked) for w in drive.wheels}
    wheels = tuple(_wheel(found, wheel, placed, heading, lying) for wheel in drive.wheels)
    return replace(found, wheels=wheels), tuple(shapeless)


def with_declared(measured: Drive, record: Drive) -> Drive:
    """Return a measured drive with the numbers that the user declared in place of its own."""
    declared = record.declared
    if "drive" in declared:
        return record
    wheels = []
    for wheel, declared_wheel in zip(measured.wheels, record.wheels, strict=True):
        keys = [key for key in WHEEL_FIELDS if f"{key} of {wheel.joint}" in declared]
        keys += ["shift"] if "track" in declared else []
        wheels.append(replace(wheel, **{key: getattr(declared_wheel, key) for key in keys}))
    lower = [new.radius - old.radius for new, old in zip(wheels, measured.wheels, strict=True)]
    return replace(
        measured,
        wheels=tuple(wheels),
        point=record.point if "point" in declared else measured.point,
        ground=measured.ground - float(np.mean(lower or [0.0])),
    )


def quantities(drive: Drive) -> Iterator[tuple[str, Array]]:
    """Yield the numbers of a drive's geometry (k,), each with what it is; m, rad."""
    parts: tuple[tuple[Sequence[Wheel | Swivel], tuple[str, ...]], ...] = (
        (drive.wheels, WHEEL_FIELDS),
        (drive.swivels, SWIVEL_FIELDS),
    )
    for records, keys in parts:
        for record in records:
            for key in keys:
                yield f"{key} of {record.joint}", _numbers(key, getattr(record, key))
    for key in DRIVE_FIELDS:
        yield key, _numbers(key, getattr(drive, key))


def _numbers(key: str, value: Any) -> Array:
    """Return a value as numbers (k,); an angle as its cosine and sine, for it may wrap."""
    return np.atleast_1d((math.cos(value), math.sin(value)) if key == "heading" else value)


def _fixed_wheels(drive: Drive) -> list[str]:
    """Return the wheels that the root link holds and that do not slide."""
    return [w.joint for w in drive.wheels if w.swivel is None and not w.slides]


def _heading(drive: Drive, placed: Mapping[str, PlacedWheel]) -> float:
    """Return the angle of the forward direction, rad."""
    fixed = _fixed_wheels(drive)
    if not fixed or drive.type == "omni":
        return 0.0
    left, axles = leftward(placed[fixed[0]].axle), [placed[name].axle for name in fixed]
    x, y = np.sum([math.copysign(1.0, axle @ left) * axle for axle in axles], axis=0)[:2].tolist()
    return math.atan2(-x, y) + 0.0


def _point(drive: Drive, placed: Mapping[str, PlacedWheel], heading: float) -> tuple[float, float]:
    """Return P (x, y): the middle of the axles of two wheels or more, else of single ones."""
    if not drive.has_axle:
        return 0.0, 0.0
    left = np.array([-math.sin(heading), math.cos(heading)])
    centres = [placed[name].centre[:2] for name in _fixed_wheels(drive)]
    lines: list[list[Array]] = []
    for centre in centres:
        line = next((each for each in lines if _on_one_axle(each[0], centre, left)), None)
        if line is None:
            lines.append([centre])
        else:
            line.append(centre)
    axles = [line for line in lines if len(line) > 1] or lines
    middles = []
    for line in axles:
        ends = sorted(line, key=lambda centre: float(centre @ left))
        middles.append(0.5 * (ends[0] + ends[-1]))
    x, y = np.mean(middles, axis=0).tolist()
    return x, y


def _on_one_axle(one: Array, other: Array, left: Array) -> bool:
    between = other - one
    ahead = abs(float(between[0] * left[1] - between[1] * left[0]))
    return ahead <= MAX_AXLE_OFFSET * float(np.linalg.norm(between))


def _forward(
    drive: Drive, raw: RawFile, placed: Mapping[str, PlacedWheel], heading: float
) -> Array:
    """Return the forward direction (2,): the heading's, or the first steered wheel's own."""
    trailing = [swivel.joint for swivel in drive.swivels if swivel.trails]
    steered = [w.joint for w in drive.wheels if w.swivel is not None and w.swivel not in trailing]
    if _fixed_wheels(drive) or not steered:
        return np.array([math.cos(heading), math.sin(heading)])
    return placed[_in_order(raw, steered)[0]].ahead


def _in_order(raw: RawFile, joints: Sequence[str]) -> list[str]:
    """Return joints in the order of the file."""
    return [joint.name for joint in raw.joints if joint.name in joints]


def _swivel(
    drive: Drive,
    swivel: Swivel,
    raw: RawFile,
    poses: Mapping[str, Array],
    placed: Mapping[str, PlacedWheel],
    forward: Array,
) -> Swivel:
    """Return a swivel as the file places it and its wheels; ``forward`` (2,) is the drive's."""
    joint = raw.joint[swivel.joint]
    pose = poses[joint.parent] @ joint.origin
    carried = _in_order(raw, [drive.wheels[i].joint for i in drive.carried(swivel)])
    ahead = placed[carried[0]].ahead
    if not swivel.trails and float(ahead @ forward) < 0.0:
        ahead = -ahead
    contact = np.mean([placed[name].centre for name in carried], axis=0)
    contact[2] -= np.mean([drive.wheels[i].radius for i in drive.carried(swivel)])
    pivot, axis = pose[:3, 3], pose[:3, :3] @ joint.axis
    if math.hypot(*axis[:2]) > UPRIGHT_ROUNDING:
        pivot = pivot + axis * (contact - pivot)[2] / axis[2]
    trail = float(ahead @ (contact - pivot)[:2])
    if swivel.trails and trail > 0.0:
        ahead, trail = -ahead, -trail
    shared = drive.type == "steered" or bool(drive.followers)
    still = SHARED_TRAIL_ROUNDING_M if shared and not swivel.trails else LENGTH_ROUNDING_M
    return replace(
        swivel,
        parent=_carrier(drive, raw, joint.parent),
        pivot=(float(pivot[0]), float(pivot[1])),
        heading=math.atan2(ahead[1], ahead[0]),
        sign=math.copysign(1.0, axis[2]),
        trail=0.0 if abs(trail) < still else trail,
    )


def _carrier(drive: Drive, raw: RawFile, link: str) -> str | None:
    """Return the swivel that carries a link; None where the root link does."""
    names = [swivel.joint for swivel in drive.swivels]
    carriers = [joint.name for joint in raw.chain(link) if joint.name in names]
    return carriers[-1] if carriers else None


def _wheel(
    drive: Drive,
    wheel: Wheel,
    placed: Mapping[str, PlacedWheel],
    heading: float,
    lying: Mapping[str, tuple[float, float] | None],
) -> Wheel:
    """Return a wheel as the file has it.

    Args:
        placed: The wheels' places, by joint.
        heading: The forward direction, rad.
        lying: Directions (x, y) of the rollers on the ground that the file has, by wheel.
    """
    at = placed[wheel.joint]
    values: dict[str, Any] = {"radius": at.radius, "offset": at.offset, "shift": 0.0}
    angle, values["lateral"] = heading, 0.0
    if wheel.swivel is not None and not drive.leans:
        (carrier,) = (s for s in drive.swivels if s.joint == wheel.swivel)
        angle = carrier.heading
        left = np.array([-math.sin(angle), math.cos(angle)])
        values["lateral"] = float(left @ (at.centre[:2] - carrier.pivot))
    elif wheel.slides or drive.type == "omni":
        angle = math.atan2(at.ahead[1], at.ahead[0])
    elif drive.type == "mecanum":
        along = lying[wheel.joint]
        if along is None:
            angle += _roller(drive, placed, at, heading)
        else:  # of its two directions the one that points forward
            ahead = along[0] * math.cos(heading) + along[1] * math.sin(heading)
            angle = math.atan2(
                math.copysign(1.0, ahead) * along[1], math.copysign(1.0, ahead) * along[0]
            )
    return replace(wheel, **values, direction=(math.cos(angle), math.sin(angle)))


def _roller(
    drive: Drive, placed: Mapping[str, PlacedWheel], at: PlacedWheel, heading: float
) -> float:
    """Return the angle of a mecanum wheel's roller on the ground from forward, rad."""
    forward = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-forward[1], forward[0]])
    centres = [placed[name].centre[:2] for name in _fixed_wheels(drive)]
    axle = [centre for centre in centres if _on_one_axle(centre, at.centre[:2], left)]
    ahead = forward @ (at.centre[:2] - np.mean(centres, axis=0))
    return (
        -ROLLER_ANGLE
        if ahead * (left @ (at.centre[:2] - np.mean(axle, axis=0))) > 0.0
        else ROLLER_ANGLE
    )
