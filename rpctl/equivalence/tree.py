"""The file's tree, read apart from ``description/``, its numbers turned into any scalar.

A vector is (..., 3), a Jacobian (..., 3, n); the axes before are states, none for one state. What
NumPy's operators do for stacks of matrices is used as it is; here is the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Drive, Swivel, Wheel
from rpctl.equivalence.file_drive import FileReading, read, rotor_inertias
from rpctl.equivalence.raw_file import RawInertial
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE
from rpctl.robot.model import Robot


def components(a: Array) -> Array:
    """Return the components of vectors (..., k) one after the other: an array (k, ...)."""
    return a if a.ndim == 1 else np.moveaxis(a, -1, 0)


def vector(entries: Sequence[Any]) -> Array:
    """Return the vectors (..., k) of k components, each a scalar or of shape (...)."""
    stacked = np.array(entries)
    return stacked if stacked.ndim == 1 else np.moveaxis(stacked, 0, -1)


def lifted(scalar: Any) -> Array:
    """Return a scalar for each state, (...), as factors (..., 1) of vectors."""
    return np.asarray(scalar)[..., None]


def dot(a: Array, b: Array) -> Any:
    """Return a · b of vectors (..., k)."""
    return (a * b).sum(axis=-1)


def outer(a: Array, b: Array) -> Array:
    """Return a bᵀ (..., k, n) of vectors (..., k) and (..., n)."""
    return a[..., :, None] * b[..., None, :]


def cross_columns(J: Array, b: Array) -> Array:
    """Return the columns of J (..., 3, n), each × b (..., 3)."""
    return np.cross(J, b[..., None], axisa=-2, axisb=-2, axisc=-2)


def in_rows(rows: Sequence[Array]) -> Array:
    """Return matrices (..., rows, n) of rows (..., n), some of which may be of no state."""
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


@dataclass(frozen=True)
class Scalars:
    """A kind of scalar.

    Attributes:
        number: Turns a number of the URDF into a scalar, given its kind (``"mass"``,
            ``"length"``, ``"inertia"``, ``"direction"``, ``"gravity"``, ``"damping"``,
            ``"friction"``, ``"rate"`` or ``"number"``) and what it is of.
        cos: Cosine of a scalar.
        sin: Sine of a scalar.
        sqrt: Square root of a scalar; None of those that have none.
        dtype: NumPy type of arrays of it.
    """

    number: Callable[[float, str, str], Any]
    cos: Callable[[Any], Any]
    sin: Callable[[Any], Any]
    dtype: type = object
    sqrt: Callable[[Any], Any] | None = None

    def numbers(self, values: Any, kind: str, label: str) -> Array:
        """Return an array of numbers as scalars.

        Args:
            kind: What they are: "mass", "length", "angle", ...; symbolic scalars are named after
                it.
            label: Which one, for the name.
        """
        array = np.asarray(values, dtype=float)
        if self.dtype is float:
            return array
        scalars = [self.number(float(value), kind, label) for value in array.ravel()]
        return _filled(scalars, array.shape)

    def zeros(self, shape: int | tuple[int, ...]) -> Array:
        """Return an array of zeros."""
        return self.numbers(np.zeros(shape), "number", "")

    def identity(self, n: int) -> Array:
        """Return the unit matrix (n, n)."""
        return self.numbers(np.eye(n), "number", "")

    def rotation(self, axis: Array, angle: Any) -> Array:
        """Return the rotations (..., 3, 3) about a unit axis by angles (...), rad."""
        cos, sin = lifted(lifted(self.cos(angle))), lifted(lifted(self.sin(angle)))
        x, y, z = axis
        skew = _filled([0 * x, -z, y, z, 0 * x, -x, -y, x, 0 * x], (3, 3))
        return cos * self.identity(3) + sin * skew + (1 - cos) * np.outer(axis, axis)


FLOATS = Scalars(lambda value, kind, label: value, np.cos, np.sin, float, np.sqrt)


@dataclass(frozen=True)
class JointLoss:
    """What opposes a joint's rate q̇: −damping q̇ − friction q̇/√(q̇² + rate²)."""

    damping: Any
    friction: Any
    rate: Any


@dataclass(frozen=True)
class Body:
    """A link's mass, centre of mass (3,), and inertia (3, 3) in axes turned by R (3, 3)."""

    mass: Any
    com: Array
    R: Array
    inertia: Array


