"""The dynamic predictive law within limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded_statements import BoundedStatements
from rpctl.control.closed_form import ClosedFormDynamic
from rpctl.control.dynamic import paper_efforts
from rpctl.control.fragment import LawFragment, LawFrame
from rpctl.control.law import LawSample, Rest
from rpctl.control.within_limits import BoundedLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Setting


@dataclass(frozen=True)
class BoundedDynamic(ClosedFormDynamic):
    """The predictive law of [MS21, Eq. 21-26] within the limits of the URDF.

    It minimises the paper's own cost over the box of effort limits,

        J = ½ pᵀ W′ p,    p = ε + h1 ε̇,    |τ| ≤ τ_max,

    and within the bounds of :class:`JointLimits`, which keep joint rates and positions. While no
    limit binds, the minimum is zero and the law is the paper's. Efforts never leave their box;
    bounds on rates and positions that the efforts cannot keep are broken by the least possible.

    The weights matter only when a limit is active. They apply to p divided by full speed, the speed
    at which the first actuator reaches its velocity limit. Joints have w′ᵢ; the base has

        W′ = √w′ (I − c d dᵀ)² √w′,    c = 1 − √along,

    with d the direction of ν_d + h1 ν̇_d, divided by full speed as well: an error along the desired
    motion is cheaper than one across it. So a robot whose wheels have reached a limit slows down, v
    and ω in proportion, and keeps the curvature. By default the base comes before the joints: a
    joint that its actuator cannot hold does not make the robot drive off under it.

    Efforts are held for a period, so M and h are those of its middle, see
    :func:`~rpctl.control.dynamic.midpoint`.
    """

    horizon_dyn: Annotated[
        float, POSITIVE, Setting("s", "Horizon h₁", "Prediction time h1 of the base.")
    ] = 0.15
    along: Annotated[
        float,
        POSITIVE,
        Setting("", "", "Weight of the base's error along its motion, where one across weighs 1."),
    ] = 1e-2
    weights: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "",
            "w′ by name of the quasi-velocity; 1 for the base's and 1e-4 for joints' if not given.",
        ),
    ] = field(default_factory=dict)
    joint_horizon_dyn: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h₁",
            "Prediction time of the arm's joints; of each what its bandwidth allows if not given.",
        ),
    ] = None
    midpoint: Annotated[
        bool,
        Setting(
            "",
            "M, h of the period's middle",
            "Whether M and h are those of the middle of the period, or those of the sample.",
        ),
    ] = True

    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the numbers among the settings on one robot, see :class:`BoundedLaw`.

        Args:
            known: Its dynamics, as far as the controller knows them.
            period: Control period, s.

        Raises:
            UnknownNameError: A weight is of no quasi-velocity of the robot.
        """
        return BoundedLaw(self, known, period).numbers()

    def free_efforts(
        self,
        known: ReducedDynamics,
        period: float,
        sample: LawSample,
        rest: Rest | None,
        disturbance: Array | float = 0.0,
    ) -> Array:
        """Return τ (n_act,) of a sample that no limit binds, with Pinocchio's dynamics.

        Args:
            known: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            sample: The sample, in arrays.
            rest: Not used.
            disturbance: Acceleration ν̇ (dof,) in addition to that of ``known``.
        """
        law = BoundedLaw(self, known, period)
        return np.asarray(paper_efforts(known, sample, law.times, law.held_for, disturbance))

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the statements that make efforts of the frame's command."""
        return BoundedStatements(frame, BoundedLaw(self, frame.reduced, frame.period)).fragment()
