"""What a user asks of a reference, and how large and fast it is on a robot, and why."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np

from rpctl.errors import RpctlError, require_positive
from rpctl.files.records import POSITIVE, Record
from rpctl.robot.model import Robot

WISHES = ("size", "speed", "laps")
AUTO = "auto"  # the tolerance that cross-validation chooses
BASE_FACTOR = 4.0 / 3.0  # the robot of [MS21], half a track of 0.75 m, counts as 1 m long
SMALLEST_LENGTH = 1e-3  # m: no robot is shorter


@dataclass(frozen=True)
class Sizing:
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

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON says it."""
        return {**asdict(self), "sentence": self.sentence}


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
            raise RpctlError(f'smooth is "{wish}"; give metres, as 0.01, or {AUTO}')
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
