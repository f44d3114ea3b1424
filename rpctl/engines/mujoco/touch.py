"""What of a robot meets the ground: its wheels and its supports."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.dynamics.supports import find_supports
from rpctl.engines.mujoco.bodies import body_name, quaternion
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.equivalence.contact.shapes import support_shapes, tyre
from rpctl.robot.model import Robot

GROUND = "ground"  # name of the ground's geom
SHARE = 0.2  # impedance of the load: how much of a contact's acceleration it decides
GRIP = 100.0  # hardness of friction as a multiple of the load's (``impratio``)
PYRAMID_IMPEDANCE = [0.9, 0.95, 1e-3, 0.5, 2.0]
PROP = 0.02  # m, radius of a prop
MIN_REACH = 0.1  # m: a prop's distance ahead of P and to its side, at least
SHAPES = {"sphere": "SPHERE", "capsule": "CAPSULE", "cylinder": "CYLINDER", "box": "BOX"}


def add_wheels(
    spec: Any, robot: Robot, settings: ContactSettings, friction: float
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Add the wheels' geoms; return whose contact each geom is, and what was assumed.

    Args:
        spec: The ``MjSpec``, with its bodies.
        robot: The robot.
        settings: Shape and width of the wheels.
        friction: Coefficient between wheels and ground.
    """
    owners, notes = {}, []
    for wheel in robot.drive.wheels:
        half_width, note = half_width_of(robot, wheel, settings)
        notes += [note] if note else []
        kind = "ELLIPSOID" if settings.wheel_shape == "crowned" else "CYLINDER"
        size = [wheel.radius, half_width, 0.0]
        if kind == "ELLIPSOID":
            size = [wheel.radius, wheel.radius, half_width]
        body = spec.body(body_name(robot.description.joint[wheel.joint].child))
        held = settings.caster_friction if _is_ball(wheel) else friction
        add_touching(spec, body, wheel.joint, kind, size, wheel_pose(wheel), held, settings)
        owners[wheel.joint] = wheel.joint
    return owners, tuple(dict.fromkeys(notes))


def _is_ball(wheel: Wheel) -> bool:
    """Return whether a wheel is a ball that slides, though its file lets it turn one way."""
    return wheel.slides and not wheel.driven and "sphere" in wheel.source


def half_width_of(robot: Robot, wheel: Wheel, settings: ContactSettings) -> tuple[float, str]:
    """Return half the width of a wheel, m, and what was assumed.

    Args:
        robot: The robot.
        wheel: The wheel.
        settings: Which may give the width.
    """
    if settings.wheel_width is not None:
        return 0.5 * settings.wheel_width, ""
    tread = tyre(robot, wheel)
    return tread.half_width, tread.note


def wheel_pose(wheel: Wheel) -> Array:
    """Return a wheel's pose (4, 4) in the frame of its joint, z along the axle."""
    axis = np.array(wheel.axis)
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    pose[:3, 3] = wheel.offset * axis
    return pose


def add_supports(
    spec: Any, robot: Robot, settings: ContactSettings, friction: float
) -> dict[str, str]:
    """Add the supports' geoms; return whose contact each geom is.

    Args:
        spec: The ``MjSpec``, with its bodies.
        robot: The robot.
        settings: Friction of what slides.
        friction: Coefficient between the ground and what rolls.
    """
    owners: dict[str, str] = {}
    supports = find_supports(robot)
    for name, link, shape in support_shapes(robot, supports):
        free = robot.tree.free_joints(link)
        rolls = any(not robot.tree.is_upright(joint) for joint in free)
        pose = _in_head(robot, link) @ shape.origin
        size = halved(shape.kind, shape.size)
        body = spec.body(body_name(_head(robot, link)))
        held = friction if rolls else settings.caster_friction
        add_touching(spec, body, name, SHAPES[shape.kind], size, pose, held, settings)
        owners[name] = name
    return owners


def add_drawn(
    spec: Any, robot: Robot, settings: ContactSettings, friction: float
) -> tuple[str, ...]:
    """Add what else meets the ground; return what was assumed.

    That is casters that only meshes draw, as balls, and, where settings say so, props and all that
    the file draws for collisions besides wheels and supports.

    Args:
        spec: The ``MjSpec``, with its bodies.
        robot: The robot.
        settings: Whether the whole robot meets the ground.
        friction: Coefficient between the ground and what is drawn.
    """
    supports, notes = find_supports(robot), []
    for link in supports.unknown:
        pose = _in_head(robot, link)
        radius = float(robot.tree.pose(link)[2, 3]) - robot.drive.ground
        body = spec.body(body_name(_head(robot, link)))
        free = robot.tree.free_joints(link)
        held = friction if free and not robot.tree.is_upright(free[-1]) else 0.0
        add_touching(spec, body, link, "SPHERE", [radius, 0.0, 0.0], pose, held, settings)
        notes.append(f'caster "{link}" is drawn by meshes alone; it is a ball of {radius:.3g} m')
    if settings.props:
        notes.append(_add_props(spec, robot, settings))
    return tuple(notes) + (_add_body(spec, robot, settings, friction) if settings.body else ())


