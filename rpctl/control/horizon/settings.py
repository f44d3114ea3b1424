"""Settings of the horizon law: its steps, the weights of its cost, the bounds of its motions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices, Model
from rpctl.control.obstacles import Obstacle
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import RpctlError, require_positive
from rpctl.robot.model import Robot

MAX_STEPS = 500  # memory grows with their square: .1 GB for a mobile manipulator


@dataclass(frozen=True)
class Weights:
    """Weights of squared errors at each step, SI units.

    Attributes:
        position: Of the base's position.
        heading: Of the base's heading.
        joints: Of the arm's positions.
        steering: Of the steered joints' positions; little, as they serve the base's.
        end_effector: Of the end effector's position.
        rates: Of ν.
        accelerations: Of ν̇.
    """

    position: float = 300.0
    heading: float = 20.0
    joints: float = 50.0
    steering: float = 1.0
    end_effector: float = 200.0
    rates: float = 2.0
    accelerations: float = 0.05

    def __post_init__(self) -> None:
        """Refuse weights that leave the cost without a minimum."""
        for name, value in vars(self).items():
            require_positive(name, value)


@dataclass(frozen=True)
class Bounds:
    """Limits that no URDF holds, and how near to all limits a predicted motion may come.

    Attributes:
        base_acceleration: Largest acceleration of the base forward and to the left, m/s².
        base_turning: Largest angular acceleration of the base, rad/s².
        catch_up: How much faster than its reference the base may drive, m/s.
        rise: Time in which a joint may reach its velocity limit, s.
        joint_acceleration: Largest acceleration of joints without one, rad/s² or m/s².
        share: Fraction of the URDF's speed and effort limits that a motion may use.
        tip_margin: Least distance of the zero-moment point to the support polygon's edge, m.
        grip: Fraction of each wheel's grip that a motion may use.
        friction: Coefficient between wheels and ground.
    """

    base_acceleration: float = 2.0
    base_turning: float = 4.0
    catch_up: float = 0.5
    rise: float = 0.25
    joint_acceleration: float = 10.0
    share: float = 0.97
    tip_margin: float = 0.01
    grip: float = 0.95
    friction: float = FRICTION

    def __post_init__(self) -> None:
        """Refuse bounds that leave nothing."""
        for name, value in vars(self).items():
            require_positive(name, value)

    def accelerations(self, model: Model) -> Array:
        """Return the largest |ν̇| (dof,)."""
        base = np.where(is_turning(model), self.base_turning, self.base_acceleration)
        limits = np.array([joint.velocity for joint in model.joints])
        joints = np.where(np.isfinite(limits), limits / self.rise, self.joint_acceleration)
        return np.concatenate([base, joints])

    def efforts(self, robot: Robot) -> tuple[Indices, Array]:
        """Return the indices (k,) of the actuators with an effort limit, and the bounds (k,)."""
        return self._limited(robot.effort_limits)

    def rates(self, robot: Robot) -> tuple[Indices, Array]:
        """Return the indices (k,) of the actuators with a velocity limit, and the bounds (k,)."""
        return self._limited(robot.velocity_limits)

    def _limited(self, limits: Array) -> tuple[Indices, Array]:
        found = np.flatnonzero(np.isfinite(limits))
        return found, self.share * limits[found]


@dataclass(frozen=True)
class PlannerSettings:
    """What the horizon law plans: see :class:`~rpctl.control.horizon.law.Horizon`."""

    steps: int = 20
    dt: float = 0.1
    period: float = 0.02
    weights: Weights = field(default_factory=Weights)
    bounds: Bounds = field(default_factory=Bounds)
    base_obstacles: tuple[Obstacle, ...] = ()
    end_effector_obstacles: tuple[Obstacle, ...] = ()
    base_radius: float | None = None
    end_effector_radius: float = 0.05
    leash: float = 0.3
    body_clearance: float | None = None

    def __post_init__(self) -> None:
        """Refuse settings that predict nothing."""
        for name in ("dt", "period", "end_effector_radius", "leash"):
            require_positive(name, getattr(self, name))
        for name in ("base_radius", "body_clearance"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        if not 2 <= self.steps <= MAX_STEPS:
            raise RpctlError(f"steps is {self.steps}; give 2 to {MAX_STEPS}")
        if self.period > self.dt:
            raise RpctlError(
                f"period {self.period:g} s is longer than a step; give at most {self.dt:g} s"
            )


def is_turning(model: Model) -> list[bool]:
    """Return which of the base's own quasi-velocities turn it (base,)."""
    return [name == "omega" for name in model.robot.drive.base_speeds[: model.base]]
