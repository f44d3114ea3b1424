"""A robot that a page moves: its joints as nested nodes, and markers on its links and wheels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.description.records import Mimic
from rpctl.drive.drive import Wheel
from rpctl.dynamics.rolling import contact_point
from rpctl.libraries import library
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.labels import shorten
from rpctl.view.palette import light, number_of, rgb
from rpctl.view.scene import threejs

STEEL_DENSITY = 7850.0  # kg/m³: a mass is shown as the ball of steel that weighs as much
MIN_BALL_RADIUS_M = 0.004  # m; radius below which nobody would see it
FRAME_AXIS_RATIO = 0.05  # length of a frame's axes, of the size of the robot
CONTACT_RANK = 1e9  # label priority of contacts, above all masses (ranked by kg); frames have 0
ROLLING_TOLERANCE_RAD = math.radians(
    1.0
)  # a direction nearer to rolling than this is the rolling direction


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers by the joint that carries them.

    Attributes:
        joint_nodes: Nodes by the index of the joint; the names of all begin with their layer.
        labels: ``node``, ``layer``, ``text`` and ``rank`` of each.
        masses: ``node`` and ``mass`` (kg) of each link that has one.
        wheels: ``node`` of the contact, ``joint`` (name), ``radius``, ``axle`` (3,) and ``along``
            (2,) of each wheel, in the axes of the contact's node.
        geometries: What the nodes are made of.
        materials: Their paint.
    """

    joint_nodes: dict[int, list[threejs.Json]]
    labels: list[dict[str, Any]]
    masses: list[dict[str, Any]]
    wheels: list[dict[str, Any]]
    geometries: list[threejs.Json]
    materials: list[threejs.Json]


def build_markers(robot: Robot, size: float) -> Markers:
    """Return the markers of a robot.

    Args:
        robot: The robot.
        size: Its size, m; frames and arrows are in proportion.
    """
    indices = range(ROOT_JOINT, robot.model.njoints)
    joint_nodes: dict[int, list[threejs.Json]] = {j: [] for j in indices}
    markers = Markers(joint_nodes, [], [], [], _geometries(), _materials())
    links = _names([link.name for link in robot.description.links])
    wheels = _names([wheel.joint for wheel in robot.drive.wheels])
    for index, link in enumerate(robot.description.links):
        frame = robot.model.frames[robot.model.getFrameId(link.name, pin.FrameType.BODY)]
        pose = frame.placement.homogeneous
        axes = _mesh("axes", "axes", _scaled(FRAME_AXIS_RATIO * size))
        _attach(markers, frame.parentJoint, f"frame-{index}", pose, [axes])
        markers.labels.append(_label(f"frame-{index}", links[link.name], 0.0))
        if link.mass:
            centre = pose @ _translated(link.com)
            ball = _mesh("ball", "mass", _scaled(max(_ball_radius(link.mass), MIN_BALL_RADIUS_M)))
            _attach(markers, frame.parentJoint, f"mass-{index}", centre, [ball])
            markers.labels.append(_label(f"mass-{index}", f"{link.mass:.3g} kg", link.mass))
            markers.masses.append({"node": f"mass-{index}", "mass": link.mass})
    for index, wheel in enumerate(robot.drive.wheels):
        _attach_wheel(robot, markers, index, wheel, wheels[wheel.joint])
    if robot.drive.wheels:
        _attach_point(robot, markers, size)
    markers.labels.append(_label("mass-all", f"{robot.mass:.4g} kg in all", robot.mass))
    return markers


def total_mass_marker(mass: float) -> threejs.Json:
    """Return the marker of a whole robot's mass (kg): a ball, and a disc on the ground below it."""
    radius = _ball_radius(mass)
    shapes = [_mesh("ball", "whole", _scaled(radius)), _mesh("disc", "whole", _scaled(radius))]
    shapes[1] = threejs.node("Group", "mass-foot", children=[shapes[1]])
    return threejs.node("Group", "mass-all", children=shapes)


