"""The laws of the controller as statements of a program: from a state to efforts."""

from __future__ import annotations

from typing import Any

import casadi

from rpctl.control.approach import Approach
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.leash import Leash
from rpctl.control.twist_law import BaseLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.laws.bounded_law import bounded_fragment
from rpctl.simulation.compiled.laws.dynamic_laws import paper_efforts
from rpctl.simulation.compiled.laws.law_fragment import LawFragment, LawFrame, LimitNames
from rpctl.simulation.compiled.laws.law_settings import ClosedFormDynamic
from rpctl.simulation.compiled.machine.program import Buffer
from rpctl.simulation.compiled.machine.statements import statement
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics

KINEMATIC = (PaperKinematic, UnifiedKinematic, Kanayama, FeedbackLinearization)
DYNAMIC = (PaperDynamic, BoundedDynamic, IntegralDynamic)


def unsupported(kinematic: Any, dynamic: Any, robot: Robot) -> str | None:
    """Return why laws cannot be compiled, a clause; None if they can.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        robot: The robot that they are for.
    """
    if type(kinematic) not in KINEMATIC:
        return f"the kinematic law {_name(kinematic)} is not one that is compiled"
    if type(kinematic.leash) not in (type(None), Leash):
        return f"the leash {_name(kinematic.leash)} is not one that is compiled"
    if type(kinematic.approach) not in (type(None), Approach):
        return f"the approach {_name(kinematic.approach)} is not one that is compiled"
    if type(dynamic) is IntegralDynamic and type(dynamic.inner) is not BoundedDynamic:
        return f"the law {_name(dynamic.inner)} within {_name(dynamic)} is not one that is compiled"
    if type(dynamic) not in DYNAMIC:
        return f"the dynamic law {_name(dynamic)} is not one that is compiled"
    return None


def _name(law: Any) -> str:
    return str(getattr(law, "__name__", type(law).__name__))


def law_fragment(
    kinematic: BaseLaw, dynamic: ClosedFormDynamic, known: SymbolicDynamics, period: float
) -> LawFragment:
    """Return the statements of a kinematic and a dynamic law.

    The numbers among the laws' settings are inputs; what is compiled depends on the others only.
    A stage for far starts is left out: it only gives the law another reference.

    Args:
        kinematic: The kinematic law, one that :func:`unsupported` has nothing against.
        dynamic: The dynamic law, likewise.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        RpctlError: A setting does not fit the robot or the period.
    """
    frame = LawFrame(kinematic, dynamic, known, period)
    if isinstance(dynamic, PaperDynamic):
        return _paper(frame, period if dynamic.midpoint else 0.0)
    return bounded_fragment(frame, dynamic)


def _paper(frame: LawFrame, held_for: float) -> LawFragment:
    """Return the fragment of the paper's dynamic law.

    Args:
        frame: What all laws have in common.
        held_for: For how long efforts are held, as far as the law takes account of it, s.
    """
    tau, count = paper_efforts(frame.known, frame.sample, held_for), frame.tau.size
    limits = Buffer("law limits", count), casadi.SX.zeros(count, 1)
    outputs = [*frame.commanded(tau), (frame.tau, tau), limits]
    call = statement("law", frame.inputs, outputs)
    return frame.fragment(limits[0], LimitNames(frame.known.robot.actuators, ()), body=(call,))
