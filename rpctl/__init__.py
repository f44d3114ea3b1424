"""From any wheeled robot's URDF to a verified model, predictive control and an animation."""

from __future__ import annotations

import sys
from importlib import import_module

TYPE_CHECKING = False  # `typing` is not imported here: it would delay the answer to Ctrl-C
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"
_MODULES = {  # public name -> the module that has it, imported when the name is first used
    "AnyOf": "rpctl.study.distributions",
    "Approach": "rpctl.control.approach",
    "BaseLaw": "rpctl.control.twist_law",
    "BoundedDynamic": "rpctl.control.bounded",
    "CarriedLoad": "rpctl.simulation.plants.carried_load",
    "Certificate": "rpctl.equivalence.certificate",
    "Command": "rpctl.control.law",
    "ContactSettings": "rpctl.engines.mujoco.settings",
    "Controller": "rpctl.control.controller",
    "ControllerOutput": "rpctl.control.controller",
    "Disc": "rpctl.control.obstacles",
    "Drive": "rpctl.drive.drive",
    "Efforts": "rpctl.control.law",
    "EndEffector": "rpctl.control.end_effector",
    "FeedbackLinearization": "rpctl.control.feedback_linearization",
    "Fixed": "rpctl.study.distributions",
    "HalfPlane": "rpctl.control.obstacles",
    "Horizon": "rpctl.control.horizon.law",
    "IntegralDynamic": "rpctl.control.integral",
    "Kanayama": "rpctl.control.kanayama",
    "Leash": "rpctl.control.leash",
    "Limit": "rpctl.control.law",
    "LogUniform": "rpctl.study.distributions",
    "MjcfRobot": "rpctl.engines.mujoco.sensors",
    "Normal": "rpctl.study.distributions",
    "PaperDynamic": "rpctl.control.dynamic",
    "PaperKinematic": "rpctl.control.kinematic",
    "Plant": "rpctl.simulation.plant",
    "PlantModel": "rpctl.simulation.plants.protocol",
    "PlantSample": "rpctl.simulation.plants.protocol",
    "ReducedDynamics": "rpctl.dynamics.reduced",
    "ReferenceState": "rpctl.reference.motion",
    "Rest": "rpctl.control.law",
    "Robot": "rpctl.robot.model",
    "Rollouts": "rpctl.study.rollouts",
    "RpctlError": "rpctl.errors",
    "Run": "rpctl.simulation.run",
    "Slipping": "rpctl.simulation.plants.slipping",
    "SpeedLog": "rpctl.study.speed_log",
    "StatelessLaw": "rpctl.control.law",
    "Tracking": "rpctl.control.error",
    "Twist": "rpctl.control.twist",
    "UnifiedKinematic": "rpctl.control.unified",
    "Uniform": "rpctl.study.distributions",
    "VelocityOutput": "rpctl.control.velocity_output",
    "Wheel": "rpctl.drive.drive",
    "Wrench": "rpctl.simulation.plants.wrench",
    "as_reference": "rpctl.reference.function",
    "check_mjcf": "rpctl.simulation.mjcf_file",
    "derive_law": "rpctl.derive.law",
    "draw_state": "rpctl.equivalence.state",
    "export_mjcf": "rpctl.simulation.mjcf_file",
    "lag_from": "rpctl.study.lag",
    "linearize": "rpctl.dynamics.derivatives",
    "load": "rpctl.robot.load",
    "load_reference": "rpctl.reference.load",
    "rollout": "rpctl.study.rollout",
    "scale_limits": "rpctl.robot.vary",
    "scale_masses": "rpctl.robot.vary",
    "set_limits": "rpctl.robot.vary",
    "start_plant": "rpctl.simulation.plants.stepped",
    "summarize": "rpctl.simulation.summary",
    "track": "rpctl.simulation.loop",
    "verify": "rpctl.equivalence.verify",
    "with_payload": "rpctl.robot.payload",
    "write_report": "rpctl.view.pages.report",
}
__all__ = sorted(_MODULES)

