"""Commanded quasi-velocities in the form that each group of a robot's joints takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.output_groups import POSITION, STEERING, WHEELS, members
from rpctl.control.sampling import MeasuredSample
from rpctl.control.velocity_output import VelocityOutput
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError

LEASH_TIME = 0.1  # s at full speed by which a commanded position may be ahead of its joint
LEASH = 0.2  # rad or m, of a joint without a speed limit


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
    """

    kind: str
    speeds: dict[str, float]
    positions: dict[str, float]
    accelerations: dict[str, float]


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
        self._index = {name: k for k, name in enumerate(names)}
        joints, steered = robot.description.joint, [swivel.joint for swivel in drive.steered]
        placed = [n for g, own in self._members.values() if g.kind == POSITION for n in own]
        self._steers = any(g.kind in (WHEELS, STEERING) for g, _ in self._members.values())
        if self._steers:
            placed += steered
        self._placed = placed
        self._which = np.array([self._index[name] for name in placed], dtype=np.intp)
        self._entries = [robot.entries[name] for name in placed]
        self._pairs = [(k, entry) for k, entry in enumerate(self._entries) if entry.is_pair]
        self._at = np.array([entry.index for entry in self._entries], dtype=np.intp)
        self._lag = output.lag_of(names)[self._which]
        self._lower = np.array([joints[name].lower for name in placed])
        self._upper = np.array([joints[name].upper for name in placed])
        fastest = np.array([joints[name].velocity for name in placed])
        self._leash = np.where(np.isfinite(fastest), LEASH_TIME * fastest, LEASH)
        self._steered, mimics = steered, robot.mimics
        self._carried = [(j, j.mimic) for j in mimics if j.mimic and j.mimic.joint in steered]
        turned = (s.joint for s in drive.swivels if s.role in ("steered", "mimic", "follower"))
        self._turned = tuple(turned)
        arm = {*robot.joint_names, *self._turned}
        self._wheels = [name for name in robot.actuators if name not in arm]
        self._rows = [robot.velocity_index(name) for name in self._wheels]
        self._ahead = 0.0  # m, of the steered joint before P
        if steered:
            (x, y), (px, py) = drive.steered[0].pivot, drive.point
            cos, sin = math.cos(drive.heading), math.sin(drive.heading)
            self._ahead = cos * (x - px) + sin * (y - py)
        self._positions = np.empty(0)  # (n,) of what is placed, as sent last
        self._before: Mapping[str, GroupCommand] = {}
        self._rates = np.zeros(len(self._wheels))
        self._angle = 0.0  # rad, of the single wheel

    def __call__(
        self, nu: Array, sample: MeasuredSample, ahead: MeasuredSample | None, off: bool
    ) -> dict[str, GroupCommand]:
        """Return what each group is sent, by its pattern.

        Args:
            nu: Commanded quasi-velocities (dof,).
            sample: What was measured last.
            ahead: The state as it will be when they begin to act; None where there is none new.
            off: Whether the motors are off: then positions are those that are measured.
        """
        places = dict[str, float]()
        if self._placed:
            first = not self._positions.size
            self._advance(nu, sample if first else ahead)
            if off:
                self._positions = self._reached(sample)
            places = dict(zip(self._placed, self._positions.tolist(), strict=True))
        turned = self._steer(nu, places, (ahead or sample).q) if self._steers else {}
        commanded = dict(zip(self._index, nu.tolist(), strict=True))
        found = {}
        for pattern, (group, names) in self._members.items():
            speeds = {name: commanded[name] for name in names}
            positions: dict[str, float] = {}
            if group.kind == POSITION:
                positions = {name: places[name] for name in names}
            elif group.kind == WHEELS:
                speeds = dict(zip(self._wheels, self._rates.tolist(), strict=True))
                positions = turned
            elif group.kind == STEERING:
                rate = 0.0
                if self._before:
                    rate = (self._angle - self._before[pattern].positions[STEERING]) / self._period
                speeds = {"v": speeds["v"], STEERING: rate}
                positions = {STEERING: self._angle, **turned}
            before = self._before[pattern].speeds if self._before else speeds
            rise = {name: (x - before[name]) / self._period for name, x in speeds.items()}
            found[pattern] = GroupCommand(group.kind, speeds, positions, rise)
        self._before = found
        return found

    def _reached(self, sample: MeasuredSample) -> Array:
        """Return where a servo of lag T is going in a state (n,): p = x + T ẋ."""
        places = sample.q[self._at]
        for k, entry in self._pairs:
            places[k] = entry.read(sample.q)
        return np.asarray(places + self._lag * sample.nu[self._which])

    def _advance(self, nu: Array, ahead: MeasuredSample | None) -> None:
        """Let the commanded positions go on for a period, on their leash."""
        if ahead is not None:
            reached = self._reached(ahead)
            gap = self._positions - reached if self._positions.size else 0.0 * reached
            for k, _ in self._pairs:
                whole = math.tau * round(gap[k] / math.tau)
                reached[k], gap[k] = reached[k] + whole, gap[k] - whole
            gap = np.minimum(np.maximum(gap, -self._leash), self._leash)
            self._positions = reached + gap
        moved = self._positions + self._period * nu[self._which]
        self._positions = np.minimum(np.maximum(moved, self._lower), self._upper)

    def _steer(self, nu: Array, places: dict[str, float], q: Array) -> dict[str, float]:
        """Return the angles of what steers (rad); find the wheels' rates and the single angle.

        Where the angles fix no one motion, rates and the single angle stay as they are.
        """
        robot, at = self._dynamics.robot, q
        turned = {name: places[name] for name in self._steered}
        if turned:
            at = q.copy()
            turned |= {
                joint.name: mimic.multiplier * turned[mimic.joint] + mimic.offset
                for joint, mimic in self._carried
            }
            turned |= {n: float(x) for n, x in follower_positions(robot.drive, turned).items()}
            for name, place in turned.items():
                robot.entries[name].write(at, place)
        with suppress(SingularBasisError):
            S = self._dynamics.basis(at)
            self._rates = S[self._rows] @ nu
            if turned:
                self._angle = math.atan(self._ahead * float((robot.point_velocity @ S[:3, 0])[2]))
        return turned