@dataclass(frozen=True)
class TreeJoint:
    """A joint: its origin in the parent's frame, its unit axis, and what it follows."""

    name: str
    kind: str
    child: str
    p: Array  # (3,)
    R: Array  # (3, 3)
    axis: Array  # (3,)
    follows: str
    factor: Any


@dataclass(frozen=True)
class WheelPart:
    """A wheel: its radius, its centre along the axle, and where its contact stands still (3,).

    ``shift`` (3,) is where it grips, seen from itself, in the root link's axes. Of a wheel on a
    swivel, ``lever`` is its radius, negative where its axle points right, and ``left`` the distance
    of its contact to the left of the swivel's axis.
    """

    radius: Any
    offset: Any
    direction: Array
    shift: Array
    swivel: str | None
    lever: Any
    left: Any


@dataclass(frozen=True)
class SwivelPart:
    """A swivel: its pivot (2,) and heading (2,) at position 0 in the root link's axes.

    ``sign`` is −1 where its axis points down, ``trail`` the distance of its contact ahead of it,
    ``left`` the mean distance of its wheels' contacts to the left of it, ``parent`` the swivel that
    carries it, if one does: its axes are those then.
    """

    joint: str
    parent: str | None
    pivot: Array
    ahead: Array
    sign: Any
    trail: Any
    left: Any


