"""The kinematic laws by their names."""

from __future__ import annotations

from collections.abc import Callable

from rpctl.control.command import KinematicLaw
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon.law import Horizon
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import Startable
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import UnknownNameError

KINEMATIC_LAWS: dict[str, Callable[[], KinematicLaw | Startable[KinematicLaw]]] = {
    "unified": UnifiedKinematic,
    "paper": PaperKinematic,
    "end-effector": EndEffector,
    "horizon": Horizon,
    "kanayama": Kanayama,
    "feedback-linearization": FeedbackLinearization,
}


def kinematic_by_name(name: str) -> KinematicLaw | Startable[KinematicLaw]:
    """Return a kinematic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    if name not in KINEMATIC_LAWS:
        raise UnknownNameError("kinematic law", name, KINEMATIC_LAWS)
    return KINEMATIC_LAWS[name]()
