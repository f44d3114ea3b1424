"""Pages served while a command runs: a robot, a run's report, or a simulation."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.motion import (
    Reference,
    ReferenceState,
    configuration_along,
    end_effector_reference,
)
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import Robot
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.merits.obstacles import AvoidedObstacle
from rpctl.view.labels import shorten
from rpctl.view.pages.robot_page import LiveMotion, robot_page
from rpctl.view.serve.server import STOP, PageServer, PageSource, Stream

FRAME_RATE = 30.0  # Hz of simulated time: what the eye needs
TIME_TOLERANCE_S = 1e-9  # s; sample times are rounded
PAGE_OPEN_TIMEOUT_S = 10.0  # s that a simulation waits for a page to be opened
LISTEN_TIMEOUT_S = 30.0  # s that a page has until it listens, once it was fetched
WAIT_STEP_S = 0.1  # s; a wait looks as often whether it is to end
HANDOVER_TIMEOUT_S = 10.0  # s that pages have to fetch the report
DESIRED_POINTS = 600  # points of the path that is to be followed
DECIMALS = 5  # decimals of what is sent: m and rad
MILLI = 1e3  # errors are shown in mm and mrad
PERCENT = 100.0
FIGURE_DECIMALS = 3  # of what is sent
Handler = Callable[[int, "FrameType | None"], object]


@contextmanager
def signals(handler: Handler) -> Iterator[None]:
    """Let SIGINT and SIGTERM call a handler inside the ``with`` block."""
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, each in before.items():
            signal.signal(number, each)


class StopRequest:
    """Whether a simulation is to end: it looks after each sample, so that samples stay whole.

    Attributes:
        running: Whether a simulation runs that looks.
        asked: Whether it is to end.
    """

    def __init__(self) -> None:
        self.running = self.asked = False

    def ask(self, _: object = None) -> None:
        """End the simulation if one runs; called from any thread."""
        if self.running:
            self.asked = True

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """End the simulation; the handler of a signal.

        Raises:
            KeyboardInterrupt: No simulation runs, or it was asked before and does not end.
        """
        if not self.running or self.asked:
            raise KeyboardInterrupt
        self.asked = True


def serve(page: PageSource, ready: Callable[[str], object] = print) -> None:
    """Serve a page until Ctrl-C or SIGTERM; called from the main thread.

    Args:
        page: Returns the page.
        ready: Called with the URL once it is served.
    """
    done = threading.Event()
    with signals(lambda number, frame: done.set()), PageServer(page) as server:
        ready(server.url)
        done.wait()


class LiveFigures:
    """Errors and efforts of a simulation, gathered between the frames that a page is sent.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot, self._data = robot, robot.model.createData()
        limits = robot.effort_limits
        limited = np.isfinite(limits) & (limits > 0.0)
        # Efforts of N and N m share an axis only as parts of their limits.
        self._shown = np.flatnonzero(limited) if limited.any() else np.arange(len(limits))
        self._scale = np.where(limited, PERCENT / np.where(limited, limits, 1.0), 1.0)
        self._percent = bool(limited.any())
        self._largest: list[Array] = []  # of each chart's lines, since the last frame

    def charts(self) -> list[dict[str, Any]]:
        """Return the charts for the page: title, unit, limits and the names of the lines."""
        short = shorten([self._robot.actuators[i] for i in self._shown])
        errors = ["base", "heading"] if self._robot.drive.base_speeds else []
        errors += ["end effector"] if self._robot.end_effector is not None else []
        return [
            {"title": "Errors", "unit": "mm, heading mrad", "limits": [], "lines": errors},
            {
                "title": "Efforts",
                "unit": "% of limit" if self._percent else "N·m or N, no limits",
                "limits": [-PERCENT, PERCENT] if self._percent else [],
                "lines": list(short.names),
                "names": short.shared,
            },
        ]

    def add(self, sample: LoopSample) -> None:
        """Take in a sample; of each line the value of largest magnitude counts."""
        now = [self._sample_errors(sample), (self._scale * sample.tau)[self._shown]]
        pairs = zip(self._largest or now, now, strict=True)
        self._largest = [np.where(np.abs(b) > np.abs(a), b, a) for a, b in pairs]

    def take(self) -> list[list[float]]:
        """Return the lines' values, one list a chart, and begin anew."""
        taken, self._largest = self._largest, []
        return [[round(float(value), FIGURE_DECIMALS) for value in values] for values in taken]

    def _sample_errors(self, sample: LoopSample) -> Array:
        errors = []
        if self._robot.drive.base_speeds:
            errors += [math.hypot(sample.e[0], sample.e[1]), float(sample.e[2])]
        if self._robot.end_effector is not None:
            wanted = end_effector_reference(self._robot, self._data, sample.state).translation
            actual = self._robot.end_effector_pose(self._data, sample.q).translation
            errors.append(float(np.linalg.norm(wanted - actual)))
        return MILLI * np.array(errors)


