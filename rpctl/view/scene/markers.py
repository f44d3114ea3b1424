"""Markers on a robot: link frames, centres of mass, wheel contacts and P."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.dynamics.rolling import contact_point
from rpctl.libraries import library
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.labels import shorten
from rpctl.view.scene import threejs

STEEL_DENSITY = 7850.0  # kg/m³: a mass is shown as the ball of steel that weighs as much
MIN_BALL_RADIUS_M = 0.004  # m; radius below which nobody would see it
FRAME_AXIS_RATIO = 0.05  # length of a frame's axes, of the size of the robot
CONTACT_RANK = 1e9  # label priority of contacts, above all masses (ranked by kg); frames have 0
ROLLING_TOLERANCE_RAD = math.radians(
    1.0
)  # a direction nearer to rolling than this is the rolling direction
AXIS_COLOURS = (
    (0.86, 0.20, 0.18),
    (0.18, 0.62, 0.22),
    (0.16, 0.42, 0.86),
)  # x red, y green, z blue
MASS_COLOUR, TOTAL_MASS_COLOUR, CONTACT_COLOUR, ROLLER_COLOUR, POINT_COLOUR = (
    0xE8A33D,
    0x6B3FA0,
    0x0072B2,
    0xCC4B9B,
    0x009E73,
)


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
        {"uuid": "marker-mass", "color": MASS_COLOUR, "emissive": 0x503000, **ball},
        {"uuid": "marker-whole", "color": TOTAL_MASS_COLOUR, "emissive": 0x201040, **ball},
        {"uuid": "marker-contact", "color": CONTACT_COLOUR, "opacity": 0.85, **flat},
        {"uuid": "marker-roller", "color": ROLLER_COLOUR, "opacity": 0.85, **flat},
        {"uuid": "marker-point", "color": POINT_COLOUR, "opacity": 0.85, **flat},
    ]


def _axes() -> tuple[dict[str, threejs.Json], NDArray[np.int64]]:
    """Return three thin boxes along the axes, each in its colour, and their triangles."""
    creation = library("trimesh.creation")

    vertices, colours, faces = [], [], []
    for axis, colour in enumerate(AXIS_COLOURS):
        edges, middle = np.full(3, 0.05), np.zeros(3)
        edges[axis], middle[axis] = 1.0, 0.5
        box = creation.box(edges)
        faces.append(box.faces + len(box.vertices) * axis)
        vertices.append(box.vertices + middle)
        colours.append(np.tile(np.rint(255.0 * np.array(colour)), (len(box.vertices), 1)))
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
