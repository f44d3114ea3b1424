"""The dynamic predictive law of [MS21]: from quasi-velocities to actuator efforts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.control.law import Command, ReportsNothing, Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Record, Setting


@dataclass(frozen=True)
class PaperDynamic(Record):
    """The predictive law of [MS21, Eq. 21-26].

    The velocity errors ε = ν − ν_d, predicted to first order over the horizon h1, minimise
    J = ½ Σ w′ᵢ (εᵢ + h1 ε̇ᵢ)² over τ (Eq. 25). Without limits the minimum is zero and the weights
    cancel:

        ν̇* = ν̇_d − (ν − ν_d)/h1,    B τ = M ν̇* + h − ℓ(ν_d)

    so that ε̇ = −ε/h1. The paper's robot loses nothing, ℓ = 0. Where a joint does, it is compensated
    at the speed it is wanted to have: what is left, ℓ(ν) − ℓ(ν_d), brakes the error, and friction
    does not follow the sign of a measurement that is noise.
    """

    horizon_dyn: Annotated[float, POSITIVE, Setting("s", "Horizon h₁", "Prediction time h1.")] = (
        0.15
    )
    joint_horizon_dyn: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h₁",
            "Prediction time of the arm's joints; h1, as published, if not given.",
        ),
    ] = None
    midpoint: Annotated[
        bool,
        Setting(
            "",
            "M, h of the period's middle",
            "Whether M and h are those of the middle of the period, or those of the sample, as "
            "published.",
        ),
    ] = False

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> PaperDynamicController:
        """Return the controller of one run.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: Not used.
        """
        joints = len(dynamics.robot.joints)
        times = by_velocity(
            dynamics, self.horizon_dyn, np.full(joints, self.joint_horizon_dyn or self.horizon_dyn)
        )
        return PaperDynamicController(times, period if self.midpoint else 0.0)

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        """Return τ (n_act,) of a controller with the usual control period, 2 ms.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: Command to follow.
        """
        return self.start(dynamics, USUAL_PERIOD)(dynamics, q, nu, command)


class PaperDynamicController(ReportsNothing):
    """:class:`PaperDynamic` on one robot.

    Args:
        times: Prediction times h1 (dof,), s.
        period: For how long efforts are held, as far as the law takes account of it, s.
    """

    def __init__(self, times: Array, period: float) -> None:
        self.times, self.held_for = times, period

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        """Return τ (n_act,)."""
        nu_dot = command.nu_d_dot - (nu - command.nu_d) / self.times
        middle = midpoint(dynamics, q, nu, command, self.held_for)
        force = dynamics.inverse(middle.q, middle.nu, nu_dot, middle.nu_d)
        return np.asarray(dynamics.efforts(middle.q, force))


class Midpoint(NamedTuple):
    """The state in the middle of a control period, or of a sample."""

    q: Array  # (nq,)
    nu: Array  # (dof,)
    nu_d: Array  # (dof,) wanted then: losses are compensated at these speeds


def midpoint(
    dynamics: ReducedDynamics, q: Array, nu: Array, command: Command, period: float
) -> Midpoint:
    """Return the state in the middle of a period, of a robot that accelerates as commanded.

    Efforts are held for a period T. With M and h of this state the mean acceleration is the one
    asked for but for terms of T²; with those of the sample h is late by ½T on the average, and
    M⁻¹ ½T ḣ remains. Along a direction of little inertia that is much: to hold a base's motion off
    wrist axes that are in line takes efforts a hundred times those that turn them.

    The acceleration is ν̇_d, without the feedback: where the robot follows, this is none, and where
    limits bind, it is what the robot does not do.

    Args:
        period: T, s; 0 returns the state of the sample.
    """
    if period == 0.0:
        return Midpoint(q, nu, command.nu_d)
    step = 0.5 * period
    ahead = pin.integrate(dynamics.robot.model, q, step * (dynamics.basis(q) @ nu))
    ahead_by = step * command.nu_d_dot
    return Midpoint(ahead, nu + ahead_by, command.nu_d + ahead_by)


def by_velocity(dynamics: ReducedDynamics, base: float, joints: Array) -> Array:
    """Return a setting by quasi-velocity (dof,).

    Args:
        joints: Those of the arm's joints (n_joints,).
    """
    return np.concatenate([np.full(dynamics.robot.dof - len(joints), base), joints])