class Broadcast:
    """Shows a simulation on the pages that are open, if any.

    At the first sample the simulation waits up to ``PAGE_OPEN_TIMEOUT_S`` for a page. While a page
    is open the simulation is slowed to real time; a slow page never delays it.

    Args:
        robot: The robot.
        server: Where the page is served.
        stream: What the page listens to.
        duration: Of the simulation, s.
        stop: Whether it is to end before; None: never.
        awaits: Whether it waits for a page at first.
    """

    def __init__(
        self,
        robot: Robot,
        server: PageServer,
        stream: Stream,
        duration: float,
        stop: StopRequest | None = None,
        awaits: bool = True,
    ) -> None:
        self._robot, self._server, self._stream = robot, server, stream
        self._duration, self._stop = duration, stop or StopRequest()
        self._figures = LiveFigures(robot)
        self._started, self._awaits, self._next = False, awaits, 0.0
        self._origin: float | None = None

    def __call__(self, sample: LoopSample) -> None:
        """Show a moment of the simulation.

        Raises:
            KeyboardInterrupt: The simulation is to end here.
        """
        if not self._started:
            self._started = True
            self._stop.asked, self._stop.running = False, True
            # A page is opened, then listens: each has a limited time.
            opened = self._server.wait_delivered
            if self._awaits and self._wait(lambda wait: opened(1, wait), PAGE_OPEN_TIMEOUT_S):
                self._wait(self._stream.wait_reader, LISTEN_TIMEOUT_S)
        self._figures.add(sample)
        last = sample.t >= self._duration - TIME_TOLERANCE_S
        if last or sample.t >= self._next:
            self._send(sample)
            self._hold_to_real_time(sample.t)
        if last:
            self._stop.running = False
        if self._stop.asked:
            raise KeyboardInterrupt

    def end(self, how: str) -> None:
        """Tell open pages, in a word, that the simulation has ended; its report is being written.

        From now on Ctrl-C interrupts at once.
        """
        self._stop.running = False
        self._stream.send("state", f"{how}; the report is being written…")

    def _wait(self, come: Callable[[float], bool], seconds: float) -> bool:
        """Wait in short steps, each of which may see that the simulation is to end."""
        for _ in range(round(seconds / WAIT_STEP_S)):
            if self._stop.asked:
                return False
            if come(WAIT_STEP_S):
                return True
        return False

    def _send(self, sample: LoopSample) -> None:
        self._next = sample.t + 1.0 / FRAME_RATE - TIME_TOLERANCE_S
        actual = _coordinates(self._robot, sample.q)
        desired = _coordinates(self._robot, _desired(self._robot, sample.q, sample.state))
        frame = [round(float(value), DECIMALS) for value in (sample.t, *actual, *desired)]
        self._stream.send("frame", [frame[0], len(actual), *frame[1:]])
        self._stream.send("figures", [frame[0], *self._figures.take()])

    def finish(self, report: Path) -> None:
        """Send open pages to the report; wait a limited time until they have fetched it.

        Args:
            report: What is served from now on.
        """
        self._server.page = report.read_bytes
        awaited = self._server.delivered + self._stream.readers
        self._stream.send("done", None)
        self._server.wait_delivered(awaited, HANDOVER_TIMEOUT_S)

    def _hold_to_real_time(self, t: float) -> None:
        if not self._stream.watched:
            self._origin = None
            return
        now = time.monotonic()
        if self._origin is None or self._origin + t < now:
            self._origin = now - t
        time.sleep(max(0.0, self._origin + t - now))  # their difference rounds below 0 at times


@contextmanager
def broadcast(
    robot: Robot,
    reference: Reference,
    duration: float,
    say: Callable[[str], object],
    obstacles: tuple[AvoidedObstacle, ...] = (),
) -> Iterator[Broadcast]:
    """Serve the page of a simulation; yields its ``Broadcast``.

    Meanwhile Ctrl-C and SIGTERM, and the page's button, end the simulation after a whole sample by
    KeyboardInterrupt, in the main thread; a second Ctrl-C raises it at once.

    Args:
        robot: The robot.
        reference: What it is to follow.
        duration: s.
        say: Called with what the user should know: the page's URL first.
        obstacles: What it keeps clear of.

    Raises:
        RpctlError: The robot leans.
    """
    robot.require_level()  # a page is sent the pose of a level root link
    states = [reference(t) for t in np.linspace(0.0, duration, DESIRED_POINTS)]
    start = configuration_along(robot, states[0])
    motion = LiveMotion(start, np.array([state.pose for state in states]), duration, obstacles)
    page = robot_page(robot, motion, charts=LiveFigures(robot).charts()).encode()
    stream, stop = Stream(), StopRequest()
    with signals(stop.on_signal), PageServer(lambda: page, stream, {STOP: stop.ask}) as server:
        stream.send("state", "Waiting for the simulation…")
        say(
            f"{server.url}  watch it there; it starts once the page is open, "
            f"or in {PAGE_OPEN_TIMEOUT_S:.0f} s"
        )
        yield Broadcast(robot, server, stream, duration, stop)


def _coordinates(robot: Robot, q: Array) -> list[float]:
    """Return the pose (x, y, heading) of the root link and all joints, in the model's order."""
    return [*read_root(q), *(entry.read(q) for entry in robot.entries.values())]


def _desired(robot: Robot, q: Array, state: ReferenceState) -> Array:
    """Return q (nq,) with base, steering and arm at the reference; wheel angles are kept."""
    there = configuration_along(robot, state)
    wanted = q.copy()
    wanted[:4] = there[:4]
    turned = [swivel.joint for swivel in robot.drive.swivels if not swivel.trails]
    for name in (*turned, *robot.joint_names, *(joint.name for joint in robot.mimics)):
        robot.set_joint(wanted, name, robot.joint_position(there, name))
    return wanted
