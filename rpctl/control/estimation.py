"""The state that laws are given: rates that nobody measures well, and what is still to act.

[M69] N. Morrison, "Introduction to Sequential Smoothing and Prediction", McGraw-Hill, 1969.
"""

from __future__ import annotations

import math as numbers
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.sampling import LONGEST_SILENCE, TIME_ROUNDING, MeasuredSample
from rpctl.dynamics.motion import NO_LAG, Stretch, of_gap, travel
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import DiffersError
from rpctl.kernels.machine_code import MachineCode, code_key
from rpctl.kernels.program import (
    Buffer,
    Call,
    Program,
    Read,
    Rows,
    RowStream,
    When,
    statement,
    symbolic,
)
from rpctl.kernels.scalars import column
from rpctl.kernels.stored import stored
from rpctl.kernels.virtual_machine import VirtualMachine
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import BASE_NV, Robot

RATES = ("measured", "estimated")
BANDWIDTH = 40.0  # rad/s of the observer: 12 bits at 100 Hz then leave leaps of 15 % in efforts
LEARNING = 5.0  # 1/s, of a disturbance by rates that are measured: over a delay it is foretold
SEED, INSTANT, ROUGHLY = 20210601, 1e-8, 1e-3  # s: a motion that short tells the acceleration
LONGEST_STEP = 0.005  # s, of the model's motion
MOST_ACTS = 2048  # such steps, between the last sample and when the next efforts act
MOST_KEPT = 8  # kernels of a process
RIDGE = 1e-9  # of what base speeds do to the pose: less is no motion

WINDOW, STRIDE = 32, 8  # samples that are looked at, and how often
PARTS = 12.0  # of the smallest change that the step may be: rates of several wheels are added
CHANGES = 4  # up, and as many down, that tell a lattice
ON_LATTICE = 1e-3  # of a step: what rates rounded to single precision are off a lattice
COARSE = 0.002  # of an effort limit: a step of a rate that changes an effort by less is fine
GAIN = 25.0  # 1/s, of laws: about their 1/h1 + k


class Motion(NamedTuple):
    """A step of a model's motion, over scalars."""

    q: Any  # (nq, 1)
    nu: Any  # (dof, 1)
    way: Any  # (dof, 1): how far each quasi-velocity has moved


def moved(known: SymbolicDynamics, q: Any, nu: Any, force: Any, d: Any, dt: Any) -> Motion:
    """Return the motion under held efforts, M and h of the middle of the way, losses implicit.

    (M + dt Sᵀ c S)(ν′ − ν) = dt (B τ − h + M d − Sᵀ c S ν) with c = −ℓ/v at the start: losses stop
    a joint within a step, however stiff, and never turn it back.

    Args:
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
        force: Efforts (n_act, 1); None: ν̇ is d.
        d: Acceleration (dof, 1) besides the model's.
        dt: For how long, s.
    """
    if force is None:
        after, middle = nu + dt * d, q
    else:
        middle = known.integrate(q, 0.5 * dt * (known.basis(q) @ nu))
        M, push = known.lossless(middle, nu, force)
        push += M @ d
        if known.lossy:
            S = known.basis(middle)
            D = S.T @ math.diag(known.loss_secant(S @ nu)) @ S
            push, M = push - D @ nu, M + dt * D
        after = nu + dt * known.solve_positive(M, push)
    way = 0.5 * dt * (nu + after)
    return Motion(known.integrate(q, known.basis(middle) @ way), after, way)