def _add_props(spec: Any, robot: Robot, settings: ContactSettings) -> str:
    """Hold the robot up by balls that slide, and say so."""
    drive = robot.drive
    reach = max(0.5 * drive.track, MIN_REACH)
    cos, sin = math.cos(drive.heading), math.sin(drive.heading)
    body = spec.body(body_name(robot.description.root))
    for k, (ahead, left) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        pose = np.eye(4)
        pose[0, 3] = drive.point[0] + reach * (cos * ahead - sin * left)
        pose[1, 3] = drive.point[1] + reach * (sin * ahead + cos * left)
        pose[2, 3] = drive.ground + PROP
        add_touching(spec, body, f"prop{k}", "SPHERE", [PROP, 0.0, 0.0], pose, 0.0, settings)
    return f"four balls that its file does not have hold it up, {reach:.3g} m around P"


def _add_body(
    spec: Any, robot: Robot, settings: ContactSettings, friction: float
) -> tuple[str, ...]:
    """Let what the file draws for collisions meet the ground; return what is left out."""
    lines = {part.line for part in find_supports(robot).parts}
    wheels = {robot.description.joint[wheel.joint].child for wheel in robot.drive.wheels}
    left = []
    for link in robot.description.links:
        if wheels & {
            robot.description.root,
            *(j.child for j in robot.description.chain(link.name)),
        }:
            continue
        for shape in link.collisions:
            if shape.kind not in SHAPES:
                left.append(link.name)
            elif shape.line not in lines:
                body = spec.body(body_name(_head(robot, link.name)))
                name, size = f"{link.name} (line {shape.line})", halved(shape.kind, shape.size)
                pose = _in_head(robot, link.name) @ shape.origin
                add_touching(spec, body, name, SHAPES[shape.kind], size, pose, friction, settings)
    if not left:
        return ()
    return (f"the meshes of {len(set(left))} links do not meet the ground",)


def add_touching(
    spec: Any,
    body: Any,
    name: str,
    kind: str,
    size: list[float],
    pose: Array,
    friction: float,
    settings: ContactSettings,
) -> Any:
    """Add a geom that meets the ground, and return their contact pair.

    Args:
        spec: The ``MjSpec``.
        body: The ``MjsBody``.
        name: Of the geom.
        kind: MuJoCo's word for its shape.
        size: MuJoCo's three sizes, m.
        pose: In the body's frame (4, 4).
        friction: Coefficient between it and the ground; 0: it slides.
        settings: How hard the contact is.
    """
    kinds = mujoco_library().mjtGeom
    geom = body.add_geom(name=name, type=getattr(kinds, f"mjGEOM_{kind}"), mass=0.0)
    geom.size, geom.pos, geom.quat = size, pose[:3, 3], quaternion(pose)
    geom.contype = geom.conaffinity = 0
    pair = spec.add_pair(name=name, geomname1=GROUND, geomname2=name)
    pair.condim = 3 if friction > 0.0 else 1
    pair.friction = [friction, friction, 0.0, 0.0, 0.0]
    _soften(pair, settings)
    return pair


def _soften(pair: Any, settings: ContactSettings) -> None:
    """Set how hard a contact is, along its normal and along the ground.

    MuJoCo's friction is relaxed: what slides at a speed v is lifted by μ b v/k, b the rate at which
    slipping ends and k the stiffness under the load. As b is set for the ground's plane alone, and
    the load's impedance is low, the lift stays below what the load presses in; with MuJoCo's own
    numbers a cylinder that scrubs leaves the ground and chatters. Friction proper stays hard, by
    ``impratio``. A pyramid has one set of numbers for all; it gets MuJoCo's.
    """
    rate = 1.0 / settings.time_constant
    if settings.cone == "pyramidal":
        pair.solref, pair.solimp = [settings.time_constant, 1.0], PYRAMID_IMPEDANCE
        return
    pair.solref = [-(rate**2) / SHARE, -2.0 * rate / SHARE]
    pair.solreffriction = [-1.0, -2.0 * rate]
    pair.solimp = [SHARE, SHARE, 1e-3, 0.5, 2.0]


def halved(kind: str, size: tuple[float, ...]) -> list[float]:
    """Return a URDF shape's size as MuJoCo counts it: half edges, half lengths; three numbers."""
    if kind == "box":
        return [0.5 * edge for edge in size]
    return [size[0], 0.0 if kind == "sphere" else 0.5 * size[1], 0.0]


def _in_head(robot: Robot, link: str) -> Array:
    """Return a link's pose (4, 4) in the frame of the body that it is part of."""
    head = robot.tree.pose(_head(robot, link))
    return np.asarray(np.linalg.inv(head) @ robot.tree.pose(link))


def _head(robot: Robot, link: str) -> str:
    """Return the link whose body a link is part of."""
    free = robot.tree.free_joints(link)
    return free[-1].child if free else robot.description.root
