"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.robot.drive import Drive, Wheel
from rpctl.robot.model import Robot, load

__version__ = "0.1.0"
__all__ = ["Drive", "ReducedDynamics", "Robot", "RpctlError", "Wheel", "load"]
