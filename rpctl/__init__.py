"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon.law import Horizon
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import Efforts, Limit, Rest
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.unified import UnifiedKinematic
from rpctl.drive.drive import Drive, Wheel
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.state import draw_state
from rpctl.equivalence.verify import verify
from rpctl.errors import RpctlError
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
    """Write one HTML file that shows a run, or compares several; see ``view/pages/report.py``."""
    from rpctl.view.pages.report import write_report as write  # meshcat and trimesh load only here

    return write(run, path)


def load_ipython_extension(shell: Any) -> None:
    """Let a notebook show a `Run` as a scene to be played (``%load_ext rpctl``).

    Where IPython runs already, ``import rpctl`` has done this.

    Args:
        shell: The notebook's ``InteractiveShell``.
    """

    def scene(run: Run) -> str:
        from rpctl.view.notebook import show

        return show(run)

    html = shell.display_formatter.formatters["text/html"]
    html.for_type_by_name("rpctl.simulation.run", "Run", scene)


if "IPython" in sys.modules and (shell := sys.modules["IPython"].get_ipython()):
    load_ipython_extension(shell)
