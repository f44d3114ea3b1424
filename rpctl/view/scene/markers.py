"""A robot that a page moves: its joints as nested nodes, and markers on its links and wheels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.records import Mimic
from rpctl.drive.drive import Wheel
from rpctl.dynamics.rolling import contact_point
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.labels import shorten
from rpctl.view.palette import number_of
from rpctl.view.scene import threejs
from rpctl.view.scene.stand_ins import link_frame

STEEL_DENSITY = 7850.0  # kg/m³: a mass is shown as the ball of steel that weighs as much
MIN_BALL_RADIUS_M = 0.004  # m; radius below which nobody would see it
FRAME_AXIS_RATIO = 0.05  # length of a frame's axes, of the size of the robot
CONTACT_RANK = 1e9  # label priority of contacts, above all masses (ranked by kg); frames have 0
ROLLING_TOLERANCE_RAD = math.radians(
    1.0
)  # a direction nearer to rolling than this is the rolling direction

# Shapes of about 1 m: the axis, the arrow and the bar along x, the disc level
ARROW = np.array(
    [(0, 0.05), (0, -0.05), (0.7, -0.05), (0.7, 0.05), (0.7, 0.14), (0.7, -0.14), (1, 0)],
    np.float32,
)
SHAPES: dict[str, threejs.Json] = {
    "axis": {"type": "BoxGeometry", "width": 1.0, "height": 0.05, "depth": 0.05},
    "ball": {"type": "SphereGeometry", "radius": 1.0, "widthSegments": 24, "heightSegments": 16},
    "disc": {"type": "CircleGeometry", "radius": 1.0, "segments": 32},
    "bar": {"type": "PlaneGeometry", "width": 2.0, "height": 0.09},
    "arrow": threejs.geometry(
        {"position": threejs.attribute(np.column_stack([ARROW, np.zeros(7, np.float32)]))},
        np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6)]),
    ),
}
AXES = {  # matrices (4, 4) that lay the middle of the axis's box half its length along each axis
    name: np.block([[np.roll(np.eye(3), k, axis=0), 0.5 * np.eye(3)[:, k : k + 1]], [np.eye(4)[3]]])
    for k, name in enumerate("xyz")
}
VISIBLE_THROUGH = {"transparent": True, "depthTest": False, "depthWrite": False, "side": 2}
FLAT = {"type": "MeshBasicMaterial", "opacity": 0.85}
# Colour and material of each kind of marker, the first drawn below the others
PAINTS: dict[str, tuple[str, threejs.Json]] = {
    "contact": ("base", FLAT),
    "roller": ("roller", FLAT),
    "point": ("point", FLAT),
    "whole": ("whole-mass", {"type": "MeshLambertMaterial", "opacity": 0.7, "emissive": 0x201040}),
    "mass": ("mass", {"type": "MeshLambertMaterial", "opacity": 0.7, "emissive": 0x503000}),
    **{name: (name, {"type": "MeshBasicMaterial"}) for name in "xyz"},
}


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers by the joint that carries them.

    Attributes:
        joint_nodes: Nodes by the index of the joint; the names of all begin with their layer.
        labels: ``node``, ``layer``, ``text`` and ``rank`` of each.
        masses: ``node`` and ``mass`` (kg) of each link that has one.
        wheels: ``node`` of the contact, ``joint`` (name), ``radius``, ``axle`` (3,) and ``along``
            (2,) of each wheel, in the axes of the contact's node.
    """

    joint_nodes: dict[int, list[threejs.Json]]
    labels: list[dict[str, Any]]
    masses: list[dict[str, Any]]
    wheels: list[dict[str, Any]]


def build_markers(robot: Robot, size: float) -> Markers:
    """Return the markers of a robot.

    Args:
        robot: The robot.
        size: Its size, m; frames and arrows are in proportion.
    """
    markers = Markers({j: [] for j in range(ROOT_JOINT, robot.model.njoints)}, [], [], [])
    links = _names([link.name for link in robot.description.links])
    wheels = _names([wheel.joint for wheel in robot.drive.wheels])
    for index, link in enumerate(robot.description.links):
        joint, pose = link_frame(robot, link)
        axes = _scaled(FRAME_AXIS_RATIO * size)
        shapes = [_mesh("axis", name, axes @ turn) for name, turn in AXES.items()]
        _attach(markers, joint, f"frame-{index}", pose, shapes)
        markers.labels.append(_label(f"frame-{index}", links[link.name], 0.0))
        if link.mass:
            centre = pose @ pin.SE3(np.eye(3), link.com).homogeneous
            ball = _mesh("ball", "mass", _scaled(max(_ball_radius(link.mass), MIN_BALL_RADIUS_M)))
            _attach(markers, joint, f"mass-{index}", centre, [ball])
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
            shapes.append(_mesh("bar", "roller", _turned(turn) @ _scaled(1.1 * wheel.radius)))
    name = f"contact-{index}"
    _attach(markers, carrier, name, data.oMi[carrier].inverse().homogeneous @ contact, shapes)
    markers.labels.append(_label(name, text, CONTACT_RANK))
    axes = {"axle": (contact[:3, :3].T @ axle).tolist(), "along": along.tolist()}
    markers.wheels.append({"node": name, "joint": wheel.joint, "radius": wheel.radius, **axes})


