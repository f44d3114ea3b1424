"""The dynamic predictive law of [MS21]: from quasi-velocities to actuator efforts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.control.law import Command, StatelessLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import require_positive


@dataclass(frozen=True)
class PaperDynamic(StatelessLaw):
    """The predictive law of [MS21, Eq. 21-26].

    The velocity errors ε = ν − ν_d, predicted to first order over the horizon h1, minimise
    J = ½ Σ w′ᵢ (εᵢ + h1 ε̇ᵢ)² over τ (Eq. 25). Without limits the minimum is zero and the weights
    cancel:

        ν̇* = ν̇_d − (ν − ν_d)/h1,    B τ = M ν̇* + h

    so that ε̇ = −ε/h1.

    Attributes:
        horizon_dyn: Prediction time h1, s.
    """

    horizon_dyn: float = 0.15

    def __post_init__(self) -> None:
        """Refuse a horizon that predicts nothing."""
        require_positive("horizon_dyn", self.horizon_dyn)

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        """Return τ (n_act,).

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: Command to follow.
        """
        nu_dot = command.nu_d_dot - (nu - command.nu_d) / self.horizon_dyn
        return np.asarray(dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot, command.nu_d)))
