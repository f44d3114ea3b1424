"""What holds a robot in MuJoCo beside contacts: tie rods, and rollers that hold one way only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.drive.steering import follower_positions
from rpctl.libraries import library
from rpctl.robot.model import Robot

TIE_ROD_BANDWIDTH = 300.0  # rad/s
DIFFERENCE_STEP = 1e-6  # rad, of a difference quotient
ROLLER_FRICTION = (
    1e-5  # friction along which a roller runs, or a ball slides: the least MuJoCo takes
)


class TieRods:
    """Springs that hold the swivels that follow others to their places.

    Args:
        robot: The robot.
        model: Its ``MjModel``, on a free root.
        data: Its ``MjData``.
        dofs: Index in qvel of the moving joints; in qpos it is one more.
        bandwidth: Of each spring, against the inertia of the swivel that it turns, rad/s;
            None: as hard as small steps allow.

    Attributes:
        inertia: Of each follower about its axis, once it is measured, kg·m².
    """

    def __init__(
        self,
        robot: Robot,
        model: Any,
        data: Any,
        dofs: Mapping[str, int],
        bandwidth: float | None = None,
    ) -> None:
        self._robot, self._model, self._data, self._dofs = robot, model, data, dofs
        self._bandwidth = TIE_ROD_BANDWIDTH if bandwidth is None else bandwidth
        self.inertia: dict[str, float] = {}

    def measure(self) -> None:
        """Measure what each follower weighs about its axis, where the robot is now."""
        followers = self._robot.drive.followers
        if followers:
            M = np.zeros((self._model.nv, self._model.nv))
            library("mujoco").mj_fullM(self._model, self._data, M)
            dofs = {swivel.joint: self._dofs[swivel.joint] for swivel in followers}
            self.inertia = {name: float(M[dof, dof]) for name, dof in dofs.items()}

    def pull(self) -> None:
        """Pull each swivel that follows towards its place, and those that it follows back.

        A tie rod is a spring and a damper on φ = δ − f(leaders), so it does no work but on φ:
        the follower feels −(k φ + d φ̇), the leaders ∂f/∂δ times the opposite.
        """
        drive, data = self._robot.drive, self._data
        if not drive.followers:
            return
        leaders = {swivel.joint: self._joint(swivel.joint) for swivel in drive.steered}
        at = {name: position for name, (position, _) in leaders.items()}
        place = follower_positions(drive, at)
        perturbed = {
            name: follower_positions(drive, at | {name: at[name] + DIFFERENCE_STEP}) for name in at
        }
        for swivel in drive.followers:
            name, jacobian = swivel.joint, {}
            position, rate = self._joint(name)
            for leader in at:
                jacobian[leader] = (perturbed[leader][name] - place[name]) / DIFFERENCE_STEP
                rate -= jacobian[leader] * leaders[leader][1]
            inertia = self.inertia[name]
            pull = (
                inertia
                * self._bandwidth
                * (self._bandwidth * (position - place[name]) + 2.0 * rate)
            )
            data.qfrc_applied[self._dofs[name]] -= pull
            for leader, derivative in jacobian.items():
                data.qfrc_applied[self._dofs[leader]] += derivative * pull

    def _joint(self, name: str) -> tuple[float, float]:
        dof = self._dofs[name]
        return float(self._data.qpos[dof + 1]), float(self._data.qvel[dof])


class Rollers:
    """Wheels that the ground holds in one direction only: rollers and balls.

    Args:
        robot: The robot.
        model: Its ``MjModel``.
        data: Its ``MjData``.
        geoms: Index of the geom of each wheel that touches at one point, by the wheel's joint.
        friction: Coefficient along the direction that is held.

    Attributes:
        geoms: The wheels of which there is something to do, by the index of their geom.
    """

    def __init__(
        self, robot: Robot, model: Any, data: Any, geoms: Mapping[str, int], friction: float
    ) -> None:
        self._robot, self._model, self._data = robot, model, data
        self._friction = friction
        wheels = {wheel.joint: wheel for wheel in robot.drive.wheels}
        self.geoms: dict[int, Wheel] = {
            geom: wheels[name]
            for name, geom in geoms.items()
            if one_directional(robot, wheels[name])
        }

    def turn(self) -> None:
        """Turn the contacts of rollers and balls: friction holds along one direction only."""
        contacts = self._data.contact
        frames, friction = contacts.frame, contacts.friction
        for k, geom in enumerate(contacts.geom2.tolist()):
            wheel = self.geoms.get(geom)
            if wheel is None:
                continue
            (nx, ny, nz), (x, y, _) = frames[k, :3].tolist(), self.held(wheel).tolist()
            frames[k, 3:] = x, y, 0.0, -nz * y, nz * x, nx * y - ny * x  # n × held
            friction[k, :2] = self._friction, ROLLER_FRICTION

    def held(self, wheel: Wheel) -> Array:
        """Return the direction (3,) in which the ground holds a wheel, level, world.

        It is the drive's angle off the wheel's rolling direction, which MuJoCo's axle gives.
        """
        axle = self._data.xaxis[self._model.joint(wheel.joint).id]
        ahead = np.array([axle[1], -axle[0], 0.0]) / math.hypot(axle[0], axle[1])
        x, y = _off_rolling(self._robot, wheel)
        return np.array([x * ahead[0] - y * ahead[1], x * ahead[1] + y * ahead[0], 0.0])


def one_directional(robot: Robot, wheel: Wheel) -> bool:
    """Return whether the ground holds a wheel in one direction only."""
    return wheel.slides or robot.drive.type in ("mecanum", "omni")


def _off_rolling(robot: Robot, wheel: Wheel) -> tuple[float, float]:
    """Return the direction in which a wheel is held, seen from its rolling direction (2,)."""
    axle = robot.tree.axis(robot.description.joint[wheel.joint])
    ahead = np.array([axle[1], -axle[0]]) / math.hypot(axle[0], axle[1])
    x, y = wheel.direction
    return float(ahead[0] * x + ahead[1] * y), float(ahead[0] * y - ahead[1] * x)
