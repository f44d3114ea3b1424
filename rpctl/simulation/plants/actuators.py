"""True actuators: what they exert of the efforts that they are commanded.

A command is first cut at the limits at which the actuators saturate, then follows a first-order
lag, T u̇ = c − u, and then passes the backlash of its joint. Each of them is left out where the
plant has none.

Backlash: a gap between an actuator and its joint, in which nothing is transmitted.

The actuator's rotor has an inertia J and a position of its own. While it is within the gap,
J ω̇ = τ, and the joint is free; at an end of the gap it pushes, and cannot pull: the rotor's speed
is then the joint's, and the joint gets τ − J ω̇. Impacts are inelastic. This is the rigid limit of
the model with a stiff and damped shaft ([NG02, Sec. 2]), stepped as the complementarity of gap and
push at the end of each step ([ST96]), which needs no stiffness and is stable in steps of any length
as long as the rotor is lighter than what the joint moves. A wheel's rate is taken to be that with
which it rolls, also where it slips.

[NG02] M. Nordin, P.-O. Gutman, "Controlling mechanical systems with backlash: a survey",
Automatica 38, 2002.
[ST96] D. E. Stewart, J. C. Trinkle, "An implicit time-stepping scheme for rigid body dynamics with
inelastic collisions and Coulomb friction", International Journal for Numerical Methods in
Engineering 39, 1996.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.protocol import Motion

ROTOR_SHARE = 0.1  # of the inertia that a joint resists with: what a rotor behind its gear has
PIECES = 4  # of a control period, in each of which efforts are constant: at most so many


def rotor_inertias(dynamics: ReducedDynamics, q: Array) -> Array:
    """Return the inertias (n_act,) of the rotors, kg·m² or kg, seen behind their gears.

    No description tells them apart from the links, so they are a share of what each joint resists
    with if the others are free: 1/(Bᵀ M⁻¹ B)ᵢᵢ. They come on top of the links' own.

    Args:
        dynamics: Of the robot.
        q: Configuration (nq,) at which that is.
    """
    B = dynamics.actuation(q)
    return np.asarray(ROTOR_SHARE / np.diag(B.T @ np.linalg.solve(dynamics.inertia(q), B)))


class Backlash:
    """Rotors behind the gaps of their joints.

    Args:
        dynamics: Of the robot.
        widths: Of the gaps (n_act,), rad or m; 0: none, and no rotor either.
        rotors: Inertias of the rotors (n_act,), kg·m² or kg.
        rest: Efforts (n_act,) before the run: each rotor lies at the end of the gap at which it
            pushes, in the middle where it does not push.

    Attributes:
        transmitted: Efforts (n_act,) on the joints in the last step.
        offset: By how much each rotor is ahead of its joint (n_act,), from −½ to ½ of the width.
    """

    def __init__(
        self, dynamics: ReducedDynamics, widths: Array, rotors: Array, rest: Array
    ) -> None:
        self._dynamics, self._rotors = dynamics, rotors
        self._half, self._has = 0.5 * widths, widths > 0.0
        self.transmitted = rest
        self.offset = self._half * np.sign(rest)
        self._speed = np.zeros(len(widths))  # of the rotors

    def transmit(self, tau: Array, q: Array, nu: Array, dt: float) -> Array:
        """Return the efforts (n_act,) on the joints in a step.

        Args:
            tau: Efforts (n_act,) on the rotors.
            q: Configuration (nq,) before the step.
            nu: Quasi-velocities (dof,) before the step.
            dt: Length of the step, s.
        """
        rate = self._dynamics.actuation(q).T @ nu
        free = self._speed + dt * tau / self._rotors
        reached = self.offset + dt * (free - rate)
        offset = np.clip(reached, -self._half, self._half)
        speed = rate + (offset - self.offset) / dt
        push = tau - self._rotors * (speed - self._speed) / dt  # 0 within the gap
        inside = np.abs(reached) < self._half
        speed, push = np.where(inside, free, speed), np.where(inside, 0.0, push)
        self.offset, self._speed = offset, speed
        self.transmitted = np.where(self._has, push, tau)
        return self.transmitted


class Actuators:
    """The actuators of a simulated robot.

    Args:
        robot: The simulated robot.
        plant: What its actuators are like.
        period: Control period, s.
        rest: Efforts (n_act,) that hold it before the run, N·m or N.
    """

    def __init__(self, robot: Robot, plant: Plant, period: float, rest: Array) -> None:
        self._limits = plant.saturation(robot)
        self._lag, self._period = plant.effort_lag, period
        self._exerted = self._saturated(rest)
        self._backlash: Backlash | None = None
        gaps = by_pattern(plant.backlash, robot.actuators, "actuator")
        if any(gaps.values()):
            dynamics = ReducedDynamics(robot)
            widths = np.array([gaps.get(name, 0.0) for name in robot.actuators])
            rotors = rotor_inertias(dynamics, robot.configuration())
            self._backlash = Backlash(dynamics, widths, rotors, self._exerted)

    def at(self, command: Array) -> Array:
        """Return the efforts (n_act,) that they exert at the moment when a command comes.

        That is before the backlash, whose impacts no actuator exerts.

        Args:
            command: Efforts (n_act,), N·m or N.
        """
        return self._exerted if self._lag else self._saturated(command)

    def true_efforts(
        self, command: Array, state: Motion, duration: float
    ) -> Iterator[tuple[float, Array]]:
        """Yield how long (s) which efforts (n_act,) act on the joints, one after another.

        In each piece they are constant: of a lag, the mean, which has its impulse exactly.

        Args:
            command: Efforts (n_act,), N·m or N.
            state: Of the robot, which moves between one piece and the next.
            duration: How long the command holds, s.
        """
        wanted = self._saturated(command)
        if not self._lag and self._backlash is None:
            yield duration, wanted
            return
        count = max(1, math.ceil(PIECES * duration / self._period - 1e-9))
        piece = duration / count
        for _ in range(count):
            effort = self._lagging(wanted, piece)
            if self._backlash is not None:
                effort = self._backlash.transmit(effort, state.q, state.nu, piece)
            yield piece, effort

    def _saturated(self, command: Array) -> Array:
        """Return a command (n_act,) within the limits."""
        return np.clip(command, -self._limits, self._limits)

    def _lagging(self, wanted: Array, duration: float) -> Array:
        """Return the mean effort (n_act,) on the way to another, and go on to its end.

        Args:
            wanted: Efforts (n_act,).
            duration: s.
        """
        if not self._lag:
            return wanted
        ratio = duration / self._lag
        left = math.exp(-ratio)
        short = self._exerted - wanted
        self._exerted = wanted + left * short
        return np.asarray(wanted + (1.0 - left) / ratio * short)
