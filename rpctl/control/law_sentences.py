"""What a user is told of the laws before a run: the joints' gains, and what a law ignores."""

from __future__ import annotations

import numpy as np

from rpctl.control.bandwidth import JointGains, joint_gains
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.integral import IntegralDynamic
from rpctl.dynamics.reduced import ReducedDynamics

IGNORED = "limits of efforts, rates and positions, and that efforts are held for a period"


def law_sentences(dynamics: ReducedDynamics, dynamic: object, period: float) -> tuple[str, ...]:
    """Return sentences on a dynamic law: how fast it makes the joints, or what it ignores.

    Args:
        dynamics: The robot's dynamics.
        dynamic: The law.
        period: Control period, s.
    """
    if isinstance(dynamic, PaperDynamic):
        ignored = IGNORED if not dynamic.midpoint else IGNORED.partition(", and")[0]
        return (f"the paper's dynamic law ignores {ignored}",)
    bounded = dynamic.inner if isinstance(dynamic, IntegralDynamic) else dynamic
    if not isinstance(bounded, BoundedDynamic) or not dynamics.robot.joints:
        return ()
    if bounded.joint_horizon_dyn is not None:
        return (f"joints: h1 {bounded.joint_horizon_dyn:.2g} s, as set",)
    return (gains_sentence(dynamics.robot.joint_names, joint_gains(dynamics, period)),)


def gains_sentence(names: tuple[str, ...], gains: JointGains) -> str:
    """Return the joints' gains in one sentence: those that sampling sets, and what efforts slow.

    Args:
        names: Of the joints.
        gains: Theirs.
    """
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
