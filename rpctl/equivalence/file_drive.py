"""The drive measured on the file's own shapes, apart from ``robot/`` and its detection.

Names and roles are the drive's: which joints are wheels, which swivels steer, follow or trail.
Every number is taken from the user's bytes (:mod:`rpctl.equivalence.raw_file`), with all joints at
0 or where they are locked, by these conventions:

- a wheel is a sphere, cylinder or capsule about its axle, the widest of the collision shapes, or
  else of the visual ones; without any, a mesh, half as high as the wider of its extents across the
  axle. Of several as wide, its centre is the mean of theirs. Links fixed to the wheel's own belong
  to it where they are centred on the axle.
- forward is across the mean of the axles that the root link holds and that do not slide.
- P is the middle between the outermost wheels of an axle; of several axles the mean.
- a swivel heads across the axle of its first wheel; its trail is how far its wheels' contact lies
  ahead, and 0 if that is less than 2 mm where several swivels share one centre of rotation.
- the roller on the ground of a mecanum wheel lies at 45° to forward, those on top form an X; an
  omni wheel's across its axle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description import mesh_files
from rpctl.description.mesh_paths import MeshError, MeshPaths
from rpctl.equivalence.raw_file import TURNING, RawFile, RawJoint, RawShape
from rpctl.robot.drive import Drive, Swivel, Wheel
from rpctl.robot.model import Robot

ROUND = ("sphere", "cylinder", "capsule")
TILT = 0.02  # sine of the largest angle between an axis and a wheel's shape, or the ground
ONE_LINE = 0.02  # wheels are on one axle if their centres are apart by less, of their distance
STEADY = 2e-3  # m; a smaller trail of wheels that share a centre of rotation is a file's rounding
SAME = 1e-9  # m; shapes whose radii differ by no more are tyres of one wheel
CENTRED = 0.1  # of the radius: how far a part of another link may be off the axle
ROUNDING = 1e-9  # m; a smaller trail is that of numbers
ROLLER = 0.25 * math.pi  # rad, between a mecanum wheel's roller and the forward direction
UP = np.array([0.0, 0.0, 1.0])
# What a drive's records hold of geometry.
OF_WHEEL = ("radius", "offset", "direction", "lateral", "shift")
OF_SWIVEL = ("pivot", "heading", "sign", "trail")
OF_DRIVE = ("point", "heading", "ground")


@dataclass(frozen=True)
class Placed:
    """A wheel of the file: its centre (3,) and unit axle (3,) in the root link's frame."""

    centre: Array
    axle: Array
    radius: float
    offset: float

    @property
    def ahead(self) -> Array:
        """Unit direction (2,) across the axle: towards +x, or +y for an axle along x."""
        x, y = _leftward(self.axle)[:2]
        return np.array([y, -x]) / math.hypot(x, y)


def measure(robot: Robot, raw: RawFile) -> tuple[Drive, tuple[str, ...]]:
    """Return the robot's drive with its geometry measured anew, and the wheels without a shape.

    The radius of a wheel without a shape is the record's.

    Args:
        robot: The robot; the names, roles and order of its drive are used, no number but those.
        raw: Its file.
    """
    drive, poses = robot.drive, raw.poses(robot.locked)
    paths = MeshPaths(robot.description.path, robot.description.package_dirs)
    placed, shapeless = {}, []
    for wheel in drive.wheels:
        size = _size(raw, raw.joint[wheel.joint], robot.locked, paths)
        if size is None:
            shapeless.append(wheel.joint)
            size = wheel.radius, wheel.offset
        placed[wheel.joint] = _placed(raw.joint[wheel.joint], poses, size)
    swivels = tuple(_swivel(drive, swivel, raw, poses, placed) for swivel in drive.swivels)
    heading = _heading(drive, placed)
    found = replace(
        drive,
        point=_point(drive, placed, heading),
        heading=heading if drive.has_axle else 0.0,
        ground=float(np.mean([p.centre[2] - p.radius for p in placed.values()] or [0.0])),
        swivels=swivels,
    )
    wheels = tuple(_wheel(found, wheel, placed, heading) for wheel in drive.wheels)
    return replace(found, wheels=wheels), tuple(shapeless)


