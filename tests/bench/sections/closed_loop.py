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
from tests.bench.peers import MujocoPeer, same_world
from tests.bench.rows import Row, Section, cpu_seconds

COMMAND = "python -m tests.bench.table --only closed_loop"
SECONDS, QUICK_SECONDS, PERIOD = 10.0, 1.0, 0.002
GOAL = 300.0  # times real time
UNIT = "times real time"


def section(quick: bool) -> Section:
    """Return how many times real time a loop runs, and how long its machine code takes to build."""
    robot, rounds, lasts = (
        rpctl.load("tiago"),
        1 if quick else 7,
        QUICK_SECONDS if quick else SECONDS,
    )
    steps = round(lasts / PERIOD)
    config = Config(*default_laws(robot), run=RunSettings(control_period=PERIOD))

    def build() -> float:
        dynamics = ReducedDynamics(rpctl.load("tiago"))  # of which this process has no loop yet
        began = time.process_time()
        compiled_loop(dynamics, dynamics, config)
        return time.process_time() - began

    built, loaded = build(), min(build() for _ in range(1 if quick else 2))
    peer, its = "MuJoCo, controller in Python", lasts / _mujoco(robot, steps, rounds)
    world = "the same world, controller in Python"
    worlds = lasts / min(same_world(robot, PERIOD, steps) for _ in range(rounds))
    reference = reference_by_name(robot, "eight")

    def row(what: str, took: float, command: str, goal: float | None = None) -> Row:
        return Row(what, lasts / took, UNIT, command, peer, its, goal)

    def track(backend: str, bare: bool, plant: str = "ideal") -> float:
        def run() -> object:
            return rpctl.track(
                robot,
                reference if bare else "eight",
                duration=lasts,
                collisions=not bare,
                backend=backend,
                plant=plant,
            )

        run()
        return cpu_seconds(run, rounds=1 if backend == "pinocchio" else rounds)

    bare = f"rpctl.track(robot, reference, duration={lasts}, collisions=False, {{}})"
    whole = f'rpctl.track(robot, "eight", duration={lasts})'
    rows = (
        row(
            "the loop with its log, compiled",
            track("compiled", True),
            bare.format('backend="compiled"'),
            GOAL,
        ),
        row("the same in Python", track("pinocchio", True), bare.format('backend="pinocchio"')),
        Row(
            "the loop on contact in MuJoCo",
            lasts / track("auto", True, "contact"),
            UNIT,
            bare.format('plant="contact"'),
            world,
            worlds,
        ),
        row("`track`, all it does, compiled", track("compiled", False), whole),
        Row(peer, its, UNIT, COMMAND),
        Row("the loop is built and checked, once", built, "s", COMMAND),
        Row("it is loaded from the cache", loaded, "s", COMMAND, "built", built),
    )
    note = (
        f"{lasts:g} s of TIAGo's figure-eight at 2 ms, the default laws. `track` also fits the "
        "reference to the robot and looks for collisions. rpctl's loop rolls without contact; "
        "MuJoCo's is of a robot on its wheels, in steps of 2 ms, whose arm a "
        "proportional-derivative law holds. On contact both are of the same world, in steps of "
        "1 ms."
    )
    return Section("One closed loop", rows, note)


def _mujoco(robot: rpctl.Robot, steps: int, rounds: int) -> float:
    found = []
    for _ in range(rounds):
        peer = MujocoPeer(robot, PERIOD)
        found.append(peer.with_python_control(steps))
        if not np.all(np.isfinite(peer.data.qpos)):
            raise ValueError("MuJoCo's robot left the finite numbers")
    return min(found)
