"""``MujocoWorld``: a robot that moves in MuJoCo, and what can be read of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.engines.mujoco.bodies import body_name
from rpctl.engines.mujoco.build import Built
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.ties import Follower, linearised
from rpctl.errors import DivergedError
from rpctl.robot.coordinates import write_root
from rpctl.robot.model import BASE_NV, Robot

FREE_NV = 6  # entries of qvel that are the root link's
HELD = 1e6  # kg·m² or kg: armature of joints that are held while the robot sinks into its contacts
SETTLING_S = 2.0  # s that it may take to come to rest
AT_REST = 1e-6  # m/s and rad/s: slower is at rest
STEP_ROUNDING = 1e-9  # of a step: a stretch that much longer takes no further one


class MujocoWorld:
    """A robot in MuJoCo, and its state.

    After each call positions, velocities and contacts are those of the present instant.

    Args:
        robot: The robot.
        built: It in MuJoCo.

    Attributes:
        model: The ``MjModel``.
        data: The ``MjData``.
    """

    def __init__(self, robot: Robot, built: Built) -> None:
        self._mujoco = mujoco_library()
        self._robot, self._built = robot, built
        self.model: Any = built.compile()
        self.data: Any = self._mujoco.MjData(self.model)
        self._timestep = float(self.model.opt.timestep)
        self.model.opt.disableflags |= int(self._mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.root = int(self.model.body(body_name(robot.description.root)).id)
        self._joints = _JointMap(robot, self.model)
        self._motors = np.array([self.model.actuator(name).trnid[0] for name in robot.actuators])
        index = {name: k for k, name in enumerate(built.contacts)}
        self._contact_of = {
            int(self.model.geom(geom).id): index[name] for geom, name in built.geoms.items()
        }
        self._wheels = [_WheelFrame(robot, wheel, self.model) for wheel in robot.drive.wheels]
        self._ties = [_Tie(robot, follower, self.model) for follower in built.followers]
        self._links: dict[str, tuple[int, int]] = {}
        self._settled: Array | None = None

    def place(self, q: Array, height: float) -> None:
        """Put the robot at q (nq,), at rest, its root link level at a ``height`` (m)."""
        data = self.data
        half = 0.5 * math.atan2(float(q[3]), float(q[2]))
        data.qpos[:3] = q[0], q[1], height
        data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
        data.qpos[self._joints.qpos] = self._joints.positions(q)
        data.qvel[:], data.ctrl[:], data.xfrc_applied[:] = 0.0, 0.0, 0.0
        data.qacc_warmstart[:] = 0.0
        self._mujoco.mj_step1(self.model, data)

    def settle(self) -> float:
        """Let the robot sink into its contacts, all joints held; return how long it took, s."""
        model, data = self.model, self.data
        armature, flags = model.dof_armature.copy(), int(model.opt.disableflags)
        off = self._mujoco.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_LIMIT) | int(off.mjDSBL_EQUALITY)
        model.dof_armature[FREE_NV:] += HELD
        model.opt.timestep = self._timestep
        self._mujoco.mj_step1(model, data)  # with these
        start, planar = data.time, self.q
        while data.time - start < SETTLING_S:
            self._step(20)
            if np.abs(data.qvel[:FREE_NV]).max() < AT_REST:
                break
        self._settled = self.loads()
        model.dof_armature[:], model.opt.disableflags = armature, flags
        took, data.time, data.qvel[:] = float(data.time - start), start, 0.0
        self._return(planar)
        self._mujoco.mj_step1(model, data)
        return took

    def _return(self, q: Array) -> None:
        """Put the robot back to where it stood at q (nq,) seen from above, joints included."""
        data, now = self.data, self.q
        turn = math.atan2(q[3] * now[2] - q[2] * now[3], q[2] * now[2] + q[3] * now[3])
        turned = np.zeros(4)
        half = np.array([math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)])
        self._mujoco.mju_mulQuat(turned, half, data.qpos[3:7])
        data.qpos[:2], data.qpos[3:7] = q[:2], turned
        data.qpos[self._joints.qpos] = self._joints.positions(q)

    def advance(self, tau: Array, dt: float) -> float:
        """Advance under constant efforts for ``dt`` (s); return their work, J.

        Args:
            tau: Actuator efforts (n_act,), N·m or N; the motors saturate at their limits.
            dt: For how long: it is divided into equal steps.

        Raises:
            DivergedError: The state left the finite numbers.
        """
        data = self.data
        steps = max(1, math.ceil(dt / self._timestep - STEP_ROUNDING))
        self.model.opt.timestep = dt / steps
        for tie in self._ties:
            tie.update(data)
        before = data.qpos[self.model.jnt_qposadr[self._motors]]
        data.ctrl[:], self._settled = tau, None
        self._step(steps)
        moved = data.qpos[self.model.jnt_qposadr[self._motors]] - before
        return float(data.actuator_force @ moved)

    def push(self, link: str, force: Sequence[float], moment: Sequence[float]) -> None:
        """Push a link until :meth:`release`; pushes add up.

        Args:
            link: The link.
            force: At its origin (3,), world, N.
            moment: (3,), world, N·m.
        """
        body, _ = self._place_of(link)
        arm = self.origin(link) - self.data.xipos[body]
        self.data.xfrc_applied[body, :3] += force
        self.data.xfrc_applied[body, 3:] += np.asarray(moment) + np.cross(arm, force)

    def release(self) -> None:
        """End all pushes."""
        self.data.xfrc_applied[:] = 0.0

    def origin(self, link: str) -> Array:
        """Return where a link's origin is (3,), world, m."""
        body, site = self._place_of(link)
        at = self.data.xpos[body] if site < 0 else self.data.site_xpos[site]
        return np.array(at)

    def velocity(self, link: str) -> Array:
        """Return the velocity (6,) of a link: of its origin (m/s), then angular (rad/s); world."""
        body, site = self._place_of(link)
        kinds, found = self._mujoco.mjtObj, np.zeros(6)
        kind, index = (kinds.mjOBJ_XBODY, body) if site < 0 else (kinds.mjOBJ_SITE, site)
        self._mujoco.mj_objectVelocity(self.model, self.data, kind, index, found, 0)
        return np.concatenate([found[3:], found[:3]])

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w."""
        return np.array(self.data.qpos[[0, 1, 2, 4, 5, 6, 3]])

    @property
    def q(self) -> Array:
        """Configuration (nq,) seen from above."""
        found = np.zeros(self._robot.nq)
        x, y, _, qw, qx, qy, qz = self.data.qpos[:7].tolist()
        turn = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        write_root(found, x, y, turn)
        self._joints.write(found, self.data.qpos[self._joints.qpos])
        return found

    @property
    def v(self) -> Array:
        """Velocity (nv,) seen from above: the root link's along its heading, then the joints'."""
        found, data = np.empty(self._robot.nv), self.data
        R = data.xmat[self.root].reshape(3, 3)
        size = math.hypot(R[0, 0], R[1, 0])
        cos, sin = R[0, 0] / size, R[1, 0] / size
        x, y = data.qvel[:2].tolist()
        found[:BASE_NV] = cos * x + sin * y, cos * y - sin * x, R[2] @ data.qvel[3:6]
        found[self._joints.v] = data.qvel[self._joints.dof]
        return found

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, J."""
        self._mujoco.mj_energyPos(self.model, self.data)
        self._mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum())

    @property
    def tilt(self) -> float:
        """How far the root link leans out of the level, rad."""
        return math.acos(min(1.0, float(self.data.xmat[self.root, 8])))

    def loads(self) -> Array:
        """Return the load of each contact (n,), N, under the efforts and pushes that act now."""
        if self._settled is not None:  # efforts that hold the joints are not known yet
            return self._settled.copy()
        mujoco, model, data = self._mujoco, self.model, self.data
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        load, wrench = np.zeros(len(self._built.contacts)), np.zeros(6)
        for k, (one, other) in enumerate(data.contact.geom.tolist()):
            contact = self._contact_of.get(other, self._contact_of.get(one))
            if contact is not None:
                mujoco.mj_contactForce(model, data, k, wrench)
                load[contact] += wrench[0]
        return load

    def slips(self) -> Array:
        """Return the velocity of each wheel's lowest point (n_wheels, 2): along it, to its left."""
        return np.array([wheel.slip(self) for wheel in self._wheels]).reshape(-1, 2)

    def _step(self, steps: int) -> None:
        mujoco, model, data = self._mujoco, self.model, self.data
        known = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(_quiet)  # else MuJoCo writes to stderr, and a file
        try:
            mujoco.mj_step2(model, data)
            if steps > 1:
                mujoco.mj_step(model, data, steps - 1)
            mujoco.mj_step1(model, data)
        finally:
            mujoco.set_mju_user_warning(known)
        warned = mujoco.mjtWarning
        bad = ("QPOS", "QVEL", "QACC", "CTRL")
        if any(data.warning[int(getattr(warned, f"mjWARN_BAD{kind}"))].number for kind in bad):
            raise DivergedError(
                f"the motion in MuJoCo diverged at {data.time:.3f} s; shorten the timestep of "
                "[plant.contact], or lengthen the controller's horizons"
            )

    def _place_of(self, link: str) -> tuple[int, int]:
        """Return a link's body, and its site or -1 where its frame is the body's."""
        if link not in self._links:
            site = self._mujoco.mj_name2id(self.model, self._mujoco.mjtObj.mjOBJ_SITE, link)
            if site < 0:
                self._links[link] = int(self.model.body(body_name(link)).id), -1
            else:
                self._links[link] = int(self.model.site_bodyid[site]), int(site)
        return self._links[link]


