"""What a controller measures in MuJoCo, and how it makes q and ν.

An exported file has these sensors, each named after what it measures:

- ``base_position`` (3,) and ``base_quaternion`` (4,) w, x, y, z: pose of the root link, world;
- ``base_velocity`` (3,) and ``base_turning`` (3,): velocity of the root link's origin (m/s), and
  its angular velocity (rad/s), along the world's axes;
- ``JOINT_position`` and ``JOINT_velocity``: each moving joint's, rad or m, rad/s or m/s.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from lxml import etree

from rpctl.arrays import Array
from rpctl.dynamics.rolling import find_rolling, selection
from rpctl.engines.mujoco.bodies import body_name
from rpctl.equivalence.contact.mujoco_body import mujoco_library, part_number, planar
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import read_root, write_root
from rpctl.robot.model import BASE_NV, Robot

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
