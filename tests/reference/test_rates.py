"""A reference's quasi-velocities, by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.reference.motion import ReferenceState, direction, reference_rates, steering
from tests.robots import write
from tests.vehicles import vehicle

V, OMEGA = 0.6, 0.5  # m/s, rad/s


@pytest.mark.parametrize("side", [1, -1])
def test_a_wheel_beside_its_pivot_is_slower_on_the_inside(tmp_path: Path, side: int) -> None:
    """A steady bend about (0, R): the pivot (0.4, 0.3) runs at ω √(0.4² + (R − 0.3)²), its wheel
    0.02 m to the left of it at ω times 0.02 m less, for the centre is to the left."""
    text = vehicle("steered").replace('xyz="0 0.02 0"', f'xyz="0 {0.02 * side} 0"')
    robot = rpctl.load(write(tmp_path, text))
    twist = np.array([V, 0.0, OMEGA])
    state = ReferenceState(np.zeros(3), twist, np.zeros(3), *np.zeros((3, 1)))
    rates, radius = reference_rates(robot, state), V / OMEGA
    pivot = math.hypot(0.4, radius - 0.3)
    speed = OMEGA * (pivot - 0.02 * side)
    np.testing.assert_allclose(rates.nu, [speed, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(rates.nu_dot, 0.0, atol=1e-12)
    np.testing.assert_allclose(steering(robot, state)[0, 0], math.atan2(0.4, radius - 0.3))
    # Sped up along the bend, the wheel speeds up with it; no angle changes.
    faster = reference_rates(robot, state._replace(twist_dot=0.2 * twist))
    np.testing.assert_allclose(faster.nu_dot, [0.2 * speed, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("up", [1, -1])
def test_a_wheel_beside_its_pivot_rolls_as_it_steers(tmp_path: Path, side: int, up: int) -> None:
    """From straight ahead into a bend, with α = ω̇: the wheel turns to the left at 0.4 α/v, its
    joint so where its axis points up, and being y to the left, it rolls at v − y times that."""
    text = vehicle("steered").replace('xyz="0 0.02 0"', f'xyz="0 {0.02 * side} 0"')
    head, _, tail = text.partition('<joint name="fl_steer"')
    text = f'{head}<joint name="fl_steer"{tail.replace("0 0 1", f"0 0 {up}", 1)}'
    robot = rpctl.load(write(tmp_path, text))
    alpha = 0.3
    twist, change = np.array([V, 0.0, 0.0]), np.array([0.0, 0.0, alpha])
    state = ReferenceState(np.zeros(3), twist, change, *np.zeros((3, 1)))
    nu = reference_rates(robot, state).nu
    turned = 0.4 * alpha / V
    assert nu[1] == pytest.approx(up * turned)
    assert nu[0] == pytest.approx(V - 0.02 * side * turned)


def test_a_direction_that_is_given_is_taken() -> None:
    given = np.arange(1.0, 10.0).reshape(3, 3)
    state = ReferenceState(np.zeros(3), np.ones(3), 2.0 * np.ones(3), *np.zeros((3, 1)))._replace(
        direction=given
    )
    np.testing.assert_array_equal(direction(state), given)
    without = direction(state._replace(direction=None))
    np.testing.assert_array_equal(without, [[1, 1, 1], [2, 2, 2], [0, 0, 0]])
