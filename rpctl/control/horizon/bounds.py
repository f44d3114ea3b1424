"""What the horizon law keeps to: hard bounds of each unknown, and soft rows for the rest."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.model import Indices, Model, Motion
from rpctl.control.horizon.program import Family, Places, Soft, Stages
from rpctl.control.horizon.sample import Sample
from rpctl.dynamics.contact import FRICTION
from rpctl.errors import require_positive
from rpctl.robot.model import Robot

PIECES = 3  # of the wheels' loads that bound the first step
RESOLVED = 1e-9  # rad or m: room left to a joint that can only just brake


@dataclass(frozen=True)
class Bounds:
    """Bounds that no URDF holds, and how near to the others a motion may come.

    Attributes:
        base_acceleration: Largest acceleration of the base forward and to the left, m/s².
        base_turning: Largest angular acceleration of the base, rad/s².
        catch_up: How much faster than its reference the base may drive, m/s.
        rise: Time in which a joint may reach its velocity limit, s.
        joint_acceleration: Largest acceleration of joints without one, rad/s² or m/s².
        share: Share of the URDF's speeds and efforts that a motion may use.
        tip_margin: Least distance of the zero-moment point to the support polygon's edge, m.
        grip: Share of each wheel's grip that a motion may use.
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
        base = np.where(_turning(model), self.base_turning, self.base_acceleration)
        limits = np.array([joint.velocity for joint in model.joints])
        joints = np.where(np.isfinite(limits), limits / self.rise, self.joint_acceleration)
        return np.concatenate([base, joints])

    def efforts(self, robot: Robot) -> tuple[Indices, Array]:
        """Return the actuators (indices) whose effort is limited, and how far it may go."""
        return self._limited(robot.effort_limits)

    def rates(self, robot: Robot) -> tuple[Indices, Array]:
        """Return the actuators (indices) whose rate is limited, and how far it may go."""
        joint = robot.description.joint
        return self._limited(np.array([joint[name].velocity for name in robot.actuators]))

    def _limited(self, limits: Array) -> tuple[Indices, Array]:
        found = np.flatnonzero(np.isfinite(limits))
        return found, self.share * limits[found]


class Box:
    """Hard bounds of accelerations, speeds and joint positions, as far as they can be kept.

    What is too fast, or too near to its limit to stop before it, is held to the hardest braking
    instead: so the bounds never contradict each other.
    """

    def __init__(self, model: Model, bounds: Bounds) -> None:
        joints, self._base = model.joints, model.base
        self._linear = np.flatnonzero(np.logical_not(_turning(model)))
        self._catch_up, self._dt = bounds.catch_up, model.dt
        self._most = bounds.accelerations(model)
        # Between two steps a parabola rises above its chord by at most a dt²/8.
        bulge = 0.125 * self._most[model.base :] * model.dt**2
        self._lower = np.array([joint.lower for joint in joints]) + bulge
        self._upper = np.array([joint.upper for joint in joints]) - bulge
        self._fastest = np.full((model.steps, model.robot.dof), np.inf)
        self._fastest[:, model.base :] = bounds.share * np.array([j.velocity for j in joints])
        later = np.arange(1, model.steps + 1)[:, None]
        self._shed = later * model.dt * self._most  # speed that braking takes away by each step

    def about(self, sample: Sample) -> tuple[Stages, Stages]:
        """Return lower and upper bounds of the deviations from a motion."""
        motion, base = sample.motion, self._base
        left = np.sign(motion.nu[0]) * np.maximum(np.abs(motion.nu[0]) - self._shed, 0.0)
        between = np.vstack([motion.nu[0], left[:-1]]) + left
        stop = motion.joints[0] + 0.5 * self._dt * np.cumsum(between[:, base:], axis=0)
        lower = np.minimum(self._lower, stop - RESOLVED) - motion.joints[1:]
        upper = np.maximum(self._upper, stop + RESOLVED) - motion.joints[1:]
        fastest = self._fastest.copy()
        wanted = sample.target.nu[1:, self._linear]
        fastest[:, self._linear] = np.linalg.norm(wanted, axis=1, keepdims=True) + self._catch_up
        fastest = np.maximum(fastest, np.abs(left) + RESOLVED)
        nu, free = motion.nu[1:], np.full((len(left), 3 if base else 0), np.inf)
        return (
            Stages(-self._most - motion.nu_dot, -free, lower, -fastest - nu),
            Stages(self._most - motion.nu_dot, free, upper, fastest - nu),
        )


def _turning(model: Model) -> list[bool]:
    """Return which of the base's own quasi-velocities turn it (base,)."""
    return [name == "omega" for name in model.robot.drive.base_speeds[: model.base]]


class SoftBound(Protocol):
    """A kind of soft rows."""

    def families(self, at: Places) -> list[Family]:
        """Return the families that :meth:`about` fills, in its order."""

    def about(self, sample: Sample) -> list[Soft]:
        """Return their numbers about a motion."""