class StateKernel:
    """The formulas of the estimate on one robot: what moves it, and what a sample corrects.

    Args:
        robot: The robot.
        efforts: Whether efforts move it, or only the disturbance; None: commanded speeds, which
            nothing corrects, see :func:`following_calls`.
        compiled: Whether it is machine code.

    Attributes:
        run: Moves q, ν and the way as ``act`` says where ``moving`` is not 0; takes the sample
            ``measured`` in where ``correcting`` is not 0. Machine code reads ``act`` from rows.
        buffers: By name: ``q`` (nq,), ``nu``, ``d``, ``way``, ``gap`` (dof,), ``act`` (1 + n_act,),
            which is for how long, s, and τ, ``measured`` and ``before`` (nq,), ``rates``, ``told``,
            ``taken`` (dof,), ``age``, ``elapsed``, ``jumped``, ``moving`` and ``correcting`` (1,).
    """

    def __init__(self, robot: Robot, efforts: bool | None, compiled: bool) -> None:
        def make() -> tuple[dict[str, Buffer], Sequence[Program]]:
            known = SymbolicDynamics(robot)
            calls, buffers = (
                following_calls(known) if efforts is None else state_calls(known, efforts)
            )
            body = tuple(When(buffers[name], (call,)) for name, call in calls.items())
            act = buffers["act"]
            reads = (Read(RowStream("acts", act.size, laned=False), act),) if compiled else ()
            return buffers, [Program((*reads, *body))]

        self.run: MachineCode | VirtualMachine
        if compiled:
            key = code_key(robot_identity(robot), "estimate", efforts)
            self.buffers, (self.run,) = stored(key, make)
            if efforts is not False:
                self._require_same(robot)
        else:
            self.buffers, (program,) = make()
            self.run = VirtualMachine(program)

    def places(self) -> tuple[dict[str, Array], Callable[[int, int], object]]:
        """Return memory, and what runs in it as long as it lives.

        It is there by the names of the buffers, and as ``acts`` (MOST_ACTS, 1 + n_act), a ring:
        what runs is given a row's number, and how many from there on ``act`` is in turn.
        """
        space = self.run.workspace()
        at = {
            name: space[buffer][:, 0] if buffer in space else np.zeros(buffer.size)
            for name, buffer in self.buffers.items()
        }
        acts = at["acts"] = np.zeros((MOST_ACTS, len(at["act"])))
        if isinstance(self.run, MachineCode):
            (stream,) = self.run.program.streams
            return at, self.run.stepper(space, {stream: Rows(acts, ring=True)})
        once = self.run.stepper(space)

        def run(first: int, count: int) -> None:
            for number in range(first, first + count):
                at["act"][:] = acts[number % MOST_ACTS]
                once()

        return at, run

    def _require_same(self, robot: Robot) -> None:
        """Refuse machine code that moves the robot otherwise than Pinocchio."""
        dynamics, rng = ReducedDynamics(robot), np.random.default_rng(SEED)
        q = robot.configuration_at(np.zeros(BASE_NV), robot.home)
        at, run = self.places()
        nu, act = rng.normal(size=robot.dof), rng.normal(size=len(at["act"]) - 1)
        at["q"][:], at["nu"][:], at["acts"][0] = q, nu, (INSTANT, *act)
        at["moving"][0] = 1.0
        if follows := "lag" in at:
            at["lag"][:] = 1.0
        run(0, 1)
        expected = act - nu if follows else dynamics.forward(q, nu, act)
        residual = np.abs((at["nu"] - nu) / INSTANT - expected).max(initial=0.0)
        if not residual <= ROUGHLY * np.abs(expected).max(initial=1.0):
            raise DiffersError(f"machine code moves {robot.name} otherwise than Pinocchio")


state_kernel = lru_cache(MOST_KEPT)(StateKernel)  # of a robot, which may have one


def state_calls(
    known: SymbolicDynamics, efforts: bool
) -> tuple[dict[str, Call], dict[str, Buffer]]:
    """Return what is called when ``moving`` and ``correcting``; and buffers, by name.

    Args:
        known: The robot's dynamics.
        efforts: Whether efforts move it, or only the disturbance.
    """
    robot = known.robot
    sizes = dict.fromkeys(("nu", "d", "way", "gap", "rates", "told", "taken"), robot.dof)
    sizes |= dict.fromkeys(("q", "measured", "before"), robot.nq)
    sizes["act"] = 1 + efforts * len(robot.actuators)
    sizes |= dict.fromkeys(("age", "elapsed", "jumped", "moving", "correcting"), 1)
    place = {name: symbolic(Buffer(f"state {name}", size)) for name, size in sizes.items()}
    at = {name: symbols for name, (_, symbols) in place.items()}
    dt, force = at["act"][0], at["act"][1:] if efforts else None
    step = moved(known, at["q"], at["nu"], force, at["d"], dt)
    ahead = {"q": step.q, "nu": step.nu, "way": at["way"] + step.way}
    found = _corrected(known, at)
    read = {
        "moving": ("q", "nu", "way", "d", "act"),
        "correcting": (*found.keys() - {"q"}, "way", "measured", "rates", "told", "taken", "age",
                       "elapsed", "jumped"),
    }  # fmt: skip
    calls = {
        name: statement(
            f"state_{name}",
            [place[each] for each in sorted(read[name])],
            [(place[each][0], value) for each, value in values.items()],
        )
        for name, values in (("moving", ahead), ("correcting", found))
    }
    return calls, {name: buffer for name, (buffer, _) in place.items()}


