"""The laws by their names."""

from __future__ import annotations

from collections.abc import Callable

from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon.law import Horizon
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import UnknownNameError

KINEMATIC_LAWS: dict[str, Callable[[], KinematicLaw]] = {
    "unified": UnifiedKinematic,
    "paper": PaperKinematic,
    "end-effector": EndEffector,
    "horizon": Horizon,
    "kanayama": Kanayama,
    "feedback-linearization": FeedbackLinearization,
}
DYNAMIC_LAWS: dict[str, Callable[[], DynamicLaw]] = {
    "paper": PaperDynamic,
    "bounded": BoundedDynamic,
    "integral": IntegralDynamic,
}


def kinematic_by_name(name: str) -> KinematicLaw:
    """Return a kinematic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    if name not in KINEMATIC_LAWS:
        raise UnknownNameError("kinematic law", name, KINEMATIC_LAWS)
    return KINEMATIC_LAWS[name]()


def dynamic_by_name(name: str) -> DynamicLaw:
    """Return a dynamic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    if name not in DYNAMIC_LAWS:
        raise UnknownNameError("dynamic law", name, DYNAMIC_LAWS)
    return DYNAMIC_LAWS[name]()
