"""The laws by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon.law import Horizon
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.obstacles import OBSTACLES, Obstacle
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import UnknownNameError
from rpctl.files.records import CHOICES, Choice

Made = TypeVar("Made")

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
KINEMATIC_CHOICE = Choice("kinematic law", "law", KINEMATIC_LAWS)
DYNAMIC_CHOICE = Choice("dynamic law", "law", DYNAMIC_LAWS)
OBSTACLE_CHOICE = Choice("obstacle", "shape", OBSTACLES)
CHOICES.update(  # what a setting may be, by its type
    {KinematicLaw: KINEMATIC_CHOICE, DynamicLaw: DYNAMIC_CHOICE, Obstacle: OBSTACLE_CHOICE}
)


def kinematic_by_name(name: str) -> KinematicLaw:
    """Return a kinematic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    return _by_name("kinematic law", name, KINEMATIC_LAWS)


def dynamic_by_name(name: str) -> DynamicLaw:
    """Return a dynamic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    return _by_name("dynamic law", name, DYNAMIC_LAWS)


def _by_name(kind: str, name: str, laws: Mapping[str, Callable[[], Made]]) -> Made:
    if name not in laws:
        raise UnknownNameError(kind, name, laws)
    return laws[name]()