def following_calls(known: SymbolicDynamics) -> tuple[dict[str, Call], dict[str, Buffer]]:
    """Return what is called when ``moving`` where speeds follow commands, and buffers, by name.

    ``act`` is for how long, s, and c of T ν̇ = c − ν, and ``lag`` (dof,) is T. Where the steered
    wheels fix no one motion, q stays.
    """
    dof = known.robot.dof
    sizes = {"q": known.robot.nq, "nu": dof, "lag": dof, "act": 1 + dof, "moving": 1}
    place = {name: symbolic(Buffer(f"following {name}", size)) for name, size in sizes.items()}
    q, nu, lag, act = (place[name][1] for name in ("q", "nu", "lag", "act"))
    dt, command = act[0], act[1:]
    x = dt / math.fmax(lag, NO_LAG)
    left, mean, change = of_gap(x, math.tanh(0.5 * x), math.if_else)
    gap = nu - command
    moved = travel(known, q, Stretch(dt, command + gap * mean, gap * change))
    call = statement(
        "following",
        [place[name] for name in ("q", "nu", "lag", "act")],
        [
            (place["q"][0], math.if_else(known.regular(q), moved, q)),
            (place["nu"][0], command + gap * left),
        ],
    )
    return {"moving": call}, {name: buffer for name, (buffer, _) in place.items()}


def _corrected(known: SymbolicDynamics, at: dict[str, Any]) -> dict[str, Any]:
    """Return q, ν, d and the gap after a sample, by name; see :class:`StateEstimate`."""
    robot, q = known.robot, at["measured"]
    S = known.basis(q)
    entries = [robot.entries.get(name) for name in robot.quasi_velocities]
    base = [k for k, entry in enumerate(entries) if entry is None]
    now: list[Any] = [0.0] * robot.dof
    for k, entry in enumerate(entries):
        if entry is not None and entry.is_pair:
            now[k] = _turned(at["before"], q, entry.index)
        elif entry is not None:
            now[k] = q[entry.index] - at["before"][entry.index]
    if base:
        rest = _base_motion(at["before"], q) - S[:BASE_NV, :] @ column(now)
        columns = S[:BASE_NV, base]
        normal = columns.T @ columns + RIDGE * math.SX.eye(len(base))
        speeds = known.solve_positive(normal, columns.T @ rest)
        for k, way in zip(base, math.vertsplit(speeds), strict=True):
            pose = math.if_else(at["jumped"], at["way"][k], way)
            now[k] = math.if_else(at["told"][k], at["elapsed"] * at["rates"][k], pose)
    gap = at["gap"] + column(now) - at["way"]
    first, second, third, learning = _gains(at["elapsed"], at["age"])
    taken, rates = at["taken"], at["rates"]
    left = _chosen(taken, math.SX.zeros(robot.dof, 1), (1.0 - first) * gap)
    arm = math.DM([0.0 if k in base else 1.0 for k in range(robot.dof)])
    return {
        "q": known.integrate(q, -(S @ (arm * left))),
        "nu": _chosen(taken, rates, at["nu"] + second * gap),
        "d": at["d"] + _chosen(taken, learning * (rates - at["nu"]), third * gap),
        "gap": left,
        "before": q,
    }


