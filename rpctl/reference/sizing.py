"""How large and fast a reference may be: what a user asks, and what the robot allows."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Drive, Swivel
from rpctl.drive.steering import heading_radius, turning_radius
from rpctl.dynamics.rolling import find_rolling
from rpctl.errors import RpctlError, require_positive
from rpctl.files.records import NOT_NEGATIVE, POSITIVE, Record
from rpctl.reference.time_law import Bound
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import BASE_NV, Robot

WISHES = ("size", "speed", "laps")
AUTO = "auto"  # the tolerance that cross-validation chooses
BASE_FACTOR = 4.0 / 3.0  # the robot of [MS21], half a track of 0.75 m, counts as 1 m long
SMALLEST_LENGTH = 1e-3  # m: no robot is shorter


@dataclass(frozen=True)
class Told:
    """A record that is told in one sentence, too."""

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return {**asdict(self), "sentence": self.sentence}


@dataclass(frozen=True)
class Sizing(Told):
    """Size and speed of a reference on a robot.

    Attributes:
        reference: Its name.
        size: Radius of a circle, half the length of an eight or of waypoints, half the side of a
            square, length of a line, m; None of a spin and of a fixed base's arm motion.
        speed: The largest speed along the path, m/s; of a spin the turning rate, rad/s; None for
            a fixed base.
        laps: How many times the path is gone through; None where it does not close.
        duration: How long that takes, s.
        reason: What set the speed.
        arm: What the arm's motion was scaled down for, or which actuator cannot hold it; empty
            where there is nothing of that.
        assumed: What was assumed for want of limits; empty where nothing was.
    """

    reference: str
    size: float | None
    speed: float | None
    laps: float | None
    duration: float
    reason: str
    arm: str = ""
    assumed: str = ""

    @property
    def sentence(self) -> str:
        """All but the assumptions in one line."""
        if self.speed is None:
            return f"the arm's motion alone: {self.arm or 'its base is fixed'}"
        unit = "rad/s" if self.size is None else "m/s"
        size = "" if self.size is None else f" of {self.size:.2g} m"
        arm = f"; arm: {self.arm}" if self.arm else ""
        laps = "" if self.laps is None else f", {self.laps:.2g} lap{'s' * (self.laps != 1)}"
        return (
            f"{self.reference}{size} at {self.speed:.2g} {unit}{laps} in {self.duration:.3g} s: "
            f"{self.reason}{arm}"
        )


@dataclass(frozen=True)
class SizingRequest(Record):
    """What a user asks of a reference; None leaves it to the robot.

    Attributes:
        size: As of :class:`Sizing`, m.
        speed: As of :class:`Sizing`, m/s or rad/s.
        laps: How many times the path is gone through.
    """

    size: Annotated[float | None, POSITIVE] = None
    speed: Annotated[float | None, POSITIVE] = None
    laps: Annotated[float | None, POSITIVE] = None

    def refuse(self, why: str, *names: str) -> None:
        """Refuse wishes that make no sense.

        Args:
            why: Of what, and what to do instead.

        Raises:
            RpctlError: One of them is given.
        """
        for name in names:
            if getattr(self, name) is not None:
                raise RpctlError(f"{name} = {getattr(self, name):g}: {why}")


def require_smoothing(wish: float | str | None) -> None:
    """Refuse what is no tolerance of smoothing.

    Raises:
        RpctlError: It is neither a positive number nor ``auto``.
    """
    if isinstance(wish, str):
        if wish != AUTO:
            raise RpctlError(f'smooth is "{wish}"; give metres, such as 0.01, or {AUTO}')
    elif wish is not None:
        require_positive("smooth", wish)


def read_smoothing(text: str | None) -> float | str | None:
    """Return the tolerance that ``METRES|auto`` names.

    Raises:
        RpctlError: It is neither.
    """
    try:
        return text if text in (None, AUTO) else float(text)
    except ValueError:
        raise RpctlError(f"--smooth {text}: give metres, as 0.01, or {AUTO}") from None


def robot_length(robot: Robot) -> float:
    """Return the length (m) of a robot: 4/3 of its base's radius, or its arm if that is longer.

    The base's radius is the distance from P to its farthest wheel contact, or the largest wheel's
    radius; the arm's length that of its links in a line. Rounded to one digit, so that the sizes
    of references are easy to read.
    """
    length = max(BASE_FACTOR * _base_radius(robot), _arm_length(robot))
    return float(f"{max(length, SMALLEST_LENGTH):.1g}") if length else 1.0


def _base_radius(robot: Robot) -> float:
    drive, radii = robot.drive, [0.0]
    for wheel in drive.wheels:
        pose = robot.tree.pose(robot.description.joint[wheel.joint].child)
        centre = pose[:3, 3] + wheel.offset * pose[:3, :3] @ wheel.axis
        radii += [math.dist(centre[:2], drive.point), wheel.radius]
    return max(radii)


def _arm_length(robot: Robot) -> float:
    """Return the sum of the distances between the joints up to the end effector, m."""
    if robot.end_effector is None:
        return 0.0
    chain = robot.description.chain(robot.end_effector)
    names = set(robot.joint_names)
    first = next((i for i, joint in enumerate(chain) if joint.name in names), len(chain))
    return float(sum(np.linalg.norm(joint.origin[:3, 3]) for joint in chain[first + 1 :]))


VELOCITY_LIMIT_FRACTION = 0.9  # of a velocity limit of the URDF: the rest is left to the controller
TURNING_RADIUS_FACTOR = 1.5  # of the least radius that a robot can steer: room for corrections
SPEED_RISE_TIME = 0.5  # s; a joint takes at least this long to its velocity limit


@dataclass(frozen=True)
class Limits(Record):
    """Limits of a reference; the velocity limits of the URDF come on top of them.

    Attributes:
        speed: Speed of P, m/s.
        acceleration: Acceleration of P along its path, m/s².
        turning_speed: Turning rate of the base, rad/s.
        turning_acceleration: Angular acceleration of the base, rad/s².
        lateral_acceleration: Speed times turning speed, m/s².
        turning_radius: Least radius of the base's path, m; 0 lets it turn on the spot.
        end_effector_speed: Speed of the end effector, m/s.
        end_effector_acceleration: Its acceleration along each axis of the world, m/s².
    """

    speed: Annotated[float, POSITIVE] = 0.5
    acceleration: Annotated[float, POSITIVE] = 0.4
    turning_speed: Annotated[float, POSITIVE] = 1.0
    turning_acceleration: Annotated[float, POSITIVE] = 1.0
    lateral_acceleration: Annotated[float, POSITIVE] = 0.4
    turning_radius: Annotated[float, NOT_NEGATIVE] = 0.0
    end_effector_speed: Annotated[float, POSITIVE] = 0.3
    end_effector_acceleration: Annotated[float, POSITIVE] = 0.4

    def steerable(self, robot: Robot) -> Limits:
        """Return limits whose turning radius a robot can steer, with room for corrections."""
        return replace(self, turning_radius=max(self.turning_radius, steerable_radius(robot)))

    def base(self, robot: Robot, direction: Array) -> list[Bound]:
        """Return the bounds of a base path.

        Args:
            direction: Twist by s and its derivative by s, at N points of the path (N, 2, 3).
        """
        twist, bend = direction[:, 0], direction[:, 1]
        speed, swerve = (
            np.hypot(twist[:, 0], twist[:, 1]),
            np.sqrt(np.abs(twist[:, 0] * twist[:, 2])),
        )
        return [
            Bound(speed, np.zeros(len(speed)), self.speed),
            Bound(twist[:, 0], bend[:, 0], self.speed, self.acceleration),
            Bound(twist[:, 1], bend[:, 1], self.speed, self.acceleration),
            Bound(twist[:, 2], bend[:, 2], self.turning_speed, self.turning_acceleration),
            Bound(swerve, np.zeros(len(speed)), math.sqrt(self.lateral_acceleration)),
            *_wheel_bounds(robot, twist),
        ]

    def end_effector(self, slope: Array, bend: Array) -> list[Bound]:
        """Return the bounds of an end effector's path from its derivatives by s, (N, 3) each."""
        speed = np.linalg.norm(slope, axis=1)
        return [
            Bound(speed, np.zeros(len(speed)), self.end_effector_speed),
            *(
                Bound(slope[:, i], bend[:, i], math.inf, self.end_effector_acceleration)
                for i in range(3)
            ),
        ]


