"""Planning in a process of its own, which holds up no sample: it is asked, and polled for answers.

Threads would not do: while one of them plans, Python lets no other run for milliseconds. The
process has no terminal and ends with its parent, however that ends: its pipe closes, and where
another process has kept that open, its parent's number changes.

Who plans there has no use for a function of this process. It gets a reference's rows at multiples
of a quarter of a step; between them, the second derivatives that a row holds go on.
"""

from __future__ import annotations

import io
import marshal
import math
import os
import pickle
import select
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.planner import Asked, Planned
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.files.worker import LENGTH, ONE_THREAD, Channel
from rpctl.reference.motion import Reference, ReferenceState, row_reader, state_of
from rpctl.robot.model import Robot

BOOT = "import sys; sys.path[:] = {}; from rpctl.control.horizon.process import main; main({})"
START_S = 120.0  # s that a process may take to load and to make its planner; 2 are usual
PARENT_S = 1.0  # s between two looks at whether the parent lives
LONG = 2**30  # bytes: no message is longer
PIECE = 2**16  # bytes that a pipe takes at once
HUNG = 4.0  # times what a plan reads without an answer: a busy machine may take more than one
NICENESS = 5  # of a process that plans
KEPT_S = 1.0  # s of the past that a reference is kept for


class Ended(Exception):
    """A process has ended."""


