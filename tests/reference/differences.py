"""Central differences of a reference: what its derivatives must agree with."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.motion import Reference

STEP = 1e-5


def check_derivatives(reference: Reference, times: Array, atol: float = 2e-6) -> None:
    """Assert that twist, rates, accelerations and direction are derivatives of what they say."""
    for t in times:
        now, before, after = reference(t), reference(t - STEP), reference(t + STEP)
        rate = (after.pose - before.pose) / (2 * STEP)
        rate[2] = math.remainder(after.pose[2] - before.pose[2], 2 * math.pi) / (2 * STEP)
        cos, sin = math.cos(now.pose[2]), math.sin(now.pose[2])
        vx, vy, omega = now.twist
        world = [cos * vx - sin * vy, sin * vx + cos * vy, omega]
        np.testing.assert_allclose(rate, world, atol=atol)
        change = (after.twist - before.twist) / (2 * STEP)
        np.testing.assert_allclose(change, now.twist_dot, atol=atol)
        joints = (after.joints - before.joints) / (2 * STEP)
        np.testing.assert_allclose(joints, now.joint_rates, atol=atol)
        rates = (after.joint_rates - before.joint_rates) / (2 * STEP)
        np.testing.assert_allclose(rates, now.joint_accelerations, atol=10 * atol)
        if now.direction is None:
            continue
        assert before.direction is not None
        assert after.direction is not None
        turn = (after.direction[:2] - before.direction[:2]) / (2 * STEP)
        np.testing.assert_allclose(turn, now.direction[1:], atol=10 * atol)


def check_rest(reference: Reference, t: float) -> None:
    """Assert that a reference neither moves nor accelerates at a time."""
    state = reference(t)
    for part in (state.twist, state.twist_dot, state.joint_rates, state.joint_accelerations):
        np.testing.assert_allclose(part, 0.0, atol=1e-9)
