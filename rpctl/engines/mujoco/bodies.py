"""The tree of bodies, one per joint of the model: inertias that MuJoCo accepts, motors, losses.

A body's second moments about its centre of mass are Σ = ∫ r rᵀ dm = ½ tr(I) 1 − I. In a real body
none is negative: each moment of inertia is at most the sum of the other two. Links that move as one
body are summed up before this is checked, because a link that is unphysical alone is often a part
of a physical body.

Sensors measure the state of the bodies; q and ν are computed from them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.records import Joint, Link
from rpctl.dynamics.rolling import find_rolling, selection
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.equivalence.contact.mujoco_body import mujoco_library, part_number, planar, quaternion
from rpctl.equivalence.mujoco_engine import Inertial, inertia_fault, moments_text
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import ROOT_JOINT, read_root, write_root
from rpctl.robot.model import BASE_NV, Robot

ROUNDING = 1e-9  # of the largest moment: rounding of a file's digits for a lamina
MIN_MASS = 1e-6  # kg of a moving body without mass
MIN_MOMENT = 1e-9  # kg·m² of a body without inertia: above MuJoCo's mjMINVAL
NO_LIMIT = 1e6  # rad or m: a range of MuJoCo has two finite ends
STOP_STEPS = 4.0  # timesteps: time constant of joint stops and of dry friction that holds
STOP_SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)
RESERVED = "world"  # MuJoCo's own body


def body_inertia(robot: Robot, joint: int) -> tuple[Inertial, tuple[str, ...]]:
    """Return a physical inertia of what a joint carries, and sentences on what was changed.

    Args:
        robot: The robot; the inertia is its model's.
        joint: Index of the joint in the model.
    """
    head = head_link(robot, joint)
    links = [robot.description.link[name] for name, _ in robot.tree.rigid_links(head)]
    whole, said = _mended(robot.model.inertias[joint], links[0])
    sound = f'; together with the links fixed to "{head}" the inertia is physical'
    fused = tuple(
        f'link "{link.name}" (line {link.line}): {fault}{sound if len(links) > 1 else ""}'
        for link in links
        if (fault := link_fault(link))
    )
    return whole, said or fused


def link_fault(link: Link) -> str:
    """Return why a link's inertia in the file is unphysical, or nothing."""
    fault = inertia_fault(link.inertia, ROUNDING) if link.mass else ""
    return fault and f"its {fault}"


def is_physical(given: Inertial) -> bool:
    """Return whether an inertia is physical and large enough for MuJoCo."""
    least = float(np.linalg.eigvalsh(given.inertia)[0])
    sound = not inertia_fault(given.inertia, ROUNDING)
    return sound and given.mass >= MIN_MASS and least >= MIN_MOMENT


def head_link(robot: Robot, joint: int) -> str:
    """Return the link whose frame is the frame of a joint of the model."""
    known = robot.description.joint.get(robot.model.names[joint])
    return robot.description.root if joint == 1 or known is None else known.child


def _mended(carried: pin.Inertia, head: Link) -> tuple[Inertial, tuple[str, ...]]:
    """Return a physical inertia near a given one, and sentences on what was changed."""
    mass, inertia = float(carried.mass), np.array(carried.inertia)
    where = f'link "{head.name}" (line {head.line})'
    said: tuple[str, ...] = ()
    if mass < MIN_MASS:
        said += (f"{where} moves and has a mass of {mass:g} kg; {MIN_MASS:g} kg is used",)
        mass = MIN_MASS
    fault = inertia_fault(inertia, ROUNDING)
    if fault:
        second, axes = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
        kept = (axes * np.maximum(second, 0.0)) @ axes.T  # no second moment is negative
        inertia = np.trace(kept) * np.eye(3) - kept
        said += (f"{where}: its {fault}; {moments_text(inertia)} are used",)
    least = np.linalg.eigvalsh(inertia)[0]
    if least < MIN_MOMENT:
        inertia = inertia + MIN_MOMENT * np.eye(3)
        if not fault and least <= ROUNDING * MIN_MOMENT:
            said += (f"{where} has no inertia about some axis; {MIN_MOMENT:g} kg·m² is added",)
    return Inertial(mass, np.array(carried.lever), inertia), said


