"""The kinematic laws by their names."""

from __future__ import annotations

from rpctl.control.command import KinematicLaw
from rpctl.control.horizon import Horizon
from rpctl.control.kinematic import PaperKinematic
from rpctl.errors import UnknownNameError

KINEMATIC_LAWS = {"paper": PaperKinematic, "horizon": Horizon}


def kinematic_by_name(name: str) -> KinematicLaw:
    """Return a kinematic law with its default settings.

    Raises:
        UnknownNameError: There is no such law.
    """
    if name not in KINEMATIC_LAWS:
        raise UnknownNameError("kinematic law", name, KINEMATIC_LAWS)
    return KINEMATIC_LAWS[name]()
