"""``LeaningRobot``: a robot on a free-flyer, whose two wheels keep to the ground as it leans."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

from rpctl.arrays import Array
from rpctl.drive.drive import LEANING_BICYCLE, Wheel
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import ROOT_JOINT, Workspace
from rpctl.robot.model import NamedState, Robot

FREE_NQ, FREE_NV = 7, 6  # x, y, z and a quaternion (x, y, z, w); linear and angular velocity
MAX_TILT = 1.2  # rad; a robot that pitches or rolls so far lies on the ground
MAX_DRAWN_TILT = 0.5  # rad; of random configurations
GRAVITY = 9.81  # m/s²
MAX_LEAN, MAX_STEERING = 0.5, 0.6  # rad: in a bend that a bicycle is asked for
LEAST_LEAN = 0.1  # rad: a bicycle whose steering holds up less is too slow to be balanced
ROUNDING_M = 1e-16  # m: by which both wheels' heights may differ where nothing makes them
FLAT = 1e-12  # least level part of a unit axle that is divided by; of a wheel lying flat it is 0
KEPT_ROBOTS = 4  # of which something is kept
UP = np.array([0.0, 0.0, 1.0])


class Axle(NamedTuple):
    """A wheel of a robot that leans, as its joint carries it.

    Attributes:
        joint: Pinocchio's index of its joint.
        centre: Its centre in the joint's frame (3,), m.
        left: Its unit axle there, towards the robot's left with all joints at 0 (3,).
        radius: m.
        tyre: Radius of its tyre's section, m.
        steers: Whether a joint steers it.
    """

    joint: int
    centre: Array
    left: Array
    radius: float
    tyre: float
    steers: bool

    def lowest(self, z: Any, rise: Any, sqrt: Callable[[Any], Any]) -> Any:
        """Return the height of its lowest point, m, of any scalar.

        Args:
            z: Height of its centre, m.
            rise: Upward part of its unit axle.
            sqrt: The scalar's root.
        """
        return z - (self.radius - self.tyre) * sqrt(1.0 - rise * rise) - self.tyre


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LeaningRobot(Robot):
    """A robot on two wheels whose root link pitches, rolls and rises: a ``JointModelFreeFlyer``.

    Its tilt is the coordinate that it balances: the pitch of a robot whose wheels stand side by
    side, forward positive; the roll of a bicycle, to the right positive.
    """

    @cached_property
    def axles(self) -> tuple[Axle, ...]:
        """Its two wheels, in the order of the drive's."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, pin.neutral(self.model))
        return tuple(self._axle(data, wheel) for wheel in self.drive.wheels)

    def _axle(self, data: pin.Data, wheel: Wheel) -> Axle:
        joint, axis = self.model.getJointId(wheel.joint), np.array(wheel.axis)
        heading = self.drive.heading
        left = np.array([-math.sin(heading), math.cos(heading), 0.0])
        side = math.copysign(1.0, float(data.oMi[joint].rotation @ axis @ left))
        steers = wheel.swivel is not None
        return Axle(joint, wheel.offset * axis, side * axis, wheel.radius, wheel.tyre, steers)

    @property
    def rolls_sideways(self) -> bool:
        """Whether its tilt is a roll, as a bicycle's; else it is a pitch."""
        return self.drive.type == LEANING_BICYCLE

    @cached_property
    def sharpest_bend(self) -> float:
        """The largest curvature of a bicycle's way, 1/m, at half its steering."""
        (swivel,) = self.drive.steered
        joint = self.description.joint[swivel.joint]
        most = min(0.5 * min(abs(joint.lower), abs(joint.upper)), MAX_STEERING)
        return math.tan(most) / abs(math.dist(self.drive.point, swivel.pivot) + swivel.trail)

    def balancing_speed(self, lean: float) -> float:
        """Return the speed (m/s) at which half a bicycle's steering holds up a lean (rad)."""
        return math.sqrt(GRAVITY * math.tan(lean) / self.sharpest_bend)

    def require_speed(self, v: float) -> None:
        """Refuse what is too slow for a bicycle.

        Args:
            v: The least speed of its way, m/s, forward positive.

        Raises:
            RpctlError: It is a bicycle, and slower than steering balances it.
        """
        if self.rolls_sideways and v < (least := self.balancing_speed(LEAST_LEAN)):
            raise RpctlError(
                f"{self.name} falls over at {v:.3g} m/s, the lowest speed of its reference: "
                f"steering balances it from {least:.3g} m/s on; give a faster one that begins in "
                "motion"
            )

    def configuration(
        self,
        x: float = 0.0,
        y: float = 0.0,
        theta: float = 0.0,
        *,
        joints: Mapping[str, float] | None = None,
        tilt: float = 0.0,
    ) -> Array:
        """Return q (nq,) with both wheels on the ground.

        Args:
            x: Position of the root link, m.
            y: Position of the root link, m.
            theta: Heading of the root link, rad.
            joints: Positions (rad or m) by joint name; 0 for those left out.
            tilt: Its pitch, or a bicycle's roll, rad.

        Raises:
            RpctlError: No height and no other angle bring both wheels to the ground.
            UnknownNameError: A joint is not among the model's.
        """
        q: Array = pin.neutral(self.model)
        self.set_positions(q, joints or {})
        data = _last_seen(self).data

        def lower(other: float) -> list[float]:
            """Return how low both wheels reach (2,), the root link's origin at height 0."""
            q[3:FREE_NQ] = self._attitude(theta, tilt, other)
            pin.forwardKinematics(self.model, data, q)
            return [self.lowest(data, axle) for axle in self.axles]

        def unlike(other: float) -> float:
            first, second = lower(other)
            return first - second

        other = 0.0
        if abs(unlike(other)) > ROUNDING_M:
            if (unlike(-MAX_TILT) > 0.0) == (unlike(MAX_TILT) > 0.0):
                raise RpctlError(
                    f"{self.name}: at a tilt of {tilt:.3g} rad no attitude brings both wheels to "
                    "the ground; give joints that let them"
                )
            other = brentq(unlike, -MAX_TILT, MAX_TILT, xtol=1e-15, rtol=1e-15)
        q[:3] = x, y, -0.5 * sum(lower(other))
        return q

    def set_positions(self, q: Array, joints: Mapping[str, float]) -> None:
        """Set joints' positions (rad or m) in q, in place; mimic joints follow."""
        given = {**self.locked, **joints}
        for name, position in joints.items():
            self.set_joint(q, name, position)
        for joint in self.mimics:
            if joint.mimic is not None:
                followed = given.get(joint.mimic.joint, 0.0)
                self.set_joint(q, joint.name, joint.mimic.multiplier * followed
                               + joint.mimic.offset)  # fmt: skip

    def _attitude(self, theta: float, tilt: float, other: float) -> tuple[float, ...]:
        """Return the root link's quaternion (4,): heading, then roll, then pitch about its axle.

        Of a drive with heading h it is k(θ + h) i(roll) j(pitch) k(−h); what k turns from both
        sides turns as a plane does, (w, z) by the half sum of both angles, (x, y) by the
        difference's.
        """
        pitch, roll = (other, tilt) if self.rolls_sideways else (tilt, other)
        turn = 0.5 * math.remainder(theta, 2.0 * math.pi)
        ahead = turn + self.drive.heading
        (a, b), (c, d) = ((math.cos(0.5 * x), math.sin(0.5 * x)) for x in (roll, pitch))
        level, upright = complex(b * c, a * d), complex(a * c, b * d)  # x + y i and w + z i
        level, upright = level * cmath.rect(1.0, ahead), upright * cmath.rect(1.0, turn)
        return level.real, level.imag, upright.imag, upright.real

    @staticmethod
    def lowest(data: pin.Data, axle: Axle) -> float:
        """Return the height of a wheel's lowest point, m; ``data`` holds the joints' places."""
        place = data.oMi[axle.joint]
        up = place.rotation[2]
        z = float(up.dot(axle.centre) + place.translation[2])
        return float(axle.lowest(z, float(up.dot(axle.left)), _level_part))

    def base_pose(self, q: Array) -> Array:
        """Return the pose (x, y, θ) of P and of the forward direction in the world; m, rad.

        P is where a bicycle's rear wheel touches the ground, else the middle between both wheels'
        contacts; forward is across their axles. Of a wheel that lies flat its middle counts, and a
        heading that no axle tells is 0.
        """
        return np.array(self.seen(q)[:3])

    def seen(self, q: Array) -> tuple[float, float, float, float]:
        """Return the pose of P and the tilt at q (nq,), m and rad; the thread's last are kept."""
        last, key = _last_seen(self), q.tobytes()
        if last.key != key:
            last.key, last.seen = key, self._see(q, last.data)
        return last.seen

    def _see(self, q: Array, data: pin.Data) -> tuple[float, float, float, float]:
        pin.forwardKinematics(self.model, data, q)
        held = [axle for axle in self.axles if not axle.steers]
        lefts, share = list[list[float]](), 1.0 / len(held)
        x = y = across = ahead = 0.0
        for axle in held:
            place = data.oMi[axle.joint]
            left, centre = place.rotation.dot(axle.left).tolist(), place.act(axle.centre).tolist()
            arm = contact_arm(left, axle, _level_part)
            x, y = x + share * (centre[0] + arm[0]), y + share * (centre[1] + arm[1])
            across, ahead = across - left[0], ahead + left[1]
            lefts.append(left)
        tilt = self._tilt(lefts[0], data.oMi[ROOT_JOINT].rotation[:, 2].tolist())
        return x, y, math.atan2(across, ahead), tilt

    def _tilt(self, left: Sequence[float], upright: Sequence[float]) -> float:
        """Return its pitch or roll, rad, by an axle and the root link's upward axis."""
        a, b, c = left
        if self.rolls_sideways:
            return math.asin(min(max(c, -1.0), 1.0))
        level = math.hypot(a, b)
        over = -a * c, -b * c, level * level  # times ``level``: ahead × left
        sine = upright[0] * b - upright[1] * a
        return math.atan2(sine, sum(u * v for u, v in zip(upright, over, strict=True)))

    def contacts(self, q: Array) -> Array:
        """Return where both wheels touch the ground at q (nq,), (2, 2), m."""
        data, found = self.model.createData(), []
        pin.forwardKinematics(self.model, data, q)
        for axle in self.axles:
            at = data.oMi[axle.joint]
            arm = contact_arm((at.rotation @ axle.left).tolist(), axle, _level_part)
            found.append(at.act(axle.centre)[:2] + arm[:2])
        return np.array(found)

    def base_poses(self, q: Array) -> Array:
        """Return the poses (K, 3) of P at q (K, nq), as :meth:`base_pose`."""
        return np.array([self.base_pose(row) for row in q]).reshape(-1, 3)

    def _move_root(self, pose: Array, q: Array) -> None:
        """Move poses (3, 4, K) in place as the root does at q (K, nq)."""
        R = np.stack([pin.Quaternion(row[3:FREE_NQ]).matrix() for row in q], axis=-1)
        pose[:, 3] += np.einsum("ijk,kj->ik", pose[:, :3], q[:, :3])
        pose[:, :3] = np.einsum("ijk,jlk->ilk", pose[:, :3], R)

    def level_place(self, q: Array) -> list[float]:
        """Return where the robot stands, seen from above: x and y of P (m), cosine and sine."""
        x, y, theta, _ = self.seen(q)
        return [x, y, math.cos(theta), math.sin(theta)]

    def configuration_at(
        self, pose: Array, joints: Array, steering: Array | None = None, tilt: float = 0.0
    ) -> Array:
        """Return q (nq,) for a pose of P, positions of the joints and a tilt; as of any robot."""
        positions = dict(zip(self.joint_names, joints, strict=True))
        if steering is not None:
            names = (swivel.joint for swivel in self.drive.steered)
            positions |= dict(zip(names, steering, strict=True))
        q = self.configuration(0.0, 0.0, 0.0, joints=positions, tilt=tilt)
        x, y, theta = self.base_pose(q)
        cos, sin = math.cos(theta), math.sin(theta)
        back = np.array([-cos * x - sin * y, sin * x - cos * y, -theta])
        return self.placed(self.placed(q, back), pose)

    def configurations_at(self, pose: Array, joints: Array, steering: Array | None) -> Array:
        """Return q (K, nq) for poses of P (K, 3) and positions; upright, as :meth:`configuration`.

        Args:
            pose: m and rad.
            joints: Positions of the arm (K, n_joints), rad or m.
            steering: Positions of the steered joints (K, n_steered), rad; None for 0.
        """
        turned = np.zeros((len(pose), len(self.drive.steered))) if steering is None else steering
        alike: dict[bytes, Array] = {}  # at the origin, by positions
        found = np.empty((len(pose), self.nq))
        for k, (place, arm, own) in enumerate(zip(pose, joints, turned, strict=True)):
            key = arm.tobytes() + own.tobytes()
            if key not in alike:
                alike[key] = self.configuration_at(np.zeros(3), arm, own)
            found[k] = self.placed(alike[key], place)
        return found

    @staticmethod
    def placed(q: Array, pose: Array) -> Array:
        """Return q (nq,), of which P is at the origin, moved to a pose of P (3,)."""
        found, (cos, sin) = q.copy(), (math.cos(pose[2]), math.sin(pose[2]))
        found[:2] = pose[0] + cos * q[0] - sin * q[1], pose[1] + sin * q[0] + cos * q[1]
        half = 0.5 * pose[2]
        turn = pin.Quaternion(np.array([0.0, 0.0, math.sin(half), math.cos(half)]))
        found[3:FREE_NQ] = (turn * pin.Quaternion(q[3:FREE_NQ])).coeffs()
        return found

    def state(
        self,
        pose: Sequence[float] = (0.0, 0.0, 0.0),
        twist: Sequence[float] = (),
        *,
        joints: Mapping[str, float] | None = None,
        rates: Mapping[str, float] | None = None,
        twist_frame: str = "body",
        tilt: float = 0.0,
    ) -> tuple[Array, Array]:
        """Return q (nq,) and ν (dof,) of a state that is given by names, as of any robot.

        Args:
            pose: Of the root link seen from above.
            twist: The base's quasi-velocities, the tilt's rate among them.
            joints: Positions by joint name.
            rates: Rates of the arm's joints by name.
            twist_frame: ``"body"``.
            tilt: Its pitch, or a bicycle's roll, rad.
        """
        q, nu = super().state(pose, twist, joints=joints, rates=rates, twist_frame=twist_frame)
        x, y, theta = pose
        return self.configuration(x, y, theta, joints=joints, tilt=tilt) if tilt else q, nu

    def state_of(self, q: Array, nu: Array) -> NamedState:
        """Return the state that q (nq,) and ν (dof,) stand for, by names; its tilt is left out."""
        count = len(self.drive.base_speeds)
        x, y, _ = q[:3].tolist()
        theta = self.seen(q)[2] - self.drive.heading
        positions = {name: self.joint_position(q, name) for name in self.moving_joint_names}
        rates = dict(zip(self.joint_names, nu[count:].tolist(), strict=True))
        return NamedState((x, y, theta), tuple(nu[:count].tolist()), positions, rates)

    def tilt(self, q: Array) -> float:
        """Return its pitch, or a bicycle's roll, at q (nq,), rad."""
        return self.seen(q)[3]

    def random_configuration(self, rng: np.random.Generator) -> Array:
        """Return a random q (nq,) with both wheels on the ground; as of any robot.

        Legs move together, so that the robot leans neither to one side nor over its limits.
        """
        x, y = rng.uniform(-10.0, 10.0, 2)
        theta, tilt = rng.uniform(-math.pi, math.pi), rng.uniform(-1.0, 1.0) * MAX_DRAWN_TILT
        while True:
            positions = {name: self._draw(name, rng) for name in self.moving_joint_names}
            try:
                return self.configuration(x, y, float(theta), joints=positions, tilt=float(tilt))
            except RpctlError:  # legs that reach the ground with no attitude
                continue