def _gains(elapsed: Any, n: Any) -> tuple[Any, Any, Any, Any]:
    """Return what the gap adds to way, ν and d, and rates that are measured to d, at sample n."""
    half = math.tanh(0.5 * BANDWIDTH * elapsed)
    p, even = (1.0 - half) / (1.0 + half), 6.0 / (n * (n + 1.0))  # p = exp(-BANDWIDTH elapsed)
    second = 1.5 * (1.0 - p * p) * (1.0 - p)
    alike = even > second
    return (
        math.if_else(alike, even * (2.0 * n - 1.0) / 3.0, 1.0 - p * p * p),
        math.if_else(alike, even, second) / elapsed,
        math.if_else(alike, 0.0, (1.0 - p) * (1.0 - p) * (1.0 - p)) / (elapsed * elapsed),
        math.fmin(LEARNING, 1.0 / elapsed),
    )


def _chosen(where: Any, one: Any, other: Any) -> Any:
    return math.vertcat(*(math.if_else(where[k], one[k], other[k]) for k in range(one.shape[0])))


def _turned(before: Any, now: Any, i: int) -> Any:
    """Return by how much the pair (cos, sin) at an index of q has turned, rad."""
    (c, s), (cosine, sine) = (before[i], before[i + 1]), (now[i], now[i + 1])
    return math.atan2(sine * c - cosine * s, cosine * c + sine * s)


def _base_motion(before: Any, now: Any) -> Any:
    """Return how far the root link has moved (3, 1), in its own axes of half the way."""
    half = 0.5 * _turned(before, now, 2)
    cos, sin = math.cos(half), math.sin(half)
    c, s = before[2] * cos - before[3] * sin, before[3] * cos + before[2] * sin
    x, y = now[0] - before[0], now[1] - before[1]
    return math.vertcat(c * x + s * y, c * y - s * x, 2.0 * half)


class LatticeWatch:
    """Tells rates that are whole multiples of a step, as differences of encoders' counts are.

    A step counts where it changes an effort by more than :data:`COARSE` of its limit. What is
    noisy, smooth, or does not change is on no lattice: over the last samples all changes of a rate,
    or of how far it goes in a sample, have to be whole multiples of the smallest, some of them up
    and some down.

    Args:
        dynamics: The robot's dynamics.
        period: Control period, s.

    Attributes:
        finest: Steps of rates (dof,) that are too fine to count.
    """

    def __init__(self, dynamics: ReducedDynamics, period: float) -> None:
        robot, self._period = dynamics.robot, period
        q = robot.configuration_at(np.zeros(BASE_NV), robot.home)
        share = GAIN * np.abs(np.linalg.pinv(dynamics.actuation(q)) @ dynamics.inertia(q))
        limits = robot.effort_limits[:, None]
        self.finest = COARSE / np.maximum((share / limits).max(axis=0, initial=0.0), 1e-300)
        self._rates = np.zeros((WINDOW, robot.dof))
        self._elapsed, self._next = np.full(WINDOW, period), 0

    def takes(self, nu: Array, elapsed: float) -> bool:
        """Take rates (dof,) a time (s) after the last; return whether they are on a lattice."""
        k = self._next
        self._rates[k], self._next = nu, (k + 1) % WINDOW
        self._elapsed[k] = elapsed if elapsed > 0.0 else self._period
        return not self._next % STRIDE and self._found()

    def _found(self) -> bool:
        shaken = _shaken(self._rates[1:] - self._rates[:-1])
        if not shaken.any():
            return False
        rates, elapsed, finest = self._rates[:, shaken], self._elapsed, self.finest[shaken]
        ways = rates * elapsed[:, None]
        return _on_lattice(rates, finest) or _on_lattice(ways, elapsed.mean() * finest)


def _shaken(change: Array) -> Array:
    """Return which of some rates (k,) go up and down, by their changes (n, k); no smooth ones."""
    ups = np.add.reduce(change > 0.0, axis=0), np.add.reduce(change < 0.0, axis=0)
    return np.minimum(*ups) >= CHANGES


def _on_lattice(values: Array, finest: Array) -> bool:
    """Return whether a column changes by whole multiples of a step larger than the finest.

    Args:
        values: (n, k).
        finest: (k,).
    """
    change = values[1:] - values[:-1]
    size = np.abs(change)
    changed = size > 1e-9 * np.maximum(np.abs(values).max(axis=0), 1e-9)
    step = np.where(changed, size, np.inf).min(axis=0)
    multiples = PARTS * np.where(changed, size, 0.0) / step
    whole = np.abs(multiples - np.round(multiples)).max(axis=0) < ON_LATTICE
    return bool((whole & _shaken(np.where(changed, change, 0.0)) & (step > finest)).any())


