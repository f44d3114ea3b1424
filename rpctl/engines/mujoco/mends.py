"""What the referee mends of a robot that MuJoCo loaded: a few lines of a spec for each switch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.supports import find_supports
from rpctl.engines.mujoco.inertias import body_inertia, head_link, set_inertia
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.user_load import GROUND, PREFIX, geom_name
from rpctl.engines.switches import Switches
from rpctl.equivalence.contact.shapes import support_shapes, tyre
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot

HARD_STEP_S = 5e-4  # s
HARD_SOLREF = (2e-3, 1.0)  # s and damping ratio: four of those steps
HARD_SOLIMP = (0.99, 0.999, 1e-4, 0.5, 2.0)
SOFT_FRICTION = 0.1  # impratio: friction softer than loads, so that axles a hair apart do not fight
MAX_TIED = 0.35  # rad of a leader: the referee steers by .3
SELF, FLOOR = 1, 2  # bits of contype and conaffinity: the robot's own shapes, and the ground
SHAPES = {"sphere": "SPHERE", "capsule": "CAPSULE", "cylinder": "CYLINDER", "box": "BOX"}


@dataclass(frozen=True, eq=False)
class Touching:
    """What of a robot meets the ground in MuJoCo.

    Attributes:
        contacts: Names of the contacts, as ``Contacts.names``.
        owner: Name of the contact of each geom, by the geom's name.
        crowned: Name of the geom of each wheel that touches at one point, by its joint.
        tied: Joints of swivels that follow another one by an equality.
    """

    contacts: tuple[str, ...]
    owner: dict[str, str] = field(default_factory=dict)
    crowned: dict[str, str] = field(default_factory=dict)
    tied: tuple[str, ...] = ()


def mend(spec: Any, robot: Robot, switches: Switches, friction: float) -> Touching:
    """Mend what the switches say, and return what then meets the ground.

    Args:
        spec: The ``MjSpec``, of :func:`rpctl.engines.mujoco.user_load.load_as_user`.
        robot: The robot.
        switches: What is mended.
        friction: Coefficient between the robot and the ground.
    """
    supports = list(support_shapes(robot, find_supports(robot)))
    wheels = [wheel.joint for wheel in robot.drive.wheels]
    tied = _tie(spec, robot) if switches.mended("mimic") else ()
    touching = Touching((*wheels, *(name for name, _, _ in supports)), tied=tied)
    _open_to_all(spec)
    for wheel in robot.drive.wheels:
        _take_wheel(spec, robot, wheel, touching, crowned=_crowned(wheel, switches))
    for name, link, shape in supports:
        shapes = robot.description.link[link].collisions
        drawn = [geom_name(link, k) for k, one in enumerate(shapes) if one.line == shape.line]
        _take(spec, drawn, name, touching, replaced=switches.mended("caster"))
        if switches.mended("caster"):
            size = halved(shape.kind, shape.size)
            geom = _touch(spec, robot, link, name, SHAPES[shape.kind], size, shape.origin)
            geom.condim = 1
            touching.owner[geom.name] = name
    if switches.mended("collisions"):
        _close(spec, touching)
    _set_contacts(spec, switches, friction)
    if switches.mended("inertia"):
        _give_inertias(spec, robot)
    return touching


def tie_polynomials(robot: Robot) -> dict[str, Array]:
    """Return, by the joint of each swivel that follows a single one, MuJoCo's polycoef (5,).

    Its angle is a polynomial of the leader's, within what the referee steers.
    """
    drive = robot.drive
    if len(drive.steered) != 1:
        return {}
    leader = drive.steered[0].joint
    grid = np.linspace(-MAX_TIED, MAX_TIED, 81)
    places = [follower_positions(drive, {leader: angle}) for angle in grid.tolist()]
    return {
        swivel.joint: np.asarray(
            polynomial.polyfit(grid, [place[swivel.joint] for place in places], 4), float
        )
        for swivel in drive.followers
    }


def _tie(spec: Any, robot: Robot) -> tuple[str, ...]:
    """Tie swivels to the one that they follow; return which."""
    mujoco, found = mujoco_library(), tie_polynomials(robot)
    for name, coefficients in found.items():
        tie = spec.add_equality(name1=name, name2=robot.drive.steered[0].joint)
        tie.type, tie.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
        tie.data[:5] = coefficients
    return tuple(found)


def halved(kind: str, size: tuple[float, ...]) -> list[float]:
    """Return a URDF shape's size as MuJoCo counts it: half edges, half lengths; three numbers."""
    if kind == "box":
        return [0.5 * edge for edge in size]
    return [size[0], 0.0 if kind == "sphere" else 0.5 * size[1], 0.0]


