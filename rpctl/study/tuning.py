"""What a bandwidth of the joints buys and costs: margins on paper, errors and efforts in runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rpctl.control.bandwidth import at_bandwidth, gains_of, joint_gains
from rpctl.control.controller import default_laws
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_masses
from rpctl.simulation.loop.periods import CONTROL_PERIOD
from rpctl.simulation.loop.track import track
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import DELAY_S, MASS_RATIO

RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the bandwidth that the joints have by default
SECONDS = 4.0  # of each run
PHASE_MARGIN = 1.298  # rad of the open loop, at ...
CROSSOVER = 1.02  # ... times its bandwidth


@dataclass(frozen=True)
class TuningResult:
    """A bandwidth of the joints, and a run of a robot that is not quite its model.

    Attributes:
        bandwidth: Hz.
        horizon: h, s.
        horizon_dyn: h1, s.
        gain: k, 1/s.
        stiffness: Before the integral acts, along the arm's direction of least inertia at home,
            N·m/rad or N/m.
        lateness: How late efforts may come, besides the hold, before the loop is unstable, s.
        outcome: Of the run, or why there is none.
        effort_ratio: The joints' largest effort over its limit.
        joint_error: The largest of the joints at the end, rad or m; None if the run failed.
        succeeded: Whether the run tracked within all limits.
    """

    bandwidth: float
    horizon: float
    horizon_dyn: float
    gain: float
    stiffness: float
    lateness: float
    outcome: str
    effort_ratio: float | None
    joint_error: float | None
    succeeded: bool

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return asdict(self)


def tuning_bandwidths(robot: Robot) -> tuple[float, ...]:
    """Return the bandwidths (Hz) to try: about the one that the fastest joint has by default.

    Raises:
        RpctlError: The robot has no joints but its base's.
    """
    if not robot.joints:
        raise RpctlError(f"{robot.name} has no arm: no joint has a bandwidth to tune")
    usual = float(joint_gains(ReducedDynamics(robot)).bandwidth.max())
    return tuple(ratio * usual for ratio in RATIOS)


def tune(
    robot: Robot,
    bandwidths: Sequence[float],
    reference: str = "eight",
    duration: float = SECONDS,
    progress: Callable[[int, int], object] | None = None,
) -> list[TuningResult]:
    """Track a reference with joints of each bandwidth, on a robot that its model is not.

    It is 10 % heavier than its controller knows, and its efforts come 5 ms late.

    Args:
        robot: The robot.
        bandwidths: Hz.
        reference: Its name or file.
        duration: Of each run, s.
        progress: Called with the runs done and their number.

    Raises:
        RpctlError: A bandwidth is not positive, or the reference does not fit the robot.
    """
    results = []
    for index, bandwidth in enumerate(bandwidths):
        results.append(_result(robot, bandwidth, reference, duration))
        if progress is not None:
            progress(index, len(bandwidths) - 1)
    return results


def _result(robot: Robot, bandwidth: float, reference: str, duration: float) -> TuningResult:
    _, h, h1, k = (float(part[0]) for part in gains_of(np.array([bandwidth])))
    plant = Plant(delay=DELAY_S, controller_model=scale_masses(robot, "*", 1.0 / MASS_RATIO))
    kinematic, dynamic = (at_bandwidth(law, bandwidth) for law in default_laws(robot))
    outcome, ratio, error, succeeded = "diverging", None, None, False
    try:
        run = track(
            robot, reference, duration=duration, kinematic=kinematic, dynamic=dynamic, plant=plant
        )
    except RpctlError as failure:
        outcome = str(failure)
    else:
        summary = summarize(run)
        outcome, succeeded = summary.outcome, summary.succeeded
        ratios = [each.ratio for each in summary.efforts if each.actuator in robot.joint_names]
        ratio = max(ratios, default=None)
        error = max(joint.final for joint in summary.joint_errors)
    least = float(np.linalg.eigvalsh(_joint_inertia(robot))[0])
    late = PHASE_MARGIN / (CROSSOVER * 2.0 * math.pi * bandwidth) - 0.5 * CONTROL_PERIOD
    return TuningResult(
        bandwidth, h, h1, k, least / (h * h1), late, outcome, ratio, error, succeeded
    )


def _joint_inertia(robot: Robot) -> np.ndarray:
    """Return the joints' inertia (n_joints, n_joints) at home, the base free to give way."""
    q = robot.configuration(joints=dict(zip(robot.joint_names, robot.home.tolist(), strict=True)))
    first = robot.dof - len(robot.joints)
    inverse = np.linalg.inv(ReducedDynamics(robot).inertia(q))
    return np.asarray(np.linalg.inv(inverse[first:, first:]))