def _contact(robot: Robot, data: pin.Data, wheel: Wheel) -> tuple[Array, Array]:
    """Return the frame (4, 4) where a wheel touches the ground, and the wheel's axle (3,), world.

    Its x axis is the way that the wheel rolls, its z axis points up.
    """
    axle = data.oMi[robot.model.getJointId(wheel.joint)].rotation @ np.array(wheel.axis)
    rolling = np.array([axle[1], -axle[0]]) / math.hypot(axle[0], axle[1])
    heading = robot.drive.heading
    if rolling @ [math.cos(heading), math.sin(heading)] < 0.0:
        rolling = -rolling
    contact = np.eye(4)
    contact[:2, 0], contact[:2, 1] = rolling, (-rolling[1], rolling[0])
    contact[:3, 3] = contact_point(robot, data, wheel)
    return contact, axle


def _attach_point(robot: Robot, markers: Markers, size: float) -> None:
    """Attach P, with the robot's forward direction, to the root link."""
    drive = robot.drive
    pose = _turned(drive.heading, (*drive.point, drive.ground))
    shapes = [
        _mesh("disc", "point", _scaled(0.012 * size)),
        _mesh("arrow", "point", _scaled(0.16 * size)),
    ]
    _attach(markers, ROOT_JOINT, "contact-P", pose, shapes)
    markers.labels.append(_label("contact-P", "P", CONTACT_RANK))


def _attach(
    markers: Markers, joint: int, name: str, pose: Array, shapes: Sequence[threejs.Json]
) -> None:
    markers.joint_nodes[joint].append(threejs.node("Group", name, pose, children=list(shapes)))


def _names(names: Sequence[str]) -> dict[str, str]:
    """Return the names as labels: shorter where they are long and begin with the same words."""
    short = shorten(names)
    return dict(zip(names, short.names if short.shared else names, strict=True))


def _label(name: str, text: str, rank: float) -> dict[str, Any]:
    """Return a label; of two that overlap, the one of higher rank is shown."""
    return {"node": name, "layer": name.partition("-")[0], "text": text, "rank": rank}


def _mesh(shape: str, paint: str, pose: Array) -> threejs.Json:
    """Return a marker visible through the robot; P and contacts are drawn first."""
    order = 10 + list(PAINTS).index(paint)
    look = {"geometry": SHAPES[shape], "material": {"color": number_of(PAINTS[paint][0])}}
    look["material"] |= {**VISIBLE_THROUGH, **PAINTS[paint][1]}
    return threejs.node("Mesh", f"{paint}-{shape}", pose, renderOrder=order, **look)


def _ball_radius(mass: float) -> float:
    """Return the radius (m) of a ball of steel of a mass (kg)."""
    return float((3.0 * mass / (4.0 * math.pi * STEEL_DENSITY)) ** (1.0 / 3.0))


def _scaled(factor: float) -> Array:
    return np.diag([factor, factor, factor, 1.0])


def _turned(angle: float, place: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """Return the pose (4, 4) at a place, m, turned about z."""
    return np.asarray(pin.SE3(pin.utils.rotate("z", angle), np.array(place)).homogeneous)


def skeleton(
    robot: Robot, prefix: str, nodes: Mapping[int, Sequence[threejs.Json]]
) -> threejs.Json:
    """Return the group of the root link, all others nested below it.

    Group ``PREFIX-j`` holds all that joint j moves; its parent group ``PREFIX-seat-j`` holds the
    joint's fixed placement.

    Args:
        robot: The robot.
        prefix: Of the groups' names.
        nodes: What else hangs on joints, by their indices in the model.
    """
    model = robot.model
    groups = {
        j: threejs.node("Group", f"{prefix}-{j}", children=[*nodes.get(j, ())])
        for j in range(ROOT_JOINT, model.njoints)
    }
    for j in range(ROOT_JOINT + 1, model.njoints):
        place = model.jointPlacements[j].homogeneous
        seat = threejs.node("Group", f"{prefix}-seat-{j}", place, children=[groups[j]])
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
