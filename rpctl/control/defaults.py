"""The laws that a robot gets if nobody names others: the best that is known for it."""

from __future__ import annotations

from rpctl.control.integral import IntegralDynamic
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.robot.model import Robot


def default_laws(robot: Robot | None = None) -> tuple[KinematicLaw, DynamicLaw]:
    """Return the default kinematic and dynamic law, the same for every robot so far.

    These are the unified law and the law within limits with integral action. On TIAGo with an error
    of (0.1, 0.3, 0.3) at the start of a line they keep every limit, where the paper's dynamic law
    asks 120 % of a wheel's effort, and bring each final error below that of the paper's.

    The end effector does not come first. ``EndEffector(base=UnifiedKinematic())`` takes a third off
    its rms error there, with 0.25 ms a sample on TIAGo; but the arm then swings to make up for the
    base (0.09 rad rms of its joints in the place of 0.00015, on a swerve 0.6 rad), and steered
    bases take 1 to 2 of the 2 ms. So it is the user's choice.

    Args:
        robot: The robot.
    """
    return UnifiedKinematic(), IntegralDynamic()
