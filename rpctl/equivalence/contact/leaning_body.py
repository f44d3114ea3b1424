"""A robot that leans in MuJoCo: where its free root link is, how it moves, and how its tyres touch.

A tyre is an ellipsoid about the axle with half axes r, r and √(ρ r): upright, its profile has the
radius ρ of the tyre's section there, and leaning by φ its lowest point is as high as a torus' but
for (1 − ρ/r) ρ φ⁴/8. A cylinder would stand on its edge, and a thin disc is a limit of both.
"""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.equivalence.contact.mujoco_body import MujocoBody
from rpctl.robot.leaning import FREE_NQ, FREE_NV, LeaningRobot

MIN_HALF_WIDTH_M = 1e-3  # m, of a disc: it touches within 1e-3 of that beside its rim's middle


def half_width(wheel: Wheel) -> float:
    """Return the third half axis of the ellipsoid that stands for a wheel's tyre, m."""
    return max(math.sqrt(wheel.tyre * wheel.radius), MIN_HALF_WIDTH_M)


class LeaningBody(MujocoBody):
    """What a body in MuJoCo does of its own where its root link pitches, rolls and rises."""

    robot: LeaningRobot

    def put(self, q: Array, height: float) -> None:
        """Put the robot at q (nq,), at rest, over a ground of a height (m)."""
        self.mujoco.mj_resetData(self.mjm, self.data)
        self.data.qpos[self.root_place] = [*q[:2], q[2] + height, q[6], *q[3:6]]
        self.set_joints(q)

    @property
    def q(self) -> Array:
        """Configuration (nq,): the pose of the root link as it is, then the joints."""
        q = np.empty(self.robot.nq)
        self._write_joints(q)
        q[:FREE_NQ] = self.pose
        return q

    @property
    def v(self) -> Array:
        """Velocity (nv,): the root link's in its own axes, then the joints'."""
        v, rate = np.empty(self.robot.nv), self.data.qvel[self.root_rate]
        v[:3] = self.data.xmat[self.root].reshape(3, 3).T @ rate[:3]  # MuJoCo's is the world's
        v[3:FREE_NV] = rate[3:]
        v[self._columns] = self.data.qvel[self._joints[1]]
        return v
