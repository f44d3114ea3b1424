"""A robot as a free body in MuJoCo, on a plane: wheels that roll because friction lets them.

No equation says that a wheel rolls. The root link has six degrees of freedom; each wheel is a
crowned tyre of the file's radius and width, and meets the plane in a contact with friction:
MuJoCo's convex model (E. Todorov, "Convex and analytically-invertible dynamics with contacts and
constraints", ICRA 2014) with an elliptic cone, stiff enough that sinking and creeping stay below
the bands of the trial. Supports slide without friction. Nothing else collides.

What the reduced model ties together is tied here, too: mimic joints by MuJoCo's equality, swivels
that keep to the centre of rotation by tie rods, which are springs. A roller, and a wheel that
slides sideways, has friction along one direction only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Shape
from rpctl.drive.drive import Wheel
from rpctl.dynamics.stance import Supports, find_supports
from rpctl.equivalence.contact.mujoco_body import (
    RollingBody,
    Touching,
    add_shape,
    add_tie,
    mujoco_library,
)
from rpctl.equivalence.file_wheels import WheelSize, wheel_size
from rpctl.equivalence.mujoco_engine import NAME_PREFIX, MujocoModel
from rpctl.equivalence.raw_file import read_file
from rpctl.robot.model import Robot

MIN_HALF_WIDTH_M = 1e-3  # m: least half width of a tyre; a thinner one is a knife
DECLARED = "drive file"  # source of a radius that the user gives


@dataclass(frozen=True)
class Tyre:
    """A wheel's tread, crowned: an ellipsoid about the axle, which meets the ground at one point.

    A cylinder on a plane touches along a line, and whatever turns on a line scrubs. The crown
    keeps the radius, the width and the middle that the file draws, and leaves scrubbing out.

    Attributes:
        link: The wheel's link.
        pose: Its pose (4, 4) in that link's frame, z along the axle.
        radius: m.
        half_width: m.
        note: What the file does not say of it, or nothing.
    """

    link: str
    pose: Array
    radius: float
    half_width: float
    note: str = ""


def tyre(robot: Robot, wheel: Wheel) -> Tyre:
    """Return the tread of a wheel as its file draws it, seen by the proof's own reader.

    Where the user declares the radius, or the file draws nothing round, the radius is the
    drive's, and the note says so.
    """
    raw = read_file(robot.description.raw)
    joint = raw.joint[wheel.joint]
    size = wheel_size(raw, joint, robot.locked, robot.description.mesh_paths)
    note = f"the radius of {wheel.joint} is the drive file's" if wheel.source == DECLARED else ""
    if size is None:
        size = WheelSize(wheel.radius, wheel.offset, 0.0)
        note = f"{wheel.joint} draws no wheel: its radius and centre are the drive's"
    radius = wheel.radius if note else size.radius
    pose = about(joint.axis)
    pose[:3, 3] = size.offset * joint.axis
    return Tyre(joint.child, pose, radius, max(size.half_width, MIN_HALF_WIDTH_M), note)


def support_shapes(robot: Robot, supports: Supports) -> Iterator[tuple[str, str, Shape]]:
    """Yield the name, the link and the shape of every support."""
    for part in supports.parts:
        link = robot.description.link[part.link]
        yield (
            part.name,
            part.link,
            next(shape for shape in link.shapes if shape.line == part.line),
        )


def geom_size(shape: Shape) -> list[float]:
    """Return a URDF shape's size as MuJoCo counts it: half edges, half lengths; three numbers."""
    if shape.kind == "box":
        return [0.5 * edge for edge in shape.size]
    radius, *length = shape.size
    return [radius, 0.5 * length[0] if length else 0.0, 0.0]


def about(axis: Array) -> Array:
    """Return a pose (4, 4) at the origin whose z axis is ``axis`` (3,)."""
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    across /= math.sqrt(across @ across)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    return pose


STEP_S = 5e-4  # s: below the contacts' time constant
SOLREF = (2e-3, 1.0)  # time constant (s), least that STEP allows with a margin, and damping ratio
SOLIMP = (0.99, 0.999, 1e-4, 0.5, 2.0)  # impedance near 1: hard contacts, which sink by microns
IMPRATIO = 0.1  # friction softer than the load: axles a hair apart creep, they do not fight
FRICTION = 0.7  # of rubber on a dry indoor floor, as the margins of the reduced model assume
MIN_LOAD_N = 1e-9  # N: below it nothing bears a load