def steerable_radius(robot: Robot) -> float:
    """Return the least radius (m) of a path for a robot, with room for corrections."""
    return TURNING_RADIUS_FACTOR * turning_radius(robot.drive, robot.description.joint)


def comfortable_radius(robot: Robot) -> float:
    """Return the least radius (m) of a path on which no wheel of a robot turns past its steering.

    It is that of :func:`steerable_radius`, and counts bases whose wheels all steer.
    """
    return TURNING_RADIUS_FACTOR * heading_radius(robot.drive, robot.description.joint)


def arm_bounds(robot: Robot, slope: Array, bend: Array) -> list[Bound]:
    """Return the bounds that the joints' velocity limits set.

    Args:
        slope: Derivatives of the joints' positions by s (N, n_joints).
        bend: Second derivatives (N, n_joints).
    """
    limits = (VELOCITY_LIMIT_FRACTION * joint.velocity for joint in robot.joints)
    return [
        Bound(slope[:, i], bend[:, i], limit, limit / SPEED_RISE_TIME)
        for i, limit in enumerate(limits)
        if math.isfinite(limit)
    ]


def _wheel_bounds(robot: Robot, twist: Array) -> list[Bound]:
    """Return the bounds that the wheels' velocity limits set to a twist by s (N, 3)."""
    root = twist @ robot.root_velocity.T
    bounds = []
    for wheel, rate in zip(robot.drive.wheels, wheel_rates(robot), strict=True):
        limit = VELOCITY_LIMIT_FRACTION * robot.description.joint[wheel.joint].velocity
        rates = np.abs(twist @ rate)
        if wheel.swivel is not None:  # it heads along its pivot's velocity
            swivel = next(each for each in robot.drive.swivels if each.joint == wheel.swivel)
            rates = pivot_speeds(robot.drive, swivel, root) / wheel.radius
        if math.isfinite(limit):
            bounds.append(Bound(rates, np.zeros(len(rates)), limit))
    return bounds


