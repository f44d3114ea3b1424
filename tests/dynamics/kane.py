"""Rigid wheels that roll and lean, by Kane's method with multipliers; nothing of rpctl is asked.

Every body's partial velocities are written down by hand in Euler angles: the frame turns by yaw ψ
about the vertical, then by lean φ about its own forward axis, then by pitch χ about its own left
one. Rates are complex steps, x(q + i ε q̇), exact to rounding. The material point of a wheel that
touches the ground stands still, which is three rows a wheel,

    Σ J_vᵀ m (a − g) + J_ωᵀ (I α + ω × I ω) = Q + Aᵀ λ,   A u = 0,   Ȧ u + A u̇ = 0.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from tests.dynamics.whipple import GRAVITY

STEP = 1e-100  # of complex steps
UP = np.array([0.0, 0.0, 1.0])
TOLERANCE = 1e-11  # of the integration

Efforts = Callable[[float], Any]  # generalised force (n,) at a time, s


class Body(NamedTuple):
    """A body at q: its mass, its inertia in the world, and rows of its velocities."""

    mass: float  # kg
    inertia: Any  # (3, 3)
    linear: Any  # (3, n), of its centre of mass
    turning: Any  # (3, n)


class Mechanism(NamedTuple):
    """What moves, as functions of q (n,); the first five are x, y, z, yaw and lean of a wheel."""

    bodies_and_rows: Callable[[Any], tuple[list[Body], Any]]  # and A (m, n)
    heights: Callable[[Any], Any]  # of wheels' lowest points, m
    radius: float  # of the first wheel, m
    gravity: float = GRAVITY  # m/s²

    def contact(self, q: Any) -> Any:
        """Return where the first wheel touches the ground (3,), m."""
        return q[:3] + self.radius * downward((turn(2, q[3]) @ turn(0, q[4]))[:, 1])

    def placed(self, q: Any, free: Sequence[int]) -> Any:
        """Return q (n,) with all wheels on the ground, by some of its entries."""
        found = np.array(q, dtype=float)
        for _ in range(8):  # Newton's steps
            steps = [self.heights(found + 1j * STEP * np.eye(len(q))[k]).imag for k in free]
            found[list(free)] -= np.linalg.solve(np.array(steps).T / STEP, self.heights(found))
        return found

    def rates(self, q: Any, speed: float, given: dict[int, float]) -> Any:
        """Return u (n,) of which the first wheel's contact moves ahead, and some entries, m/s."""
        n = len(q)
        ahead = np.array([np.cos(q[3]), np.sin(q[3]), 0.0])
        steps = [self.contact(q + 1j * STEP * e).imag / STEP for e in np.eye(n)]
        rows = [*self.bodies_and_rows(q)[1], np.array(steps) @ ahead, *np.eye(n)[list(given)]]
        still = np.zeros(len(rows) - 1 - len(given))
        return np.linalg.solve(np.array(rows), [*still, speed, *given.values()])

    def acceleration(self, q: Any, u: Any, force: Any) -> Any:
        """Return u̇ (n,) at q (n,) and its rates u (n,) under a generalised force (n,)."""
        n = len(q)
        here, A = self.bodies_and_rows(q)
        there, moving = self.bodies_and_rows(q + 1j * STEP * u)
        mass, load = np.zeros((n, n)), np.array(force, dtype=float)
        for body, ahead in zip(here, there, strict=True):
            omega = body.turning @ u
            a, alpha = ahead.linear.imag @ u / STEP, ahead.turning.imag @ u / STEP
            turned = body.inertia @ alpha + np.cross(omega, body.inertia @ omega)
            mass += body.mass * body.linear.T @ body.linear
            mass += body.turning.T @ body.inertia @ body.turning
            load -= body.mass * body.linear.T @ (a + self.gravity * UP) + body.turning.T @ turned
        both = np.block([[mass, -A.T], [A, np.zeros((len(A), len(A)))]])
        return np.linalg.solve(both, [*load, *(-moving.imag @ u / STEP)])[:n]

    def motion(self, q: Any, u: Any, times: Any, efforts: Efforts) -> Any:
        """Return q and u (K, 2 n) at times (K,), s; efforts may jump at any of these."""
        y = np.concatenate([q, u])
        found, n = [y], len(q)
        for start, end in itertools.pairwise(times):
            force = efforts(0.5 * (start + end))

            def rate(_: float, y: Any, force: Any = force) -> Any:
                return np.concatenate([y[n:], self.acceleration(y[:n], y[n:], force)])

            done = solve_ivp(rate, (start, end), y, "DOP853", rtol=TOLERANCE, atol=TOLERANCE)
            found.append(y := done.y[:, -1])
        return np.array(found)


def turn(axis: int, angle: Any) -> Any:
    """Return the rotation (3, 3) about a coordinate axis."""
    cos, sin = np.cos(angle), np.sin(angle)
    R = np.zeros((3, 3), dtype=np.asarray(angle).dtype)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[axis, axis], R[i, i], R[j, j], R[i, j], R[j, i] = 1.0, cos, cos, -sin, sin
    return R


