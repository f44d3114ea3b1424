"""What a bandwidth of the joints buys and costs: margins on paper, errors and efforts in runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.control.bandwidth import USUAL_PERIOD, gains_of, usual_gains
from rpctl.control.controller import default_laws
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_masses
from rpctl.simulation.config import CONTROL_PERIOD, Config, RunSettings
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import DELAY_S, MASS_RATIO
from rpctl.study.cells import References, Row

RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the usual bandwidth
SECONDS = 4.0  # of each run
PHASE_MARGIN = 1.298  # rad of the open loop, at ...
CROSSOVER = 1.02  # ... times its bandwidth


@dataclass(frozen=True, eq=False)
class TuneCell:
    """A run of a robot whose joints have a bandwidth (Hz).

    The robot is 10 % heavier than its controller knows, and its efforts come 5 ms late.
    """

    bandwidth: float
    prepared: Config

    def config(self, references: References) -> Config:
        """Return the run's configuration; see :class:`rpctl.study.cells.Cell`."""
        return self.prepared


def tune_cells(robot: Robot, bandwidths: Sequence[float], run: RunSettings) -> list[TuneCell]:
    """Return a run with joints of each bandwidth (Hz).

    Raises:
        RpctlError: A bandwidth is not positive.
    """
    plant = Plant(delay=DELAY_S, controller_model=scale_masses(robot, "*", 1.0 / MASS_RATIO))
    config = Config(*default_laws(robot), run=run, plant=plant)
    return [TuneCell(each, config.with_bandwidth(each)) for each in bandwidths]


def tuning_bandwidths(robot: Robot) -> tuple[float, ...]:
    """Return the bandwidths (Hz) to try: about the usual one.

    Raises:
        RpctlError: The robot has no joints but its base's.
    """
    if not robot.joints:
        raise RpctlError(f"{robot.name} has no arm: no joint has a bandwidth to tune")
    return tuple(ratio * usual_gains(USUAL_PERIOD).bandwidth for ratio in RATIOS)


def row_dict(robot: Robot, row: Row[TuneCell]) -> dict[str, Any]:
    """Return a bandwidth (Hz), what follows from it, and how its run went, as JSON says it.

    ``stiffness`` is that before the integral acts, along the arm's direction of least inertia at
    home (N·m/rad or N/m); ``lateness`` how late efforts may come, besides the hold, before the loop
    is unstable (s).
    """
    bandwidth, figures = row.cell.bandwidth, row.figures
    _, h, h1, k = gains_of(bandwidth)
    q, first = robot.configuration_at(np.zeros(3), robot.home), robot.dof - len(robot.joints)
    # The base is free to give way: the joints' part of the inverse, not of the inertia.
    mobility = np.linalg.inv(ReducedDynamics(robot).inertia(q))[first:, first:]
    least = 1.0 / float(np.linalg.eigvalsh(mobility)[-1])
    return {
        "bandwidth": bandwidth,
        "horizon": h,
        "horizon_dyn": h1,
        "gain": k,
        "stiffness": least / (h * h1),
        "lateness": PHASE_MARGIN / (CROSSOVER * 2.0 * math.pi * bandwidth) - 0.5 * CONTROL_PERIOD,
        "outcome": figures.failure or figures.outcome,
        "effort_ratio": figures.joint_effort,
        "joint_error": figures.joint_error,
        "succeeded": figures.succeeded,
    }