class Process:
    """A process that runs :func:`main`, and messages to and from it that nobody waits for.

    It ends when this object is let go of, at the latest when Python ends.
    """

    def __init__(self) -> None:
        own = os.getpid()
        try:
            self._child = subprocess.Popen(
                [sys.executable, "-c", BOOT.format(sys.path, own)], bufsize=0,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                env=os.environ | ONE_THREAD, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise RpctlError(
                f"the planning process could not be started ({error.strerror}); with "
                "Horizon(asynchronous=False) rpctl plans between the samples"
            ) from None
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self.pid, self._own = self._child.pid, own
        self._to, self._from = self._child.stdin.fileno(), self._child.stdout.fileno()
        os.set_blocking(self._to, False)
        self._poll = select.poll()
        self._poll.register(self._from, select.POLLIN)
        self._unsent, self._received = b"", b""
        self.end = weakref.finalize(self, _end, self._child, own)

    @property
    def own(self) -> bool:
        """Whether this process started it; one that was forked from that did not."""
        return self._own == os.getpid()

    def send(self, message: bytes) -> None:
        """Send a message; what the pipe does not take at once goes with the next calls.

        Raises:
            Ended: It has.
        """
        self._unsent += len(message).to_bytes(LENGTH, "big") + message
        self._write()

    def receive(self) -> bytes | None:
        """Return its next message; None if there is none yet.

        Raises:
            Ended: It has.
        """
        self._write()
        if not self._poll.poll(0):
            return None
        data = os.read(self._from, PIECE)
        if not data:
            raise Ended
        self._received += data
        size = LENGTH + int.from_bytes(self._received[:LENGTH], "big")
        if len(self._received) < size:
            return None
        message, self._received = self._received[LENGTH:size], self._received[size:]
        return message

    def wait(self, seconds: float) -> None:
        """Wait until there is something to receive, or to send, or that long (s)."""
        select.select([self._from], [self._to] if self._unsent else [], [], seconds)

    def _write(self) -> None:
        try:
            while self._unsent:
                self._unsent = self._unsent[os.write(self._to, self._unsent[:PIECE]) :]
        except BlockingIOError:
            pass
        except OSError:
            raise Ended from None


def _end(child: subprocess.Popen[bytes], own: int) -> None:
    """End a process; in one that was forked from its parent, only forget it."""
    if os.getpid() == own:
        child.kill()
        child.wait()
    else:
        child.returncode = 0
    for pipe in (child.stdin, child.stdout):
        with suppress(OSError):
            pipe.close()  # type: ignore[union-attr]


class PlanningProcess:
    """Plans of one robot from a process: started here, and anew whenever it ends.

    Args:
        make: Makes there, of the robot's dynamics, what plans.
        robot: The robot.
        dt: Length of a step, s.
        reach: How many steps of the reference it reads.

    Raises:
        RpctlError: It cannot be started, or the settings cannot be sent to it.

    Attributes:
        restarts: How often it ended, or did not answer within some horizons.
        fault: Why it is not started any more.
    """

    def __init__(
        self, make: Callable[[ReducedDynamics], Any], robot: Robot, dt: float, reach: int
    ) -> None:
        try:
            self._made_of = pickle.dumps((make, robot))
        except Exception as error:  # whatever somebody's own obstacle raises
            raise RpctlError(
                f"the horizon law's settings cannot be sent to the planning process ({error}); "
                "give obstacles of a class of an importable module, or "
                "Horizon(asynchronous=False)"
            ) from None
        self._reach, self._ahead = reach * dt, ReadAhead(robot, dt)
        self.restarts, self.fault = 0, ""
        self._process: Process | None = None
        self._asked: Asked | None = None
        self._ready = False
        self._start()

    def await_ready(self) -> None:
        """Wait until it is ready to plan.

        Raises:
            RpctlError: It does not become so.
        """
        for _ in range(round(START_S / PARENT_S)):
            if self._ready or self._process is None:
                break
            self._process.wait(PARENT_S)
            self._receive()
        if not self._ready:
            raise RpctlError(
                f"the planning process does not start: {self.fault or 'it takes too long'}; with "
                "Horizon(asynchronous=False) rpctl plans between the samples"
            )

    @property
    def busy(self) -> bool:
        """Whether it owes a plan."""
        return self._asked is not None

    def can_begin(self, reference: Reference, t: float, lag: float, delay: float) -> bool:
        """Return whether it can be asked for a plan, and its numbers are read; read some, if not.

        Args:
            reference: What is to be followed.
            t: Time, s.
            lag: How much later the reference is read, s.
            delay: s until the plan is expected.
        """
        if self.busy or not self._alive():
            return False
        return self._ahead.reaches(reference, t - lag, t + delay + self._reach) and self._ready

    def begin(self, reference: Reference, asked: Asked) -> None:
        """Ask for a plan; ``can_begin`` has said that it can be."""
        self._asked = asked
        try:
            assert self._process is not None
            message: Any = *asked, *self._ahead.taken()
            self._process.send(marshal.dumps(message))
        except Ended:
            self._lost()

    def result(self, t: float) -> Planned | None:
        """Return the plan that was asked for if it is there at a time (s), once."""
        if (self._ready and not self.busy) or not self._alive():
            return None
        found = self._receive()
        if self._asked is not None and t - self._asked.t > HUNG * self._reach:
            self._lost()
        return found

    def _receive(self) -> Planned | None:
        try:
            message = None if self._process is None else self._process.receive()
        except Ended:
            self._lost()
            return None
        if message is None:
            return None
        found: Planned = pickle.loads(message)
        if not self._ready:  # the first message: no plan, or why it cannot make any
            self.fault = found.fault
            self._ready = not self.fault
            return None
        self._asked = None
        return found

    def _alive(self) -> bool:
        """Return whether there is a process; one that was forked starts its own."""
        if self._process is not None and not self._process.own:
            self._start()
        return self._process is not None

    def _start(self) -> None:
        self._asked, self._ready, self._process = None, False, None
        self._ahead.forget()
        process = Process()
        process.send(self._made_of)
        self._process = process

    def _lost(self) -> None:
        """Start anew, unless it never was ready."""
        assert self._process is not None
        self.restarts += 1
        self._process.end()
        if not self._ready:
            self.fault, self._process = self.fault or "it ended at its start", None
            return
        try:
            self._start()
        except (RpctlError, Ended) as error:
            self.fault, self._process = str(error), None


def _failed(error: Exception) -> Planned:
    return Planned(None, fault=f"{type(error).__name__}: {error}")


def main(parent: int) -> None:
    """Be the process: make a planner of the first message, then a plan of each.

    Args:
        parent: Number of the process that started it.
    """
    incoming, outgoing = os.dup(0), os.dup(1)
    os.dup2(2, 1)  # what is printed is no message
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(AttributeError, OSError):  # samples come first: a plan that waits is told so
        os.nice(NICENESS)
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    channel = Channel(
        io.BufferedReader(io.FileIO(incoming)), io.BufferedWriter(io.FileIO(outgoing, "w"))
    )
    with suppress(EOFError, BrokenPipeError):
        planning = _planning(channel)
        rows, number, lag = NumbersAhead(0, 1.0), -1, 0.0
        while True:
            while not select.select([incoming], [], [], PARENT_S)[0]:
                if os.getppid() != parent:
                    return
            t, q, nu, delay, beside, sees, new, first, shape, more = marshal.loads(
                channel.receive(LONG)
            )
            if new != number:
                rows, number = NumbersAhead(first, planning.dt), new
            rows.add(np.frombuffer(more).reshape(shape), t - lag - KEPT_S)
            q, nu, beside = (np.frombuffer(each).copy() for each in (q, nu, beside))
            asked = Asked(t, q, nu, delay, beside, sees)
            try:
                found = planning(rows, asked)
            except Exception as error:  # this one; the next may do
                found = _failed(error)
            lag = found.lag if found.plan else lag
            channel.send(pickle.dumps(found))


def _planning(channel: Channel) -> Any:
    """Return what plans, and tell that it does."""
    try:
        make, robot = pickle.loads(channel.receive(LONG))
        planning = make(ReducedDynamics(robot))
    except Exception as error:  # as of a class that the parent alone knows
        channel.send(pickle.dumps(_failed(error)))
        raise EOFError from None
    channel.send(pickle.dumps(Planned(None)))
    return planning


ROWS_PER_STEP = 4
READING_S = 50e-6  # s that a sample may spend on reading ahead; a row takes 5 to 30 µs


class ReadAhead:
    """Reads references ahead, a few rows at a time."""

    def __init__(self, robot: Robot, dt: float) -> None:
        self._robot, self._stride = robot, dt / ROWS_PER_STEP
        self._reference: Reference | None = None
        self._number = 0
        self._row: Callable[[float], Array]
        self._first, self._rows = 0, list[Array]()

    def reaches(self, reference: Reference, begin: float, end: float) -> bool:
        """Return whether a reference has been read from one time (s) to another."""
        if reference is not self._reference:
            self._number, self._reference = self._number + 1, reference
            self._row = row_reader(self._robot, reference)
            self._first, self._rows = math.floor(begin / self._stride), []
        until = time.perf_counter() + READING_S
        while True:
            at = self._first + len(self._rows)
            if (at - 1) * self._stride >= end:
                return True
            self._rows.append(self._row(at * self._stride).copy())
            if time.perf_counter() > until:
                return False

    def taken(self) -> tuple[int, int, tuple[int, ...], Array]:
        """Return the rows that were read since the last call, and what they are.

        The number of the reference, counted: another one makes all rows before worthless; that of
        the first row, a multiple of the stride; the shape (K, 9 + 3 n_joints + 9); and the rows.
        """
        first, rows = self._first, np.array(self._rows)
        self._first, self._rows = first + len(rows), []
        return self._number, first, rows.shape, rows

    def forget(self) -> None:
        """Read everything again: who had the rows is gone."""
        self._reference = None


class NumbersAhead:
    """A reference made of its rows; before the first and after the last, it goes on from there."""

    def __init__(self, first: int, dt: float) -> None:
        self._first, self._stride = first, dt / ROWS_PER_STEP
        self._rows = list[Array]()

    def add(self, rows: Array, read_from: float) -> None:
        """Add the rows that follow, and forget those before a time (s)."""
        self._rows += list(rows)
        old = min(max(math.floor(read_from / self._stride) - self._first, 0), len(self._rows) - 1)
        self._first, self._rows = self._first + old, self._rows[old:]

    def __call__(self, t: float) -> ReferenceState:
        """Return the state at a time (s)."""
        at = min(max(round(t / self._stride) - self._first, 0), len(self._rows) - 1)
        state, since = state_of(self._rows[at]), t - (self._first + at) * self._stride
        since = min(max(since, -self._stride), self._stride)
        vx, vy, omega = state.twist.tolist()
        bent = state.twist_dot + np.array([-omega * vy, omega * vx, 0.0])
        x, y, turned = (since * (state.twist + 0.5 * since * bent)).tolist()
        cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
        pose = state.pose + np.array([cos * x - sin * y, sin * x + cos * y, turned])
        toward = np.asarray(state.direction)
        return ReferenceState(
            pose,
            state.twist + since * state.twist_dot,
            state.twist_dot,
            state.joints + since * (state.joint_rates + 0.5 * since * state.joint_accelerations),
            state.joint_rates + since * state.joint_accelerations,
            state.joint_accelerations,
            np.array([toward[0] + since * (toward[1] + 0.5 * since * toward[2]),
                      toward[1] + since * toward[2], toward[2]]),
        )  # fmt: skip