def about(axis: Any, angle: Any) -> Any:
    """Return the rotation (3, 3) about a unit axis, by its matrix exponential in closed form."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def moved(columns: Any, arm: Any) -> Any:
    """Return the rows (3, n) of ω × arm, of those of ω."""
    return np.cross(columns, arm, axisa=0, axisc=0)


def downward(axle: Any) -> Any:
    """Return the unit way (3,) in a wheel's plane to its lowest point."""
    steepest = axle[2] * axle - UP
    return steepest / np.sqrt(steepest @ steepest)


def whipple(p: dict[str, float]) -> Mechanism:
    """Return Whipple's bicycle of the benchmark's parameters.

    Its axes are turned: here x is forward, y to the left and z up. Steering is positive to the
    right, about the axis that points down and ahead. q is the place of the rear wheel's centre,
    ψ, φ, χ, the steering and the angles of rear and front wheel (9,).
    """
    sin, cos = math.sin(p["lam"]), math.cos(p["lam"])
    hub = np.array([0.0, 0.0, p["rR"]])  # all places when upright, from the rear contact
    crown = np.array([p["w"] + p["c"], 0.0, 0.0])  # where the steering axis meets the ground
    far = np.array([p["w"], 0.0, p["rF"]])
    rider = np.array([p["xB"], 0.0, -p["zB"]])
    handlebar = np.array([p["xH"], 0.0, -p["zH"]])
    steering = np.array([sin, 0.0, -cos])

    def tensor(part: str) -> Any:
        xx, yy, xz = p[f"I{part}xx"], p[f"I{part}yy"], -p.get(f"I{part}xz", 0.0)
        return np.array([[xx, 0.0, xz], [0.0, yy, 0.0], [xz, 0.0, p.get(f"I{part}zz", xx)]])

    def bodies_and_rows(q: Any) -> tuple[list[Body], Any]:
        R, frame, turning = _frame(q, 9)
        fork = frame @ about(steering, q[6])
        steered, rear, front = turning.copy(), turning.copy(), turning.copy()
        steered[:, 6] = front[:, 6] = frame @ steering
        rear[:, 7], front[:, 8] = R[:, 1], fork[:, 1]
        slides = np.eye(3, 9)
        pivot = slides + moved(turning, frame @ (crown - hub))
        centre = pivot + moved(steered, fork @ (far - crown))

        def body(part: str, axes: Any, linear: Any, turns: Any) -> Body:
            return Body(p[f"m{part}"], axes @ tensor(part) @ axes.T, linear, turns)

        return [
            body("B", frame, slides + moved(turning, frame @ (rider - hub)), turning),
            body("R", frame, slides, rear),
            body("H", fork, pivot + moved(steered, fork @ (handlebar - crown)), steered),
            body("F", fork, centre, front),
        ], np.concatenate([
            slides + moved(rear, p["rR"] * downward(R[:, 1])),
            centre + moved(front, p["rF"] * downward(fork[:, 1])),
        ])  # fmt: skip

    def heights(q: Any) -> Any:
        _, frame, _ = _frame(q, 9)
        fork = frame @ about(steering, q[6])
        centre = q[:3] + frame @ (crown - hub) + fork @ (far - crown)
        rear = q[2] + p["rR"] * downward(frame[:, 1])[2]
        return np.array([rear, centre[2] + p["rF"] * downward(fork[:, 1])[2]])

    return Mechanism(bodies_and_rows, heights, p["rR"])


def disc(mass: float, radius: float, axial: float, across: float) -> Mechanism:
    """Return a thin wheel alone; q is the place of its centre, ψ, φ and its angle (6,)."""

    def bodies_and_rows(q: Any) -> tuple[list[Body], Any]:
        R = turn(2, q[3]) @ turn(0, q[4])
        turning = np.zeros((3, 6), dtype=R.dtype)
        turning[:, 3], turning[:, 4], turning[:, 5] = UP, turn(2, q[3])[:, 0], R[:, 1]
        inertia = R @ np.diag([across, axial, across]) @ R.T
        slides = np.eye(3, 6)
        contact = slides + moved(turning, radius * downward(R[:, 1]))
        return [Body(mass, inertia, slides, turning)], contact

    def heights(q: Any) -> Any:
        return np.array([q[2] - radius * np.cos(q[4])])

    return Mechanism(bodies_and_rows, heights, radius)


def _frame(q: Any, count: int) -> tuple[Any, Any, Any]:
    """Return the axes of yaw and lean, those of the frame, and rows of its turning (3, count)."""
    R = turn(2, q[3]) @ turn(0, q[4])
    turning = np.zeros((3, count), dtype=R.dtype)
    turning[:, 3], turning[:, 4], turning[:, 5] = UP, turn(2, q[3])[:, 0], R[:, 1]
    return R, R @ turn(1, q[5]), turning
