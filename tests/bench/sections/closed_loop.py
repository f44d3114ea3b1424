"""One closed loop of TIAGo, with its log, beside MuJoCo with a controller in Python."""

from __future__ import annotations

import time

import numpy as np

import rpctl
from rpctl.control.controller import default_laws
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.named import reference_by_name
from rpctl.simulation.compiled.build import compiled_loop
from rpctl.simulation.config import Config, RunSettings
from tests.bench.peers import MujocoPeer
from tests.bench.rows import Row, Section, cpu_seconds

COMMAND = "python -m tests.bench.table --only closed_loop"
SECONDS, PERIOD = 10.0, 0.002
GOAL = 300.0  # times real time
UNIT = "times real time"


def section(quick: bool) -> Section:
    """Return how many times real time a loop runs, and how long its machine code takes to build."""
    robot, rounds = rpctl.load("tiago"), 3 if quick else 7
    config = Config(*default_laws(robot), run=RunSettings(control_period=PERIOD))

    def build() -> float:
        dynamics = ReducedDynamics(rpctl.load("tiago"))  # of which this process has no loop yet
        began = time.process_time()
        compiled_loop(dynamics, dynamics, config)
        return time.process_time() - began

    built, loaded = build(), min(build() for _ in range(2))
    peer, its = "MuJoCo, controller in Python", SECONDS / _mujoco(robot, rounds)
    reference = reference_by_name(robot, "eight")

    def row(what: str, took: float, command: str, goal: float | None = None) -> Row:
        return Row(what, SECONDS / took, UNIT, command, peer, its, goal)

    def track(backend: str, bare: bool) -> float:
        of = reference if bare else "eight"

        def run() -> object:
            return rpctl.track(robot, of, duration=SECONDS, collisions=not bare, backend=backend)

        run()
        return cpu_seconds(run, rounds=1 if backend == "pinocchio" else rounds)

    bare = 'rpctl.track(robot, reference, duration=10.0, collisions=False, backend="{}")'
    whole = 'rpctl.track(robot, "eight", duration=10.0)'
    rows = (
        row(
            "the loop with its log, compiled",
            track("compiled", True),
            bare.format("compiled"),
            GOAL,
        ),
        row("the same in Python", track("pinocchio", True), bare.format("pinocchio")),
        row("`track`, all it does, compiled", track("compiled", False), whole),
        Row(peer, its, UNIT, COMMAND),
        Row("the loop is built and checked, once", built, "s", COMMAND),
        Row("it is loaded from the cache", loaded, "s", COMMAND, "built", built),
    )
    note = (
        "10 s of TIAGo's figure-eight at 2 ms, the default laws. `track` also fits the reference "
        "to the robot and looks for collisions. The processor time of MuJoCo's loop is that of a "
        "robot on its wheels whose arm a proportional-derivative law holds."
    )
    return Section("One closed loop", rows, note)


def _mujoco(robot: rpctl.Robot, rounds: int) -> float:
    steps, found = round(SECONDS / PERIOD), []
    for _ in range(rounds):
        peer = MujocoPeer(robot, PERIOD)
        found.append(peer.with_python_control(steps))
        if not np.all(np.isfinite(peer.data.qpos)):
            raise ValueError("MuJoCo's robot left the finite numbers")
    return min(found)
