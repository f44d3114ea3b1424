"""The laws of a robot where nobody names any."""

from __future__ import annotations

from rpctl.control.integral import IntegralDynamic
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.robot.model import Robot


def default_laws(robot: Robot) -> tuple[KinematicLaw, DynamicLaw]:
    """Return the best kinematic and dynamic law for a robot that is known."""
    return UnifiedKinematic(), IntegralDynamic()
