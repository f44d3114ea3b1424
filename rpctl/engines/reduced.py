"""The reduced model behind the engines' protocol: what the others are compared with."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.wheels import mostly_left
from rpctl.dynamics.ground_reaction import Contacts, ground_reaction
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.engine import EngineState
from rpctl.robot.coordinates import read_root

SKID_NOTE = (
    "straight ahead only: a skid-steer base turns by scrubbing, which the effective track stands "
    "for in the reduced model"
)


class ReducedRun:
    """The reduced model of a robot; :class:`rpctl.engines.engine.EngineRun` has the attributes.

    Args:
        dynamics: Its dynamics.
        contacts: How it stands.
        q: Configuration at the start (nq,).
    """

    def __init__(self, dynamics: ReducedDynamics, contacts: Contacts, q: Array) -> None:
        self._dynamics, self._known = dynamics, contacts
        self._q, self._nu, self._t = q.copy(), np.zeros(dynamics.robot.dof), 0.0
        self._tau = np.zeros(len(dynamics.robot.actuators))
        robot = dynamics.robot
        self.contacts = contacts.names
        self.notes: tuple[str, ...] = (SKID_NOTE,) if robot.drive.type == "skid-steer" else ()
        self._turned = {name: robot.joint_position(q, name) for name in robot.moving_joint_names}
        axes = [robot.tree.axis(robot.description.joint[w.joint]) for w in robot.drive.wheels]
        self._left = [math.copysign(1.0, mostly_left(axis)) for axis in axes]

    def advance(self, efforts: Mapping[str, float], dt: float) -> None:
        """Hold the efforts for ``dt``; :meth:`rpctl.engines.engine.EngineRun.advance`."""
        robot = self._dynamics.robot
        self._tau = np.array([efforts.get(name, 0.0) for name in robot.actuators])
        self._q, self._nu, *_ = step(self._dynamics, self._q, self._nu, self._tau, dt)
        self._t += dt
        for name, before in self._turned.items():
            moved = robot.joint_position(self._q, name) - before
            if robot.entries[name].is_pair:
                moved = math.remainder(moved, 2.0 * math.pi)
            self._turned[name] = before + moved

    def state(self) -> EngineState:
        """Return the state now."""
        robot, dynamics, q, nu = self._dynamics.robot, self._dynamics, self._q, self._nu
        v = dynamics.basis(q) @ nu
        x, y, turn = read_root(q)
        pose = [x, y, -robot.drive.ground, 0.0, 0.0, math.sin(0.5 * turn), math.cos(0.5 * turn)]
        rates = {name: float(v[robot.velocity_index(name)]) for name in self._turned}
        return EngineState(
            t=self._t,
            pose=np.array(pose),
            joints={name: (at, rates[name]) for name, at in self._turned.items()},
            load=ground_reaction(dynamics, self._known, q, nu, self._tau).load,
            slip=self._slip(q, v),
            energy=dynamics.energy(q, nu),
        )

    def _slip(self, q: Array, v: Array) -> Array:
        """Return the velocities of the wheels' contact points, ahead and to the left, m/s."""
        robot, found = self._dynamics.robot, []
        model, data = robot.model, self._dynamics.data
        pin.forwardKinematics(model, data, q, v)
        for wheel, sign in zip(robot.drive.wheels, self._left, strict=True):
            joint = model.getJointId(wheel.joint)
            axle = sign * (data.oMi[joint].rotation @ np.array(wheel.axis))[:2]
            axle /= np.hypot(*axle)
            motion = pin.getVelocity(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            centre = data.oMi[joint].rotation @ (wheel.offset * np.array(wheel.axis))
            arm = centre - np.array([0.0, 0.0, wheel.radius])
            moving = motion.linear + np.cross(motion.angular, arm)
            found.append((moving[0] * axle[1] - moving[1] * axle[0], moving[:2] @ axle))
        return np.array(found).reshape(-1, 2)