if TYPE_CHECKING:  # the same, for type checkers and editors
    from rpctl.control.approach import Approach as Approach
    from rpctl.control.bounded import BoundedDynamic as BoundedDynamic
    from rpctl.control.controller import Controller as Controller
    from rpctl.control.controller import ControllerOutput as ControllerOutput
    from rpctl.control.dynamic import PaperDynamic as PaperDynamic
    from rpctl.control.end_effector import EndEffector as EndEffector
    from rpctl.control.error import Tracking as Tracking
    from rpctl.control.feedback_linearization import FeedbackLinearization as FeedbackLinearization
    from rpctl.control.horizon.law import Horizon as Horizon
    from rpctl.control.integral import IntegralDynamic as IntegralDynamic
    from rpctl.control.kanayama import Kanayama as Kanayama
    from rpctl.control.kinematic import PaperKinematic as PaperKinematic
    from rpctl.control.law import Command as Command
    from rpctl.control.law import Efforts as Efforts
    from rpctl.control.law import Limit as Limit
    from rpctl.control.law import Rest as Rest
    from rpctl.control.law import StatelessLaw as StatelessLaw
    from rpctl.control.leash import Leash as Leash
    from rpctl.control.obstacles import Disc as Disc
    from rpctl.control.obstacles import HalfPlane as HalfPlane
    from rpctl.control.twist import Twist as Twist
    from rpctl.control.twist_law import BaseLaw as BaseLaw
    from rpctl.control.unified import UnifiedKinematic as UnifiedKinematic
    from rpctl.control.velocity_output import VelocityOutput as VelocityOutput
    from rpctl.derive.law import derive_law as derive_law
    from rpctl.drive.drive import Drive as Drive
    from rpctl.drive.drive import Wheel as Wheel
    from rpctl.dynamics.derivatives import linearize as linearize
    from rpctl.dynamics.reduced import ReducedDynamics as ReducedDynamics
    from rpctl.engines.mujoco.sensors import MjcfRobot as MjcfRobot
    from rpctl.engines.mujoco.settings import ContactSettings as ContactSettings
    from rpctl.equivalence.certificate import Certificate as Certificate
    from rpctl.equivalence.state import draw_state as draw_state
    from rpctl.equivalence.verify import verify as verify
    from rpctl.errors import RpctlError as RpctlError
    from rpctl.reference.function import as_reference as as_reference
    from rpctl.reference.load import load_reference as load_reference
    from rpctl.reference.motion import ReferenceState as ReferenceState
    from rpctl.robot.load import load as load
    from rpctl.robot.model import Robot as Robot
    from rpctl.robot.payload import with_payload as with_payload
    from rpctl.robot.vary import scale_limits as scale_limits
    from rpctl.robot.vary import scale_masses as scale_masses
    from rpctl.robot.vary import set_limits as set_limits
    from rpctl.simulation.loop import track as track
    from rpctl.simulation.mjcf_file import check_mjcf as check_mjcf
    from rpctl.simulation.mjcf_file import export_mjcf as export_mjcf
    from rpctl.simulation.plant import Plant as Plant
    from rpctl.simulation.plants.carried_load import CarriedLoad as CarriedLoad
    from rpctl.simulation.plants.protocol import PlantModel as PlantModel
    from rpctl.simulation.plants.protocol import PlantSample as PlantSample
    from rpctl.simulation.plants.slipping import Slipping as Slipping
    from rpctl.simulation.plants.stepped import start_plant as start_plant
    from rpctl.simulation.plants.wrench import Wrench as Wrench
    from rpctl.simulation.run import Run as Run
    from rpctl.simulation.summary import summarize as summarize
    from rpctl.study.distributions import AnyOf as AnyOf
    from rpctl.study.distributions import Fixed as Fixed
    from rpctl.study.distributions import LogUniform as LogUniform
    from rpctl.study.distributions import Normal as Normal
    from rpctl.study.distributions import Uniform as Uniform
    from rpctl.study.lag import lag_from as lag_from
    from rpctl.study.rollout import rollout as rollout
    from rpctl.study.rollouts import Rollouts as Rollouts
    from rpctl.study.speed_log import SpeedLog as SpeedLog
    from rpctl.view.pages.report import write_report as write_report
else:

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULES[name]), name)
        return value


def __dir__() -> list[str]:
    return __all__


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
