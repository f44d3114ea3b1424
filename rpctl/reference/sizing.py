"""How large and how fast a reference is on a robot, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rpctl.errors import RpctlError, listed, require_positive
from rpctl.reference.usage import Usage
from rpctl.robot.model import Robot

LIMIT_SHARE = 0.5  # of each limit: what a default reference takes; the rest corrects errors
LIMIT_SHARE_TEXT = "half"
WISHES = ("size", "speed", "laps")
MAX_LISTED = 3  # joints that a sentence lists


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

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Sizing:
        """Return what :meth:`to_dict` took apart."""
        return Sizing(**{key: value for key, value in values.items() if key != "sentence"})


@dataclass(frozen=True)
class SizingRequest:
    """What a user asks of a reference; None leaves it to the robot.

    Attributes:
        size: As of :class:`Sizing`, m.
        speed: As of :class:`Sizing`, m/s or rad/s.
        laps: How many times the path is gone through.
    """

    size: float | None = None
    speed: float | None = None
    laps: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no positive number."""
        for name, value in asdict(self).items():
            if value is not None:
                require_positive(name, value)

    def refuse(self, why: str, *names: str) -> None:
        """Refuse wishes that make no sense.

        Args:
            why: Of what, and what to do instead.
            *names: The wishes.

        Raises:
            RpctlError: One of them is given.
        """
        for name in names:
            if getattr(self, name) is not None:
                raise RpctlError(f"{name} = {getattr(self, name):g}: {why}")


def reason(usage: Usage | None, robot: Robot, given: bool) -> str:
    """Return in words what set the speed.

    Args:
        usage: The limit of which the reference takes the most, if any.
        robot: The robot.
        given: Whether the user gave the speed.
    """
    if usage is None:
        return "as given" if given else "a pace for a robot of its size"
    of = "what holding leaves of " if usage.quantity == "effort" else ""
    if given:
        return f"as given, {100.0 * usage.ratio:.0f} % of {of}{usage.text(robot)}"
    return f"{LIMIT_SHARE_TEXT} of {of or 'what '}{usage.text(robot)}{'' if of else ' allow'}"


def assumptions(robot: Robot) -> str:
    """Return which limits the URDF lacks, and what was assumed for them, or nothing."""
    joints = [robot.description.joint[name] for name in robot.actuators]
    missing = {
        quantity: [joint.name for joint in joints if math.isinf(getattr(joint, quantity))]
        for quantity in ("velocity", "effort")
    }
    lacking = " and ".join(
        f"no {quantity} limit of {listed(names, MAX_LISTED)}"
        for quantity, names in missing.items()
        if names
    )
    if not lacking:
        return ""
    return f"the URDF has {lacking}; there, size alone sets the pace"
