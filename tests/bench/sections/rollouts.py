"""Many closed loops on one core, beside as many of MuJoCo's rollouts; and what memory they take."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import rpctl
from rpctl.study.scatter import Normal
from tests.bench.peers import MujocoPeer
from tests.bench.rows import Row, Section

COMMAND = "python -m tests.bench.table --only rollouts"
SECONDS, PERIOD = 10.0, 0.001
COUNT, RATIO_GOAL = 1000, 25.0
FEW = 16  # of them, for a quick look
MANY, MANY_GOAL = 100_000, 60.0  # runs of the paper's robot, s
SCATTER = {
    "run.initial_error.x": Normal(0.0, 0.05),
    "run.initial_error.y": Normal(0.0, 0.05),
    "run.initial_error.theta": Normal(0.0, 0.1),
}


def section(quick: bool) -> Section:
    """Return what many runs take; quick measures some, the others in proportion."""
    robot = rpctl.load("paper" if quick else "tiago")
    took, theirs = _ours(robot, FEW if quick else COUNT), _mujoco(robot, 1 if quick else 40)
    what = f"{COUNT} runs of 10 s at 1 kHz, {'paper' if quick else 'TIAGo'}"
    peer = "MuJoCo's rollout, open loop"
    part, whole = (64, 256) if quick else (4000, MANY)
    few, many = (_paper(count) for count in (part, whole))
    scaled = few["seconds"] + (many["seconds"] - few["seconds"]) / (whole - part) * (MANY - part)
    paper = "python -m tests.bench.paper_rollouts {}".format
    rows = (
        Row(what, took, "s", COMMAND, peer, theirs, ratio_goal=RATIO_GOAL),
        Row(peer, theirs, "s", COMMAND),
        Row(
            f"{MANY} runs of 10 s at 2 ms, the paper's robot",
            scaled,
            "s",
            paper(whole),
            goal=MANY_GOAL,
        ),
        Row(f"memory of {part} of them", few["peak"], "MB", paper(part)),
        Row(f"memory of {whole} of them", many["peak"], "MB", paper(whole)),
    )
    note = (
        "Closed loops with scattered starts, all on one core, preparation from a cached loop "
        "included; MuJoCo's runs have no controller and are done one after the other, "
        f"{1 if quick else 40} of them measured. Memory is the largest of a whole process that "
        "does chunks of 256 runs and keeps none of them."
    )
    if quick:
        note += f" Quick: {FEW} and {whole} runs were measured, the others are in proportion."
    return Section("Thousands of closed loops", rows, note)


def _ours(robot: rpctl.Robot, count: int) -> float:
    """Return the processor time of :data:`COUNT` runs, s, of which some are done."""

    def runs(number: int) -> float:
        began = time.process_time()
        rpctl.rollout(
            robot,
            "eight",
            SCATTER,
            count=number,
            duration=SECONDS,
            control_period=PERIOD,
            plant_step=PERIOD,
            backend="compiled",
        )
        return time.process_time() - began

    runs(8)  # builds the loop, and leaves it in the cache
    if count == COUNT:
        return runs(count)
    few, more = runs(8), runs(count)
    return few + (more - few) / (count - 8) * (COUNT - 8)


def _mujoco(robot: rpctl.Robot, count: int) -> float:
    peer = MujocoPeer(robot, PERIOD)
    return COUNT / count * peer.rollouts(count, round(SECONDS / PERIOD))


def _paper(count: int) -> dict[str, float]:
    """Return processor time (s) and largest memory (MB) of a process that does so many runs."""
    arguments = [sys.executable, "-m", "tests.bench.paper_rollouts", str(count)]
    done = subprocess.run(arguments, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found
