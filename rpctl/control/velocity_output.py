"""Output as speeds, for robots that take a twist or wheel speeds instead of efforts."""

from __future__ import annotations

import math as numbers
from bisect import bisect
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.estimation import MOST_ACTS, state_kernel
from rpctl.control.fragment import LawFragment, LawFrame
from rpctl.control.lag_estimate import LagEstimate
from rpctl.control.law import Command, Rest, Speeds
from rpctl.control.law_kernel import RunningLaws, running_laws
from rpctl.control.output_groups import (
    BASE,
    DEAD_TIME,
    EFFORT,
    LAG,
    POSITION,
    RATES,
    REST,
    SPEED_KINDS,
    OutputGroup,
    as_groups,
    by_quasi_velocity,
    members,
)
from rpctl.control.sampling import TIME_ROUNDING, MeasuredSample
from rpctl.control.speed_limits import Lateness, SpeedLimits, SpeedSample
from rpctl.dynamics.motion import NO_LAG
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import (
    SMALLEST,
    SolverError,
    UnknownNameError,
    require_known,
)
from rpctl.files.records import POSITIVE, Range, Record, Setting
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import Robot

OUTPUTS = ("effort", "velocity")
STOPPING_TIME = 0.3  # s: time constant with which a controlled stop ends the motion