class StateEstimate:
    """The state of one robot when the next efforts act, as far as it can be known.

    **Rates.** Where a rate is missing, or only known in steps, an observer follows the position
    s of its quasi-velocity: that of a joint, and the way of a base, by its told speeds or by its
    pose. Between samples the model moves the estimate under the efforts that act, plus a constant
    acceleration d besides; then, with the gap r between the measured and the estimated s,

        ŝ ← ŝ + (1 − p³) r,   ν̂ ← ν̂ + 1.5 (1 − p²)(1 − p) r/T,   d ← d + (1 − p)³ r/T²

    the filter of fading memory of [M69], p = exp(−ωT): three poles at ω. It starts at rest; its
    first n samples count alike, as long as that weighs the last one more: a robot that moves is
    known after some of them.

    **Delay.** Efforts act a told time δ after the sample they follow from. The state is moved on
    over δ under those that were sent and have not acted yet. The laws' integral so learns from
    those that have: what ν differs from its own prediction is the same then as now.

    Args:
        dynamics: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.
        delay: δ, s.
        rates: ``"measured"``, ``"estimated"``, or None: those that are missing are estimated, and
            all once one is on a lattice.
        efforts: Those that act before the first that are sent (n_act,); none where speeds are sent.
        compiled: Whether it runs as machine code.

    Attributes:
        samples: At how many rates were estimated.
        lattice: When rates were found to be on a lattice, s; NaN as long as they were not.
        astray: What arrived in the last period beside what had been sent for it (n_act,); None
            where nobody tells, or nothing is estimated.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        period: float,
        delay: float,
        rates: str | None,
        efforts: Array,
        compiled: bool,
    ) -> None:
        self._dynamics, self._period, self._delay = dynamics, period, delay
        self._told = rates == "estimated"
        self._every, self._compiled = rates == "estimated", compiled
        self._watch = LatticeWatch(dynamics, period) if rates is None and efforts.size else None
        self._efforts, self._until = efforts, 0.0  # sent last; until when they are among the acts
        # Acts that have not come to an end, or come: numbers of the first and after the last, and
        # how long they take, s.
        self._first, self._end, self._pending = 0, 0, 0.0
        self._last, self._time = numbers.nan, numbers.nan  # of the last sample; of the estimate, s
        self._nu = np.zeros(dynamics.robot.dof)  # of the last sample
        self._at: dict[str, Array] = {}
        self.astray: Array | None
        self.samples, self.lattice, self.astray = 0, numbers.nan, None
        if compiled and rates != "measured":
            self._build()  # while no robot waits

    def _build(self) -> None:
        """Build what computes, or read it from the disk."""
        efforts = bool(self._efforts.size)
        try:
            kernel = state_kernel(self._dynamics.robot, efforts, self._compiled)
        except DiffersError:
            kernel = state_kernel(self._dynamics.robot, efforts, False)
        self._at, self._run = kernel.places()

    def __call__(
        self, sample: MeasuredSample, applied: Array | None = None, jumped: bool = False
    ) -> MeasuredSample:
        """Return the state at the time of a sample, which is when the next efforts act.

        Args:
            sample: What was measured δ before its time; rates may be NaN.
            applied: Efforts (n_act,) that arrived since the last sample, if the robot tells.
            jumped: Whether the base's pose has, which is no motion.
        """
        t, q, nu = sample
        whole = numbers.isfinite(nu.dot(nu))
        elapsed, self._last = t - self._last, t  # NaN at first
        if whole and self._watch is not None and self._watch.takes(nu, elapsed):
            self._every, self._watch, self.lattice = True, None, t
        if whole and not (self._every or self._delay or self._begun):
            self._nu = nu
            return sample
        told = np.isfinite(nu)
        if not self._at:
            self._build()
        at, now = self._at, t - self._delay
        taken = np.zeros_like(told) if self._every else told
        self.samples += not taken.all()
        at["measured"][:], at["rates"][:] = q, np.where(told, nu, 0.0)
        at["told"][:], at["taken"][:] = told & (not self._told), taken
        at["jumped"][0] = jumped
        self._pass(t)
        impulse, since, self.astray = self._act(applied), now - self._time, None
        if applied is not None and since <= LONGEST_SILENCE:
            self.astray = applied - impulse / since
        if not (since <= LONGEST_SILENCE and self._correct(since)):
            known = told | (elapsed <= LONGEST_SILENCE)
            at["q"][:], at["before"][:] = q, q
            at["nu"][:] = np.where(told, nu, np.where(known, self._nu, 0.0))
            at["d"][:] = at["gap"][:] = 0.0
            at["age"][0] = numbers.inf if known.all() else 1.0
        if not self._begun:
            self._until = now
        self._time = now
        self._pass(t)  # where it begins: what was sent before
        estimate = MeasuredSample(t, at["q"].copy(), at["nu"].copy())
        self._nu = estimate.nu
        if not self._delay:
            return estimate
        at["moving"][0], at["correcting"][0] = 1.0, 0.0
        self._run(self._first, self._end - self._first)
        ahead = MeasuredSample(t, at["q"].copy(), at["nu"].copy())
        at["q"][:], at["nu"][:] = estimate.q, estimate.nu
        return ahead if np.isfinite(ahead.nu).all() else estimate

    @property
    def note(self) -> str:
        """A sentence on rates that were estimated; "" where none were."""
        if not self.samples:
            return ""
        why = "they were missing" if numbers.isnan(self.lattice) else (
            f"they were found to be quantised at {self.lattice:.4g} s"
        )  # fmt: skip
        why = 'as set by rates="estimated"' if self._told else why
        return f"the controller estimated rates at {self.samples} samples: {why}"

    def sent(self, t: float, efforts: Array) -> None:
        """Take note of efforts (n_act,) that act from a time (s) on."""
        self._pass(t)
        self._efforts = efforts

    @property
    def _begun(self) -> bool:
        return not numbers.isnan(self._time)

    def _pass(self, t: float) -> None:
        """Take note that the efforts that were sent last act until a time (s)."""
        if not self._begun:
            return
        most = LONGEST_SILENCE + self._delay + TIME_ROUNDING
        length, self._until = min(t - self._until, LONGEST_SILENCE), t
        steps, acts = numbers.ceil((length - TIME_ROUNDING) / LONGEST_STEP), self._at["acts"]
        while self._pending + length > most or self._end + steps - self._first >= MOST_ACTS:
            self._pending -= float(acts[self._first % MOST_ACTS, 0])
            self._first += 1
        for _ in range(steps):
            act, self._end = acts[self._end % MOST_ACTS], self._end + 1
            act[0], act[1:] = length / steps, self._efforts
            self._pending += length / steps

    def _act(self, applied: Array | None) -> Any:
        """Let the model move under all that has acted by now: what was sent, but for the last δ.

        Args:
            applied: Efforts (n_act,) that acted instead.

        Returns:
            Those that were sent (n_act,) times how long they acted, N·m·s or N·s.
        """
        at, acts, impulse = self._at, self._at["acts"], 0.0
        at["way"][:], at["moving"][0], at["correcting"][0] = 0.0, 1.0, 0.0
        while (length := self._pending - self._delay) > TIME_ROUNDING:
            act, free = acts[self._first % MOST_ACTS], (self._first - 1) % MOST_ACTS
            acts[free], lasts = act, float(act[0])
            if lasts - length < TIME_ROUNDING:
                length, self._first = lasts, self._first + 1
            act[0], acts[free, 0] = lasts - length, length
            if applied is not None:
                acts[free, 1:], impulse = applied, impulse + length * act[1:]
            self._pending -= length
            self._run(free, 1)
        return impulse

    def _correct(self, elapsed: float) -> bool:
        """Take in the sample, so long (s) after the last; return whether the state is finite."""
        at = self._at
        at["age"][0] += 1.0
        at["elapsed"][0], at["moving"][0], at["correcting"][0] = elapsed, 0.0, 1.0
        self._run(0, 1)
        return numbers.isfinite(at["nu"].dot(at["nu"]) + at["q"].dot(at["q"]))