def with_declared(measured: Drive, record: Drive) -> Drive:
    """Return a measured drive with the numbers that the user declared in place of its own."""
    declared = record.declared
    if "drive" in declared:
        return record
    wheels = []
    for wheel, told in zip(measured.wheels, record.wheels, strict=True):
        keys = [key for key in OF_WHEEL if f"{key} of {wheel.joint}" in declared]
        keys += ["shift"] if "track" in declared else []
        wheels.append(replace(wheel, **{key: getattr(told, key) for key in keys}))
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
        (drive.wheels, OF_WHEEL),
        (drive.swivels, OF_SWIVEL),
    )
    for records, keys in parts:
        for record in records:
            for key in keys:
                yield f"{key} of {record.joint}", _numbers(key, getattr(record, key))
    for key in OF_DRIVE:
        yield key, _numbers(key, getattr(drive, key))


def _numbers(key: str, value: Any) -> Array:
    """Return a value as numbers (k,); an angle as its cosine and sine, for it may wrap."""
    return np.atleast_1d((math.cos(value), math.sin(value)) if key == "heading" else value)


def _size(
    raw: RawFile, joint: RawJoint, locked: Mapping[str, float], paths: MeshPaths
) -> tuple[float, float] | None:
    """Return a wheel's radius and the distance of its centre along the axle, m; None without."""
    parts = list(_parts(raw, joint.child, locked))
    for measured in (_primitive, _mesh):
        for role in ("collision", "visual"):
            found = [
                size
                for shape, at, own in parts
                if shape.role == role
                and (size := measured(shape, at, joint.axis, paths)) is not None
                and (own or size[2] <= CENTRED * size[0])
            ]
            if found:
                radius = max(size[0] for size in found)
                tyres = [middle for size, middle, _ in found if radius - size <= SAME]
                return radius, float(np.mean(tyres))
    return None


def _parts(
    raw: RawFile, link: str, locked: Mapping[str, float]
) -> Iterator[tuple[RawShape, Array, bool]]:
    """Yield the shapes of a link and of those that do not move on it: pose (4, 4), whose it is."""
    still = {link}
    for name, pose in raw.poses(locked, link).items():
        joint = raw.above[name]
        if name != link and joint.parent in still:
            if joint.type in (*TURNING, "prismatic") and joint.name not in locked:
                continue
            still.add(name)
        if name in still:
            for shape in raw.link[name].shapes:
                yield shape, pose @ shape.origin, name == link


def _primitive(
    shape: RawShape, at: Array, axis: Array, paths: MeshPaths
) -> tuple[float, float, float] | None:
    """Return a round shape's radius, its middle along an axis and beside it, m; None if not."""
    if shape.kind not in ROUND or not shape.size[0] > 0.0:
        return None
    if shape.kind != "sphere" and np.linalg.norm(np.cross(at[:3, 2], axis)) > TILT:
        return None
    middle = at[:3, 3]
    return shape.size[0], float(middle @ axis), float(np.linalg.norm(np.cross(middle, axis)))


def _mesh(
    shape: RawShape, at: Array, axis: Array, paths: MeshPaths
) -> tuple[float, float, float] | None:
    """Return half of a mesh's wider extent across an axis, its middle along it and beside it, m.

    None where it cannot be read.
    """
    if shape.kind != "mesh":
        return None
    try:
        surfaces = mesh_files.read(paths.resolve(shape.mesh))
    except MeshError:
        return None
    points = np.concatenate([surface.vertices for surface in surfaces]) * shape.size
    points = points @ at[:3, :3].T + at[:3, 3]
    one = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    one /= np.linalg.norm(one)
    placed = points @ np.column_stack([axis, one, np.cross(axis, one)])
    low, high = placed.min(axis=0), placed.max(axis=0)
    along, x, y = (0.5 * (low + high)).tolist()
    return 0.5 * float(max(high[1:] - low[1:])), along, math.hypot(x, y)


def _placed(joint: RawJoint, poses: Mapping[str, Array], size: tuple[float, float]) -> Placed:
    pose, (radius, offset) = poses[joint.parent] @ joint.origin, size
    axle = pose[:3, :3] @ joint.axis
    return Placed(pose[:3, 3] + offset * axle, axle, radius, offset)


def _leftward(axle: Array) -> Array:
    """Return an axle (3,), turned round where it points right of forward (+x, or else +y)."""
    left = axle[1] if abs(axle[1]) > TILT else -axle[0]
    return axle if left > 0.0 else -axle


