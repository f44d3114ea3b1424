"""What the horizon law remembers of its reference changes no plan, and spares it the reading."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics
from rpctl.arrays import Array
from rpctl.control.horizon import target as pace
from rpctl.control.horizon.law import Horizon
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.named import reference_by_name

PERIOD = 0.02  # s


def plans(name: str, reference: Reference, off: Array, count: int) -> list[Array]:
    """Return the commands of solves along a motion beside the reference."""
    robot = rpctl.load(name)
    dynamics = ReducedDynamics(robot)
    law = Horizon(asynchronous=False).start(dynamics, PERIOD)
    found = []
    for k in range(count):
        state = reference(k * PERIOD)
        q = robot.configuration_at(state.pose + off, state.joints)
        found.append(law(dynamics, reference, k * PERIOD, q, np.zeros(robot.dof)).nu_d_dot)
    assert law.fallbacks == 0
    return found


@pytest.mark.parametrize("name", ["paper", pytest.param("casters", marks=pytest.mark.thorough)])
def test_plans_are_those_of_a_law_that_remembers_nothing(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = reference_by_name(rpctl.load(name), "eight")
    off = np.array([-0.4, 0.2, 0.1])  # beyond the leash: the time is scaled
    remembering = plans(name, reference, off, 8)
    monkeypatch.setattr(pace, "MAX_REMEMBERED", 0)
    forgetful = plans(name, reference, off, 8)
    np.testing.assert_allclose(remembering, forgetful, rtol=0.0, atol=1e-12)


def test_an_instant_is_read_once() -> None:
    usual, read = reference_by_name(rpctl.load("paper"), "eight"), list[float]()

    def reference(t: float) -> ReferenceState:
        read.append(t)
        return usual(t)

    robot = rpctl.load("paper")
    dynamics = ReducedDynamics(robot)
    law = Horizon(asynchronous=False).start(dynamics, PERIOD)
    for k in range(20):
        q = robot.configuration_at(usual(k * PERIOD).pose, usual(k * PERIOD).joints)
        law(dynamics, reference, k * PERIOD, q, np.zeros(robot.dof))
    assert len(read) == len(set(read))
    assert len(read) == 20 + 5 * 20 + 1  # of 20 solves, 5 a step, each 20 steps ahead; pace beyond