def _attach_wheel(robot: Robot, markers: Markers, index: int, wheel: Wheel, text: str) -> None:
    """Attach a wheel's contact to the link that carries the wheel, so that it does not turn."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.configuration())
    contact, axle = _contact(robot, data, wheel)
    carrier = robot.model.parents[robot.model.getJointId(wheel.joint)]
    shapes = [
        _mesh("disc", "contact", _scaled(0.16 * wheel.radius)),
        _mesh("arrow", "contact", _scaled(1.5 * wheel.radius)),
    ]
    along = np.array([1.0, 0.0])
    if carrier == ROOT_JOINT:  # the drive gives the direction in the root link's frame
        along = contact[:2, :2].T @ wheel.direction
        turn = math.atan2(along[1], along[0])
        if abs(math.sin(turn)) > math.sin(ROLLING_TOLERANCE_RAD):
            bar = _rotated(turn) @ _scaled(1.1 * wheel.radius)
            shapes.append(_mesh("bar", "roller", bar))
    name = f"contact-{index}"
    _attach(markers, carrier, name, data.oMi[carrier].inverse().homogeneous @ contact, shapes)
    markers.labels.append(_label(name, text, CONTACT_RANK))
    entry = {"node": name, "joint": wheel.joint, "radius": wheel.radius}
    entry |= {"axle": (contact[:3, :3].T @ axle).tolist(), "along": along.tolist()}
    markers.wheels.append(entry)


def _contact(robot: Robot, data: pin.Data, wheel: Wheel) -> tuple[Array, Array]:
    """Return the frame (4, 4) where a wheel touches the ground, and the wheel's axle (3,), world.

    Its x axis is the way that the wheel rolls, its z axis points up.
    """
    point = contact_point(robot, data, wheel)
    axle = data.oMi[robot.model.getJointId(wheel.joint)].rotation @ np.array(wheel.axis)
    rolling = np.array([axle[1], -axle[0]]) / math.hypot(axle[0], axle[1])
    heading = robot.drive.heading
    if rolling @ [math.cos(heading), math.sin(heading)] < 0.0:
        rolling = -rolling
    contact = np.eye(4)
    contact[:2, 0], contact[:2, 1] = rolling, (-rolling[1], rolling[0])
    contact[:3, 3] = point
    return contact, axle


def _attach_point(robot: Robot, markers: Markers, size: float) -> None:
    """Attach P, with the robot's forward direction, to the root link."""
    drive = robot.drive
    pose = _rotated(drive.heading)
    pose[:3, 3] = *drive.point, drive.ground
    shapes = [
        _mesh("disc", "point", _scaled(0.012 * size)),
        _mesh("arrow", "point", _scaled(0.16 * size)),
    ]
    _attach(markers, ROOT_JOINT, "contact-P", pose, shapes)
    markers.labels.append(_label("contact-P", "P", CONTACT_RANK))


def _attach(
    markers: Markers, joint: int, name: str, pose: Array, shapes: Sequence[threejs.Json]
) -> None:
    group = threejs.node("Group", name, children=list(shapes), **threejs.fixed_matrix(pose))
    markers.joint_nodes[joint].append(group)


def _names(names: Sequence[str]) -> dict[str, str]:
    """Return the names as labels: shorter where they are long and begin with the same words."""
    short = shorten(names)
    return dict(zip(names, short.names if short.shared else names, strict=True))


def _label(name: str, text: str, rank: float) -> dict[str, Any]:
    """Return a label; of two that overlap, the one of higher rank is shown."""
    return {"node": name, "layer": name.partition("-")[0], "text": text, "rank": rank}


def _mesh(shape: str, paint: str, pose: Array) -> threejs.Json:
    """Return a marker visible through the robot; P and contacts are drawn first."""
    order = 10 + ("contact", "roller", "point", "whole", "mass", "axes").index(paint)
    entries = {"geometry": f"marker-{shape}", "material": f"marker-{paint}", "renderOrder": order}
    return threejs.node("Mesh", f"{paint}-{shape}", **entries, **threejs.fixed_matrix(pose))


