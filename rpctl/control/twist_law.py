"""Base class of the kinematic laws: the twist of the base, and the arm beside it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.control.approach import Approach
from rpctl.control.bandwidth import USUAL_PERIOD, joint_gains
from rpctl.control.error import BASE_ERRORS, Leash, Tracking, Twist, observe, omnidirectional_twist
from rpctl.control.law import Command, KinematicController, ReportsNothing, Rest
from rpctl.control.steering import base_command
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import Reference


@dataclass(frozen=True)
class BaseLaw(Record, ABC):
    """A kinematic law that is defined by its twist for a base that cannot move sideways.

    An omnidirectional base gets :func:`~rpctl.control.error.omnidirectional_twist`, whatever the
    law: its three errors need no trade. The arm's errors, predicted to first order over a horizon h
    of each joint's own, vanish: q̇_d = q̇_r + (q_r − q)/h ([MS21, Eq. 20]).
    """

    horizon: Annotated[
        float,
        POSITIVE,
        Setting("s", "Horizon h", "Prediction time of the arm and of an omnidirectional base."),
    ]
    joint_horizon: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h",
            "Prediction time of the arm's joints; of each what its bandwidth allows if not given.",
        ),
    ] = field(default=None, kw_only=True)
    leash: Annotated[
        Leash | None,
        Setting("", "Leash", "Bounds the base's error before the law; false: as it was published."),
    ] = field(default=None, kw_only=True)
    approach: Annotated[
        Approach | None,
        Setting(
            "",
            "Approach from",
            "Stage for large errors of a base that cannot turn on the spot; false: none.",
        ),
    ] = field(default=None, kw_only=True)

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> KinematicController:
        """Return the controller of one run, with its stage for far starts before it.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s: the joints' prediction times depend on it.
            rest: Not used.
        """
        controller = BaseController(self, self.joint_horizons(dynamics, period))
        return controller if self.approach is None else self.approach.start(dynamics, controller)

    def joint_horizons(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return the prediction times of the arm's joints (n_joints,), s.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
        """
        if self.joint_horizon is None:
            return joint_gains(dynamics, period).horizon
        return np.full(len(dynamics.robot.joints), self.joint_horizon)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command of a controller with the usual control period, 2 ms, near or far.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        controller = BaseController(self, self.joint_horizons(dynamics, USUAL_PERIOD))
        return controller(dynamics, reference, t, q, nu)

    def leashed(self, tracking: Tracking) -> Tracking:
        """Return the tracking error that :meth:`unicycle` is given."""
        return tracking if self.leash is None else self.leash(tracking)

    @abstractmethod
    def unicycle(self, tracking: Tracking) -> Twist:
        """Return the twist of a base that cannot move sideways."""


class BaseController(ReportsNothing):
    """A :class:`BaseLaw` on one robot at one control period.

    Args:
        joint_horizons: Prediction times of the arm's joints (n_joints,), s.
    """

    def __init__(self, law: BaseLaw, joint_horizons: Array) -> None:
        self._law, self._joint_horizons = law, joint_horizons

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion."""
        law, h = self._law, self._joint_horizons
        tracking = observe(dynamics, reference(t), q, nu)
        state, e, e_dot = tracking
        if dynamics.robot.drive.omnidirectional:
            twist = omnidirectional_twist(tracking, law.horizon, law.leash)
        else:
            twist = law.unicycle(law.leashed(tracking))
        base, base_rate = base_command(dynamics, state, q, nu, twist, law.horizon)
        rates = state.joint_rates + e[BASE_ERRORS:] / h
        accelerations = state.joint_accelerations + e_dot[BASE_ERRORS:] / h
        return Command(np.concatenate([base, rates]), np.concatenate([base_rate, accelerations]))