def _held(drive: Drive) -> list[str]:
    """Return the wheels that the root link holds and that do not slide."""
    return [w.joint for w in drive.wheels if w.swivel is None and not w.slides]


def _heading(drive: Drive, placed: Mapping[str, Placed]) -> float:
    """Return the angle of the forward direction, rad."""
    held = _held(drive)
    if not held or drive.type == "omni":
        return 0.0
    left, axles = _leftward(placed[held[0]].axle), [placed[name].axle for name in held]
    x, y = np.sum([math.copysign(1.0, axle @ left) * axle for axle in axles], axis=0)[:2].tolist()
    return math.atan2(-x, y) + 0.0


def _point(drive: Drive, placed: Mapping[str, Placed], heading: float) -> tuple[float, float]:
    """Return P (x, y): the middle of the axles of two wheels or more, else of single ones."""
    if not drive.has_axle:
        return 0.0, 0.0
    left = np.array([-math.sin(heading), math.cos(heading)])
    centres = [placed[name].centre[:2] for name in _held(drive)]
    lines: list[list[Array]] = []
    for centre in centres:
        line = next((each for each in lines if _beside(each[0], centre, left)), None)
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


def _beside(one: Array, other: Array, left: Array) -> bool:
    between = other - one
    ahead = abs(float(between[0] * left[1] - between[1] * left[0]))
    return ahead <= ONE_LINE * float(np.linalg.norm(between))


def _swivel(
    drive: Drive,
    swivel: Swivel,
    raw: RawFile,
    poses: Mapping[str, Array],
    placed: Mapping[str, Placed],
) -> Swivel:
    """Return a swivel as the file places it and its wheels."""
    joint = raw.joint[swivel.joint]
    pose = poses[joint.parent] @ joint.origin
    order = [each.name for each in raw.joints]
    carried = sorted((drive.wheels[i].joint for i in drive.carried(swivel)), key=order.index)
    ahead = placed[carried[0]].ahead
    contact = np.mean([placed[name].centre[:2] for name in carried], axis=0)
    trail = float(ahead @ (contact - pose[:2, 3]))
    if swivel.role == "caster" and trail > 0.0:
        ahead, trail = -ahead, -trail
    shared = drive.type == "steered" or bool(drive.followers)
    still = STEADY if shared and swivel.role != "caster" else ROUNDING
    return replace(
        swivel,
        pivot=(float(pose[0, 3]), float(pose[1, 3])),
        heading=math.atan2(ahead[1], ahead[0]),
        sign=math.copysign(1.0, float((pose[:3, :3] @ joint.axis)[2])),
        trail=0.0 if abs(trail) < still else trail,
    )


def _wheel(drive: Drive, wheel: Wheel, placed: Mapping[str, Placed], heading: float) -> Wheel:
    """Return a wheel as the file has it; ``drive`` has its swivels measured."""
    at = placed[wheel.joint]
    values: dict[str, Any] = {"radius": at.radius, "offset": at.offset, "shift": 0.0}
    angle, values["lateral"] = heading, 0.0
    if wheel.swivel is not None:
        (carrier,) = (s for s in drive.swivels if s.joint == wheel.swivel)
        angle = carrier.heading
        left = np.array([-math.sin(angle), math.cos(angle)])
        values["lateral"] = float(left @ (at.centre[:2] - carrier.pivot))
    elif wheel.slides or drive.type == "omni":
        angle = math.atan2(at.ahead[1], at.ahead[0])
    elif drive.type == "mecanum":
        angle += _roller(drive, placed, at, heading)
    return replace(wheel, **values, direction=(math.cos(angle), math.sin(angle)))


def _roller(drive: Drive, placed: Mapping[str, Placed], at: Placed, heading: float) -> float:
    """Return the angle of a mecanum wheel's roller on the ground from forward, rad."""
    forward = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-forward[1], forward[0]])
    centres = [placed[name].centre[:2] for name in _held(drive)]
    axle = [centre for centre in centres if _beside(centre, at.centre[:2], left)]
    ahead = forward @ (at.centre[:2] - np.mean(centres, axis=0))
    return -ROLLER if ahead * (left @ (at.centre[:2] - np.mean(axle, axis=0))) > 0.0 else ROLLER
