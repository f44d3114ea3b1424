"""Base class of the kinematic laws: the twist of the base, and the arm beside it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import BASE_ERRORS, Tracking, observe
from rpctl.control.law import Command, StatelessLaw
from rpctl.control.leash import Leash
from rpctl.control.steering import base_command
from rpctl.control.twist import Twist, omnidirectional_twist
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import require_positive
from rpctl.reference.motion import Reference


@dataclass(frozen=True)
class BaseLaw(StatelessLaw, ABC):
    """A kinematic law that is defined by its twist for a base that cannot move sideways.

    An omnidirectional base gets :func:`~rpctl.control.twist.omnidirectional_twist`, whatever the
    law: its three errors need no trade. The arm's errors, predicted to first order over the horizon
    h, vanish: q̇_d = q̇_r + (q_r − q)/h ([MS21, Eq. 20]).

    Attributes:
        horizon: Prediction time h of the arm and of an omnidirectional base, s.
        leash: Bounds the base's error before the law; None: the law as it was published.
    """

    horizon: float
    leash: Leash | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse a horizon that predicts nothing."""
        require_positive("horizon", self.horizon)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        tracking = observe(dynamics, reference(t), q, nu)
        state, e, e_dot = tracking
        if dynamics.robot.drive.omnidirectional:
            twist = omnidirectional_twist(tracking, self.horizon, self.leash)
        else:
            twist = self.unicycle(self.leashed(tracking))
        base, base_rate = base_command(dynamics, state, q, nu, twist, self.horizon)
        rates = state.joint_rates + e[BASE_ERRORS:] / self.horizon
        accelerations = state.joint_accelerations + e_dot[BASE_ERRORS:] / self.horizon
        return Command(np.concatenate([base, rates]), np.concatenate([base_rate, accelerations]))

    def leashed(self, tracking: Tracking) -> Tracking:
        """Return the tracking error that :meth:`unicycle` is given."""
        return tracking if self.leash is None else self.leash(tracking)

    @abstractmethod
    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist of a base that cannot move sideways."""
