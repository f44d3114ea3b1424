"""The wheels drawn in the user's file: how large they are, and where they stand.

A wheel is a sphere, cylinder or capsule about its axle, the widest of the collision shapes, or else
of the visual ones; without any, a mesh, half as high as the wider of its extents across the axle.
Of several as wide, its centre is the mean of theirs. Links fixed to the wheel's own belong to it
where they are centred on the axle. A wheel with rollers on joints of their own stands on them;
these are three or more frozen joints that turn on it, those of ``rpctl.drive.wheels`` seen anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.equivalence.raw_file import TURNING, RawFile, RawJoint, RawShape

MIN_ROLLERS = 3
MECANUM_COSINES = math.cos(math.radians(70.0)), math.cos(math.radians(20.0))
ROUND_KINDS = ("sphere", "cylinder", "capsule")
MAX_TILT_SINE = 0.02  # sine of the largest angle between an axis and a wheel's or roller's shape
RADIUS_ROUNDING_M = 1e-9  # m; shapes whose radii differ by no more are tyres of one wheel
MAX_ECCENTRICITY = 0.1  # of the radius: how far a part of another link may be off the axle


def on_the_ground(
    raw: RawFile, wheel: RawJoint, locked: Mapping[str, float]
) -> tuple[float, float] | None:
    """Return the direction (x, y) of a mecanum wheel's lowest roller; None without rollers.

    Args:
        wheel: The wheel's joint.
        locked: Positions of the frozen joints, rad or m.
    """
    poses = raw.poses(locked)
    axle = poses[wheel.parent][:3, :3] @ wheel.origin[:3, :3] @ wheel.axis
    rollers = _rollers(raw, wheel, locked)
    axes = {roller.child: poses[roller.child][:3, :3] @ roller.axis for roller in rollers}
    low, high = MECANUM_COSINES
    if not axes or not all(low < abs(float(axis @ axle)) < high for axis in axes.values()):
        return None
    x, y, _ = axes[min(axes, key=lambda child: float(poses[child][2, 3]))].tolist()
    return x, y


def _rollers(raw: RawFile, wheel: RawJoint, locked: Mapping[str, float]) -> list[RawJoint]:
    """Return the rollers of a wheel; none, if they are too few."""
    found, links = [], [wheel.child]
    while links:
        for joint in raw.below[links.pop()]:
            turns = joint.type in TURNING and joint.name in locked
            found += [joint] * turns
            links += [joint.child] * (joint.type == "fixed")
    return found if len(found) >= MIN_ROLLERS else []


def _sine(a: Array, b: Array) -> float:
    """Return the distance of a point (3,) from the line through the origin along a unit (3,)."""
    return float(np.linalg.norm(np.cross(a, b)))


@dataclass(frozen=True)
class PlacedWheel:
    """A wheel of the file: its centre (3,) and unit axle (3,) in the root link's frame."""

    centre: Array
    axle: Array
    radius: float
    offset: float

    @property
    def ahead(self) -> Array:
        """Unit direction (2,) across the axle: towards +x, or +y for an axle along x."""
        x, y = leftward(self.axle)[:2]
        return np.array([y, -x]) / math.hypot(x, y)


class WheelSize(NamedTuple):
    """A wheel's radius, the distance of its centre along the axle, and half its width, m."""

    radius: float
    offset: float
    half_width: float


def wheel_size(
    raw: RawFile, joint: RawJoint, locked: Mapping[str, float], paths: MeshPaths
) -> WheelSize | None:
    """Return how large a wheel is drawn; None where nothing draws it.

    Args:
        joint: The wheel's joint.
        locked: Positions of the frozen joints, rad or m.
    """
    on_rollers = _reach(raw, joint, locked)
    if on_rollers is not None:
        return on_rollers
    parts = [
        (shape, pose @ shape.origin, name == joint.child)
        for name, pose in raw.poses(locked, joint.child, rigid=True).items()
        for shape in raw.link[name].shapes
    ]
    for measured in (_primitive, _mesh):
        for role in ("collision", "visual"):
            found = [
                size
                for shape, at, own in parts
                if shape.role == role
                and (drawn := measured(shape, at, joint.axis, paths)) is not None
                for size, beside in [drawn]
                if own or beside <= MAX_ECCENTRICITY * size.radius
            ]
            if found:
                widest = max(found, key=lambda size: size.radius)
                tyres = [
                    size.offset
                    for size in found
                    if widest.radius - size.radius <= RADIUS_ROUNDING_M
                ]
                return widest._replace(offset=float(np.mean(tyres)))
    return None


