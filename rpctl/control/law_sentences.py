"""What a user is told of the laws of a run: the joints' gains, and what a law ignores."""

from __future__ import annotations

import numpy as np

from rpctl.control.bandwidth import JointGains, joint_gains
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot

IGNORED = "limits of efforts, rates and positions, and that efforts are held for a period"
LIMITLESS = "ignores limits of speeds, rates and positions"
UNLEASHED = "is on no leash (far errors ask for high speeds)"
LINE = "leaves the lateral error of a straight line as it is"


def law_sentences(
    dynamics: ReducedDynamics, kinematic: object, dynamic: object, period: float
) -> tuple[str, ...]:
    """Return sentences on the laws: what those of the paper ignore, how fast the joints are.

    Args:
        dynamic: The dynamic law; None where speeds are the output.
        period: Control period, s.
    """
    base = kinematic.base if isinstance(kinematic, EndEffector) else kinematic
    found = []
    if isinstance(base, PaperKinematic):
        found.append(_paper_kinematic(base, dynamics.robot))
    if isinstance(dynamic, PaperDynamic):
        ignored = IGNORED if not dynamic.midpoint else IGNORED.partition(", and")[0]
        found.append(f"the paper's dynamic law ignores {ignored}")
    elif isinstance(dynamic, BoundedDynamic | IntegralDynamic) and dynamics.robot.joints:
        found.append(_joints_sentence(dynamics, base, dynamic, period))
    return tuple(found)


def _paper_kinematic(law: PaperKinematic, robot: Robot) -> str:
    """Return what the paper's kinematic law does not do, on this robot."""
    rest = [UNLEASHED] if law.leash is None and robot.drive.base_speeds else []
    rest += [LINE] if robot.drive.base_speeds and not robot.drive.omnidirectional else []
    *first, last = [LIMITLESS, *rest]
    return f"the paper's kinematic law {', '.join(first)}{' and ' * bool(first)}{last}"


def _joints_sentence(
    dynamics: ReducedDynamics,
    base: object,
    dynamic: BoundedDynamic | IntegralDynamic,
    period: float,
) -> str:
    """Return the joints' gains in one sentence: those that are derived, and those that are set."""
    integral = dynamic if isinstance(dynamic, IntegralDynamic) else None
    bounded = dynamic if isinstance(dynamic, BoundedDynamic) else dynamic.inner
    h = base.joint_horizon if isinstance(base, BaseLaw) else None
    if isinstance(base, PaperKinematic):
        h = base.joint_horizon or base.horizon
    h1, k = bounded.joint_horizon_dyn, None if integral is None else integral.joint_gain
    known = ((f"h {h or 0:.2g} s", h), (f"h1 {h1 or 0:.2g} s", h1), (f"k {k or 0:.2g} 1/s", k))
    given = ", ".join(text for text, value in known if value is not None)
    if h1 is not None:
        return f"joints: {given}, as set"
    derived = gains_sentence(dynamics.robot.joint_names, joint_gains(dynamics, period))
    return f"{derived}; but {given}, as set" if given else derived


def gains_sentence(names: tuple[str, ...], gains: JointGains) -> str:
    """Return the joints' gains in one sentence: those that sampling sets, and what efforts slow."""
    first = int(np.argmax(gains.bandwidth))
    fastest, h, h1, k = (float(part[first]) for part in gains)
    slower = [
        f"{name} {bandwidth:.2g} Hz"
        for name, bandwidth in zip(names, gains.bandwidth, strict=True)
        if bandwidth < 0.99 * fastest
    ]
    tail = f"; as efforts allow: {', '.join(slower)}" if slower else ""
    return (
        f"joints: {fastest:.2g} Hz (h {h:.2g} s, h1 {h1:.2g} s, k {k:.2g} 1/s), as sampling and "
        f"10 ms in reserve allow{tail}"
    )
