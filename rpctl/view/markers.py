"""What a viewer shows of a robot beside its shapes: frames, masses, and how it meets the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.description.records import Array
from rpctl.robot.drive import Wheel
from rpctl.robot.model import Robot
from rpctl.view import wire
from rpctl.view.skeleton import ROOT

AXES = ((0.86, 0.20, 0.18), (0.18, 0.62, 0.22), (0.16, 0.42, 0.86))  # x red, y green, z blue
MASS, WHOLE, CONTACT, ROLLER, POINT = 0xE8A33D, 0x6B3FA0, 0x0072B2, 0xCC4B9B, 0x009E73
STEEL = 7850.0  # kg/m³: a mass is shown as the ball of steel that weighs as much
LEAST_BALL = 0.004  # m; radius below which nobody would see it
FRAME_SHARE = 0.05  # length of a frame's axes, of the size of the robot
FIRST = 1e9  # rank of the names of contacts; masses rank by their kg, frames last
ACROSS = math.radians(1.0)  # a direction nearer to rolling than this is the rolling direction


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers, and the joints that they hang on.

    Attributes:
        hung: Nodes by the index of the joint; the names of all begin with their layer.
        labels: ``node``, ``layer``, ``text`` and ``rank`` of each.
        masses: ``node`` and ``mass`` (kg) of each link that has one.
        wheels: ``node`` of the contact, ``joint`` (name), ``radius``, ``axle`` and ``along`` (3,)
            of each wheel, both in the axes of the contact's node.
        geometries: What the nodes are made of.
        materials: Their paint.
    """

    hung: dict[int, list[wire.Json]]
    labels: list[dict[str, Any]]
    masses: list[dict[str, Any]]
    wheels: list[dict[str, Any]]
    geometries: list[wire.Json]
    materials: list[wire.Json]


def build_markers(robot: Robot, size: float) -> Markers:
    """Return the markers of a robot.

    Args:
        robot: The robot.
        size: Its size, m; frames and arrows are in proportion.
    """
    hung: dict[int, list[wire.Json]] = {j: [] for j in range(ROOT, robot.model.njoints)}
    markers = Markers(hung, [], [], [], _geometries(), _materials())
    for index, link in enumerate(robot.description.links):
        frame = robot.model.frames[robot.model.getFrameId(link.name, pin.FrameType.BODY)]
        pose = frame.placement.homogeneous
        axes = _mesh("axes", "axes", _scaled(FRAME_SHARE * size))
        _hang(markers, frame.parentJoint, f"frame-{index}", pose, [axes])
        markers.labels.append(_label(f"frame-{index}", link.name, 0.0))
        if link.mass:
            centre = pose @ _at(link.com)
            ball = _mesh("ball", "mass", _scaled(max(_ball(link.mass), LEAST_BALL)))
            _hang(markers, frame.parentJoint, f"mass-{index}", centre, [ball])
            markers.labels.append(_label(f"mass-{index}", f"{link.mass:.3g} kg", link.mass))
            markers.masses.append({"node": f"mass-{index}", "mass": link.mass})
    for index, wheel in enumerate(robot.drive.wheels):
        _hang_wheel(robot, markers, index, wheel)
    _hang_point(robot, markers, size)
    markers.labels.append(_label("mass-all", f"{robot.mass:.4g} kg in all", robot.mass))
    return markers


def whole_mass(mass: float) -> wire.Json:
    """Return the marker of a whole robot's mass (kg): a ball, and a disc on the ground below it."""
    radius = _ball(mass)
    shapes = [_mesh("ball", "whole", _scaled(radius)), _mesh("disc", "whole", _scaled(radius))]
    shapes[1] = wire.node("Group", "mass-foot", children=[shapes[1]])
    return wire.node("Group", "mass-all", children=shapes)


def _hang_wheel(robot: Robot, markers: Markers, index: int, wheel: Wheel) -> None:
    """Hang a wheel's contact on what carries the wheel: it does not turn with it.

    The node's x axis is the way that the wheel rolls, its z axis points up.
    """
    model = robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, robot.configuration())
    joint = model.getJointId(wheel.joint)
    carrier = model.parents[joint]
    axle = data.oMi[joint].rotation @ np.array(wheel.axis)
    centre = data.oMi[joint].translation + wheel.offset * axle
    rolling = np.array([axle[1], -axle[0]]) / math.hypot(axle[0], axle[1])
    forward = np.array([math.cos(robot.drive.heading), math.sin(robot.drive.heading)])
    rolling = rolling if rolling @ forward >= 0.0 else -rolling
    contact = np.eye(4)
    contact[:2, 0], contact[:2, 1] = rolling, (-rolling[1], rolling[0])
    contact[:3, 3] = centre - [0.0, 0.0, wheel.radius]
    pose = data.oMi[carrier].inverse().homogeneous @ contact
    shapes = [
        _mesh("disc", "contact", _scaled(0.16 * wheel.radius)),
        _mesh("arrow", "contact", _scaled(1.5 * wheel.radius)),
    ]
    along = rolling
    if carrier == ROOT:  # the direction is told in the root link's frame
        along = np.array(wheel.direction)
        turn = math.atan2(*_cross_dot(rolling, along))
        if abs(math.sin(turn)) > math.sin(ACROSS):
            bar = _turned(turn) @ _scaled(1.1 * wheel.radius)
            shapes.append(_mesh("bar", "roller", bar))
    name = f"contact-{index}"
    _hang(markers, carrier, name, pose, shapes)
    markers.labels.append(_label(name, wheel.joint, FIRST))
    told = {"node": name, "joint": wheel.joint, "radius": wheel.radius}
    axes = contact[:3, :3]
    told |= {"axle": (axes.T @ axle).tolist(), "along": (axes[:2, :2].T @ along).tolist()}
    markers.wheels.append(told)


