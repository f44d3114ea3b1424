"""``MujocoWorld``: a robot that moves in MuJoCo, and what can be read of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.engine import LinkMotion, wheel_slips
from rpctl.engines.mujoco.bodies import body_name
from rpctl.engines.mujoco.build import Built
from rpctl.equivalence.contact.mujoco_body import MujocoBody, muted
from rpctl.errors import DivergedError
from rpctl.robot.model import Robot

HELD = 1e6  # kg·m² or kg: armature of joints that are held while the robot sinks into its contacts
SETTLING_S = 2.0  # s that it may take to come to rest
AT_REST = 1e-6  # m/s and rad/s: slower is at rest
STEP_ROUNDING = 1e-9  # of a step: a stretch that much longer takes no further one


class MujocoWorld(MujocoBody):
    """A robot in MuJoCo, and its state.

    After each call positions, velocities and contacts are those of the present instant.
    """

    def __init__(self, robot: Robot, built: Built) -> None:
        root = body_name(robot.description.root)
        super().__init__(robot, built.compile(), root, built.contacts, built.geoms)
        self._timestep = float(self.mjm.opt.timestep)
        self._motors = np.array([self.mjm.actuator(name).trnid[0] for name in robot.actuators])
        self._tied = bool(built.followers)
        self._links: dict[str, tuple[int, int]] = {}
        self._settled: Array | None = None

    def place(self, q: Array, height: float) -> None:
        """Put the robot at q (nq,), at rest, its root link level at a ``height`` (m)."""
        self.put(q, height)
        self.mujoco.mj_step1(self.mjm, self.data)
        if self._tied:
            self.tie()

    def settle(self) -> None:
        """Let the robot sink into its contacts, all joints held."""
        model, data = self.mjm, self.data
        armature, flags = model.dof_armature.copy(), int(model.opt.disableflags)
        off = self.mujoco.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_LIMIT) | int(off.mjDSBL_EQUALITY)
        model.dof_armature[self.root_rate.stop :] += HELD
        model.opt.timestep = self._timestep
        self.mujoco.mj_step1(model, data)  # with these
        start, seen = data.time, self.q
        while data.time - start < SETTLING_S:
            self._step(20)
            if np.abs(data.qvel[self.root_rate]).max() < AT_REST:
                break
        self._settled = self.loads()
        model.dof_armature[:], model.opt.disableflags = armature, flags
        data.time, data.qvel[:] = start, 0.0
        self._return(seen)
        self.mujoco.mj_step1(model, data)

    def _return(self, q: Array) -> None:
        """Put the robot back to where it stood at q (nq,) seen from above, joints included."""
        data, now = self.data, self.q
        turn = math.atan2(q[3] * now[2] - q[2] * now[3], q[2] * now[2] + q[3] * now[3])
        turned = np.zeros(4)
        half = np.array([math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)])
        self.mujoco.mju_mulQuat(turned, half, data.qpos[3:7])
        data.qpos[:2], data.qpos[3:7] = q[:2], turned
        self.set_joints(q)

    def run(self, tau: Array, dt: float) -> float:
        """Advance under constant efforts for ``dt`` (s); return their work, J.

        Args:
            tau: Actuator efforts (n_act,), N·m or N; the motors saturate at their limits.
            dt: For how long: it is divided into equal steps.

        Raises:
            DivergedError: The state left the finite numbers.
        """
        data = self.data
        steps = max(1, math.ceil(dt / self._timestep - STEP_ROUNDING))
        self.mjm.opt.timestep = dt / steps
        before = self.places
        data.ctrl[:], self._settled = tau, None
        self._step(steps)
        return float(data.actuator_force @ (self.places - before))

    @property
    def places(self) -> Array:
        """Where the actuators' joints are (n_act,), rad or m."""
        return np.array(self.data.qpos[self.mjm.jnt_qposadr[self._motors]])

    def serve(self, stiffness: Array, damping: Array) -> None:
        """Give the joints servos in the place of motors, with the motors' limits.

        From then on :meth:`run` takes where they are to be (n_act,), rad or m.

        Args:
            stiffness: Of each actuator (n_act,), N·m/rad or N/m.
            damping: Likewise, N·m s/rad or N s/m.
        """
        model, limits = self.mjm, self.robot.effort_limits
        model.actuator_ctrllimited[:], model.actuator_forcelimited[:] = 0, np.isfinite(limits)
        model.actuator_forcerange[:] = np.where(np.isfinite(limits), limits, 0.0)[:, None] * [-1, 1]
        model.actuator_biastype[:] = int(self.mujoco.mjtBias.mjBIAS_AFFINE)
        model.actuator_gainprm[:, 0] = stiffness
        model.actuator_biasprm[:, 1:3] = -np.stack([stiffness, damping], axis=1)

    def push(self, link: str, force: Sequence[float], moment: Sequence[float]) -> None:
        """Push a link until :meth:`release`; pushes add up.

        Args:
            link: The link.
            force: At its origin (3,), world, N.
            moment: (3,), world, N·m.
        """
        body, _ = self._place_of(link)
        self.push_body(body, self.origin(link), np.asarray(force), np.asarray(moment))

    def release(self) -> None:
        """End all pushes."""
        self.data.xfrc_applied[:] = 0.0

    def origin(self, link: str) -> Array:
        """Return where a link's origin is (3,), world, m."""
        body, site = self._place_of(link)
        return np.array(self.data.xpos[body] if site < 0 else self.data.site_xpos[site])

    def velocity(self, link: str) -> Array:
        """Return the velocity (6,) of a link: of its origin (m/s), then angular (rad/s); world."""
        (body, site), kinds = self._place_of(link), self.mujoco.mjtObj
        return (
            self.twist(kinds.mjOBJ_XBODY, body) if site < 0 else self.twist(kinds.mjOBJ_SITE, site)
        )

    def loads(self) -> Array:
        """Return the load of each contact (n,), N, under the efforts and pushes that act now."""
        if self._settled is not None:  # efforts that hold the joints are not known yet
            return self._settled.copy()
        self.mujoco.mj_fwdActuation(self.mjm, self.data)
        self.mujoco.mj_fwdAcceleration(self.mjm, self.data)
        self.mujoco.mj_fwdConstraint(self.mjm, self.data)
        return super().loads()

    def slips(self) -> Array:
        """Return the velocity of each wheel's lowest point (n_wheels, 2): along it, to its left."""
        return wheel_slips(self.robot, self._motion)

    def _motion(self, link: str) -> LinkMotion:
        velocity, R = self.velocity(link), self.data.body(body_name(link)).xmat.reshape(3, 3)
        return LinkMotion(R, self.origin(link), velocity[:3], velocity[3:])

    def _step(self, steps: int) -> None:
        with muted():
            at_once = 1 if self.rods else steps  # rods pull anew in each step
            for _ in range(steps // at_once):
                self.data.qfrc_applied[:] = 0.0
                self.pull_rods()
                self.mujoco.mj_step2(self.mjm, self.data)
                if at_once > 1:
                    self.mujoco.mj_step(self.mjm, self.data, at_once - 1)
                self.mujoco.mj_step1(self.mjm, self.data)
        if self.diverged:
            raise DivergedError(
                f"the motion in MuJoCo diverged at {self.data.time:.3f} s; shorten the timestep of "
                "[plant.contact], or lengthen the controller's horizons"
            )

    def _place_of(self, link: str) -> tuple[int, int]:
        """Return a link's body, and its site or -1 where its frame is the body's."""
        if link not in self._links:
            site = int(self.mujoco.mj_name2id(self.mjm, self.mujoco.mjtObj.mjOBJ_SITE, link))
            fixed = site >= 0
            body = self.mjm.site_bodyid[site] if fixed else self.mjm.body(body_name(link)).id
            self._links[link] = int(body), site
        return self._links[link]
