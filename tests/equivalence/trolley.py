"""A robot on three contacts whose onsets of slipping and tipping paper and pencil give."""

from __future__ import annotations

import math
from pathlib import Path

import rpctl
from rpctl import Robot
from tests import urdf
from tests.robots import SET_A, ball, platform, write

G = 9.81
AHEAD = 0.6  # m: from the axle to the ball
MAST = 0.8  # m: height at which it is pushed
HALF_TRACK, RADIUS, SPIN, WHEEL = SET_A["b"], SET_A["r"], SET_A["I_s"], SET_A["m_w"]
MASS = SET_A["m_c"] + 2.0 * WHEEL
COM = SET_A["m_c"] * SET_A["d"] / MASS  # m ahead of the axle
HEIGHT = (SET_A["m_c"] * 0.2 + 2.0 * WHEEL * RADIUS) / MASS  # m
PITCH = MASS * HEIGHT + 2.0 * SPIN / RADIUS  # N·m per m/s² that loads the axle
WEIGHT = MASS * G
AXLE = WEIGHT * (1.0 - COM / AHEAD)  # N on the axle at rest


def trolley(folder: Path) -> Robot:
    """Return the platform of known parameters with a ball ahead and a mast without mass."""
    mast = (
        f"{urdf.link('mast')}\n{urdf.joint('mast_joint', 'fixed', ('base', 'mast'), (0, 0, MAST))}"
    )
    return rpctl.load(write(folder, platform(SET_A, extra=f"{ball(AHEAD)}\n{mast}")))


def slipping_force(friction: float, direction: int) -> float:
    """Return the force at which the wheels spin: m a = μ (N + ± PITCH a / L).

    Args:
        friction: μ.
        direction: 1 where it drives off, −1 where it brakes.
    """
    return MASS * friction * AXLE / (MASS - direction * friction * PITCH / AHEAD)


def tipping_force() -> float:
    """Return the force at which it rears: PITCH a = W x."""
    return MASS * WEIGHT * COM / PITCH


def pushed_over() -> float:
    """Return the push to the left at which it tips over the line from wheel to ball."""
    return WEIGHT * HALF_TRACK * (1.0 - COM / AHEAD) / MAST


def pushed_aside(friction: float) -> float:
    """Return the push to the left at which both wheels, which alone hold it, slide."""
    return friction * AXLE


def pushed_ahead(friction: float) -> float:
    """Return the push ahead at which locked wheels slide: F = μ (N − F H / L)."""
    return friction * AXLE / (1.0 + friction * MAST / AHEAD)


def circle_slip(friction: float, radius: float) -> float:
    """Return the speed at which the axle slides sideways, the inner wheel braking, the outer not.

    At a = v²/R the wheels' forces along are ∓ m x a / 2 b, their loads N/2 ∓ (m h a + the wheels'
    gyroscopic moment) / 2 b, as far as the ball bears none of it, and Σ √((μ N)² − F²) = m a.
    """

    def spare(speed: float) -> float:
        a, turn = speed**2 / radius, speed / radius
        drag = MASS * COM * turn**2  # the centre of mass is pulled to the middle, too
        pitch = drag * HEIGHT / AHEAD  # N that leaves the ball for the axle
        roll = MASS * HEIGHT * a + 2.0 * SPIN / RADIUS * speed * turn
        held = 0.0
        for side in (-1.0, 1.0):
            load = 0.5 * (AXLE - pitch) + side * roll / (2.0 * HALF_TRACK)
            along = 0.5 * -drag + side * MASS * COM * a / (2.0 * HALF_TRACK)
            held += math.sqrt(max(0.0, (friction * load) ** 2 - along**2))
        return held - MASS * a

    low, high = 0.1, math.sqrt(2.0 * friction * G * radius)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if spare(middle) > 0.0 else (low, middle)
    return low