class _LastSeen(Workspace):
    """Where a robot was found last, in each thread."""

    key, seen = b"", (0.0, 0.0, 0.0, 0.0)


@lru_cache(maxsize=KEPT_ROBOTS)
def _last_seen(robot: LeaningRobot) -> _LastSeen:
    return _LastSeen(robot.model)


def _level_part(square: float) -> float:
    """Return the level part of a unit axle by its square, which rounding may leave below 0."""
    return max(math.sqrt(max(square, 0.0)), FLAT)


def lies(q: Array) -> bool:
    """Return whether a robot that leans at q (nq,) has leant so far that it lies on the ground."""
    return 2.0 * math.asin(min(math.hypot(q[3], q[4]), 1.0)) > MAX_TILT


def contact_arm(left: Sequence[Any], axle: Axle, sqrt: Callable[[Any], Any]) -> list[Any]:
    """Return the way from a wheel's centre to its lowest point (3,), m, of any scalar.

    Of a disc it is r d with d = −(ẑ − a_z a)/s, s = √(a_x² + a_y²); of a torus the section's centre
    lies at (r − ρ) d, and the lowest point ρ below that.

    Args:
        left: Its unit axle a (3,).
    """
    x, y, z = left
    sine = sqrt(x * x + y * y)  # 1 − z² would be rounding where a wheel lies nearly flat
    reach = (axle.radius - axle.tyre) / sine
    return [reach * z * x, reach * z * y, -(axle.radius - axle.tyre) * sine - axle.tyre]
