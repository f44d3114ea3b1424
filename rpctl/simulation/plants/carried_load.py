"""A load that the simulated robot carries without its controller's knowledge."""

from __future__ import annotations

from dataclasses import dataclass

from rpctl.errors import RpctlError, require_within
from rpctl.robot.model import Robot
from rpctl.robot.payload import with_payload

MAX_OFFSET_M = 1e3  # m: no load is farther off than this


@dataclass(frozen=True)
class CarriedLoad:
    """A point mass fixed to a link of the simulated robot.

    Attributes:
        link: The link; "" is that of the end effector.
        mass: kg; 0: none.
        com: Its place (x, y, z) in the link's frame, m.
    """

    link: str = ""
    mass: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse what is no load."""
        require_within("the payload's mass", [self.mass])
        if self.mass < 0.0:
            raise RpctlError(f"the payload's mass is {self.mass:g}; give 0 or more, in kg")
        if len(self.com) != 3:
            raise RpctlError(f"the payload's com is {self.com}; give x, y, z in m")
        require_within("the payload's com", self.com, MAX_OFFSET_M)

    def link_of(self, robot: Robot) -> str:
        """Return the link that carries it.

        Raises:
            RpctlError: None is named, and the robot has no end effector.
        """
        if self.link:
            return self.link
        if robot.end_effector is None:
            raise RpctlError(
                f"{robot.name} has no end effector to carry the payload; name a link in "
                "[plant.payload]"
            )
        return robot.end_effector

    def on(self, robot: Robot) -> Robot:
        """Return a robot that carries it; itself where there is none.

        Raises:
            UnknownNameError: The link is not known.
            RpctlError: None is named, and the robot has no end effector.
        """
        if not self.mass:
            return robot
        return with_payload(robot, self.link_of(robot), self.mass, self.com)