class WheelSpeeds:
    """Speeds of the wheels within their limits: they are Bᵀν. One unit of slack is one limit."""

    def __init__(self, model: Model, bounds: Bounds) -> None:
        joints = {joint.name for joint in model.joints}
        limited, limits = bounds.rates(model.robot)
        wheels = [i for i, k in enumerate(limited) if model.robot.actuators[k] not in joints]
        self._limited, self._limits = limited[wheels], limits[wheels]
        self._model, self._fixed = model, None
        if not model.steered:  # casters have no actuators
            self._fixed = self._rates(np.zeros(len(model.joints)))

    def _rates(self, joints: Array) -> Array:
        """Return the map (n, dof) from ν to the wheels' rates over their limits."""
        B = self._model.dynamics.actuation(self._model.configuration(joints))
        return B.T[self._limited] / self._limits[:, None]

    def families(self, at: Places) -> list[Family]:
        """Return one family, of the speeds after each step."""
        if not len(self._limited):
            return []
        return [Family(at.nu[:, : self._model.moving], 2 * len(self._limited))]

    def about(self, sample: Sample) -> list[Soft]:
        """Return its numbers."""
        if not len(self._limited):
            return []
        motion = sample.motion
        if self._fixed is not None:
            rates = np.broadcast_to(self._fixed, (len(motion.nu_dot), *self._fixed.shape))
        else:
            rates = np.array([self._rates(joints) for joints in motion.joints[1:]])
        value = np.einsum("kij,kj->ki", rates, motion.nu[1:])
        slopes = rates[:, :, : self._model.moving]
        return [Soft(np.hstack([value, -value]) - 1.0, np.concatenate([slopes, -slopes], axis=1))]


class ForceBounds:
    """Efforts within their limits, zero-moment point inside the polygon, wheels within their grip.

    The first step is bounded in all accelerations: it is the one that will be carried out. Later
    steps are looked at for the ground only, at the ``ground`` stages, and there the arm's
    accelerations and the steering are those of the motion: rows that tie all joints together at
    many stages would cost the QP its sparsity.

    Contacts let go and take hold, and the wheels' loads are linear in between only. A step that is
    bounded by one such piece alone may end in another one, where it slips, and the next step back
    in the first. So the first step keeps to the grip of the last three pieces that were met.
    """

    def __init__(self, model: Model, bounds: Bounds, forces: ForceModel, ground: list[int]) -> None:
        self._limited, self._limits = bounds.efforts(model.robot)
        self._model, self._forces = model, forces
        self._pieces: deque[Array] = deque(maxlen=PIECES)
        self._later = [k for k in ground if k and forces.rows]

    def families(self, at: Places) -> list[Family]:
        """Return the efforts' family, the ground's now, and the ground's later."""
        base, count = self._model.moving, self._forces.rows
        now = PIECES * self._forces.grips
        found = [
            Family(at.nu_dot[:1], 2 * len(self._limited)),
            Family(at.nu_dot[:1], count - self._forces.grips + now),
        ]
        before = [k - 1 for k in self._later]
        later = np.hstack([at.nu_dot[self._later, :base], at.nu[before, :base]])
        return [*found, Family(later, count)]

    def about(self, sample: Sample) -> list[Soft]:
        """Return their numbers."""
        found = self._now(sample.motion)
        base, count = self._model.moving, self._forces.rows
        value = np.empty((len(self._later), count))
        slopes = np.empty((len(self._later), count, 2 * base))
        for row, k in enumerate(self._later):
            motion = sample.motion
            q = self._model.configuration(motion.joints[k])
            room = self._forces.ground(self._forces.at(q, motion.nu[k], motion.nu_dot[k]))
            value[row] = -room[:, 0]
            slopes[row, :, :base] = -room[:, 1 : 1 + base]
            slopes[row, :, base:] = -room[:, room.shape[1] - base :]
        return [*found, Soft(value, slopes)]

    def _now(self, motion: Motion) -> list[Soft]:
        dynamics = self._model.dynamics
        forces = self._forces.at(motion.start, motion.nu[0], motion.nu_dot[0], dynamics)
        dof = len(motion.nu[0])
        tau = self._forces.efforts(forces)[self._limited] / self._limits[:, None]
        value, slopes = tau[:, 0], tau[:, 1 : 1 + dof]
        efforts = Soft(
            np.append(value, -value)[None] - 1.0, np.concatenate([slopes, -slopes])[None]
        )
        if not self._forces.rows:
            return [efforts, Soft(np.empty((1, 0)), np.empty((1, 0, dof)))]
        self._meet(self._forces.shares(forces))
        grips = self._forces.slipping(forces, self._pieces)
        room = np.vstack([self._forces.tipping(forces), grips])
        return [efforts, Soft(-room[None, :, 0], -room[None, :, 1 : 1 + dof])]

    def _meet(self, piece: Array) -> None:
        """Remember a piece; at first it stands for the others as well."""
        if not self._pieces:
            self._pieces.extend([piece] * PIECES)
        elif not np.array_equal(piece, self._pieces[-1]):
            self._pieces.append(piece)
