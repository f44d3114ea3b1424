"""The tree of bodies, one for each joint of the model: inertias that MuJoCo takes, motors, losses.

A body's second moments Σ = ∫ r rᵀ dm about its centre of mass are ½ tr(I) 1 − I. A real body has
none that is negative, which is the rule that each moment of inertia is at most the sum of the other
two. What moves as one body is summed up before it is judged: a link that is unphysical alone often
stands for a part of a sound whole.

What a controller measures of them are sensors, and q and ν are made of these.
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

ROUNDING = 1e-9  # of the largest moment: a file's figures meet the rule of a lamina so well
MIN_MASS = 1e-6  # kg of a body that weighs nothing and moves
MIN_MOMENT = 1e-9  # kg·m² of one that has no inertia: above MuJoCo's mjMINVAL
NO_LIMIT = 1e6  # rad or m: MuJoCo has no range that is open on one side
STOP_STEPS = 4.0  # timesteps: time constant of joint stops and of dry friction that holds
STOP_SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)
RESERVED = "world"  # MuJoCo's own body


def body_inertia(robot: Robot, joint: int) -> tuple[Inertial, tuple[str, ...]]:
    """Return the inertia of what a joint carries, mended, and the sentences that say how.

    Args:
        robot: The robot; the inertia is its model's.
        joint: Index of the joint in the model.
    """
    head = head_link(robot, joint)
    links = [robot.description.link[name] for name, _ in robot.tree.rigid_links(head)]
    whole, said = _mended(robot.model.inertias[joint], links[0])
    sound = f'; as one body with the links fixed to "{head}" it is sound, and so it moves'
    fused = tuple(
        f'link "{link.name}" (line {link.line}): {fault}{sound if len(links) > 1 else ""}'
        for link in links
        if (fault := link_fault(link))
    )
    return whole, said or fused


def link_fault(link: Link) -> str:
    """Return why no body has the inertia that a file gives a link, or nothing."""
    fault = inertia_fault(link.inertia, ROUNDING) if link.mass else ""
    return fault and f"its {fault}"


def is_physical(given: Inertial) -> bool:
    """Return whether some body may have an inertia, and MuJoCo lets it move."""
    least = float(np.linalg.eigvalsh(given.inertia)[0])
    sound = not inertia_fault(given.inertia, ROUNDING)
    return sound and given.mass >= MIN_MASS and least >= MIN_MOMENT


def head_link(robot: Robot, joint: int) -> str:
    """Return the link whose frame is that of a joint of the model."""
    known = robot.description.joint.get(robot.model.names[joint])
    return robot.description.root if joint == 1 or known is None else known.child


def _mended(carried: pin.Inertia, head: Link) -> tuple[Inertial, tuple[str, ...]]:
    """Return a physical inertia near one that is given, and what was changed."""
    mass, inertia = float(carried.mass), np.array(carried.inertia)
    where = f'link "{head.name}" (line {head.line})'
    said: tuple[str, ...] = ()
    if mass < MIN_MASS:
        said += (f"{where} moves and weighs {mass:g} kg; it gets {MIN_MASS:g} kg",)
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
    """Return what the body of a link is called: as the link, but for MuJoCo's own name."""
    return f"{link}_link" if link == RESERVED else link


def add_bodies(spec: Any, robot: Robot, settings: ContactSettings) -> tuple[str, ...]:
    """Add a robot's bodies and joints to a spec, its root link free; return what was mended.

    Links fixed to one another are one body, named after the first; the others are sites of it.
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
    """Add a motor to each actuator's joint, saturating at its limit, named after it.

    Its control is the effort at the joint, N·m or N: a gear is in the limit and in the rotor's
    inertia, seen from there.
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
    """Return the link after which a link's body is named, and the pose (4, 4) of the link in it."""
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


HOME = "home"  # the keyframe in which a file's robot stands
FREE = "_free"  # ends the name of the root link's joint
BASE = {
    "base_position": "framepos",
    "base_quaternion": "framequat",
    "base_velocity": "framelinvel",
    "base_turning": "frameangvel",
}
HOW = (
    "q: x, y of base_position, heading of base_quaternion, JOINT_position; nu: base_velocity along "
    "the heading and to its left and the z of base_turning make the speeds of the base, "
    "JOINT_velocity the rates of the joints; rpctl.MjcfRobot(robot, model).state(data) returns "
    "(q, nu)"
)


def sensor_parts(robot: Robot, root: str) -> list[Any]:
    """Return the sensors of a file."""
    parts = [
        etree.Element(tag, {"name": name, "objtype": "xbody", "objname": root})
        for name, tag in BASE.items()
    ]
    for joint in robot.moving_joint_names:
        parts.append(etree.Element("jointpos", {"name": f"{joint}_position", "joint": joint}))
        parts.append(etree.Element("jointvel", {"name": f"{joint}_velocity", "joint": joint}))
    return parts


class MjcfRobot:
    """The robot in an exported file: its stand, its state as a controller takes it, its motors.

    Args:
        robot: The robot that was exported.
        model: ``MjModel`` of the file, alone or among other things.

    Raises:
        RpctlError: A sensor is not there.

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
        actuators: Places of the robot's actuators in ``data.ctrl`` (n_act,).
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
        """Return q (nq,) and ν (dof,), as measured at the last step or ``mj_forward``.

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
        """Put the robot at rest into the stand of the file's keyframe, and there to q.

        Args:
            data: ``MjData`` of the model.
            q: Configuration (nq,); None: at the origin, at home.
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
            raise RpctlError(f'sensor "{name}" has no {size} numbers; export the robot again')
        return slice(start, start + size)