def body_name(link: str) -> str:
    """Return the name of a link's body: the link's, except where MuJoCo uses that name."""
    return f"{link}_link" if link == RESERVED else link


def add_bodies(spec: Any, robot: Robot, settings: ContactSettings) -> tuple[str, ...]:
    """Add a robot's bodies and joints to a spec, with a free root link; return what was changed.

    Links fixed to each other are one body, named after the first link; the others are its sites.
    """
    model, bodies = robot.model, {0: spec.worldbody}
    said: list[str] = []
    for joint in range(ROOT_JOINT, model.njoints):
        link = head_link(robot, joint)
        place = np.eye(4) if joint == ROOT_JOINT else model.jointPlacements[joint].homogeneous
        body = bodies[model.parents[joint]].add_body(name=body_name(link))
        body.pos, body.quat = place[:3, 3], quaternion(place)
        bodies[joint] = body
        inertia, mended = body_inertia(robot, joint)
        inertia.put(body)
        said += mended
        if joint == ROOT_JOINT:
            body.add_freejoint()
        else:
            _add_joint(body, robot, robot.description.joint[model.names[joint]], settings)
        for name, pose in robot.tree.rigid_links(link):
            if name != link:
                body.add_site(name=name, pos=pose[:3, 3], quat=quaternion(pose))
    return tuple(said)


def add_motors(spec: Any, robot: Robot) -> None:
    """Add to each actuator's joint a motor with its name, which saturates at its limit.

    The control is the effort at the joint, N·m or N; limit and rotor inertia are those seen from
    the joint, behind the gears.
    """
    for name, limit in zip(robot.actuators, robot.effort_limits.tolist(), strict=True):
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco_library().mjtTrn.mjTRN_JOINT
        )
        motor.set_to_motor()
        motor.ctrllimited = math.isfinite(limit)
        if math.isfinite(limit):
            motor.ctrlrange = [-limit, limit]


def place_in_body(robot: Robot, link: str) -> tuple[str, Array]:
    """Return the link that names a link's body, and the pose (4, 4) of the link in that body."""
    free = robot.tree.free_joints(link)
    head = free[-1].child if free else robot.description.root
    return head, np.asarray(np.linalg.inv(robot.tree.pose(head)) @ robot.tree.pose(link))


def _add_joint(body: Any, robot: Robot, joint: Joint, settings: ContactSettings) -> None:
    kinds = mujoco_library().mjtJoint
    kind = kinds.mjJNT_SLIDE if joint.kind == "prismatic" else kinds.mjJNT_HINGE
    added = body.add_joint(name=joint.name, type=kind, axis=joint.axis)
    index = robot.velocity_index(joint.name)
    added.armature = float(robot.armature[index])
    limited = not joint.endless and math.isfinite(min(abs(joint.lower), abs(joint.upper)))
    added.limited = limited
    if limited:
        added.range = np.clip([joint.lower, joint.upper], -NO_LIMIT, NO_LIMIT)
    added.solref_limit = added.solref_friction = [STOP_STEPS * settings.timestep, 1.0]
    added.solimp_friction = STOP_SOLIMP
    if settings.losses and robot.losses is not None:
        _set_damping(added, float(robot.losses.damping[index]))
        added.frictionloss = float(robot.losses.friction[index])


def _set_damping(joint: Any, damping: float) -> None:
    """Set viscous damping; from MuJoCo 4 on it is the first coefficient of a polynomial."""
    if np.ndim(joint.damping):
        joint.damping[0] = damping
    else:
        joint.damping = damping


HOME = "home"  # name of the keyframe in which the robot stands
FREE = "_free"  # suffix of the name of the root link's joint
BASE = {
    "base_position": "framepos",
    "base_quaternion": "framequat",
    "base_velocity": "framelinvel",
    "base_turning": "frameangvel",
}
HOW = (
    "q: x and y of base_position, the heading of base_quaternion, JOINT_position. nu: the base's "
    "speeds follow from base_velocity along the heading and to its left and from the z component "
    "of base_turning, the joints' rates from JOINT_velocity. "
    "rpctl.MjcfRobot(robot, model).state(data) returns (q, nu)"
)