class Tree:
    """The links with inertia and the joints below each link, by the links' names.

    Args:
        reading: Its file; read anew if None.
    """

    def __init__(self, robot: Robot, scalars: Scalars, reading: FileReading | None = None) -> None:
        self.scalars = scalars
        self.reading = reading = reading or read(robot)
        self._mimics = {joint.name: joint.mimic for joint in reading.joints if joint.mimic}
        inertials = {link.name: link.inertial for link in reading.links}
        for name in robot.description.estimated_links:
            record, origin = robot.description.link[name], np.eye(4)  # what a density gave it
            origin[:3, 3] = record.com
            inertials[name] = RawInertial(float(record.mass or 0.0), origin, record.inertia)
        self.bodies = {
            name: self._body(name, each)
            for name, each in inertials.items()
            if each is not None and (each.mass or np.any(each.inertia))
        }
        self.below: dict[str, list[TreeJoint]] = {name: [] for name in inertials}
        for joint in reading.joints:
            self.below[joint.parent].append(self._hinge(joint))
        hinges = [hinge for below in self.below.values() for hinge in below]
        self.moving = [hinge.name for hinge in hinges if hinge.kind != "fixed"]
        (self.root,) = self.below.keys() - {hinge.child for hinge in hinges}
        drive = reading.drive
        poses = reading.raw.poses(robot.locked)
        axles = {
            wheel.joint: poses[reading.raw.joint[wheel.joint].child][:3, :3] @ wheel.axis
            for wheel in drive.wheels
        }
        self.wheels = {w.joint: self._wheel(drive, w, axles[w.joint]) for w in drive.wheels}
        self.swivels = {swivel.joint: self._swivel(drive, swivel) for swivel in drive.swivels}
        self.armature = {
            name: scalars.number(inertia, "inertia", f"armature of {name}")
            for name, inertia in rotor_inertias(robot, reading.raw).items()
        }
        self.losses = self._losses(robot)
        ahead = (math.cos(drive.heading), math.sin(drive.heading), 0.0)
        self.forward = scalars.numbers(ahead, "direction", "")
        self.point = scalars.numbers((*drive.point, 0.0), "length", "axle midpoint P")

    def heading(self, part: SwivelPart, positions: Mapping[str, Any]) -> Array:
        """Return the rolling direction (..., 2) of a swivel, in the axes of what carries it."""
        position = positions[part.joint]
        cos, sin = self.scalars.cos(position), part.sign * self.scalars.sin(position)
        x, y = part.ahead
        return vector([cos * x - sin * y, cos * y + sin * x])

    def leader(self, joint: str) -> tuple[str, Any]:
        """Return the joint that a mimic follows in the end, and how many times its rate."""
        leader, factor = self._leader(joint)
        return leader, self.scalars.number(factor, "number", "")

    def _losses(self, robot: Robot) -> dict[str, JointLoss]:
        """Return what the file says of each joint's losses, where they count."""
        found = {}
        for name in self.moving:
            joint = self.reading.raw.joint[name]
            lossless = name in robot.locked or not (joint.damping or joint.friction)
            if lossless or not robot.loaded_with.losses:
                continue
            rate = SLIDING_RATE if joint.type == "prismatic" else TURNING_RATE
            values = {"damping": joint.damping, "friction": joint.friction, "rate": rate}
            found[name] = JointLoss(
                **{
                    what: self.scalars.number(value, what, f"{what} of {name}")
                    for what, value in values.items()
                }
            )
        return found

    def _wheel(self, drive: Drive, wheel: Wheel, axle: Array) -> WheelPart:
        """Return a wheel's rolling; ``axle`` (3,) is in the root link's frame."""
        number, left = self.scalars.number, drive.heading + 0.5 * math.pi
        name, forward = wheel.joint, 1.0
        if wheel.swivel is not None:
            forward = wheel.direction[0] * axle[1] - wheel.direction[1] * axle[0]
        grip = (wheel.shift * math.cos(left), wheel.shift * math.sin(left), 0.0)
        return WheelPart(
            radius=number(wheel.radius, "length", f"radius of {name}"),
            offset=number(wheel.offset, "length", f"offset of {name}"),
            direction=self.scalars.numbers((*wheel.direction, 0.0), "direction", ""),
            shift=self.scalars.numbers(grip, "length", f"shift of {name}"),
            swivel=wheel.swivel,
            lever=number(math.copysign(wheel.radius, forward), "length", f"radius of {name}"),
            left=number(wheel.lateral, "length", f"lateral offset of {name}"),
        )

    def _swivel(self, drive: Drive, swivel: Swivel) -> SwivelPart:
        number, name = self.scalars.number, swivel.joint
        offsets = [drive.wheels[wheel].lateral for wheel in drive.carried(swivel)]
        ahead = (math.cos(swivel.heading), math.sin(swivel.heading))
        return SwivelPart(
            joint=name,
            parent=swivel.parent,
            pivot=self.scalars.numbers(swivel.pivot, "length", f"pivot of {name}"),
            ahead=self.scalars.numbers(ahead, "direction", ""),
            sign=number(swivel.sign, "number", ""),
            trail=number(swivel.trail, "length", f"trail of {name}"),
            left=number(sum(offsets) / (len(offsets) or 1), "length", f"lateral offset of {name}"),
        )

    def _body(self, name: str, inertial: Any) -> Body:
        numbers = self.scalars.numbers
        origin = np.eye(4) if inertial.origin is None else inertial.origin
        inertia = np.zeros((3, 3)) if inertial.inertia is None else inertial.inertia
        return Body(
            mass=self.scalars.number(float(inertial.mass or 0), "mass", f"mass of {name}"),
            com=numbers(origin[:3, 3], "length", f"centre of mass of {name}"),
            R=numbers(origin[:3, :3], "direction", ""),
            inertia=numbers(inertia, "inertia", f"inertia of {name}"),
        )

    def _hinge(self, joint: Any) -> TreeJoint:
        numbers = self.scalars.numbers
        origin = np.eye(4) if joint.origin is None else joint.origin
        axis = np.zeros(3)
        if joint.type != "fixed":
            axis = np.asarray(joint.axis, dtype=float)
            axis = axis / np.linalg.norm(axis)
        leader, factor = self._leader(joint.name)
        return TreeJoint(
            name=joint.name,
            kind=joint.type,
            child=joint.child,
            p=numbers(origin[:3, 3], "length", f"origin of {joint.name}"),
            R=numbers(origin[:3, :3], "direction", ""),
            axis=numbers(axis, "direction", ""),
            follows=leader,
            factor=self.scalars.number(factor, "number", ""),
        )

    def _leader(self, joint: str) -> tuple[str, float]:
        """Return the joint that a mimic follows in the end, and how many times its rate."""
        leader, factor = "", 1.0
        while joint in self._mimics:
            mimic = self._mimics[joint]
            leader = joint = mimic.joint
            factor *= 1.0 if mimic.multiplier is None else float(mimic.multiplier)
        return leader, factor


def _filled(values: list[Any], shape: tuple[int, ...]) -> Array:
    """Return an array of scalars; NumPy alone would try to look into them."""
    plain = all(isinstance(value, float | int | np.integer) for value in values)
    array = np.empty(len(values), dtype=float if plain else object)
    for index, value in enumerate(values):
        array[index] = value
    return array.reshape(shape)