def pivot_speeds(drive: Drive, swivel: Swivel, twists: Array) -> Array:
    """Return the speeds (N,) of a swivel's pivot under twists of the root link (N, 3), m/s.

    Of a trailer's they are bounds: it turns at V/k at most, with V the speed of its own pivot and k
    its trail.
    """
    x, y = swivel.pivot
    carrier = next((each for each in drive.swivels if each.joint == swivel.parent), None)
    if carrier is not None and carrier.trails:
        ahead = np.array([math.cos(carrier.heading), math.sin(carrier.heading)])
        arm = math.dist(carrier.pivot + carrier.trail * ahead, swivel.pivot)
        return pivot_speeds(drive, carrier, twists) * (1.0 + arm / abs(carrier.trail))
    return np.hypot(twists[:, 0] - twists[:, 2] * y, twists[:, 1] + twists[:, 2] * x)


def wheel_rates(robot: Robot) -> Array:
    """Return the map (n_wheels, 3) from P's twist to the wheels' rates, rad/s; 0 on swivels."""
    rows = np.zeros((len(robot.drive.wheels), BASE_NV))
    if isinstance(robot, LeaningRobot):
        half = 0.0 if robot.rolls_sideways else 0.5 * robot.drive.track
        radii = np.array([axle.radius for axle in robot.axles])
        return np.column_stack([1.0 / radii, 0.0 * radii, [-half, half] / radii])
    rolling = find_rolling(robot)
    for row, wheel, at in zip(rows, robot.drive.wheels, rolling.along, strict=True):
        if wheel.swivel is None:
            lever = rolling.matrix.constant[at, robot.velocity_index(wheel.joint)]
            row[:] = -rolling.matrix.constant[at, :BASE_NV] @ robot.root_velocity / lever
    return rows