@dataclass(frozen=True, kw_only=True)
class VelocityOutput(Record):
    """The output of a controller whose robot takes speeds and follows them with a lag.

    The model is T ν̇(t) = c(t − T_d) − ν(t): each quasi-velocity follows its command c with a
    first-order lag T after a dead time T_d. At each sample

    - the controller predicts the state over T_d. All commands that act until then have been sent,
      so the prediction is exact for this model;
    - it evaluates the kinematic law there: at t + T_d, for the predicted q and ν;
    - it inverts the lag along the motion, c = ν_d + (T + ½ T_s) ν̇_d, where ½ T_s compensates that
      the command is held for a period T_s. Then ν − ν_d decays as exp(−t/T), and the robot follows
      a reference like one that realises ν_d at once;
    - :class:`~rpctl.control.speed_limits.SpeedLimits` bounds c.

    If their dead times differ, base and arm are predicted over their own, and follow the reference
    at those times. ``groups`` define the form in which the speeds are sent.

    T and T_d are the declared ones until measured speeds contradict them, then the identified ones,
    see :class:`~rpctl.control.lag_estimate.LagEstimate`. A wrong T makes the loop less accurate
    only, because the measured ν enters the prediction.
    """

    lag: Annotated[
        float,
        LAG,
        Setting(
            "s",
            "Lag",
            "First-order lag with which the robot follows speeds, s; default: 0.",
            metavar="S",
        ),
    ] = field(default=0.0, kw_only=False)
    dead_time: Annotated[
        float,
        DEAD_TIME,
        Setting(
            "s",
            "Dead time",
            "Time until the robot begins to follow a change of speed, s; default: 0.",
            metavar="S",
        ),
    ] = field(default=0.0, kw_only=False)
    lags: Annotated[
        Mapping[str, float],
        LAG,
        Setting("s", "", "Lag by name of the quasi-velocity, where it differs."),
    ] = field(default_factory=dict)
    accelerations: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting("m/s² or rad/s²", "", "Largest accelerations by name of the quasi-velocity."),
    ] = field(default_factory=dict)
    effort_ratio: Annotated[
        float,
        Range(SMALLEST, 1.0, "more than 0, at most 1"),
        Setting("", "", "Fraction of the effort limits that accelerations may take."),
    ] = 0.95
    dead_times: Annotated[
        Mapping[str, float],
        DEAD_TIME,
        Setting("s", "", "Dead time by name of the quasi-velocity, where it differs."),
    ] = field(default_factory=dict)
    speeds: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting("m/s or rad/s", "", "Largest speeds by name of the quasi-velocity."),
    ] = field(default_factory=dict)
    jerks: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting("m/s³ or rad/s³", "", "Largest jerks by name of the quasi-velocity."),
    ] = field(default_factory=dict)
    groups: Annotated[
        Mapping[str, OutputGroup],
        Setting(
            "",
            "",
            'What the controller commands, by "base" and by pattern of joints; default: speeds.',
        ),
    ] = field(default_factory=dict)

    def on(self, robot: Robot) -> VelocityOutput:
        """Return the output with the settings of its groups, by name of the quasi-velocity.

        Raises:
            RpctlError: A group does not fit the robot.
        """
        if not self.groups:
            return self
        said = by_quasi_velocity(self.groups, robot).items()
        found: dict[str, Any] = {name: {**getattr(self, name), **of} for name, of in said}
        return replace(self, **found)

    def start(
        self,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None = None,
        *,
        running: RunningLaws | None = None,
    ) -> VelocityController:
        """Return the controller of the output for one run; commands before it count as zero.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s.
            rest: Not used.
            running: The kernel of both laws, if it exists already.

        Raises:
            UnknownNameError: A lag or an acceleration names no quasi-velocity of the robot.
        """
        running = running or running_laws(None, self, dynamics, period, None)
        return VelocityController(self, dynamics, period, running)

    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the settings that are inputs of the kernel, by name: lags and dead times, s.

        Args:
            known: The robot's dynamics.
            period: Control period, s.

        Raises:
            UnknownNameError: A lag names no quasi-velocity of the robot.
        """
        return Lateness.of(self.lag_of(known.robot.quasi_velocities), period)._asdict()

    def structure(self, robot: Robot) -> object:
        """Return a value that identifies the machine code on a robot, without lag and dead time."""
        return replace(self, lag=0.0, dead_time=0.0, lags={}, dead_times={}, groups={})

    def statements(self, frame: LawFrame) -> LawFragment:
        """Return the kernel statements that compute speeds from the frame's command.

        Raises:
            UnknownNameError: An acceleration names no quasi-velocity of the robot.
        """
        robot, period, sample, late = frame.known.robot, frame.period, frame.sample, frame.s
        bounds = self.accelerations, self.effort_ratio, self.speeds, self.jerks
        within = SpeedLimits(robot, period, Lateness(**late), *bounds)
        wanted = sample.nu_d + (late["lag"] + 0.5 * period) * sample.nu_d_dot
        model = frame.model_nu, frame.model_nu_dot
        at = SpeedSample(sample.q, sample.nu, *(symbols for _, symbols in model))
        nu, binding = within(frame.known, wanted, at, sample.nu_d_dot)
        return frame.answered("law_speeds", nu, within.labels, binding, model)

    def sent_efforts(self, robot: Robot) -> tuple[str, ...]:
        """Return the names of the joints that take efforts."""
        groups = members(self.groups, robot) if self.groups else {}
        return tuple(n for group, names in groups.values() if group.kind == EFFORT for n in names)

    def lag_of(self, quasi_velocities: tuple[str, ...]) -> Array:
        """Return T (dof,) of quasi-velocities by their names, s.

        Raises:
            UnknownNameError: A lag names none of them.
        """
        return lags_by_name(quasi_velocities, self.lag, self.lags)

    def dead_times_of(self, quasi_velocities: tuple[str, ...]) -> Array:
        """Return T_d (dof,) of quasi-velocities by their names, s.

        Raises:
            UnknownNameError: A dead time names none of them.
        """
        return lags_by_name(quasi_velocities, self.dead_time, self.dead_times)


def lags_by_name(names: tuple[str, ...], lag: float, lags: Mapping[str, float]) -> Array:
    """Return the lag of each quasi-velocity (dof,), s.

    Args:
        lag: Of those that are not named, s.
        lags: By name, s.

    Raises:
        UnknownNameError: A lag names none of them.
    """
    require_known("quasi-velocity", lags, names)
    return np.array([lags.get(name, lag) for name in names])


def as_output(
    output: str | Mapping[str, str | OutputGroup] | VelocityOutput,
) -> VelocityOutput | None:
    """Return what makes speeds of a command, or None where efforts are wanted.

    Args:
        output: ``"effort"``, ``"velocity"``, another kind of :class:`OutputGroup` for the base
            beside the arm's rates (or ``"position"`` for an arm alone), a mapping of ``"base"`` and
            of patterns of joints to such kinds or groups, or settings.

    Raises:
        UnknownNameError: It is none of them.
    """
    if isinstance(output, VelocityOutput):
        return output
    if isinstance(output, Mapping):
        return VelocityOutput(groups=as_groups(output))
    if output not in (*OUTPUTS, *SPEED_KINDS):
        raise UnknownNameError("output", output, dict.fromkeys((*OUTPUTS, *SPEED_KINDS)))
    if output in OUTPUTS:
        return None if output == "effort" else VelocityOutput()
    return as_output({REST: output} if output == POSITION else {BASE: output, REST: RATES})


def same_kinds(one: VelocityOutput, other: VelocityOutput) -> bool:
    """Return whether two outputs are sent in the same form."""
    a, b = ({name: g.kind for name, g in each.groups.items()} for each in (one, other))
    return a == b


@dataclass(frozen=True, eq=False)
class Staggered:
    """What a robot follows whose arm obeys sooner or later than its base.

    Attributes:
        reference: What it follows at one time.
        dead_times: Of its quasi-velocities (dof,), s: a joint is read as much later as its own is
            longer than the base's.
    """

    reference: Reference
    dead_times: Array

    def __call__(self, t: float) -> ReferenceState:
        """Return the state of the base at a time (s), and of the joints at their own."""
        found = self.reference(t)
        joints = np.array(found[3:6])
        shifts = self.dead_times[len(self.dead_times) - joints.shape[1] :] - self.dead_times[0]
        for shift in {*shifts.tolist()} - {0.0}:
            own, later = shifts == shift, self.reference(max(t + shift, 0.0))
            joints = np.where(own, later[3:6], joints)
        return ReferenceState(*found[:3], joints[0], joints[1], joints[2], found.direction)


class VelocityController:
    """:class:`VelocityOutput` on one robot in one run.

    Args:
        period: Control period, s.
        running: Its kernel, or one that has a kinematic law as well.
    """

    def __init__(
        self,
        output: VelocityOutput,
        dynamics: ReducedDynamics,
        period: float,
        running: RunningLaws,
    ) -> None:
        robot, self._period, self._running = dynamics.robot, period, running
        self._dynamics, self._names = dynamics, robot.quasi_velocities
        self._joints = [(self._names.index(n), robot.entries[n]) for n in robot.joint_names]
        self._staggered: tuple[Reference, Reference] | None = None  # as it is, and staggered
        told = output.lag_of(self._names), output.dead_times_of(self._names)
        self._late = LagEstimate(*told, period)
        self._dead_times = self._late.dead_times  # as learnt, in place
        self._learns = not output.sent_efforts(robot)
        self._own = running.settings[-2 * robot.dof :]  # the last numbers are the output's
        # When commands were sent, the first of which acts already, and its number in the ring.
        self._starts, self._first, self._command = [-numbers.inf], 0, np.zeros(robot.dof)
        self._at, self._move = state_kernel(robot, None, running.compiled).places()
        self._at["moving"][0] = 1.0
        # When the next one is sent; the kernel has what those so far have led to when it acts.
        self._model_time = numbers.nan
        self._seen: MeasuredSample | None = None  # the last sample, as predicted

    def followed(self, reference: Reference) -> Reference:
        """Return a reference with its joints after their own dead times, where these differ."""
        if self._staggered is None or self._staggered[0] is not reference:
            # The laws and who watches them ask for one time after another.
            self._staggered = reference, lru_cache(1)(Staggered(reference, self._dead_times))
        return self._staggered[1] if len({*self._dead_times.tolist()}) > 1 else reference

    def predict(self, t: float, q: Array, nu: Array) -> MeasuredSample:
        """Return the time at which the base's next command acts, and the state then.

        Each joint of the arm is as it will be when its own acts. Where the steered wheels fix no
        one motion on the way, the prediction of q ends.
        """
        self._learn(t, nu)
        self._follow(t, nu)
        latest = float(self._dead_times.max(initial=0.0))
        over = max(self._acting(t, latest), len(self._starts) - MOST_ACTS)
        self._first += over
        del self._starts[:over]
        parts = {
            dead: self._ahead(t, q, nu, dead) for dead in dict.fromkeys(self._dead_times.tolist())
        }
        at, *later = parts.values()
        if later:
            at = MeasuredSample(at.t, at.q.copy(), at.nu.copy())
            for k, entry in self._joints:
                _, own_q, own_nu = parts[float(self._dead_times[k])]
                at.nu[k] = own_nu[k]
                entry.write(at.q, entry.read(own_q))
        self._seen = at
        return at

    def _learn(self, t: float, nu: Array) -> None:
        """Take note of measured speeds (dof,) at a time (s), and of how late they are."""
        known = self._late.lag
        if self._learns:
            self._late.measured(t, nu)
        if self._late.lag is not known:
            self._own[:] = np.ravel(Lateness.of(self._late.lag, self._period))

    def _ahead(self, t: float, q: Array, nu: Array, dead_time: float) -> MeasuredSample:
        """Return the state a dead time (s) after a sample, of what has that one."""
        if dead_time <= TIME_ROUNDING:
            return MeasuredSample(t, q, nu)
        at, starts, k = self._at, self._starts, self._acting(t, dead_time)
        row, last = self._row(k), self._row(len(starts) - 1)
        kept, last[0] = float(row[0]), t - starts[-1]
        row[0] = dead_time + starts[k + 1] - t if k + 1 < len(starts) else dead_time
        at["q"][:], at["nu"][:], at["lag"][:] = q, nu, self._late.lag
        self._move(self._first + k, len(starts) - k - (last[0] <= TIME_ROUNDING))
        row[0] = kept
        return MeasuredSample(t + dead_time, at["q"].copy(), at["nu"].copy())

    def _acting(self, t: float, dead_time: float) -> int:
        """Return which of the commands acts at a time (s), after a dead time (s)."""
        return max(bisect(self._starts, t - dead_time + TIME_ROUNDING) - 1, 0)

    def _row(self, k: int) -> Array:
        """Return a command's row of the ring: for how long it holds (s), and what it is."""
        return self._at["acts"][(self._first + k) % MOST_ACTS]

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Speeds:
        """Return the speeds to send, and the limits that bind them.

        Raises:
            SingularBasisError: At q the steered wheels fix no one motion.
            SolverError: They are not finite.
        """
        if not self._running.follow(q, nu, command):
            dynamics.at(q)
            raise SolverError("the speeds to send are not finite")
        return Speeds(self._running.answer.copy(), self._running.limits())

    def sent(self, t: float, nu: Array) -> None:
        """Take note of speeds (dof,) that are sent at a time (s): they act from t + T_d on."""
        self._late.sent(t, nu)
        self._follow(t, nu)
        while self._starts[-1] >= t:  # what brakes a lost robot is sent instead
            self._starts.pop()
        self._row(len(self._starts) - 1)[0] = t - self._starts[-1]
        self._row(len(self._starts))[1:] = self._command = nu
        self._starts.append(t)

    def last(self, *_: object) -> Speeds:
        """Return the speeds that were sent last: what stands in where there are no others."""
        return Speeds(self._command)

    def unseen(self, t: float, brakes: bool) -> Array:
        """Return the speeds (dof,) to send at a time (s) without a sample, within their limits.

        Args:
            brakes: Whether they decay, or those that were sent last go on.
        """
        nu = self._command
        self._follow(t, nu)
        model, command = self._running.model_nu, Command(nu, 0.0 * nu)
        if brakes:
            fall, share = numbers.exp(-self._period / STOPPING_TIME), self._own[len(nu) :]
            nu = fall * nu  # or what leads the model down as much within the period:
            command = Command(model * (1.0 - (1.0 - fall) / (self._period * share)), 0.0 * nu)
        if self._seen is not None and self._running.follow(*self._seen[1:], command):
            nu = self._running.answer.copy()
        self.sent(t, nu)
        return nu

    def coming(self, t: float, nu: Array) -> Array:
        """Return the mean ν̇ (dof,) of the period from a time (s) on, at which ν is (dof,)."""
        soon = t + 0.5 * self._period
        acting = [
            self._row(self._acting(soon, dead))[1 + k]
            for k, dead in enumerate(self._dead_times.tolist())
        ]
        return np.asarray((acting - nu) * self._own[len(nu) :])

    def report(self) -> dict[str, float]:
        """Return the lags (s) by name and the base's dead time that are used, if learnt."""
        late = self._late
        rows = np.flatnonzero(late.learnt)
        found = {f"lag of {self._names[k]}": float(late.lag[k]) for k in rows}
        return {**found, "dead_time": float(late.dead_times[0])} if found else {}

    def lateness(self) -> str:
        """Return how late the robot follows its speeds, a sentence; "" where it is as told."""
        return self._late.sentence(self._names)

    def _follow(self, t: float, nu: Array) -> None:
        """Let the model follow its last command until a time (s); it begins at ν (dof,)."""
        model_nu, model_nu_dot = self._running.model_nu, self._running.model_nu_dot
        if numbers.isnan(self._model_time):
            model_nu[:] = nu
            self._row(0)[1:] = self._command = nu
        elif t > self._model_time:
            command, passed = self._command, t - self._model_time
            lag = np.maximum(self._late.lag, NO_LAG)
            left = np.exp(-passed / lag)  # of the way to the command, as in `follow`
            model_nu_dot[:] = (1.0 - left) * (command - model_nu) / passed
            model_nu[:] = command + (model_nu - command) * left
        self._model_time = t
