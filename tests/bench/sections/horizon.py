"""What a sample of the horizon law takes, by part."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import rpctl
from rpctl import Controller, Robot
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.leaning_plan import LeaningPlanner
from rpctl.control.horizon.planner import Planner
from tests.bench.real_time import step_seconds
from tests.bench.rows import Row, Section

OFF = (0.1, -0.1, 0.2)  # of the closed loop's start: limits bind for a second or so
COMMAND = "python -m tests.bench.table --only horizon"
WHOLE = "a sample, whole"
PARTS = {
    WHOLE: "plan",
    "target: time scaling and look-ahead": "_target",
    "linearisation: constraints and cost": "linearise",
    "quadratic program": "_solved",
}
ROBOTS = "tiago", "car"
LEANING = "balancer", "wheel_legs"
FLOOR = "default laws, same samples"
SHARES = {"median": 50.0, "99 %": 99.0, "99.9 %": 99.9, "longest": 100.0}


def section(quick: bool) -> Section:
    """Return medians over a closed loop of TIAGo, ms."""
    robot, duration = rpctl.load("tiago"), 0.5 if quick else 12.0
    found = part_seconds(robot, Horizon(), PARTS, duration)
    median = {name: 1e3 * float(np.median(seconds[1:])) for name, seconds in found.items()}
    rows = tuple(Row(name, each, "ms", COMMAND) for name, each in median.items())
    most = 1e3 * float(np.percentile(found[WHOLE][1:], 99.0))
    rows += (Row(f"{WHOLE}, 99 %", most, "ms", COMMAND),)
    rows += tuple(row for name in ROBOTS[1 if quick else 0 :] for row in paced_rows(name, duration))
    rows += tuple(
        row for name in LEANING[: 1 if quick else None] for row in leaning_rows(name, duration)
    )
    note = (
        f"TIAGo, 20 steps ahead, medians over {duration:g} s of a figure-eight that starts where "
        "limits bind. What is left of a sample is prediction and bookkeeping. Steps: at 500 Hz in "
        "real time, plans from a process of their own or in line; beside them the default laws, in "
        "the same run half a period later: what of their slowest steps is the machine's is so of "
        "both. Robots that lean: processor time of a plan, one each 20 ms, over 60 "
        "steps; one in five linearises about a new motion."
    )
    return Section("A sample of the horizon law", rows, note)


def paced_rows(name: str, duration: float) -> Iterator[Row]:
    """Yield percentiles of what a step takes (ms), with plans beside the samples and in line."""
    robot = rpctl.load(name)
    for how, law in (("", Horizon()), (", plans in line", Horizon(asynchronous=False))):
        floor = Controller(robot, "eight")
        took = 1e3 * step_seconds(Controller(robot, "eight", kinematic=law), floor, duration)
        for label, share in SHARES.items():
            figure, peer = (float(each) for each in np.percentile(took, share, axis=1))
            yield Row(
                f"Controller.step, {name}{how}: {label}", figure, "ms", COMMAND, FLOOR, peer,
                goal=0.3 if share == 99.9 and not how else None,
            )  # fmt: skip


def leaning_rows(name: str, duration: float) -> Iterator[Row]:
    """Yield percentiles of what a plan of a robot that leans takes, ms."""
    parts = {"plan": "_solved"}
    took = part_seconds(rpctl.load(name), Horizon(), parts, duration, LeaningPlanner)["plan"]
    for label in ("median", "99 %"):
        figure = 1e3 * float(np.percentile(took[1:], SHARES[label]))
        yield Row(f"plan, {name}: {label}", figure, "ms", COMMAND)


def timed(call: Callable[..., Any], seconds: list[float]) -> Callable[..., Any]:
    """Return a call that notes the processor time it took, s."""

    def noted(*args: Any) -> Any:
        began = time.thread_time()
        result = call(*args)
        seconds.append(time.thread_time() - began)
        return result

    return noted


def part_seconds(
    robot: Robot, law: Horizon, parts: dict[str, str], duration: float, of: type = Planner
) -> dict[str, list[float]]:
    """Return the processor times (s) of parts of a planner, call by call, over a closed loop.

    Args:
        robot: The robot.
        law: The law.
        parts: Methods of the planner by label.
        duration: Of the loop, s.
        of: The planner.
    """
    figures: dict[str, list[float]] = {label: [] for label in parts}
    usual = {name: getattr(of, name) for name in parts.values()}
    for label, name in parts.items():
        setattr(of, name, timed(usual[name], figures[label]))
    try:
        rpctl.track(robot, "eight", duration=duration, initial_error=OFF, kinematic=law)
    finally:
        for name, call in usual.items():
            setattr(of, name, call)
    return figures
