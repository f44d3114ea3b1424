# The public names and where they are: type checkers and editors read this file, and so does
# __init__.py, which imports a module when one of its names is first used.

from typing import Any

from rpctl.control.approach import Approach as Approach
from rpctl.control.baselines import FeedbackLinearization as FeedbackLinearization
from rpctl.control.baselines import Kanayama as Kanayama
from rpctl.control.baselines import Samson as Samson
from rpctl.control.bounded import BoundedDynamic as BoundedDynamic
from rpctl.control.bounded import IntegralDynamic as IntegralDynamic
from rpctl.control.controller import Controller as Controller
from rpctl.control.controller import ControllerOutput as ControllerOutput
from rpctl.control.dynamic import PaperDynamic as PaperDynamic
from rpctl.control.end_effector import EndEffector as EndEffector
from rpctl.control.error import Leash as Leash
from rpctl.control.error import Tracking as Tracking
from rpctl.control.group_commands import GroupCommand as GroupCommand
from rpctl.control.horizon.law import Horizon as Horizon
from rpctl.control.kinematic import PaperKinematic as PaperKinematic
from rpctl.control.law import Command as Command
from rpctl.control.law import Efforts as Efforts
from rpctl.control.law import Limit as Limit
from rpctl.control.law import Rest as Rest
from rpctl.control.law import StatelessLaw as StatelessLaw
from rpctl.control.obstacles import Disc as Disc
from rpctl.control.obstacles import HalfPlane as HalfPlane
from rpctl.control.output_groups import OutputGroup as OutputGroup
from rpctl.control.safeguards import Guards as Guards
from rpctl.control.twist_law import BaseLaw as BaseLaw
from rpctl.control.unified import UnifiedKinematic as UnifiedKinematic
from rpctl.control.velocity_output import VelocityOutput as VelocityOutput
from rpctl.derive.write import derive_law as derive_law
from rpctl.drive.drive import Drive as Drive
from rpctl.drive.drive import Wheel as Wheel
from rpctl.dynamics.derivatives import linearize as linearize
from rpctl.dynamics.reduced import ReducedDynamics as ReducedDynamics
from rpctl.engines.mujoco.bodies import MjcfRobot as MjcfRobot
from rpctl.engines.mujoco.settings import ContactSettings as ContactSettings
from rpctl.equivalence.state import draw_state as draw_state
from rpctl.equivalence.verify import Certificate as Certificate
from rpctl.equivalence.verify import verify as verify
from rpctl.errors import RpctlError as RpctlError
from rpctl.files.records import Setting as Setting
from rpctl.reference.function import as_reference as as_reference
from rpctl.reference.load import load_reference as load_reference
from rpctl.reference.motion import ReferenceState as ReferenceState
from rpctl.robot.load import load as load
from rpctl.robot.model import Robot as Robot
from rpctl.robot.variation import CarriedLoad as CarriedLoad
from rpctl.robot.vary import scale_limits as scale_limits
from rpctl.robot.vary import scale_masses as scale_masses
from rpctl.robot.vary import set_limits as set_limits
from rpctl.robot.vary import with_payload as with_payload
from rpctl.simulation.config import Config as Config
from rpctl.simulation.loop.track import track as track
from rpctl.simulation.merits.summary import summarize as summarize
from rpctl.simulation.mjcf_file import check_mjcf as check_mjcf
from rpctl.simulation.mjcf_file import export_mjcf as export_mjcf
from rpctl.simulation.plants.plant import Plant as Plant
from rpctl.simulation.plants.protocol import PlantModel as PlantModel
from rpctl.simulation.plants.protocol import PlantSample as PlantSample
from rpctl.simulation.plants.settings import Slipping as Slipping
from rpctl.simulation.plants.settings import Wrench as Wrench
from rpctl.simulation.plants.starting import start_plant as start_plant
from rpctl.simulation.run.run import Run as Run
from rpctl.study.lag import SpeedLog as SpeedLog
from rpctl.study.lag import lag_from as lag_from
from rpctl.study.rollout import Rollouts as Rollouts
from rpctl.study.rollout import rollout as rollout
from rpctl.study.scatter import AnyOf as AnyOf
from rpctl.study.scatter import Fixed as Fixed
from rpctl.study.scatter import LogUniform as LogUniform
from rpctl.study.scatter import Normal as Normal
from rpctl.study.scatter import Uniform as Uniform
from rpctl.view.pages.report import write_report as write_report

__version__: str
__all__: list[str]

def load_ipython_extension(shell: Any) -> None: ...