def _quiet(message: str) -> None:
    """Take a warning; what matters of it is counted in the ``MjData``."""


class _JointMap:
    """Where the joints stand in q and v, and in MuJoCo's qpos and qvel."""

    def __init__(self, robot: Robot, model: Any) -> None:
        names = robot.moving_joint_names
        entries = [robot.entries[name] for name in names]
        ids = [int(model.joint(name).id) for name in names]
        self.qpos = np.array(model.jnt_qposadr[ids], dtype=int)
        self.dof = np.array(model.jnt_dofadr[ids], dtype=int)
        self.v = np.array([robot.velocity_index(name) for name in names], dtype=int)
        self._index = np.array([entry.index for entry in entries], dtype=int)
        self._pair = np.array([entry.is_pair for entry in entries], dtype=bool)

    def positions(self, q: Array) -> Array:
        """Return the joints' positions (K,), rad or m, at q (nq,)."""
        found = q[self._index]
        pairs = self._index[self._pair]
        found[self._pair] = np.arctan2(q[pairs + 1], q[pairs])
        return found

    def write(self, q: Array, positions: Array) -> None:
        """Set the joints' positions (K,) in q (nq,), in place."""
        q[self._index] = positions
        pairs, angles = self._index[self._pair], positions[self._pair]
        q[pairs], q[pairs + 1] = np.cos(angles), np.sin(angles)


