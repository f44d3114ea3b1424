"""Settings of the horizon law: its steps, the weights of its cost, the bounds of its motions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Indices, Model
from rpctl.control.obstacles import Obstacle
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import RpctlError
from rpctl.files.records import POSITIVE, SIGNED, Range, Record, Setting
from rpctl.robot.model import Robot

# Of a weight: beyond, the costs of a horizon differ by more than rounding leaves of the smaller.
WEIGHT = Range(1e-6, 1e6, SIGNED)
MAX_STEPS = 200  # memory grows with their square: .3 GB for a mobile manipulator


@dataclass(frozen=True)
class Weights(Record):
    """Weights of squared errors at each step, SI units."""

    position: Annotated[float, WEIGHT, Setting("", "", "Weight of the base's position error.")] = (
        300.0
    )
    heading: Annotated[float, WEIGHT, Setting("", "", "Weight of the base's heading error.")] = 20.0
    joints: Annotated[float, WEIGHT, Setting("", "", "Weight of the arm's position errors.")] = 50.0
    steering: Annotated[
        float,
        WEIGHT,
        Setting(
            "",
            "",
            "Weight of the steered joints' positions; small, as they follow from the "
            "base's motion.",
        ),
    ] = 1.0
    end_effector: Annotated[
        float, WEIGHT, Setting("", "", "Weight of the end effector's position error.")
    ] = 200.0
    rates: Annotated[float, WEIGHT, Setting("", "", "Of ν.")] = 2.0
    accelerations: Annotated[float, WEIGHT, Setting("", "", "Of ν̇.")] = 0.05


@dataclass(frozen=True)
class Bounds(Record):
    """Limits that no URDF holds, and how near to all limits a predicted motion may come."""

    base_acceleration: Annotated[
        float,
        POSITIVE,
        Setting("m/s²", "", "Largest acceleration of the base forward and to the left."),
    ] = 2.0
    base_turning: Annotated[
        float, POSITIVE, Setting("rad/s²", "", "Largest angular acceleration of the base.")
    ] = 4.0
    catch_up: Annotated[
        float,
        POSITIVE,
        Setting("m/s", "", "How much faster than its reference the base may drive."),
    ] = 0.5
    rise: Annotated[
        float, POSITIVE, Setting("s", "", "Time in which a joint may reach its velocity limit.")
    ] = 0.25
    joint_acceleration: Annotated[
        float,
        POSITIVE,
        Setting("rad/s² or m/s²", "", "Largest acceleration of joints without one."),
    ] = 10.0
    share: Annotated[
        float,
        POSITIVE,
        Setting("", "", "Fraction of the URDF's speed and effort limits that a motion may use."),
    ] = 0.97
    tip_margin: Annotated[
        float,
        POSITIVE,
        Setting("m", "", "Least distance of the zero-moment point to the support polygon's edge."),
    ] = 0.01
    grip: Annotated[
        float, POSITIVE, Setting("", "", "Fraction of each wheel's grip that a motion may use.")
    ] = 0.95
    friction: Annotated[
        float, POSITIVE, Setting("", "", "Coefficient between wheels and ground.")
    ] = FRICTION

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


@dataclass(frozen=True, kw_only=True)
class PlannerSettings(Record):
    """What the horizon law plans: see :class:`~rpctl.control.horizon.law.Horizon`."""

    steps: Annotated[
        int, Range(2, MAX_STEPS, f"2 to {MAX_STEPS}"), Setting("", "Steps N", "Number of steps N.")
    ] = 20
    dt: Annotated[float, POSITIVE, Setting("s", "Step", "Length of a step.")] = 0.1
    period: Annotated[
        float,
        POSITIVE,
        Setting("s", "Time from solve to solve", "Time between two solves; at most dt."),
    ] = 0.02
    weights: Annotated[Weights, Setting("", "", "Weights of the cost.")] = field(
        default_factory=Weights
    )
    bounds: Annotated[Bounds, Setting("", "", "Bounds beside those of the URDF.")] = field(
        default_factory=Bounds
    )
    base_obstacles: Annotated[tuple[Obstacle, ...], Setting("", "", "Obstacles of the base.")] = ()
    end_effector_obstacles: Annotated[
        tuple[Obstacle, ...], Setting("", "", "Obstacles of the end effector.")
    ] = ()
    base_radius: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "m",
            "Base's radius",
            "Radius of the base about P; default: distance of the farthest contact.",
        ),
    ] = None
    end_effector_radius: Annotated[
        float, POSITIVE, Setting("m", "End effector's radius", "Radius of the end effector.")
    ] = 0.05
    leash: Annotated[
        float,
        POSITIVE,
        Setting(
            "m",
            "Leash",
            "Distance of the base behind the reference beyond which the reference waits.",
        ),
    ] = 0.3
    body_clearance: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "m",
            "Links keep clear by",
            "Distance that all links keep from obstacles, the ground and each other; default: "
            "only discs around base and end effector keep clear.",
        ),
    ] = None

    def __post_init__(self) -> None:
        """Refuse settings that predict nothing."""
        super().__post_init__()
        if self.period > self.dt:
            raise RpctlError(
                f"period {self.period:g} s is longer than a step; give at most {self.dt:g} s"
            )


def is_turning(model: Model) -> list[bool]:
    """Return which of the base's own quasi-velocities turn it (base,)."""
    return [name == "omega" for name in model.robot.drive.base_speeds[: model.base]]