@dataclass(frozen=True)
class Contact:
    """The ground's action at one instant: load (n,) by contact, total force (3,), both N.

    ``zmp`` (2,) is where the loads balance, world, m.
    """

    load: Array
    force: Array
    zmp: Array


class Builder:
    """Sets a robot's bodies on a ground; ``geoms`` are those that meet it, with their contacts."""

    def __init__(self, robot: Robot, friction: float) -> None:
        self._robot, self._friction = robot, friction
        self.geoms: dict[str, str] = {}
        self.notes: list[str] = []

    def release(self, spec: Any, root: Any) -> None:
        """Give the root link six degrees of freedom, and the robot a ground to stand on."""
        mujoco, option = mujoco_library(), spec.option
        root.add_freejoint()
        option.timestep, option.cone = STEP_S, mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = IMPRATIO
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)  # contacts are edited
        plane = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
        plane.contype, plane.conaffinity = 2, 0
        for wheel in self._robot.drive.wheels:
            tread = self.tread(wheel)
            size = [tread.radius, tread.radius, tread.half_width]
            self._touch(spec, tread.link, wheel.joint, "ellipsoid", size, tread.pose)
            self.notes += [tread.note] if tread.note else []
        for name, link, shape in support_shapes(self._robot, find_supports(self._robot)):
            size = geom_size(shape)
            self._touch(spec, link, name, shape.kind, size, shape.origin).condim = 1
        for joint in self._robot.mimics:
            if joint.mimic is not None and joint.mimic.joint not in self._robot.locked:
                line = joint.mimic.offset, joint.mimic.multiplier
                add_tie(spec, joint.name, joint.mimic.joint, line, (SOLREF, SOLIMP))

    def _touch(
        self, spec: Any, link: str, name: str, kind: str, size: list[float], pose: Array
    ) -> Any:
        """Return a geom of a link that meets the plane, placed in the link."""
        geom = add_shape(spec.body(NAME_PREFIX + link), NAME_PREFIX + name, kind, size, pose)
        geom.contype, geom.conaffinity, geom.priority = 0, 2, 1
        geom.friction[0] = self._friction
        geom.solref, geom.solimp = SOLREF, SOLIMP
        self.geoms[geom.name] = name
        return geom

    def tread(self, wheel: Wheel) -> Tyre:
        """Return the tread of a wheel."""
        return tyre(self._robot, wheel)


class ContactModel(RollingBody):
    """MuJoCo's model of a robot on the ground, and its state.

    Args:
        robot: The robot; its file's numbers and shapes are used, not its Pinocchio model. Of the
            drive: which joints carry wheels, and how a roller lies on its wheel.
        friction: Coefficient between wheels and ground.

    Attributes:
        contacts: The wheels' joints, then the supports, as ``Contacts.names``.
        notes: What the file does not say of them.
        ground: What the ground did in the first step of the last advance.
    """

    builder = Builder

    def __init__(self, robot: Robot, friction: float = FRICTION) -> None:
        builder = self.builder(robot, friction)
        tree = MujocoModel(robot, release=builder.release)
        crowned = {wheel.joint: NAME_PREFIX + wheel.joint for wheel in robot.drive.wheels}
        touching = Touching(tuple(builder.geoms.values()), builder.geoms, crowned)
        super().__init__(robot, tree.mjm, tree.mjm.body(tree.root).name, touching, friction)
        self.notes = tuple(builder.notes)
        self.ground = Contact(np.zeros(len(self.contacts)), np.zeros(3), np.zeros(2))

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        for step in self.steps(tau, round(dt / STEP_S)):
            if step == 0:
                self.ground = self._ground()

    def _ground(self) -> Contact:
        load, total, moment = np.zeros(len(self.contacts)), np.zeros(3), np.zeros(2)
        frames, places = self.data.contact.frame.reshape(-1, 3, 3), self.data.contact.pos
        for k, contact, wrench in self.bearing():
            load[contact] += wrench[0]
            total += frames[k].T @ wrench[:3]
            moment += wrench[0] * places[k][:2]
        return Contact(load, total, moment / max(float(load.sum()), MIN_LOAD_N))
