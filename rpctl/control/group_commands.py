"""Commanded quasi-velocities in the form that each group of a robot's joints takes."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.output_groups import EFFORT, POSITION, STEERING, WHEELS, members
from rpctl.control.sampling import MeasuredSample
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError

LEASH_TIME = 0.1  # s at full speed by which a commanded position may be ahead of its joint
STEERED = ("steered", "mimic", "follower")  # roles of swivels whose angles are commanded
NOTHING = np.empty(0)
FASTEST = 2.0  # rad/s or m/s, of a joint without a speed limit


class GroupCommand(NamedTuple):
    """What one group of a robot's joints is sent, by names; all of it finite.

    Attributes:
        kind: As of :class:`~rpctl.control.output_groups.OutputGroup`.
        speeds: m/s or rad/s. ``"velocity"`` and ``"twist"``: of its quasi-velocities, those of a
            base of P along the base's own axes. ``"wheel-speeds"``: of the driven wheels' joints,
            and of driven swivels that carry casters. ``"steering"``: ``v`` of P, and the rate of
            ``steering``. ``"position"``: of the joints.
        positions: rad or m, at the end of the period. ``"position"``: of the joints.
            ``"wheel-speeds"`` and ``"steering"``: of the swivels' joints that steer; the latter
            also ``steering``, the angle of a single wheel as far ahead of P as the steered joint.
        accelerations: Of the same as the speeds, m/s² or rad/s²: since what was sent before.
        efforts: N·m or N. ``"effort"``: of the joints, and nothing else.
    """

    kind: str
    speeds: dict[str, float]
    positions: dict[str, float]
    accelerations: dict[str, float]
    efforts: Mapping[str, float] = MappingProxyType({})


class GroupCommands:
    """Makes the commands of one robot's groups in one run.

    A commanded position p advances by the commanded rate. Where its joint does not follow, by more
    than a leash, p waits: it never runs away from a joint that is held.

    Args:
        output: What the groups are, with what they say on the robot.
        dynamics: The robot's dynamics.
        period: Control period, s.
    """

    def __init__(self, output: VelocityOutput, dynamics: ReducedDynamics, period: float) -> None:
        robot, self._period = dynamics.robot, period
        self._dynamics, self._members = dynamics, members(output.groups, robot)
        names, drive = robot.quasi_velocities, robot.drive
        self._steered = [swivel.joint for swivel in drive.steered]
        self._placed = [n for g, own in self._members.values() if g.kind == POSITION for n in own]
        self._steers = any(g.kind in (WHEELS, STEERING) for g, _ in self._members.values())
        if self._steers:
            self._placed += self._steered
        self._which = np.array([names.index(name) for name in self._placed], dtype=np.intp)
        entries = [robot.entries[name] for name in self._placed]
        self._pairs = np.array([entry.is_pair for entry in entries], dtype=np.intp)
        self._at = np.array([entry.index for entry in entries], dtype=np.intp)
        self._lag = output.lag_of(names)[self._which]
        joints = [robot.description.joint[name] for name in self._placed]
        self._limits = np.array([[j.lower, j.upper] for j in joints]).reshape(-1, 2).T
        self._leash = LEASH_TIME * np.array([min(joint.velocity, FASTEST) for joint in joints])
        self._turned = [swivel.joint for swivel in drive.swivels if swivel.role in STEERED]
        arm = {*robot.joint_names, *self._turned}
        self._wheels = [name for name in robot.actuators if name not in arm]
        self._rows = [robot.velocity_index(name) for name in self._wheels]
        self._actuators = {name: k for k, name in enumerate(robot.actuators)}
        self._positions = NOTHING  # (n,) of what is placed, as sent last
        self._before: Mapping[str, GroupCommand] = {}
        self._rates = np.zeros(len(self._wheels))
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
        places = dict[str, float]()
        if self._placed:
            self._advance(nu, ahead if self._positions.size else sample)
            if off:
                self._positions = self._reached(sample)
            places = dict(zip(self._placed, self._positions.tolist(), strict=True))
        turned = self._steer(nu, places, (ahead or sample).q) if self._steers else {}
        commanded = dict(zip(self._dynamics.robot.quasi_velocities, nu.tolist(), strict=True))
        found = {}
        for pattern, (group, names) in self._members.items():
            if group.kind == EFFORT:
                own = {name: float(efforts[self._actuators[name]]) for name in names}
                found[pattern] = GroupCommand(EFFORT, {}, {}, {}, own)
                continue
            speeds = {name: commanded[name] for name in names}
            positions = {name: places[name] for name in names if group.kind == POSITION}
            if group.kind == WHEELS:
                speeds = dict(zip(self._wheels, self._rates.tolist(), strict=True))
                positions = turned
            elif group.kind == STEERING:
                known = self._before[pattern].positions if self._before else {}
                turn = self._angle - known.get(STEERING, self._angle)
                speeds = {"v": speeds["v"], STEERING: turn / self._period}
                positions = {STEERING: self._angle, **turned}
            before = self._before[pattern].speeds if self._before else speeds
            rise = {name: (x - before[name]) / self._period for name, x in speeds.items()}
            found[pattern] = GroupCommand(group.kind, speeds, positions, rise)
        self._before = found
        return found

    def _reached(self, sample: MeasuredSample) -> Array:
        """Return where a servo of lag T is going in a state (n,): p = x + T ẋ."""
        cosines, sines = sample.q[self._at], sample.q[self._at + self._pairs]
        places = np.where(self._pairs, np.arctan2(sines, cosines), cosines)
        return np.asarray(places + self._lag * sample.nu[self._which])

    def _advance(self, nu: Array, ahead: MeasuredSample | None) -> None:
        """Let the commanded positions go on for a period, on their leash."""
        if ahead is not None:
            reached = self._reached(ahead)
            gap = self._positions - reached if self._positions.size else 0.0 * reached
            turns = self._pairs * math.tau * np.round(gap / math.tau)
            short = np.minimum(np.maximum(gap - turns, -self._leash), self._leash)
            self._positions = reached + turns + short
        (lower, upper), moved = self._limits, self._positions + self._period * nu[self._which]
        self._positions = np.minimum(np.maximum(moved, lower), upper)

    def _steer(self, nu: Array, places: dict[str, float], q: Array) -> dict[str, float]:
        """Return the angles of what steers (rad); find the wheels' rates and the single angle.

        Where the angles fix no one motion, rates and the single angle stay as they are.
        """
        robot, at = self._dynamics.robot, q
        if self._steered:
            at = robot.configuration(joints={name: places[name] for name in self._steered})
        with suppress(SingularBasisError):
            S = self._dynamics.basis(at)
            self._rates = S[self._rows] @ nu
            if self._steered:
                ahead = complex(*robot.drive.steered[0].pivot) - complex(*robot.drive.point)
                ahead *= cmath.rect(1.0, -robot.drive.heading)
                self._angle = math.atan(ahead.real * float(S[2, 0]))
        return {name: robot.joint_position(at, name) for name in self._turned}
