"""The kinematic laws by their names."""

from __future__ import annotations

from rpctl.control.command import KinematicLaw
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import UnknownNameError

KINEMATIC_LAWS = {
    "unified": UnifiedKinematic,
    "paper": PaperKinematic,
    "kanayama": Kanayama,
    "feedback-linearization": FeedbackLinearization,
}


def kinematic_by_name(name: str) -> KinematicLaw:
    """Return a kinematic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    if name not in KINEMATIC_LAWS:
        raise UnknownNameError("kinematic law", name, KINEMATIC_LAWS)
    return KINEMATIC_LAWS[name]()
