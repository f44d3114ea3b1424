"""Which wheels Drake and PyBullet have nothing for."""

from __future__ import annotations

from rpctl.engines.engine import EngineFault
from rpctl.engines.switches import Switches
from rpctl.robot.model import Robot


def refuse_rollers(robot: Robot, switches: Switches, engine: str) -> None:
    """Refuse to mend wheels that the ground holds in one direction only.

    Args:
        robot: The robot.
        switches: What is mended.
        engine: Name of an engine whose friction is the same in all directions.

    Raises:
        EngineFault: The drive has such wheels, and they are to be mended.
    """
    sliding = [wheel.joint for wheel in robot.drive.wheels if wheel.slides]
    rolling = robot.drive.type in ("mecanum", "omni")
    if switches.mended("wheel") and (rolling or sliding):
        what = "rollers" if rolling else f"wheel that slides sideways, as {sliding[0]} does"
        raise EngineFault(f"{robot.name} is not compared in {engine}: it has no {what}")