class _Tie:
    """A follower's tie, linearised where the swivels that lead it stand."""

    def __init__(self, robot: Robot, follower: Follower, model: Any) -> None:
        self._drive, self._follower, self._model = robot.drive, follower, model
        self._qpos = int(model.joint(follower.joint).qposadr[0])
        self._leaders = [int(model.joint(name).qposadr[0]) for name in follower.leaders]
        self._equality = int(model.equality(follower.tie).id)
        first = int(model.tendon_adr[model.tendon(follower.tie).id])
        self._wraps = slice(first + 1, first + 1 + len(follower.leaders))

    def update(self, data: Any) -> None:
        """Let it follow the leaders from where they are; heading back is heading along."""
        at = data.qpos[self._leaders]
        angles = dict(zip(self._follower.leaders, at.tolist(), strict=True))
        place, jacobian = linearised(self._drive, self._follower, angles)
        place += math.pi * round((float(data.qpos[self._qpos]) - place) / math.pi)
        self._model.wrap_prm[self._wraps] = -jacobian
        self._model.eq_data[self._equality, 0] = place - jacobian @ at


class _WheelFrame:
    """A wheel's axle and the way it rolls."""

    def __init__(self, robot: Robot, wheel: Wheel, model: Any) -> None:
        joint = robot.description.joint[wheel.joint]
        self._link, self._radius = joint.child, wheel.radius
        self._body = int(model.body(body_name(joint.child)).id)
        self._axis, self._offset = np.array(wheel.axis), wheel.offset
        axle = robot.tree.pose(joint.child)[:3, :3] @ self._axis
        heading = robot.drive.heading
        for swivel in robot.drive.swivels:
            if swivel.joint == wheel.swivel:
                heading = swivel.heading
        ahead = axle[1] * math.cos(heading) - axle[0] * math.sin(heading)
        self._sign = -1.0 if ahead < -1e-9 else 1.0

    def slip(self, world: MujocoWorld) -> tuple[float, float]:
        """Return the velocity of its lowest point along its rolling and to its left, m/s."""
        R = world.data.xmat[self._body].reshape(3, 3)
        axle = self._sign * (R @ self._axis)
        down = axle[2] * axle - np.array([0.0, 0.0, 1.0])
        down /= np.linalg.norm(down)
        velocity = world.velocity(self._link)
        arm = self._offset * (R @ self._axis) + self._radius * down
        x, y, _ = (velocity[:3] + np.cross(velocity[3:], arm)).tolist()
        size = math.hypot(axle[0], axle[1])
        cos, sin = axle[1] / size, -axle[0] / size
        return cos * x + sin * y, cos * y - sin * x