def _reach(raw: RawFile, wheel: RawJoint, locked: Mapping[str, float]) -> WheelSize | None:
    """Return a wheel's size over its rollers; None without."""
    poses = raw.poses(locked, wheel.child)
    radii, along = [], []
    for roller in _rollers(raw, wheel, locked):
        shapes = [  # collision shapes first
            (drawn[0].radius, (poses[roller.child] @ shape.origin)[:3, 3])
            for shape in sorted(raw.link[roller.child].shapes, key=lambda shape: shape.role)
            if (drawn := _primitive(shape, shape.origin, roller.axis, None)) is not None
        ]
        if shapes:
            middle = shapes[0][1]
            radii.append(max(radius for radius, _ in shapes) + _sine(middle, wheel.axis))
            along.append(float(middle @ wheel.axis))
    return WheelSize(max(radii), float(np.mean(along)), 0.0) if radii else None


def _primitive(
    shape: RawShape, at: Array, axis: Array, _: MeshPaths | None
) -> tuple[WheelSize, float] | None:
    """Return a round shape's size about an axis and its distance beside it, m; None if not."""
    if shape.kind not in ROUND_KINDS or not shape.size[0] > 0.0:
        return None
    if shape.kind != "sphere" and _sine(at[:3, 2], axis) > MAX_TILT_SINE:
        return None
    radius, middle = shape.size[0], at[:3, 3]
    half_width = radius if shape.kind == "sphere" else 0.5 * shape.size[-1]
    return WheelSize(radius, float(middle @ axis), half_width), _sine(middle, axis)


def _mesh(
    shape: RawShape, at: Array, axis: Array, paths: MeshPaths
) -> tuple[WheelSize, float] | None:
    """Return a mesh's size about an axis, half of its wider extent across, and its distance beside.

    None where it cannot be read.
    """
    if shape.kind != "mesh":
        return None
    try:
        surfaces = mesh_files.read_shape(shape.mesh, shape.size, paths).surfaces
    except MeshError:
        return None
    points = np.concatenate([surface.vertices for surface in surfaces]) * shape.size
    points = points @ at[:3, :3].T + at[:3, 3]
    one = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    one /= np.linalg.norm(one)
    placed = points @ np.column_stack([axis, one, np.cross(axis, one)])
    low, high = placed.min(axis=0), placed.max(axis=0)
    along, x, y = (0.5 * (low + high)).tolist()
    half_width, *across = (0.5 * (high - low)).tolist()
    return WheelSize(max(across), along, half_width), math.hypot(x, y)


def place(joint: RawJoint, poses: Mapping[str, Array], radius: float, offset: float) -> PlacedWheel:
    """Return a wheel at its joint.

    Args:
        joint: The wheel's joint.
        poses: Pose (4, 4) of every link in the root link's frame, m.
        radius: Its radius, m.
        offset: Distance of its centre along its axle, m.
    """
    pose = poses[joint.parent] @ joint.origin
    axle = pose[:3, :3] @ joint.axis
    return PlacedWheel(pose[:3, 3] + offset * axle, axle, radius, offset)


def leftward(axle: Array) -> Array:
    """Return an axle (3,), turned round where it points right of forward (+x, or else +y)."""
    left = axle[1] if abs(axle[1]) > MAX_TILT_SINE else -axle[0]
    return axle if left > 0.0 else -axle
