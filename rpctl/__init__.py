"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon import Horizon
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import Efforts, Limit, Rest
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.state import draw_state
from rpctl.equivalence.verify import verify
from rpctl.errors import RpctlError
from rpctl.robot.drive import Drive, Wheel
from rpctl.robot.load import load
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_limits, scale_masses, set_limits
from rpctl.simulation.loop import track
from rpctl.simulation.plant import Plant
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize

__version__ = "0.1.0"
__all__ = [
    "BoundedDynamic",
    "Certificate",
    "Disc",
    "Drive",
    "Efforts",
    "EndEffector",
    "FeedbackLinearization",
    "HalfPlane",
    "Horizon",
    "IntegralDynamic",
    "Kanayama",
    "Limit",
    "PaperDynamic",
    "PaperKinematic",
    "Plant",
    "ReducedDynamics",
    "Rest",
    "Robot",
    "RpctlError",
    "Run",
    "UnifiedKinematic",
    "Wheel",
    "draw_state",
    "load",
    "scale_limits",
    "scale_masses",
    "set_limits",
    "summarize",
    "track",
    "verify",
    "write_report",
]


def write_report(run: Run | Sequence[Run], path: str | Path) -> Path:
    """Write one HTML file that shows a run, or compares several; see :mod:`rpctl.view.report`."""
    from rpctl.view.report import write_report as write  # meshcat and trimesh load only here

    return write(run, path)
