"""Commanded quasi-velocities in the form that each group of a robot's joints takes."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import NamedTuple

from rpctl.arrays import NOTHING, Array
from rpctl.control.output_groups import EFFORT, POSITION, STEERING, WHEELS, members
from rpctl.control.sampling import MeasuredSample
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.robot.model import Robot

LEASH_TIME = 0.1  # s at full speed by which a commanded position may be ahead of its joint
STEERED = ("steered", "mimic", "follower")  # roles of swivels whose angles are commanded
FASTEST = 2.0  # rad/s or m/s, of a joint without a speed limit


class GroupCommand(NamedTuple):
    """The command of one group of a robot's joints, by names; all numbers are finite.

    Attributes:
        kind: The kind of :class:`~rpctl.control.output_groups.OutputGroup`.
        speeds: Speeds, m/s or rad/s. ``"velocity"`` and ``"twist"``: quasi-velocities of the group,
            those of a base being P's in the base's axes. ``"wheel-speeds"``: rates of the driven
            wheels' joints, and of driven swivels that carry casters. ``"steering"``: ``v`` of P,
            and the rate of ``steering``. ``"position"``: rates of the joints.
        positions: Positions at the end of the period, rad or m. ``"position"``: of the joints.
            ``"wheel-speeds"`` and ``"steering"``: of the steered swivels' joints; the latter also
            ``steering``, the angle of a single wheel as far ahead of P as the steered joint.
        accelerations: Change of the speeds since the last command over the period, by the same
            names, m/s² or rad/s².
        efforts: Efforts, N·m or N, by joint, for the kind ``"effort"``; else empty.
    """

    kind: str
    speeds: dict[str, float]
    positions: dict[str, float]
    accelerations: dict[str, float]
    efforts: Mapping[str, float] = MappingProxyType({})


class Place:
    """The commanded position of one joint in one run, on a leash: it waits for one that is held.

    Args:
        lag: T with which the joint follows, s.

    Attributes:
        at: The position, rad or m; NaN before the first.
    """

    def __init__(self, robot: Robot, name: str, lag: float) -> None:
        joint, self._entry = robot.description.joint[name], robot.entries[name]
        self._row, self._lag = robot.quasi_velocities.index(name), lag
        self._limits = joint.lower, joint.upper
        self._leash = LEASH_TIME * min(joint.velocity, FASTEST)
        self.at = math.nan

    def reached(self, state: MeasuredSample) -> float:
        """Return where a servo of lag T is going in a state: p = x + T ẋ."""
        return self._entry.read(state.q) + self._lag * float(state.nu[self._row])

    def advance(self, way: float, ahead: MeasuredSample | None) -> None:
        """Go on by a way (rad or m) from where it was, or from no farther than the leash."""
        if ahead is not None:
            reached = self.reached(ahead)
            gap = 0.0 if math.isnan(self.at) else self.at - reached
            turns = math.tau * round(gap / math.tau) if self._entry.is_pair else 0.0
            self.at = reached + turns + min(max(gap - turns, -self._leash), self._leash)
        lower, upper = self._limits
        self.at = min(max(self.at + way, lower), upper)


class GroupCommands:
    """Makes the commands of one robot's groups in one run.

    Args:
        output: What the groups are, with what they say on the robot.
        dynamics: The robot's dynamics.
        period: Control period, s.
    """

    def __init__(self, output: VelocityOutput, dynamics: ReducedDynamics, period: float) -> None:
        robot, drive = dynamics.robot, dynamics.robot.drive
        self._dynamics, self._period = dynamics, period
        self._members = members(output.groups, robot)
        self._steered = [swivel.joint for swivel in drive.steered]
        self._turned = [swivel.joint for swivel in drive.swivels if swivel.role in STEERED]
        placed = [n for g, own in self._members.values() if g.kind == POSITION for n in own]
        self._steers = any(g.kind in (WHEELS, STEERING) for g, _ in self._members.values())
        placed += self._steered if self._steers else []
        lags = dict(zip(robot.quasi_velocities, output.lag_of(robot.quasi_velocities), strict=True))
        self._places = {name: Place(robot, name, float(lags[name])) for name in placed}
        arm = {*robot.joint_names, *self._turned}
        self._wheels = [name for name in robot.actuators if name not in arm]
        self._rows = [robot.velocity_index(name) for name in self._wheels]
        self._before: Mapping[str, GroupCommand] = {}
        self._rates = [0.0] * len(self._wheels)
        self._angle = 0.0  # rad, of the single wheel

    def __call__(
        self,
        nu: Array,
        sample: MeasuredSample,
        ahead: MeasuredSample | None,
        off: bool,
        efforts: Array = NOTHING,
    ) -> dict[str, GroupCommand]:
        """Return what each group is sent, by its pattern.

        Args:
            nu: Commanded quasi-velocities (dof,).
            sample: What was measured last.
            ahead: The state as it will be when they begin to act; None where there is none new.
            off: Whether the motors are off: then positions are those that are measured.
            efforts: Of all actuators (n_act,), where some are sent any.
        """
        robot, before, found = self._dynamics.robot, self._before, dict[str, GroupCommand]()
        commanded = dict(zip(robot.quasi_velocities, nu.tolist(), strict=True))
        forces = dict(zip(robot.actuators, efforts.tolist(), strict=False))
        for name, place in self._places.items():
            place.advance(self._period * commanded[name], ahead if before else sample)
            place.at = place.reached(sample) if off else place.at
        turned = self._steer(nu, (ahead or sample).q) if self._steers else {}
        for pattern, (group, names) in self._members.items():
            speeds = {name: commanded[name] for name in names if group.kind != EFFORT}
            positions = {name: self._places[name].at for name in names if group.kind == POSITION}
            if group.kind == WHEELS:
                speeds, positions = dict(zip(self._wheels, self._rates, strict=True)), turned
            elif group.kind == STEERING:
                last = before[pattern].positions[STEERING] if before else self._angle
                speeds = {"v": speeds["v"], STEERING: (self._angle - last) / self._period}
                positions = {STEERING: self._angle, **turned}
            known = before[pattern].speeds if before else speeds
            rise = {name: (x - known[name]) / self._period for name, x in speeds.items()}
            own = {name: forces[name] for name in names if group.kind == EFFORT}
            found[pattern] = GroupCommand(group.kind, speeds, positions, rise, own)
        self._before = found
        return found

    def _steer(self, nu: Array, q: Array) -> dict[str, float]:
        """Return the angles of what steers (rad); find the wheels' rates and the single angle.

        Where the angles fix no one motion, rates and the single angle stay as they are.
        """
        robot, placed = self._dynamics.robot, {n: self._places[n].at for n in self._steered}
        at = robot.configuration(joints=placed) if placed else q
        with suppress(SingularBasisError):
            S = self._dynamics.basis(at)
            self._rates = (S[self._rows] @ nu).tolist()
            if placed:
                ahead = complex(*robot.drive.steered[0].pivot) - complex(*robot.drive.point)
                ahead *= cmath.rect(1.0, -robot.drive.heading)
                self._angle = math.atan(ahead.real * float(S[2, 0]))
        return {name: robot.joint_position(at, name) for name in self._turned}