def _ball_radius(mass: float) -> float:
    """Return the radius (m) of a ball of steel of a mass (kg)."""
    return float((3.0 * mass / (4.0 * math.pi * STEEL_DENSITY)) ** (1.0 / 3.0))


def _translated(place: Array) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


def _scaled(factor: float) -> Array:
    return np.diag([factor, factor, factor, 1.0])


def _rotated(angle: float) -> Array:
    """Return a rotation (4, 4) about z."""
    pose = np.eye(4)
    cos, sin = math.cos(angle), math.sin(angle)
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    return pose


def _geometries() -> list[threejs.Json]:
    """Return axes, ball, disc, arrow and bar, each about 1 m long."""
    creation = library("trimesh.creation")

    ball = creation.icosphere(subdivisions=2)
    disc = creation.cylinder(1.0, 0.02, sections=32)
    return [
        threejs.geometry("marker-axes", *_axes()),
        _geometry("marker-ball", ball.vertices, ball.faces),
        _geometry("marker-disc", disc.vertices, disc.faces),
        _geometry("marker-arrow", *_flat([(0, 0.05), (0.7, 0.05), (0.7, 0.14), (1.0, 0.0)])),
        _geometry("marker-bar", *_flat([(-1.0, 0.045), (1.0, 0.045), (1.0, 0.0)])),
    ]


def _materials() -> list[threejs.Json]:
    """Return the material of each kind of marker, visible through the robot."""
    seen = {"transparent": True, "depthTest": False, "depthWrite": False, "side": 2}
    flat = {"type": "MeshBasicMaterial", **seen}
    ball = {"type": "MeshLambertMaterial", "opacity": 0.7, **seen}
    return [
        {"uuid": "marker-axes", "vertexColors": 2, **flat},
        {"uuid": "marker-mass", "color": number_of("mass"), "emissive": 0x503000, **ball},
        {"uuid": "marker-whole", "color": number_of("whole-mass"), "emissive": 0x201040, **ball},
        {"uuid": "marker-contact", "color": number_of("base"), "opacity": 0.85, **flat},
        {"uuid": "marker-roller", "color": number_of("roller"), "opacity": 0.85, **flat},
        {"uuid": "marker-point", "color": number_of("point"), "opacity": 0.85, **flat},
    ]


def _axes() -> tuple[dict[str, threejs.Json], NDArray[np.int64]]:
    """Return three thin boxes along the axes, each in its colour, and their triangles."""
    creation = library("trimesh.creation")

    vertices, colours, faces = [], [], []
    for axis, name in enumerate("xyz"):
        edges, middle = np.full(3, 0.05), np.zeros(3)
        edges[axis], middle[axis] = 1.0, 0.5
        box = creation.box(edges)
        faces.append(box.faces + len(box.vertices) * axis)
        vertices.append(box.vertices + middle)
        colours.append(np.tile(rgb(light(name)), (len(box.vertices), 1)))
    attributes = {
        "position": threejs.attribute(np.concatenate(vertices).astype(np.float32)),
        "color": threejs.attribute(np.concatenate(colours).astype(np.uint8), normalized=True),
    }
    return attributes, np.concatenate(faces)


def _geometry(uuid: str, vertices: Array, faces: NDArray[np.int64]) -> threejs.Json:
    unit = np.asarray(vertices, float)
    lengths = np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-9)
    attributes = {
        "position": threejs.attribute(unit.astype(np.float32)),
        "normal": threejs.attribute((unit / lengths).astype(np.float32)),
    }
    return threejs.geometry(uuid, attributes, np.asarray(faces))


def _flat(upper: list[tuple[float, float]]) -> tuple[Array, NDArray[np.int64]]:
    """Return a flat mesh in the xy plane, symmetric about the x axis, from its upper outline."""
    edge = np.array(upper)
    outline = np.concatenate([edge, edge[::-1] * [1.0, -1.0]])
    count = len(edge)
    faces = []
    for k in range(count - 1):
        a, b, c, d = k, k + 1, 2 * count - 2 - k, 2 * count - 1 - k
        faces += [(a, b, c), (a, c, d)]
    return np.column_stack([outline, np.zeros(len(outline))]), np.array(faces)


