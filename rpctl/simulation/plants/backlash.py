"""Backlash: a gap between an actuator and its joint, in which nothing is transmitted.

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

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics

ROTOR_SHARE = 0.1  # of the inertia that a joint resists with: what a rotor behind its gear has


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
