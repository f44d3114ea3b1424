"""What the kinematic laws share: which outputs a base has, and the arm beside it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from rpctl.arrays import Array
from rpctl.control.command import Command, command
from rpctl.control.error import Tracking, observe
from rpctl.control.holonomic import holonomic
from rpctl.control.twist import Twist
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import require_positive
from rpctl.reference.motion import Reference


@dataclass(frozen=True)
class BaseLaw(ABC):
    """A kinematic law that is known by what it asks of a base that cannot move sideways.

    An omnidirectional base is asked for :func:`omnidirectional` twists, whatever the law: its three
    errors need no trade.

    Attributes:
        horizon: Prediction time h of the arm and of a holonomic base, s.
    """

    horizon: float

    def __post_init__(self) -> None:
        """Refuse a horizon that predicts nothing."""
        require_positive("horizon", self.horizon)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion."""
        tracking = observe(dynamics, reference(t), q, nu)
        if dynamics.robot.drive.omnidirectional:
            twist = holonomic(tracking, self.horizon)
        else:
            twist = self.unicycle(tracking)
        return command(dynamics, tracking, q, nu, twist, self.horizon)

    @abstractmethod
    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist to ask of a base that cannot move sideways."""
