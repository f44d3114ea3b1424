"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from __future__ import annotations

from pathlib import Path

from rpctl.control.dynamic import PaperDynamic
from rpctl.control.horizon import Horizon
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.checks import draw_state
from rpctl.equivalence.verify import verify
from rpctl.errors import RpctlError
from rpctl.robot.drive import Drive, Wheel
from rpctl.robot.load import load
from rpctl.robot.model import Robot
from rpctl.simulation.loop import track
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize

__version__ = "0.1.0"
__all__ = [
    "Certificate",
    "Disc",
    "Drive",
    "HalfPlane",
    "Horizon",
    "PaperDynamic",
    "PaperKinematic",
    "ReducedDynamics",
    "Robot",
    "RpctlError",
    "Run",
    "Wheel",
    "draw_state",
    "load",
    "summarize",
    "track",
    "verify",
    "write_report",
]


def write_report(run: Run, path: str | Path) -> Path:
    """Write one self-contained HTML file that shows a run; see :mod:`rpctl.view.report`."""
    from rpctl.view.report import write_report as write  # meshcat and trimesh load only here

    return write(run, path)
