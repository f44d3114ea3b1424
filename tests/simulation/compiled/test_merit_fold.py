"""Merits folded sample by sample against those of a whole log."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, Run, track
from rpctl.arrays import Array
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Program, Read, Rows, RowStream
from rpctl.simulation.compiled.merit_fold import FIRST, merit_fold
from rpctl.simulation.merits.measures import SampleMeasures, fold, measures, merits_of, spans_of
from tests.grids import cells
from tests.kernels.interpreted import Interpreted

FIELDS = ("q", "nu", "e", "tau")


def folded(robot: Robot, run: Run, limits: Array) -> tuple[Array, Array]:
    """Return totals and measures (count, n) by the statements, reading what a log has."""
    log, count = run.log, len(run.t)
    dynamics = SymbolicDynamics(robot)
    logged: dict[str, Any] = {name: getattr(log, name) for name in FIELDS} | {"limits": limits}
    logged["count"] = np.arange(1.0, count + 1.0)[:, None]
    buffers = {name: Buffer(name, values.shape[1]) for name, values in logged.items()}
    streams = {name: RowStream(name, b.size, laned=False) for name, b in buffers.items()}
    sample = [buffers[name] for name in (*FIELDS, "limits")]
    found = merit_fold(dynamics, sample, Buffer("p", dynamics.p.numel()), buffers["count"])
    reads = tuple(Read(streams[name], buffers[name]) for name in logged)
    program = Program((*reads, *found.statements))
    kernel = Interpreted(program, 1)
    workspace = kernel.workspace()
    workspace[found.totals][:] = FIRST[:, None]
    workspace[found.spans][:] = spans_of(count)[:, None]
    rows = {streams[name]: np.ascontiguousarray(values) for name, values in logged.items()}
    if found.tip is not None:
        rows[found.tip] = np.ascontiguousarray(log.ee_ref)
    seen = []
    for k in range(count):
        one = {s: Rows(np.ascontiguousarray(values[k : k + 1])) for s, values in rows.items()}
        kernel.run(k, 1, workspace, one)
        seen.append(workspace[found.measures][:, 0].copy())
    return workspace[found.totals][:, 0], np.array(seen)


@pytest.mark.parametrize("name", cells(("paper", "car", "bicycle"), ["paper"], ["car"]))
def test_folding_is_the_batch(name: str) -> None:
    """Random states whose distances cross the threshold, with and without an arm and steering."""
    robot = rpctl.load(name)
    run, rng = track(robot, "eight", duration=0.1, collisions=False), np.random.default_rng(1)
    count = len(run.t)
    e = rng.normal(size=run.log.e.shape) * 0.05
    tau = run.log.tau + rng.normal(size=run.tau.shape)
    limits = (rng.random((count, 3)) < 0.1).astype(float)
    wanted = run.log.ee_ref + rng.normal(size=run.log.ee_ref.shape) * 0.05
    log = run.log.changed({"e": e, "tau": tau, "active_limits": limits, "ee_ref": wanted})
    changed = dataclasses.replace(run, log=log)
    expected = measures(changed)
    totals, seen = folded(robot, changed, limits)
    np.testing.assert_allclose(seen, np.array(expected).T, rtol=1e-12, atol=1e-14)
    batch = fold(expected)
    np.testing.assert_allclose(totals, np.array(batch), rtol=1e-12)
    assert 0 < batch.settled <= count
    assert batch.limited > 0


def test_measures_are_what_the_log_says(paper: Robot) -> None:
    """Sample by sample, by NumPy and the robot's own limits."""
    run, rng = track(paper, "eight", duration=0.05, collisions=False), np.random.default_rng(2)
    log = run.log.changed({"e": rng.normal(size=run.log.e.shape), "tau": 90.0 * run.tau})
    log = log.changed({"active_limits": (rng.random((len(run.t), 4)) < 0.1).astype(float)})
    found = measures(dataclasses.replace(run, log=log))
    described = [paper.description.joint[name] for name in paper.actuators]
    for k in range(len(run.t)):
        x, y, _, *arm = log.e[k]
        asked = [abs(x) / j.effort for x, j in zip(log.tau[k], described, strict=True)]
        rates = [abs(x) / j.velocity for x, j in zip(log.rates[k], described, strict=True)]
        rows = [*zip(log.joints[k], paper.joints, strict=True)]
        expected = SampleMeasures(
            base=np.hypot(x, y),
            lateral=abs(y),
            tip=np.linalg.norm(log.ee[k] - log.ee_ref[k]),
            joint=max(map(abs, arm)),
            effort=max(asked),
            speed=max(rates),
            excess=max(max(j.lower - at, at - j.upper) for at, j in rows),
            limited=float(log.active_limits[k].any()),
        )
        at = [each[k] for each in found]
        np.testing.assert_allclose(at, expected, rtol=1e-12, atol=1e-15)


def hand(base: list[float], **others: list[float]) -> SampleMeasures:
    """Return measures of samples whose distances are ``base``; of the others, 0."""
    none = np.zeros(len(base))
    given = {"base": np.array(base)} | {key: np.array(x) for key, x in others.items()}
    return SampleMeasures(**{name: given.get(name, none) for name in SampleMeasures._fields})


def merits(measured: SampleMeasures) -> dict[str, Array]:
    """Return the merits of samples 0.5 s apart."""
    count = measured.base.shape[-1]
    totals = fold(measured)
    return merits_of(totals, np.array(7.0), np.array(2.0), count, 0.5)


def test_merits_are_those_on_paper() -> None:
    found = merits(
        hand(
            [3.0, 0.1, 0.04, 0.04, 0.03],
            lateral=[0.0, 5.0, 0.0, 0.0, 0.02],
            tip=[2.0, 0.0, 0.0, 0.0, 1.0],
            joint=[0.1, 0.4, 0.2, 0.0, 0.0],
            effort=[0.1, 0.2, 1.4, 0.0, 0.0],
            speed=[0.3, 0.2, 0.1, 0.0, 0.0],
            excess=[-3.0, -0.5, -2.0, -1.0, -4.0],
            limited=[0.0, 1.0, 1.0, 0.0, 1.0],
        )
    )
    square = 9.0 + 0.01 + 2 * 0.0016 + 0.0009
    expected = {
        "rms_base_error": np.sqrt(square / 5),
        "final_base_error": 0.03,
        "max_base_error": 3.0,
        "settled_rms_base_error": np.sqrt((2 * 0.0016 + 0.0009) / 3),
        "final_lateral_error": 0.02,
        "rms_end_effector_error": 1.0,
        "final_end_effector_error": 1.0,
        "max_joint_error": 0.4,
        "max_effort_ratio": 1.4,
        "max_speed_ratio": 0.3,
        "max_position_excess": -0.5,
        "work": 7.0,
        "lost": 2.0,
        "settling_time": 1.0,
        "samples_at_limits": 3.0,
    }
    assert {name: float(value) for name, value in found.items()} == pytest.approx(expected)


@pytest.mark.parametrize(
    ("base", "time"),
    [
        ([0.0, 0.0, 0.0], 0.0),
        ([1.0, 0.0, 1.0], np.inf),
        ([1.0, 0.05, 0.0], 0.5),
        ([0.0, 1.0, 0.0], 1.0),
        ([0.0, 0.0, np.nan], np.inf),
    ],
)
def test_when_a_run_settles(base: list[float], time: float) -> None:
    assert float(merits(hand(base))["settling_time"]) == time