def skeleton(
    robot: Robot, prefix: str, nodes_of: Callable[[int], list[threejs.Json]]
) -> threejs.Json:
    """Return the group of the root link, all others nested below it.

    Group ``PREFIX-j`` holds all that joint j moves; its parent group ``PREFIX-seat-j`` holds the
    joint's fixed placement.

    Args:
        robot: The robot.
        prefix: Of the groups' names.
        nodes_of: Returns what else hangs on a joint, by its index in the model.
    """
    model = robot.model
    groups = {
        j: threejs.node("Group", f"{prefix}-{j}", children=nodes_of(j))
        for j in range(ROOT_JOINT, model.njoints)
    }
    for j in range(ROOT_JOINT + 1, model.njoints):
        place = threejs.fixed_matrix(model.jointPlacements[j].homogeneous)
        seat = threejs.node("Group", f"{prefix}-seat-{j}", children=[groups[j]], **place)
        groups[model.parents[j]]["children"].append(seat)
    return groups[ROOT_JOINT]


def joints(robot: Robot, q: Array) -> list[dict[str, Any]]:
    """Return the page's data of each joint after the root, in the model's order.

    Args:
        robot: The robot.
        q: Configuration (nq,) at which it stands.

    Returns:
        ``name``, ``node`` (its index), ``parent`` (index in this list, −1 for the root link),
        ``place`` (its fixed placement there, see :func:`pose`), ``slides``, ``axis``, ``role``
        (``"wheel"``, ``"arm"``, ``"mimic"`` or ``"other"``), ``position``, ``lower`` and
        ``upper`` (rad or m, None where there is none) and, of a mimic joint, ``mimic``
        (``follows``: index in this list or None where the joint that it follows is locked;
        ``multiplier``; ``offset``).
    """
    names = list(robot.moving_joint_names)
    wheels, arm = {w.joint for w in robot.drive.wheels}, set(robot.joint_names)
    mimics = {joint.name for joint in robot.mimics}
    entries = []
    for number, name in enumerate(names):
        joint = robot.description.joint[name]
        role = "wheel" if name in wheels else "arm" if name in arm else "other"
        entry: dict[str, Any] = {
            "name": name,
            "node": ROOT_JOINT + 1 + number,
            "parent": robot.model.parents[ROOT_JOINT + 1 + number] - ROOT_JOINT - 1,
            "place": pose(robot.model.jointPlacements[ROOT_JOINT + 1 + number]),
            "slides": joint.kind == "prismatic",
            "axis": joint.axis.tolist(),
            "role": "mimic" if name in mimics else role,
            "position": robot.joint_position(q, name),
            "lower": joint.lower if np.isfinite(joint.lower) else None,
            "upper": joint.upper if np.isfinite(joint.upper) else None,
        }
        if joint.mimic is not None and name in mimics:
            entry["mimic"] = _followed(joint.mimic, names)
        entries.append(entry)
    return entries


def _followed(mimic: Mimic, names: Sequence[str]) -> dict[str, Any]:
    return {
        "name": mimic.joint,
        "follows": names.index(mimic.joint) if mimic.joint in names else None,
        "multiplier": mimic.multiplier,
        "offset": mimic.offset,
    }


def hand(robot: Robot) -> dict[str, Any] | None:
    """Return the page's data of the end effector: its joint in :func:`joints`, its place there.

    None for a robot without an arm.
    """
    if robot.end_effector is None:
        return None
    frame = robot.model.frames[robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY)]
    joint = frame.parentJoint - ROOT_JOINT - 1
    return {"link": robot.end_effector, "joint": joint, "place": pose(frame.placement)}


def pose(place: pin.SE3) -> dict[str, list[float]]:
    """Return a placement for the page: ``R``, its rotation row after row, and ``p``, m."""
    return {"R": place.rotation.ravel().tolist(), "p": place.translation.tolist()}
