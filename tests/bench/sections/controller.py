"""What a step of the controller takes on a robot, with the default laws."""

from __future__ import annotations

import time

import numpy as np

import rpctl
from rpctl.arrays import Array
from tests.bench.rows import Row, Section

COMMAND = "python -m tests.bench.table --only controller"
MEDIAN_GOAL, MOST_GOAL, VIRTUAL_GOAL = 25.0, 60.0, 120.0  # µs
PERIOD = 0.002  # s


def section(quick: bool) -> Section:
    """Return median, 99 % and 99.9 % of a step along a figure-eight, µs."""
    samples, rows = 1000 if quick else 15000, []
    for name in ("tiago",) if quick else ("tiago", "swerve"):
        robot = rpctl.load(name)
        for output in ("effort",) if quick else ("effort", "velocity"):
            machine, virtual = (
                np.quantile(step_seconds(robot, output, compiled, samples), [0.5, 0.99, 0.999])
                * 1e6
                for compiled in (True, False)
            )
            what, peer = f"{name}, {output}: a step", "CasADi's virtual machine"
            rows.append(Row(what, machine[0], "µs", COMMAND, peer, virtual[0], MEDIAN_GOAL))
            rows.append(Row(f"{what}, 99 %", machine[1], "µs", COMMAND, peer, virtual[1]))
            rows.append(Row(f"{what}, 99.9 %", machine[2], "µs", COMMAND, goal=MOST_GOAL))
            rows.append(Row(f"{what}, {peer}", virtual[0], "µs", COMMAND, goal=VIRTUAL_GOAL))
    note = (
        "Unified law and law within limits with integral action, on the states of a run; medians "
        "of processor time. Where it waits for others a step takes longer."
    )
    return Section("A step of the controller", tuple(rows), note)


def step_seconds(robot: rpctl.Robot, output: str, compiled: bool, samples: int) -> Array:
    """Return the processor time, s, of each step (samples,) of a run but the first thousand."""
    lasts = min(20.0, (samples + 1000) * PERIOD)
    run = rpctl.track(robot, "eight", duration=lasts, control_period=PERIOD, collisions=False)
    controller = rpctl.Controller(robot, "eight", period=PERIOD, output=output, compiled=compiled)
    seconds = np.empty(samples + 1000)
    for k in range(len(seconds)):
        at = k % len(run.t)
        if not at:
            controller.reset()
        t, q, nu = float(run.t[at]), run.q[at], run.nu[at]
        began = time.thread_time()
        controller.step(t, q, nu)
        seconds[k] = time.thread_time() - began
    return seconds[1000:]
