"""What a robot steps: measured state in, efforts or speeds out, whatever happens in between."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from rpctl.arrays import NOTHING, Array
from rpctl.control.arm_efforts import ArmEfforts
from rpctl.control.balance import Balance
from rpctl.control.bandwidth import knowing_delay
from rpctl.control.both_laws import BothLaws
from rpctl.control.bounded import IntegralDynamic
from rpctl.control.error import tracking_error
from rpctl.control.estimation import RATES, StateEstimate
from rpctl.control.group_commands import GroupCommand, GroupCommands
from rpctl.control.law import (
    Command,
    DynamicFunction,
    DynamicLaw,
    Efforts,
    KinematicFunction,
    KinematicLaw,
    Limit,
    Rest,
    Speeds,
    as_law,
)
from rpctl.control.output_groups import MAX_DEAD_TIME, OutputGroup
from rpctl.control.registry import configuration, read_law
from rpctl.control.safeguards import (
    EFFORT_RATE,
    FAILURES,
    Braking,
    Guards,
    Watchdog,
    falls_short,
)
from rpctl.control.sampling import TIME_ROUNDING, JumpWatch, MeasuredSample, SampleReader
from rpctl.control.transition import Following
from rpctl.control.unified import UnifiedKinematic
from rpctl.control.velocity_output import (
    VelocityOutput,
    as_output,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_known, require_positive
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference, require_pulling, require_reference
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot

PERIOD = 0.002  # s
PAUSED, MOTORS_OFF = "paused", "paused, with the motors off"
LATE_RATIO = 1.5  # of the period: a sample that comes later is counted as late

Status = Literal["ok", "fallback", "held", "stopped", "lost"]


def default_laws(robot: Robot | None = None) -> tuple[KinematicLaw, DynamicLaw]:
    """Return the default kinematic and dynamic law.

    These are the unified law and the law within limits with integral action; of a robot that leans
    the unified law and :class:`~rpctl.control.balance.Balance`. On TIAGo with an error
    of (0.1, 0.3, 0.3) at the start of a line they keep every limit, where the paper's dynamic law
    asks 120 % of a wheel's effort, and bring each final error below that of the paper's.

    The end effector does not come first. ``EndEffector(base=UnifiedKinematic())`` takes a third off
    its rms error there, with 0.25 ms a sample on TIAGo; but the arm then swings to make up for the
    base (0.09 rad rms of its joints in the place of 0.00015, on a swerve 0.6 rad), and steered
    bases take 1 to 2 of the 2 ms. So it is the user's choice.
    """
    leans = isinstance(robot, LeaningRobot)
    return UnifiedKinematic(), Balance() if leans else IntegralDynamic()


class ControllerOutput(NamedTuple):
    """The answer of a controller to a sample.

    Attributes:
        efforts: Actuator efforts (n_act,), N·m or N, in the order of ``robot.actuators``; always
            finite. (0,) for a robot that takes speeds; if some of its joints take efforts, 0 for
            all other actuators.
        speeds: Quasi-velocities to send (dof,), m/s or rad/s, in the order of
            ``robot.quasi_velocities``; always finite. (0,) for a robot that takes efforts. For
            joints that take efforts, the rates that the efforts aim at.
        command: The output of the kinematic law.
        limits: The limits of the URDF that bind the efforts or speeds.
        status: "ok"; "fallback" if a substitute answered for a law that failed; "held" if the
            sample was bad or both laws failed, and the last safe output is repeated; "stopped" if
            that lasted too long, so that the controller brakes, or if the controller is paused;
            "lost" if the robot does not follow and is braked until :meth:`Controller.resume`.
        reason: Why the status is not "ok"; else empty.
        commands: For an output with groups, the command of each group, by its pattern; empty
            without groups and before the first good sample.
    """

    efforts: Array
    speeds: Array
    command: Command
    limits: tuple[Limit, ...] = ()
    status: Status = "ok"
    reason: str = ""
    commands: Mapping[str, GroupCommand] = MappingProxyType({})


class Controller:
    """The predictive laws of one robot: :meth:`step` turns a measured state into efforts or speeds.

    A sample is bad if a number is not finite, if it has the wrong shape, or if its time does not
    advance or jumps. The controller counts it and repeats the last safe efforts. If that lasts for
    ``guards.stale_after``, it brakes the robot along the motion of the model; the next good sample
    ends the stop. If several samples continue from a time that jumped, the clock was set, and the
    controller's own time continues without the jump.

    If the measured pose jumps, as a localisation's does, the jump is fed in at the rate
    ``guards.fading``. A robot that stays at its limits while its error does not decrease is lost:
    it is braked until :meth:`resume`.

    The rate of efforts is bounded from sample to sample, except at the first sample and if the
    motors are switched off.

    If a law fails at a sample (its solver fails, a posture is singular), a substitute answers: the
    unified law, or the paper's dynamic law within the effort limits. If the substitute fails too,
    the sample counts as bad. Samples may be late or missing: the laws use the measured time between
    them.

    Args:
        robot: The robot.
        reference: A reference, or the name or the file of one; None: that of ``config``, or the
            eight.
        config: A :class:`rpctl.Config`, or the path of its TOML file: laws, limits, period, output,
            guards, rates and delay, as for a run; the other arguments take precedence.
        kinematic: The kinematic law, or its name; None: the robot's default.
        dynamic: The dynamic law, or its name; None: the robot's default.
        period: Nominal time between two samples, s; default: 2 ms.
        output: ``"effort"`` (default); ``"velocity"`` for a robot that takes speeds and follows
            them at once; a :class:`~rpctl.control.velocity_output.VelocityOutput` with the lag of
            the robot. ``"twist"``, ``"wheel-speeds"``, ``"steering"``, ``"position"``, or a mapping
            such as ``{"base": "twist", "arm_*": "position"}``, whose values may be
            :class:`~rpctl.control.output_groups.OutputGroup` with their own bounds and lags: the
            output's ``commands`` then hold what to send. A robot that takes speeds has no dynamic
            law, except for joints in a group of the kind ``"effort"``.
        rest: State before the first sample, if it is known. Its efforts are sent until the first
            good sample; without it, zeros are sent.
        guards: How the controller treats bad samples, jumps of the pose and robots that do not
            follow; None: the defaults.
        compiled: Whether laws in closed form run as machine code, which is built now unless the
            cache has it. Otherwise CasADi's virtual machine runs them, and a step takes twice as
            long.
        rates: ``"measured"``: the controller uses the measured rates, and a sample that lacks one
            is bad. ``"estimated"``: it estimates all rates. None: it estimates rates that are NaN,
            and all rates once it finds one to be quantised. See
            :class:`~rpctl.control.estimation.StateEstimate`.
        delay: Known time from a measurement to the efforts that answer it, s. The laws then use the
            predicted state and the reference at that time, joints without gains of their own get a
            higher bandwidth, and reported times include the delay. None: unknown; the gains then
            tolerate 50 ms.

    Raises:
        RpctlError: A setting is out of range, or the reference or a law does not fit the robot.
        UnknownNameError: The name of a law, an output or a reference is not known.
        DescriptionError: The file of the reference or of the configuration cannot be used.

    Attributes:
        robot: The robot, with the limits of ``config``.
        period: Nominal time between two samples, s.
        guards: The guards.
    """

    def __init__(
        self,
        robot: Robot,
        reference: str | Path | Reference | None = None,
        *,
        config: Any = None,
        kinematic: str | KinematicLaw | KinematicFunction | None = None,
        dynamic: str | DynamicLaw | DynamicFunction | None = None,
        period: float | None = None,
        output: str | Mapping[str, str | OutputGroup] | VelocityOutput | None = None,
        rest: Rest | None = None,
        guards: Guards | None = None,
        compiled: bool = True,
        rates: str | None = None,
        delay: float | None = None,
    ) -> None:
        if config is not None:
            config = configuration(config, robot, kinematic, dynamic)
            robot, run = config.limits.apply(robot), config.run
            kinematic, dynamic, output = config.kinematic, config.dynamic, output or config.output
            period = run.control_period if period is None else period
            guards, rates = guards or config.guards, rates or run.rates
            delay = run.delay if delay is None else delay
            reference = run.load_reference(robot) if reference is None else reference
        period = PERIOD if period is None else period
        require_positive("period", period)
        if rates is not None:
            require_known("kind of rates", [rates], RATES)
        if delay is not None and not 0.0 <= delay <= MAX_DEAD_TIME:
            raise RpctlError(f"delay is {delay:g} s; give a time from 0 to {MAX_DEAD_TIME:g} s")
        self._rates, self._delay = rates, delay or 0.0
        self.robot, self.period, self.guards = robot, period, guards or Guards()
        self._reference, usual = (
            self._read("eight" if reference is None else reference),
            default_laws(robot),
        )
        kinematic = read_law("kinematic", usual[0] if kinematic is None else kinematic)
        dynamic = read_law("dynamic", usual[1] if dynamic is None else dynamic)
        self._laws = (
            as_law(knowing_delay(kinematic, period, delay)),
            as_law(knowing_delay(dynamic, period, delay)),
        )
        self._rest, self._output = rest, as_output(output or "effort")
        if delay and self._output is not None:
            raise RpctlError(
                f"delay is {delay:g} s; for a robot that takes speeds the dead time includes it: "
                "give dead_time of its VelocityOutput, --dead-time"
            )
        if self._output is not None:
            self._output = self._output.on(robot)
        self._dynamics, self._compiled = ReducedDynamics(robot), compiled
        self._rolls, self._leans = bool(robot.drive.base_speeds), robot.drive.leans
        if self._leans and (rates == "estimated" or self._output is not None):
            what = (
                "rates are estimated"
                if self._output is None
                else ("another controller sends the efforts")
            )
            raise RpctlError(
                f"{robot.name} leans: no law of rpctl balances it if {what}; measure its rates, "
                "and send efforts"
            )
        self._in_arm = np.array([name in robot.joint_names for name in robot.actuators])
        self._most = (self.guards.effort_rate or EFFORT_RATE) * period * robot.effort_limits
        self.reset()

    def _read(self, reference: str | Path | Reference) -> Reference:
        if isinstance(reference, str | Path):
            reference = load_reference(self.robot, reference)
        require_reference(reference)
        require_pulling(self.robot, reference)
        return reference

    @property
    def reference(self) -> Reference:
        """The reference that the robot follows, without the transition to it."""
        return self._reference

    def reset(self) -> None:
        """Restart the controller: forget all samples, restart the laws, and set all counts to 0."""
        robot, sent = self.robot, self._output or self._laws[1]
        started = self._dynamics, self.period, self._rest
        self._both = BothLaws(self._laws[0], sent, *started, self._compiled)
        self._counts = dict.fromkeys(
            ("samples", "held", "stopped", "fallbacks", "late", "paused", "lost", "jumps"), 0
        )
        still = np.zeros(robot.dof)
        tau = np.zeros(len(robot.actuators)) if self._rest is None else self._rest.tau
        efforts, speeds = (tau, NOTHING) if self._output is None else (NOTHING, still)
        acting, self._arm = efforts, None
        if self._output is not None and self._output.sent_efforts(robot):
            self._arm = ArmEfforts(self._laws[1], self._output, started, self._compiled)
            efforts = np.where(self._arm.sent, tau, 0.0)
        self._unknown = self._sent = ControllerOutput(efforts, speeds, Command(still, still))
        # The law that balances foretells for itself, and takes rates as they are measured.
        rates, foretold = ("measured", 0.0) if self._leans else (self._rates, self._delay)
        self._reader = SampleReader(robot, self.period, foretold, rates == "measured")
        self._estimate = StateEstimate(
            self._dynamics, self.period, foretold, rates, acting, self._compiled
        )
        self._jumps = JumpWatch()
        self._watchdog = Watchdog(self.guards.lost_after)
        self._following = Following(self._dynamics, self._reference, self.guards.fading)
        self._waits = self._lost = ""  # why the reference stands, and why the robot was lost last
        self._asked = self._meant = efforts  # by the laws, and to be sent, whatever its rate
        self._safe_until = math.inf  # when the last safe efforts are stale, s
        self._measured: MeasuredSample | None = None  # the last good sample, as the laws get it
        self._braking: Braking | None = None
        self._groups: GroupCommands | None = None
        if self._output is not None and self._output.groups:
            self._groups = GroupCommands(self._output, self._dynamics, self.period)

    def step(
        self, t: float, q: Array, nu: Array, *, applied: Array | None = None
    ) -> ControllerOutput:
        """Return what to send now. A bad sample raises no exception.

        Args:
            t: Time of the sample, s; it increases from sample to sample.
            q: Measured configuration (nq,); :meth:`Robot.state` makes it from named readings.
            nu: Measured quasi-velocities (dof,), m/s or rad/s; NaN for those that are not measured.
            applied: Efforts (n_act,), N·m or N, that acted since the last sample, if the robot
                reports them: the integral ignores efforts that did not act.

        Returns:
            Efforts or speeds, always finite, with the status.

        Raises:
            RpctlError: A law of the user returns something that is not the output of such a law.
        """
        self._counts["samples"] += 1
        self._both.ahead = None
        sample = self._reader.read(t, q, nu)
        output = sample if isinstance(sample, str) else self._answer(sample, applied)
        if isinstance(output, str):
            output = self._without_answer(self._reader.time, output)
        output = self._within_rate(output)
        if self._groups is not None and self._measured is not None:
            state = self._measured, self._both.ahead, output.reason == MOTORS_OFF
            output = output._replace(commands=self._groups(output.speeds, *state, output.efforts))
        self._sent = output
        # What moves a robot that follows speeds is not known.
        self._estimate.sent(self._reader.time, output.efforts if self._output is None else NOTHING)
        return output

    def pause(self, *, motors_off: bool = False) -> None:
        """Stop the robot and the time of the reference; may be called between any two steps.

        A robot that is lost remains lost; its motors may still be switched off.

        Args:
            motors_off: Whether the motors are off from now on, as after an emergency stop: the
                controller sends zeros, and its integral and estimates ignore the motion.
        """
        if not self._waits:
            self._following.stand(self._reader.time)
        if motors_off:
            self._waits = MOTORS_OFF
        elif self._waits in ("", MOTORS_OFF):
            self._waits = PAUSED
            if self._measured is not None:
                self._following.stop(self._measured)

    def resume(self) -> None:
        """Continue after a pause or a loss, with a smooth transition to the halted reference."""
        if self._waits:
            self._waits = ""
            self._following.go_on(max(self._reader.time, 0.0), self._measured)

    def set_reference(self, reference: str | Path | Reference) -> None:
        """Follow another reference from its time 0, with a smooth transition to it.

        A controller that is paused remains paused.

        Args:
            reference: A reference, or the name or the file of one.

        Raises:
            RpctlError: The reference does not fit the robot.
        """
        self._reference = self._read(reference)
        self._following.change(self._reference, max(self._reader.time, 0.0), self._measured)

    def report(self) -> dict[str, float]:
        """Return counts and figures since the last reset, by name.

        The number of ``samples``; how many of them were ``held``, ``stopped``, ``paused``, ``lost``
        or answered by ``fallbacks``, how many were ``late`` (by more than half a period), and at
        how many rates were ``estimated``; the number of ``jumps`` of the pose and of
        ``clock_changes``; the present ``pace`` of the reference, below 1 if the robot cannot keep
        up; ``machine_code``, 1 if the laws run as machine code; then the figures of the laws.
        """
        own = {
            "clock_changes": self._reader.clock_changes,
            "estimated": self._estimate.samples,
            "pace": self._following.pace,
        }
        return {**self._counts, **own, **self._both.report()}

    def kinematic_report(self) -> dict[str, float]:
        """Return the counts and figures of the kinematic law, by name."""
        return self._both.kinematic_report()

    def lateness(self) -> str:
        """Return a sentence on the identified lag of speeds; "" if it is as declared."""
        return "" if self._both.speeds is None else self._both.speeds.lateness()

    def notes(self) -> tuple[str, ...]:
        """Return sentences on laws that failed, and on a robot that was braked, lost or slow."""
        found = self._both.notes(self._counts["samples"])
        if self._counts["stopped"]:
            found.append(f"the controller braked the robot at {self._counts['stopped']} samples: "
                         "it had no safe command for too long")  # fmt: skip
        if self._counts["lost"]:
            found.append(
                f"the robot did not follow its commands, so the controller braked it: {self._lost}"
            )
        if (slowest := self._following.slowest) < 1.0:
            found.append(f"the reference ran at {slowest:.2g} of its speed or more where the "
                         f"robot left it, and at {self._following.pace:.2g} at last")  # fmt: skip
        return (*found, *filter(None, [self._estimate.note, self.lateness()]))

    def _answer(self, sample: MeasuredSample, applied: Array | None) -> ControllerOutput | str:
        """Return what is sent after a good sample, or why nothing new is."""
        arrived = None if applied is None else self._efforts_of(applied)
        jumped = self._rolls and self._jumps.jumps(sample.t, self.robot.level_place(sample.q))
        sample = self._estimate(sample, arrived, jumped)
        before, self._measured, self._braking = self._measured, sample, None
        if jumped and before is not None:
            self._counts["jumps"] += 1
            self._following.jumped(before, sample)  # what is followed jumps along
        if self._waits == MOTORS_OFF:
            return self._without_motors(sample.t)
        gap = before is not None and sample.t - before.t > self.guards.stale_after + self.period
        own = self._sent.status != "stopped" or self._sent.reason == PAUSED
        self._come_back(before, sample, gap)
        if before is not None:
            self._counts["late"] += sample.t - before.t > LATE_RATIO * self.period
            told = self._meant if applied is None else arrived
            self._tell(before, sample.t, told, own and not gap)
        answer = self._both.answer(sample, self._following.now)
        if isinstance(answer, str):
            return answer
        output = self._sending(sample, *answer)
        if self._waits == PAUSED:
            self._counts["paused"] += 1
            return output._replace(status="stopped", reason=PAUSED)
        if self._waits:
            return self._lost_base(sample, output)
        return self._watched(sample, output)

    def _come_back(self, before: MeasuredSample | None, sample: MeasuredSample, gap: bool) -> None:
        """Let a robot come back smoothly that was braked, or that was not seen for long.

        Args:
            gap: Whether there was no sample for long.
        """
        if self._waits:
            if self._brakes or before is None:
                self._following.stop(sample)
            return
        if self._brakes or gap:
            with suppress(*FAILURES):  # of the reference: the laws find them as well
                self._following.go_on(sample.t, sample)

    @property
    def _brakes(self) -> bool:
        """Whether the robot was braked at the last sample for want of good ones."""
        return self._sent.status == "stopped" and self._sent.reason not in (PAUSED, MOTORS_OFF)

    def _tell(self, before: MeasuredSample, t: float, arrived: Array | None, learns: bool) -> None:
        """Tell the laws how long ago the last sample was (s), and what arrived since.

        Args:
            arrived: Efforts (n_act,); None where what was told are no such numbers.
            learns: Whether what the robot did since is the laws' doing.
        """
        elapsed = self._since(before.t, t) if learns else None
        if arrived is not None and arrived is not self._meant:
            astray = self._estimate.astray
            arrived = self._meant + (arrived - self._sent.efforts if astray is None else astray)
        if arrived is not self._asked and elapsed is not None and self._output is None:
            kernel = self._both.kernel
            if kernel is None or arrived is None:
                elapsed = None
            elif kernel.learns:
                with suppress(*FAILURES):
                    nu_dot = self._dynamics.forward(before.q, before.nu, arrived)
                    missing = self._dynamics.actuation(before.q) @ (arrived - self._asked)
                    kernel.moved(nu_dot, missing != 0.0)
        self._both.sampled_after(elapsed)
        if self._arm is not None:
            self._arm.law.sampled_after(elapsed if arrived is self._asked else None)

    def _efforts_of(self, applied: Any) -> Array | None:
        """Return efforts (n_act,) that a robot tells; None where they are no such numbers."""
        with suppress(Exception):  # whatever its numbers raise where they are made floats
            efforts = np.array(applied, dtype=float)
            if efforts.shape == self._asked.shape and np.isfinite(efforts).all():
                return efforts
        return None

    def _within_rate(self, output: ControllerOutput) -> ControllerOutput:
        """Return what is sent with the rate of its efforts within their own limit.

        Motors that are off need none, nor does the first sample, whose efforts begin a motion. What
        the rate holds back, the laws are not told: where noise asks for it, theirs is the mean, and
        what the rate lets through is the median.
        """
        self._meant = output.efforts
        if not output.efforts.size:
            return output
        change = output.efforts - self._sent.efforts
        begins = self._sent is self._unknown and self.guards.effort_rate is None
        if begins or output.reason == MOTORS_OFF or (np.abs(change) <= self._most).all():
            return output
        tau = self._sent.efforts + np.clip(change, -self._most, self._most)
        return output._replace(efforts=tau)

    def _watched(self, sample: MeasuredSample, output: ControllerOutput) -> ControllerOutput:
        """Return what is sent, or what brakes a robot that is lost."""
        at_limit = (
            any(limit.kind == "effort" for limit in output.limits)
            if self._output is None
            else bool(falls_short(sample.nu, output.speeds))
        )
        looks = at_limit or self._watchdog.bound or self._output is not None
        # Of what is followed, not of a way up to that, at the time for which the laws answer.
        at, reference = self._both.ahead or sample, self._both.reference
        e = tracking_error(self.robot, reference(at.t), at.q) if looks else NOTHING
        slows = self._output is not None and self._following.keep_up(sample.t, math.hypot(*e[:2]))
        error = 0.0 if slows else float(np.abs(e).max(initial=0.0))  # it has another chance
        if not self._watchdog.lost(sample.t, at_limit, error):
            return output
        self._following.stand(sample.t)
        self._lost = (
            f"at its limits for {self.guards.lost_after:g} s, {error:.2g} m or rad from its "
            f"reference without coming nearer, at {sample.t:.4g} s"
        )
        self._waits = f"lost: {self._lost}; call resume() to continue"
        self._following.stop(sample)
        return self._lost_base(sample, output)

    def _lost_base(self, sample: MeasuredSample, output: ControllerOutput) -> ControllerOutput:
        """Return what stops a robot that is lost: the laws have its arm, and its base is braked.

        Args:
            output: What the laws make of a stop.
        """
        self._counts["lost"] += 1
        if self._leans:  # braked by anything but its laws, it would fall
            return output._replace(status="lost", reason=self._waits)
        asked = output.efforts
        braked = self._brake(sample.t, output._replace(status="lost", reason=self._waits))
        arm = self._in_arm[: asked.size]  # none where speeds are sent
        return braked._replace(efforts=np.where(arm, asked, braked.efforts))

    def _without_motors(self, t: float) -> ControllerOutput:
        """Return what a robot is sent whose motors are off: nothing."""
        self._counts["paused"] += 1
        if self._both.speeds is not None:
            self._both.speeds.sent(t, self._unknown.speeds)
        return self._unknown._replace(
            efforts=np.zeros_like(self._unknown.efforts), status="stopped", reason=MOTORS_OFF
        )

    def _since(self, before: float, t: float) -> float:
        """Return the time between samples, s: the period where no more than rounding differs."""
        elapsed = t - before
        return self.period if abs(elapsed - self.period) < TIME_ROUNDING else elapsed

    def _sending(
        self, sample: MeasuredSample, command: Command, answer: Efforts | Speeds
    ) -> ControllerOutput:
        """Return what is sent after a sample, and take note of it."""
        self._safe_until, speeds = sample.t + self.guards.stale_after, self._both.speeds
        reason, (tau, limits), nu = self._both.reason, answer, NOTHING
        if speeds is not None:
            speeds.sent(sample.t, tau)
            tau, nu = NOTHING, tau
            if self._arm is not None:
                coming = speeds.coming(sample.t, sample.nu)
                found = self._arm(sample, command, coming) or Efforts(self._sent.efforts)
                tau, limits = found.tau, (*limits, *found.limits)
                reason = reason or self._arm.law.reason
        self._counts["fallbacks"] += bool(reason)
        status: Status = "fallback" if reason else "ok"
        self._asked = tau
        return ControllerOutput(tau, nu, command, limits, status, reason)

    def _without_answer(self, now: float, reason: str) -> ControllerOutput:
        """Return what was sent last, or what brakes the robot once that is stale.

        Args:
            now: Time, s.
            reason: Why there are no others.
        """
        if self._waits == MOTORS_OFF:
            return self._without_motors(now)
        self._safe_until = min(self._safe_until, now + self.guards.stale_after)
        if now <= self._safe_until:
            self._counts["held"] += 1
            held = self._sent._replace(status="held", reason=reason)
            if self._both.speeds is None:
                return held
            return held._replace(speeds=self._both.speeds.unseen(now, brakes=False))
        self._counts["stopped"] += 1
        if not (self._brakes or self._waits):
            self._following.stand(now)
        return self._brake(now, self._unknown._replace(status="stopped", reason=reason))

    def _brake(self, now: float, output: ControllerOutput) -> ControllerOutput:
        """Return an output with the efforts or speeds of a controlled stop.

        Args:
            now: Time, s.
            output: What it is without any.
        """
        if self._both.speeds is not None:
            output = output._replace(speeds=self._both.speeds.unseen(now, brakes=True))
        if self._measured is None or not output.efforts.size:
            return output
        seen = self._measured
        if self._sent.reason == MOTORS_OFF:  # brakes held it, not the zeros that were sent
            seen = seen._replace(t=now)
        self._braking = self._braking or Braking(
            self._dynamics, seen, self._sent.efforts, alone=output.status == "lost"
        )
        tau = self._braking.efforts(now)
        if tau is None:
            return output
        return output._replace(efforts=tau if self._arm is None else self._arm.sent * tau)