def _crowned(wheel: Wheel, switches: Switches) -> bool:
    """Return whether a wheel gets a crown: a ball that slides belongs to the casters."""
    return switches.mended("caster" if wheel.slides else "wheel")


def _open_to_all(spec: Any) -> None:
    """Let everything meet everything, as by default, but with bits that can be told apart."""
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = SELF, SELF | FLOOR
    spec.geom(GROUND).contype, spec.geom(GROUND).conaffinity = FLOOR, 0


def _take_wheel(
    spec: Any, robot: Robot, wheel: Wheel, touching: Touching, *, crowned: bool
) -> None:
    """Find the geoms of a wheel; give it a crown instead, if asked to."""
    child = robot.description.joint[wheel.joint].child
    drawn = [
        geom_name(link, k)
        for link in links_below(robot, child)
        for k in range(len(robot.description.link[link].collisions))
    ]
    _take(spec, drawn, wheel.joint, touching, replaced=crowned)
    if crowned:
        tread = tyre(robot, wheel)
        size = [tread.radius, tread.radius, tread.half_width]
        geom = _touch(spec, robot, tread.link, wheel.joint, "ELLIPSOID", size, tread.pose)
        touching.owner[geom.name] = wheel.joint
        touching.crowned[wheel.joint] = geom.name


def links_below(robot: Robot, link: str) -> Iterator[str]:
    """Yield a link and all that it carries."""
    yield link
    for joint in robot.description.child_joints[link]:
        yield from links_below(robot, joint.child)


def _take(spec: Any, names: list[str], contact: str, touching: Touching, *, replaced: bool) -> None:
    """Make geoms the contact's, or keep them off the ground."""
    for geom in filter(None, map(spec.geom, names)):
        if replaced:
            geom.conaffinity = SELF
        else:
            touching.owner[geom.name] = contact


def _touch(
    spec: Any, robot: Robot, link: str, name: str, kind: str, size: list[float], pose: Array
) -> Any:
    """Add a geom that meets the ground and nothing else, and weighs nothing."""
    mujoco, quaternion = mujoco_library(), np.zeros(4)
    free = robot.tree.free_joints(link)
    head = free[-1].child if free else robot.description.root
    # On the body that moves: MuJoCo 3.14 misplaces what is added to links that it fuses.
    pose = np.linalg.inv(robot.tree.pose(head)) @ robot.tree.pose(link) @ pose
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")
    geom = spec.body(PREFIX + head).add_geom(name=f"{PREFIX}{name}", type=kind, size=size)
    geom.pos, geom.quat, geom.mass = pose[:3, 3], quaternion, 0.0
    geom.contype, geom.conaffinity, geom.priority = 0, FLOOR, 1
    return geom


def _close(spec: Any, touching: Touching) -> None:
    """Let wheels and supports alone meet the ground, and nothing meet the robot."""
    for geom in spec.geoms:
        if geom.name != GROUND:
            geom.contype = 0
            geom.conaffinity = geom.conaffinity & FLOOR if geom.name in touching.owner else 0


def _set_contacts(spec: Any, switches: Switches, friction: float) -> None:
    """Set the cone, the friction, the softness and the step."""
    mujoco, option = mujoco_library(), spec.option
    if switches.mended("cone"):
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    if switches.mended("timestep"):
        option.timestep = HARD_STEP_S
    if switches.mended("softness"):
        option.impratio = SOFT_FRICTION
        for soft in (*spec.geoms, *spec.equalities):
            soft.solref, soft.solimp = HARD_SOLREF, HARD_SOLIMP
        for joint in spec.joints:
            joint.solref_friction = HARD_SOLREF
    if switches.mended("friction"):
        for geom in spec.geoms:
            geom.friction[0] = friction
    if switches.mended("mimic"):
        for tie in spec.equalities:
            tie.solref, tie.solimp = HARD_SOLREF, HARD_SOLIMP
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)  # contacts are edited


def _give_inertias(spec: Any, robot: Robot) -> None:
    """Give each moving body the robot's inertia, those fixed to it none, joints their rotors'."""
    compiler = spec.compiler
    compiler.balanceinertia, compiler.boundmass, compiler.boundinertia = False, 0.0, 0.0
    compiler.inertiafromgeom = mujoco_library().mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for link in robot.description.links:
        body = spec.body(PREFIX + link.name)
        body.mass, body.ipos, body.inertia = 0.0, np.zeros(3), np.zeros(3)
        body.fullinertia, body.explicitinertial = np.full(6, np.nan), True
    for index in range(ROOT_JOINT, robot.model.njoints):
        set_inertia(spec.body(PREFIX + head_link(robot, index)), body_inertia(robot, index)[0])
    for name in robot.moving_joint_names:
        spec.joint(name).armature = float(robot.armature[robot.velocity_index(name)])
