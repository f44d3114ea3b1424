"""The page of a robot that goes to the goals set there, until Ctrl-C."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.errors import RpctlError, require_known
from rpctl.files.records import WITHIN, OneOf, Range, Record, Setting, read_record
from rpctl.reference.pose_goal import MAX_DISTANCE, PoseGoal, seen_from, to_goal
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.loop.track import default_duration, simulate
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.run.run import Run
from rpctl.view.pages.robot_page import robot_page
from rpctl.view.serve.live import Broadcast, LiveFigures, StopRequest, signals
from rpctl.view.serve.server import GO, STOP, Action, PageServer, Stream

DEFAULT_LAW = "unified"  # the first to choose
LOOK_S = 0.1  # s; as often the server looks whether it is to end
REACHED_M, REACHED_RAD = 0.02, 0.02  # a goal as near as that is called reached
PLACE = Range(-MAX_DISTANCE, MAX_DISTANCE)
Pose = tuple[float, float, float]
LIMIT_TOLERANCE = 1e-9  # rad or m; a posture is written in decimals


@dataclass(frozen=True)
class GoRequest(Record):
    """A motion that a page asks for."""

    of = "the page's "
    start: Annotated[Pose, PLACE, Setting("m, m, rad", help="Pose of P at the start.")]
    posture: Annotated[
        Mapping[str, float], WITHIN, Setting("rad or m", help="Posture of the arm at the start.")
    ]
    goal: Annotated[Pose | None, PLACE, Setting("m, m, rad", help="Pose of P at the goal.")]
    arm: Annotated[
        Mapping[str, float],
        WITHIN,
        Setting("rad or m", help="Positions of the arm's joints at the goal."),
    ]
    kinematic: Annotated[str, OneOf(tuple(KINEMATIC_LAWS)), Setting(help="The kinematic law.")]


def read_request(robot: Robot, asked: Any) -> GoRequest:
    """Return what a page asks for, every number checked.

    Args:
        robot: The robot that the page shows.
        asked: The JSON that it sent.

    Raises:
        RpctlError: It is of another form, a number is none or too large, or a joint is not known
            or beyond its limits.
    """
    faults: list[str] = []
    request = read_record(GoRequest, asked if isinstance(asked, dict) else {}, "", faults)
    if request is None:
        raise RpctlError(f"the request is invalid: {'; '.join(faults)}")
    require_known("joint of the arm", [*request.posture, *request.arm], robot.joint_names)
    if set(request.posture) != set(robot.joint_names):
        raise RpctlError(f"posture: give all joints of the arm, {', '.join(robot.joint_names)}")
    for joint in robot.joints:
        position, room = request.posture[joint.name], LIMIT_TOLERANCE
        if not joint.lower - room <= position <= joint.upper + room:
            raise RpctlError(f"{joint.name} begins at {position:.6g}, beyond its limits")
    return request


class GoServer:
    """Serves a robot's page, and simulates the motions that it asks for, one at a time.

    Args:
        load: Loads the robot; called for every request of the page.
        command: The words that a command to go to a goal begins with.
    """

    def __init__(self, load: Callable[[], Robot], command: str | None = None) -> None:
        self._load, self._command = load, command
        self._robot: Robot | None = None  # the one that the page shows
        self._asked: queue.Queue[tuple[Robot, GoRequest]] = queue.Queue()
        self._busy = threading.Lock()
        self._done, self._stop = threading.Event(), StopRequest()
        self._stream = Stream()

    def run(self, ready: Callable[[str], object] = print) -> None:
        """Serve until Ctrl-C or SIGTERM; called from the main thread.

        Args:
            ready: Called with the URL once the page is served.
        """
        actions: dict[str, Action] = {GO: self._ask, STOP: self._stop.ask}
        with signals(self._end), PageServer(self._page, self._stream, actions) as server:
            ready(server.url)
            while not self._done.is_set():
                try:
                    robot, request = self._asked.get(timeout=LOOK_S)
                except queue.Empty:
                    continue
                self._go(robot, request, server)

    def _end(self, number: int, frame: object) -> None:
        if self._done.is_set():
            raise KeyboardInterrupt  # a law that does not return is left at the second one
        self._done.set()
        self._stop.ask()

    def _page(self) -> bytes:
        robot = self._load()
        laws = sorted(KINEMATIC_LAWS, key=lambda name: name != DEFAULT_LAW)
        charts = LiveFigures(robot).charts()
        page = robot_page(robot, command=self._command, laws=laws, charts=charts).encode()
        self._robot = robot
        return page

    def _ask(self, asked: Any) -> None:
        """Take a page's request; the main thread simulates it."""
        robot = self._robot
        if robot is None:
            raise RpctlError("no page has shown the robot yet")
        robot.require_level()  # a page is sent the pose of a level root link
        request = read_request(robot, asked)
        if not self._busy.acquire(blocking=False):
            raise RpctlError("the robot is already moving; stop it first")
        self._stream.forget()  # who listens from now on hears of this motion only
        self._asked.put((robot, request))

    def _go(self, robot: Robot, request: GoRequest, server: PageServer) -> None:
        """Simulate a motion; pages are sent it, and how it ended."""
        try:
            text, bad = self._simulate(robot, request, server), False
        except KeyboardInterrupt:
            text, bad = "Stopped.", False
        except RpctlError as error:
            text, bad = str(error), True
        finally:
            self._stop.running = False
            self._busy.release()
        self._stream.send("end", {"text": text, "bad": bad})

    def _simulate(self, robot: Robot, request: GoRequest, server: PageServer) -> str:
        """Return how near a motion came to its goal, in a sentence."""
        start = np.array([request.posture[name] for name in robot.joint_names])
        goal = PoseGoal(request.goal, request.arm)
        reference = to_goal(robot, goal, np.array(request.start), start)
        config = Config().with_laws(request.kinematic, None).with_run(reference=str(goal))
        duration = default_duration(reference)
        self._stream.send("begin", {"duration": duration})
        show = Broadcast(robot, server, self._stream, duration, self._stop, awaits=False)

        def watch(sample: LoopSample) -> None:
            if self._done.is_set():
                raise KeyboardInterrupt
            show(sample)

        return ending(simulate(robot, config, reference, watch=watch), request)


def ending(run: Run, request: GoRequest) -> str:
    """Return how near a run came to the goal that was asked for, in a sentence."""
    pose = np.array(request.start if request.goal is None else request.goal)
    x, y, turn = seen_from(run.log.base[-1], pose)
    distance, turn = math.hypot(x, y), abs(turn)
    near = distance < REACHED_M and turn < REACHED_RAD
    words = [f"{1e3 * distance:.1f} mm and {1e3 * turn:.1f} mrad from the goal"]
    if run.log.ee.size:
        gap = 1e3 * float(np.linalg.norm(run.log.ee_ref[-1] - run.log.ee[-1]))
        words.append(f"the end effector {gap:.1f} mm")
    broken = summarize(run).limits_violated
    if broken:
        words.append(f"{broken[0].joint} broke its limit of {broken[0].limit}")
    return f"{'Reached' if near else 'Not reached'} in {run.t[-1]:.1f} s: {'; '.join(words)}."
