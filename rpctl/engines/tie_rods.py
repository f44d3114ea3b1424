"""Tie rods: springs that hold the swivels which a drive steers together."""

from __future__ import annotations

from collections.abc import Mapping

import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.drive import Drive
from rpctl.drive.steering import follower_positions
from rpctl.engines.switches import Switches
from rpctl.robot.model import Robot

BANDWIDTH = 200.0  # rad/s of each spring, against the inertia of the swivel that it turns
STABLE = 0.2  # bandwidth times the step at which a spring that is pulled once a step stays stable
DIFFERENCE_STEP = 1e-6  # rad, of a difference quotient


class TieRodPulls:
    """The tie rods of a robot in an engine; without any if ``mimic`` is left or nothing follows.

    Args:
        robot: The robot.
        q: Where it starts (nq,).
        switches: What is mended.
        step: How long efforts hold, s.
    """

    def __init__(self, robot: Robot, q: Array, switches: Switches, step: float) -> None:
        tied = switches.mended("mimic") and bool(robot.drive.followers)
        self._drive, self._step = robot.drive, step
        self._inertia = follower_inertia(robot, q) if tied else {}

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self._inertia)

    def added(
        self, efforts: Mapping[str, float], joints: Mapping[str, tuple[float, float]]
    ) -> dict[str, float]:
        """Return efforts (N·m or N, by joint) and those of the rods.

        Args:
            efforts: Without the rods.
            joints: Positions (rad) and rates (rad/s) of the swivels, by joint.
        """
        given = dict(efforts)
        if self:
            rods = tie_rod_efforts(self._drive, joints, self._inertia, self._step)
            given |= {name: given.get(name, 0.0) + rod for name, rod in rods.items()}
        return given


def tie_rod_efforts(
    drive: Drive,
    joints: Mapping[str, tuple[float, float]],
    inertia: Mapping[str, float],
    step: float,
) -> dict[str, float]:
    """Return the efforts (N·m) of tie rods, critically damped, on followers and their leaders.

    Each works on φ = δ − f(leaders) alone: the follower feels −(k φ + d φ̇), the leaders ∂f/∂δ
    times the opposite.

    Args:
        drive: The drive.
        joints: Positions (rad) and rates (rad/s) of its swivels, by joint.
        inertia: Of each follower about its axis, kg·m².
        step: How long the efforts hold, s: a spring too stiff for it would shake.
    """
    if not drive.followers:
        return {}
    at = {swivel.joint: joints[swivel.joint][0] for swivel in drive.steered}
    place = follower_positions(drive, at)
    nearby = {
        name: follower_positions(drive, at | {name: at[name] + DIFFERENCE_STEP}) for name in at
    }
    efforts = dict.fromkeys((*at, *place), 0.0)
    bandwidth = min(BANDWIDTH, STABLE / step)
    for name, wanted in place.items():
        slopes = {leader: (nearby[leader][name] - wanted) / DIFFERENCE_STEP for leader in at}
        position, rate = joints[name]
        rate -= sum(slope * joints[leader][1] for leader, slope in slopes.items())
        pull = inertia[name] * bandwidth * (bandwidth * (position - wanted) + 2.0 * rate)
        efforts[name] -= pull
        for leader, slope in slopes.items():
            efforts[leader] += slope * pull
    return efforts


def follower_inertia(robot: Robot, q: Array) -> dict[str, float]:
    """Return the inertia of each follower about its axis at q (nq,), kg·m²."""
    data = robot.model.createData()
    M = pin.crba(robot.model, data, q)
    index = {swivel.joint: robot.velocity_index(swivel.joint) for swivel in robot.drive.followers}
    return {name: float(M[i, i]) for name, i in index.items()}
