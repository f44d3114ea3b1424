"""The robot in MuJoCo as the trial of onsets needs it: set in motion, pushed, its slip measured."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.contact.inverse_mass import vertical_inverse_masses
from rpctl.equivalence.contact.model import SOLREF, ContactModel
from rpctl.equivalence.mujoco_model import NAME_PREFIX
from rpctl.robot.model import Robot

# MuJoCo lifts a contact that slides at v by 2 μ d T v, T its time constant and d its impedance.
# Where it stands on the ground by less than that it hops, and what hops holds less than Coulomb's
# friction. So contacts are soft here and sink by (1 − d) g T², .08 mm. What moves on a circle
# creeps by ½ d T a at an acceleration a, as MuJoCo leaves the turning of contacts out, some mm/s.
TIME_CONSTANT_S = 4e-3  # T, s
IMPEDANCE = 0.5  # d
IMPRATIO = 100.0  # how much stiffer friction is than the load: its own creep is .1 mm/s
MIN_LOAD = 5e-3  # of the weight, that a wheel bears
BRAKE = 1e6  # N·m: more than any wheel passes on
HARD = 0.9999  # impedance of a brake
UP = np.array([0.0, 0.0, 1.0])


class PushedBody(ContactModel):
    """A robot as a free body on a plane, which starts in motion and may be pushed.

    Args:
        robot: The robot.
        friction: Coefficient between wheels and ground.
        softness: Scale of the contacts' time constant.
    """

    def __init__(self, robot: Robot, friction: float, softness: float = 1.0) -> None:
        super().__init__(robot, friction)
        ground = self._model.geom_contype == 0  # all shapes but the plane
        self._model.geom_solref[ground] = softness * TIME_CONSTANT_S, 1.0
        self._model.geom_solimp[ground, :2] = IMPEDANCE
        self._model.opt.impratio = IMPRATIO
        bodies = self._model.geom_bodyid[list(self._index)]
        level = vertical_inverse_masses(self._model, self._index).mean()
        self._model.body_invweight0[bodies, 0] = level  # equally stiff, as predictions assume
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        self._wheels = [
            (int(self._model.geom(f"{NAME_PREFIX}{wheel.joint}").id), wheel.radius)
            for wheel in robot.drive.wheels
        ]
        self._settled: Array = np.zeros(0)

    def brake(self) -> None:
        """Lock the wheels that have motors: friction in their joints holds them from now on."""
        for wheel in self._robot.drive.wheels:
            if wheel.driven:
                dof = self._dofs[wheel.joint]
                self._model.dof_frictionloss[dof] = BRAKE
                self._model.dof_solref[dof], self._model.dof_solimp[dof, :2] = SOLREF, HARD

    def keep(self) -> None:
        """Remember where the robot stands now, for :meth:`set_moving`."""
        self._settled = np.array(self._data.qpos)

    def set_moving(self, v: Array) -> None:
        """Put the robot where it was kept, upright in the plane, with velocities v (nv,).

        Args:
            v: Pinocchio's velocity: of the root link in its own axes, then of the joints.
        """
        data, mujoco = self._data, self._mujoco
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = self._settled
        w, x, y, z = data.qpos[3:7]
        turn = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        cos, sin = np.cos(turn), np.sin(turn)
        data.qvel[:2] = cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]
        data.qvel[5] = v[2]
        for name, dof in self._dofs.items():
            data.qvel[dof] = v[self._robot.velocity_index(name)]
        mujoco.mj_forward(self._model, data)

    def push(self, force: Array, moment: Array) -> None:
        """Push the root link from now on.

        Args:
            force: At the origin of its frame (3,), world axes, N.
            moment: (3,), world axes, N·m.
        """
        data, root = self._data, self._root
        data.xfrc_applied[root, :3] = force  # MuJoCo takes it at the centre of mass
        lever = data.xpos[root] - data.xipos[root]
        data.xfrc_applied[root, 3:] = moment + np.cross(lever, force)

    def load(self) -> Array:
        """Return what each contact bears now (n_contacts,), N, in the order of ``names``."""
        wrench, found = np.zeros(6), np.zeros(len(self.names))
        for k, geom in enumerate(self._data.contact.geom2.tolist()):
            self._mujoco.mj_contactForce(self._model, self._data, k, wrench)
            found[self._index[int(geom)]] += wrench[0]
        return found

    def slip(self) -> Array:
        """Return how fast each wheel slides over the ground (n_wheels, 2), m/s.

        It is the velocity of the wheel's material point that lies lowest, in the wheel's plane and
        along its axle, which turn with the wheel; their signs are those of its shape. Of a roller,
        and of a wheel that may slide sideways, the first is the speed in the direction that the
        ground holds, and the other is 0. A wheel without a motor that bears nothing to speak of
        slides nowhere.
        """
        mujoco, model, data = self._mujoco, self._model, self._data
        found, twist = np.zeros((len(self._wheels), 2)), np.zeros(6)
        idle = self.load()[: len(found)] < MIN_LOAD * self._weight
        idle &= [not wheel.driven for wheel in self._robot.drive.wheels]
        for row, (geom, radius), lifted in zip(found, self._wheels, idle, strict=True):
            if lifted:
                continue
            body = int(model.geom_bodyid[geom])
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
            lowest = data.geom_xpos[geom] - radius * UP
            lever = lowest - data.xpos[body] - 0.5 * min(lowest[2], 0.0) * UP  # amid what sinks
            velocity = twist[3:] + np.cross(twist[:3], lever)
            wheel = self.rollers.geoms.get(geom)
            if wheel is not None:
                row[0] = self.rollers.held(wheel) @ velocity
                continue
            x, y, _ = data.geom_xmat[geom].reshape(3, 3)[:, 2]  # the axle
            row[:] = np.array([[y, -x], [x, y]]) @ velocity[:2] / np.hypot(x, y)
        return found
