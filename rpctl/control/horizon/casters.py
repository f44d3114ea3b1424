"""The powered casters of a base along a predicted motion.

Their angles are no part of the prediction's state: what the base does turns them. With V the
velocity of a caster's pivot (a complex number, in the base's axes), ω the turning rate, k the
distance of its contact behind its axis and z = exp(iθ) its heading, θ̇ = Im(V z̄)/k − ω, so that

    ż = a − i ω z − ā z²,    a = V/2k,

a Riccati equation. Over a step of constant twist its solution is the exact, and so stable,

    z(t) = (c z + σ (a − ½ i ω z)) / (c + σ (ā z + ½ i ω)),    c = cosh st, σ = sinh(st)/s,

with s² = |a|² − ω²/4; divided by cosh st where s is real.
"""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.model import Robot

LARGEST_TANH = 1.0 - 1e-9  # of the step's decay: a caster that heads backwards stays determinate
STILL = 1e-9  # 1/s: with a smaller s a caster turns as if s were 0


class Casters:
    """The powered casters of one robot.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        casters = robot.drive.powered_casters
        self._root_velocity = robot.root_velocity
        self._pivots = np.array([complex(*swivel.pivot) for swivel in casters], dtype=complex)
        self._behind = np.array([-swivel.trail for swivel in casters])  # k, m
        self._headings = np.array([swivel.heading for swivel in casters])
        self._signs = np.array([swivel.sign for swivel in casters])
        self._entries = tuple(robot.entries[swivel.joint] for swivel in casters)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._entries)

    def read(self, q: Array) -> Array:
        """Return the positions (n,) in q, rad."""
        return np.array([entry.read(q) for entry in self._entries])

    def write(self, q: Array, positions: Array) -> None:
        """Set positions (n,), rad, in q."""
        for entry, position in zip(self._entries, positions.tolist(), strict=True):
            entry.write(q, position)

    def follow(self, positions: Array, twists: Array, dt: float) -> Array:
        """Return the positions (N + 1, n) along a motion, rad.

        Args:
            positions: At its start (n,), rad.
            twists: P's twists (N, 3), constant in each step.
            dt: Length of a step, s.
        """
        if not len(self):
            return np.empty((len(twists) + 1, 0))
        z = np.exp(1j * (self._headings + self._signs * positions))
        found = [z]
        for x, y, turn in (twists @ self._root_velocity.T).tolist():
            z = self._turned(z, complex(x, y) + 1j * turn * self._pivots, turn, dt)
            found.append(z)
        turned = np.angle(np.array(found) * np.exp(-1j * self._headings))
        return np.asarray(self._signs * turned)

    def _turned(self, z: Array, V: Array, turn: float, dt: float) -> Array:
        """Return the headings (n,) after a step; V (n,) are the pivots' velocities, m/s."""
        a = V / (2.0 * self._behind)
        square = np.abs(a) ** 2 - 0.25 * turn**2
        s = np.maximum(np.sqrt(np.abs(square)), STILL)
        decays = square > 0.0
        c = np.where(decays, 1.0, np.cos(s * dt))
        sigma = np.where(decays, np.minimum(np.tanh(s * dt), LARGEST_TANH), np.sin(s * dt)) / s
        swing = 0.5j * turn
        moved = c * z + sigma * (a - swing * z)
        moved /= c + sigma * (a.conj() * z + swing)
        return np.asarray(moved / np.abs(moved))