def sensor_parts(robot: Robot, root: str) -> list[Any]:
    """Return the elements of a file's sensors."""
    parts = [
        etree.Element(tag, {"name": name, "objtype": "xbody", "objname": root})
        for name, tag in BASE.items()
    ]
    for joint in robot.moving_joint_names:
        parts.append(etree.Element("jointpos", {"name": f"{joint}_position", "joint": joint}))
        parts.append(etree.Element("jointvel", {"name": f"{joint}_velocity", "joint": joint}))
    return parts


class MjcfRobot:
    """A robot in a model of MuJoCo that contains an exported file: its state, pose and actuators.

    Args:
        robot: The robot that was exported.
        model: ``MjModel`` of the exported file, or of a larger model that includes it.

    Raises:
        RpctlError: The model lacks a sensor, joint or actuator of the exported file.

    Example::

        model = mujoco.MjModel.from_xml_path("tiago.xml")
        data = mujoco.MjData(model)
        exported = rpctl.MjcfRobot(robot, model)
        exported.place(data)
        while data.time < 10.0:
            q, nu = exported.state(data)
            data.ctrl[exported.actuators] = controller.step(data.time, q, nu).efforts
            mujoco.mj_step(model, data, nstep=2)

    Attributes:
        actuators: Indices of the robot's actuators in ``data.ctrl`` (n_act,), in the order of
            ``robot.actuators``. Controls are efforts at the joints, N·m or N.
    """

    def __init__(self, robot: Robot, model: Any) -> None:
        self._robot, self._mujoco, self._model = robot, mujoco_library(), model
        self._places = {name: self._address(name, size) for name, size in
                        zip(BASE, (3, 4, 3, 3), strict=True)}  # fmt: skip
        joints = robot.moving_joint_names
        self._positions = [self._address(f"{name}_position", 1).start for name in joints]
        self._rates = [self._address(f"{name}_velocity", 1).start for name in joints]
        self._index = [robot.velocity_index(name) for name in joints]
        self._root = f"{body_name(robot.description.root)}{FREE}"
        self._selection = selection(robot, find_rolling(robot))
        self.actuators = [part_number(model, "actuator", name) for name in robot.actuators]

    def state(self, data: Any) -> tuple[Array, Array]:
        """Return q (nq,) and ν (dof,) from the sensors of the last ``mj_step`` or ``mj_forward``.

        Args:
            data: ``MjData`` of the model.
        """
        measured, robot = data.sensordata, self._robot
        w, *turn = measured[self._places["base_quaternion"]]
        x, y, heading = planar(np.array([*measured[self._places["base_position"]], *turn, w]))
        cos, sin = math.cos(heading), math.sin(heading)
        vx, vy, _ = measured[self._places["base_velocity"]].tolist()
        q, v = np.zeros(robot.nq), np.zeros(robot.nv)
        write_root(q, x, y, heading)
        for name, place in zip(robot.moving_joint_names, self._positions, strict=True):
            robot.set_joint(q, name, float(measured[place]))
        turning = float(measured[self._places["base_turning"]][2])
        v[:BASE_NV] = cos * vx + sin * vy, cos * vy - sin * vx, turning
        v[self._index] = measured[self._rates]
        return q, np.asarray(self._selection @ v)

    def place(self, data: Any, q: Array | None = None) -> None:
        """Reset ``data`` to the file's keyframe, in which the robot stands at rest; then set q.

        The root link keeps the height of the keyframe.

        Args:
            data: ``MjData`` of the model.
            q: Configuration (nq,); None: the keyframe's, at home at the origin.

        Raises:
            RpctlError: The model has no such keyframe.
        """
        self._mujoco.mj_resetDataKeyframe(self._model, data, part_number(self._model, "key", HOME))
        if q is not None:
            x, y, heading = read_root(q)
            free = data.joint(self._root)
            free.qpos[:2] = x, y
            free.qpos[3:7] = math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)
            for name in self._robot.moving_joint_names:
                data.joint(name).qpos[0] = self._robot.joint_position(q, name)
        self._mujoco.mj_forward(self._model, data)

    def _address(self, name: str, size: int) -> slice:
        index = part_number(self._model, "sensor", name)
        start = int(self._model.sensor_adr[index])
        if int(self._model.sensor_dim[index]) != size:
            raise RpctlError(
                f'sensor "{name}" does not have {size} numbers; export the robot again'
            )
        return slice(start, start + size)