def _hang_point(robot: Robot, markers: Markers, size: float) -> None:
    """Hang P with the robot's forward direction on the root link."""
    drive = robot.drive
    pose = _turned(drive.heading)
    pose[:3, 3] = *drive.point, drive.ground
    shapes = [
        _mesh("disc", "point", _scaled(0.012 * size)),
        _mesh("arrow", "point", _scaled(0.16 * size)),
    ]
    _hang(markers, ROOT, "contact-P", pose, shapes)
    markers.labels.append(_label("contact-P", "P", FIRST))


def _hang(
    markers: Markers, joint: int, name: str, pose: Array, shapes: Sequence[wire.Json]
) -> None:
    group = wire.node("Group", name, children=list(shapes), **wire.fixed(pose))
    markers.hung[joint].append(group)


def _label(name: str, text: str, rank: float) -> dict[str, Any]:
    """Return a label; of two that do not fit beside each other, the one of higher rank is shown."""
    return {"node": name, "layer": name.partition("-")[0], "text": text, "rank": rank}


def _mesh(shape: str, paint: str, pose: Array) -> wire.Json:
    """Return a marker that is seen through the robot; P and contacts lie below the others."""
    order = 10 + ("contact", "roller", "point", "whole", "mass", "axes").index(paint)
    entries = {"geometry": f"marker-{shape}", "material": f"marker-{paint}", "renderOrder": order}
    return wire.node("Mesh", f"{paint}-{shape}", **entries, **wire.fixed(pose))


def _geometries() -> list[wire.Json]:
    from trimesh import creation

    ball = creation.icosphere(subdivisions=2)
    disc = creation.cylinder(1.0, 0.02, sections=32)
    return [
        wire.geometry("marker-axes", *_axes()),
        _geometry("marker-ball", ball.vertices, ball.faces),
        _geometry("marker-disc", disc.vertices, disc.faces),
        _geometry("marker-arrow", *_flat([(0, 0.05), (0.7, 0.05), (0.7, 0.14), (1.0, 0.0)])),
        _geometry("marker-bar", *_flat([(-1.0, 0.045), (1.0, 0.045), (1.0, 0.0)])),
    ]


def _materials() -> list[wire.Json]:
    seen = {"transparent": True, "depthTest": False, "depthWrite": False, "side": 2}
    flat = {"type": "MeshBasicMaterial", **seen}
    ball = {"type": "MeshLambertMaterial", "opacity": 0.7, **seen}
    return [
        {"uuid": "marker-axes", "vertexColors": 2, **flat},
        {"uuid": "marker-mass", "color": MASS, "emissive": 0x503000, **ball},
        {"uuid": "marker-whole", "color": WHOLE, "emissive": 0x201040, **ball},
        {"uuid": "marker-contact", "color": CONTACT, "opacity": 0.85, **flat},
        {"uuid": "marker-roller", "color": ROLLER, "opacity": 0.85, **flat},
        {"uuid": "marker-point", "color": POINT, "opacity": 0.85, **flat},
    ]


def _axes() -> tuple[dict[str, wire.Json], NDArray[np.int64]]:
    """Return three thin boxes along the axes, each in its colour, and their triangles."""
    from trimesh import creation

    vertices, colours, faces = [], [], []
    for axis, colour in enumerate(AXES):
        edges, middle = np.full(3, 0.05), np.zeros(3)
        edges[axis], middle[axis] = 1.0, 0.5
        box = creation.box(edges)
        faces.append(box.faces + len(box.vertices) * axis)
        vertices.append(box.vertices + middle)
        colours.append(np.tile(np.rint(255.0 * np.array(colour)), (len(box.vertices), 1)))
    attributes = {
        "position": wire.attribute(np.concatenate(vertices).astype(np.float32)),
        "color": wire.attribute(np.concatenate(colours).astype(np.uint8), normalized=True),
    }
    return attributes, np.concatenate(faces)


def _geometry(uuid: str, vertices: Array, faces: NDArray[np.int64]) -> wire.Json:
    unit = np.asarray(vertices, float)
    lengths = np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-9)
    attributes = {
        "position": wire.attribute(unit.astype(np.float32)),
        "normal": wire.attribute((unit / lengths).astype(np.float32)),
    }
    return wire.geometry(uuid, attributes, np.asarray(faces))


def _flat(upper: list[tuple[float, float]]) -> tuple[Array, NDArray[np.int64]]:
    """Return a level figure that is its own mirror image about the x axis, from its upper edge."""
    edge = np.array(upper)
    outline = np.concatenate([edge, edge[::-1] * [1.0, -1.0]])
    count = len(edge)
    faces = []
    for k in range(count - 1):
        a, b, c, d = k, k + 1, 2 * count - 2 - k, 2 * count - 1 - k
        faces += [(a, b, c), (a, c, d)]
    return np.column_stack([outline, np.zeros(len(outline))]), np.array(faces)


def _ball(mass: float) -> float:
    """Return the radius (m) of a ball of steel of a mass (kg)."""
    return float((3.0 * mass / (4.0 * math.pi * STEEL)) ** (1.0 / 3.0))


def _at(place: Array) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


def _scaled(factor: float) -> Array:
    return np.diag([factor, factor, factor, 1.0])


def _turned(angle: float) -> Array:
    """Return a turn (4, 4) about z."""
    pose = np.eye(4)
    cos, sin = math.cos(angle), math.sin(angle)
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    return pose


def _cross_dot(a: Array, b: Array) -> tuple[float, float]:
    return float(a[0] * b[1] - a[1] * b[0]), float(a @ b)
