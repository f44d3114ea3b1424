"""The benchmark: scenarios are what they say, figures those of the runs, verdicts fair."""

from __future__ import annotations

import csv
import json
import math
import multiprocessing as mp
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl import ReducedDynamics, Robot, UnifiedKinematic
from rpctl.cli.app import app
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.errors import UnknownNameError
from rpctl.reference.load import load_reference
from rpctl.study.cells import run_cells
from rpctl.study.compare import (
    LAW_PAIRS,
    PAPER,
    PROPOSED,
    SCENARIOS,
    Benchmark,
    Cell,
    Figures,
    LawPair,
    Row,
    Stopwatch,
    Verdict,
    controllers,
    figures,
    grid,
    proposed,
    verdicts,
)
from rpctl.study.executor import ProcessExecutor, SerialExecutor
from tests.robots import SET_A, platform, write

NOTHING = 1e-3  # m: what is left of the lateral error on a line

KANAYAMA = LawPair("kanayama", "paper")
LINEARIZATION = LawPair("feedback-linearization", "paper")


def test_scenarios_are_what_they_say(paper: Robot) -> None:
    reference = load_reference(paper, "eight")
    cases = {name: scenario.make(paper, reference) for name, scenario in SCENARIOS.items()}
    assert cases["nominal"].plant == rpctl.Plant()
    controller_model = cases["arm-mass"].plant.controller_model
    assert controller_model is not None
    masses = dict(zip(paper.model.names, (i.mass for i in paper.model.inertias), strict=True))
    for name, inertia in zip(
        controller_model.model.names, controller_model.model.inertias, strict=True
    ):
        share = 0.7 if name.startswith("arm_") else 1.0
        assert inertia.mass == pytest.approx(share * masses[name]), name
    assert cases["wheel-bias"].plant.tau_bias == {"wheel_left_joint": 0.05 * 40.0}
    assert cases["delay"].plant.delay == 0.02
    halved = cases["half-limits"].robot
    np.testing.assert_allclose(halved.effort_limits, 0.5 * paper.effort_limits)
    assert [joint.velocity for joint in halved.joints] == [j.velocity for j in paper.joints]


def test_halved_limits_still_hold_the_arm_up(tiago: Robot) -> None:
    """Half of arm_2's 39 N·m would not: it takes 30 at the worst place of the eight."""
    reference = load_reference(tiago, "eight")
    limits = SCENARIOS["half-limits"].make(tiago, reference).robot.effort_limits
    full, dynamics = tiago.effort_limits, ReducedDynamics(tiago)
    np.testing.assert_allclose(limits[:2], 0.5 * full[:2])
    for t in np.arange(0.0, 19.0, 0.5):
        q = tiago.configuration_at(np.zeros(3), reference(float(t)).joints)
        held = np.abs(dynamics.efforts(q, dynamics.bias(q, np.zeros(tiago.dof))))
        assert (limits - held >= 0.5 * (full - held) - 1e-9).all()
    assert dict(zip(tiago.actuators, limits, strict=True))["arm_2_joint"] > 30.0


def test_a_robot_without_arm_or_wheels_says_so(tmp_path: Path) -> None:
    bare, fixed = rpctl.load(write(tmp_path, platform(SET_A))), rpctl.load("panda")
    row = Benchmark(bare, 0.1)(Cell("arm-mass", "line", PAPER))
    assert (row.figures, row.failure) == (None, "platform has no arm")
    assert Benchmark(fixed, 0.1)(Cell("wheel-bias", "eight", PAPER)).failure == (
        "panda has no driven wheel"
    )
    pushed = SCENARIOS["wheel-bias"].make(bare, load_reference(bare, "line")).plant.tau_bias
    assert list(pushed.values()) == [1.0]
    found = Benchmark(bare, 0.1)(Cell("nominal", "line", proposed(bare))).figures
    assert found is not None
    assert found.rms_end_effector is found.peak_effort is found.rms_effort is None
    assert Benchmark(fixed, 0.1)(Cell("nominal", "eight", PROPOSED)).figures is not None


def test_controllers_by_name() -> None:
    assert set(controllers()) >= {pair for pair in LAW_PAIRS if pair.kinematic in KINEMATIC_LAWS}
    assert controllers(["unified"]) == [p for p in LAW_PAIRS if p.kinematic == "unified"]
    assert controllers(["kanayama", "paper"], "integral") == [
        LawPair("kanayama", "integral"),
        LawPair("paper", "integral"),
    ]
    assert controllers(["unified+bounded"], "paper") == [LawPair("unified", "bounded")]
    for name in ("papr", "paper+papr"):
        with pytest.raises(UnknownNameError, match="did you mean paper"):
            controllers([name])


def test_figures_are_those_of_the_run(paper: Robot) -> None:
    run = rpctl.track(paper, "circle", duration=0.3, initial_error=(0.1, 0.2, 0.0))
    found = figures(run, [1.0, 3.0] * 99 + [0.0, 50.0])
    base = np.hypot(run.log.e[:, 0], run.log.e[:, 1])
    assert found.rms_base == pytest.approx(math.sqrt(np.mean(base**2)))
    assert found.final_base == base[-1]
    assert found.final_lateral == abs(run.log.e[-1, 1])
    shares = np.abs(run.tau) / np.array(run.robot.effort_limits)
    assert found.peak_effort == pytest.approx(shares.max())
    assert found.rms_effort == pytest.approx(np.sqrt((shares**2).mean()))
    assert found.violations == ()
    assert found.outcome == "tracked"
    assert found.sample_time == 4.0
    assert 4.0 < found.sample_time_99 < 50.0


def test_a_timed_law_does_as_the_law_does(paper: Robot) -> None:
    watch = Stopwatch()
    laws = (UnifiedKinematic(), rpctl.IntegralDynamic())
    config = rpctl.Config(*laws)
    plain = rpctl.track(paper, "eight", config, duration=0.1, initial_error=(0.1, 0.1, 0.1))
    timed = rpctl.track(
        paper,
        "eight",
        duration=0.1,
        initial_error=(0.1, 0.1, 0.1),
        kinematic=watch.time_law(laws[0]),
        dynamic=watch.time_law(laws[1]),
    )
    np.testing.assert_array_equal(plain.tau, timed.tau)
    assert len(watch.seconds) == 2 * len(timed.t)
    assert min(watch.seconds) >= 0.0 < sum(watch.seconds)


def errors(rows: Sequence[Row]) -> list[tuple[float | None, str | None]]:
    return [(row.figures.rms_base if row.figures else None, row.failure) for row in rows]


@pytest.mark.slow
def test_processes_find_what_one_does(paper: Robot) -> None:
    cells = grid(["nominal", "delay"], ["spin"], [PAPER, LINEARIZATION])
    output: list[tuple[int, int]] = []
    alone = run_cells(Benchmark(paper, 0.05), cells, SerialExecutor())
    with ProcessExecutor(2) as two:
        shared = run_cells(Benchmark(paper, 0.05), cells, two, lambda *done: output.append(done))
    assert [row.cell for row in shared] == cells
    assert errors(shared) == errors(alone)
    assert output == [(k, len(cells)) for k in range(1, len(cells) + 1)]
    refused = [row for row in shared if row.failure]
    assert [row.cell.controller for row in refused] == [LINEARIZATION] * 2
    assert refused[0].failure is not None
    assert "turns on the spot" in refused[0].failure
    assert not mp.active_children()


def row(
    controller: LawPair,
    base: float,
    tip: float | None = 1.0,
    *broken: str,
    outcome: str = "tracked",
) -> Row:
    cell = Cell("nominal", "line", controller)
    figures = Figures(base, base, base, tip, tip, 0.5, 0.1, broken, 1e-5, 1e-4, outcome)
    return Row(cell, figures, None)


def test_verdicts() -> None:
    rows = [row(PAPER, 2.0), row(PROPOSED, 1.005), row(KANAYAMA, 1.0)]
    assert verdicts(rows, PROPOSED) == [
        Verdict("nominal", "line", "rms_base", 1.005, 2.0, 1.0, KANAYAMA),
        Verdict("nominal", "line", "rms_end_effector", 1.0, 1.0, 1.0, PAPER),
    ]
    assert verdicts(rows, PROPOSED)[0].won
    assert not verdicts(rows, PROPOSED)[0].worse_than_paper
    worse = verdicts([row(PAPER, 1.0), row(PROPOSED, 1.1)], PROPOSED)[0]
    assert (worse.won, worse.worse_than_paper) == (False, True)


def test_who_breaks_a_limit_wins_nothing() -> None:
    base, _ = verdicts([row(PAPER, 1.0, 1.0, "wheel effort"), row(PROPOSED, 3.0)], PROPOSED)
    assert (base.won, base.worse_than_paper, base.paper) == (True, False, None)
    base, _ = verdicts([row(PAPER, 3.0), row(PROPOSED, 1.0, 1.0, "wheel effort")], PROPOSED)
    assert (base.won, base.worse_than_paper, base.ours) == (False, True, None)
    assert verdicts([row(PAPER, 1.0)], PROPOSED) == []
    assert len(verdicts([row(PAPER, 1.0, None), row(PROPOSED, 1.0, None)], PROPOSED)) == 1


@pytest.mark.parametrize("name", ["late", "stuck"])
def test_who_does_not_track_wins_nothing(name: str) -> None:
    """A law that slows down to keep limits is late, and its error counts."""
    base, _ = verdicts([row(PAPER, 1.0, outcome=name), row(PROPOSED, 3.0)], PROPOSED)
    assert base.paper == (1.0 if name in ("tracked", "late") else None)
    assert base.won == (base.paper is None)


def compare(*words: str) -> Any:
    return CliRunner().invoke(app, ["compare", "paper", "--jobs", "1", *words])


def test_compare_writes_a_table_and_a_picture(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "folder"
    words = ["--references", "spin", "--scenarios", "delay", "--duration", "0.1"]
    words += ["--laws", "paper,end-effector,feedback-linearization", "--out", str(out)]
    result = compare(*words, "--json")
    assert result.exit_code == 0, result.output
    output = json.loads(result.stdout)
    assert json.loads((out / "compare.json").read_text()) == output
    assert sorted(path.name for path in out.iterdir()) == [
        "compare.csv", "compare.json", "compare.pdf", "compare.png",
    ]  # fmt: skip
    assert output["controllers"] == [str(PAPER), str(PROPOSED), str(LINEARIZATION)]
    assert len(output["rows"]) == 3
    assert output["rows"][0]["rms_base"] > 0.1
    assert output["rows"][2]["rms_base"] is None
    assert {verdict["reference"] for verdict in output["verdicts"]} == {"spin"}
    table = list(csv.DictReader((out / "compare.csv").read_text().splitlines()))
    assert [each["reference"] for each in table] == ["spin"] * 3
    assert float(table[0]["rms_base"]) == output["rows"][0]["rms_base"]
    assert "turns on the spot" in table[2]["failure"]
    assert (out / "compare.png").read_bytes().startswith(b"\x89PNG")
    assert (out / "compare.pdf").read_bytes().startswith(b"%PDF")
    text = compare(*words).stdout
    for word in ("delay: 20 ms", "end-effector+integral", "did not run", "where paper+paper works"):
        assert word in text


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("--laws", "papr"), "did you mean paper"),
        (("--dynamic", "x"), "dynamic law 'x' is not known"),
        (("--references", "lines"), "did you mean line"),
        (("--scenarios", "dela"), "did you mean delay"),
        (("--initial-error", "1"), "give three numbers"),
        (("--references", "none.csv"), "none.csv: error: No such file"),
        (("--duration", "-1"), "duration is -1; give a positive number"),
    ],
)
def test_wrong_input_exits_2(words: tuple[str, ...], output: str, tmp_path: Path) -> None:
    result = compare(*words, "--out", str(tmp_path / "out"))
    assert result.exit_code == 2
    assert output in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_no_process_is_left(ending: signal.Signals, tmp_path: Path) -> None:
    """A Ctrl-C reaches all processes, and exits 130; a kill reaches the first one only."""
    out = tmp_path / "out"
    words = ["-m", "rpctl", "compare", "paper", "--duration", "60", "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, *words, "--references", "line", "--out", str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        group = os.getpgid(process.pid)
        deadline = time.monotonic() + 60.0
        while members(group) < 4 and time.monotonic() < deadline:  # a tracker and two workers
            time.sleep(0.2)
        if ending == signal.SIGINT:
            os.killpg(group, ending)
        else:
            process.kill()
        _, err = process.communicate(timeout=120)
    finally:
        process.kill()
    if ending == signal.SIGINT:
        assert (process.returncode, err.strip()) == (130, "interrupted")
    assert not out.exists()
    deadline = time.monotonic() + 20.0
    while members(group) and time.monotonic() < deadline:  # the tracker sees itself left alone
        time.sleep(0.1)
    assert members(group) == 0


def members(group: int) -> int:
    """Return how many processes of a group run."""
    ps = ["ps", "-eo", "pgid=,stat="]
    listed = subprocess.run(ps, capture_output=True, text=True, check=True).stdout.splitlines()
    found = (line.split() for line in listed)
    return sum(int(pgid) == group and not stat.startswith("Z") for pgid, stat in found)


def test_its_runs_end_with_whole_control_periods(paper: Robot) -> None:
    assert Benchmark(paper, 0.0215).duration == pytest.approx(0.02)
    assert Benchmark(paper).duration is None


@pytest.mark.thorough
def test_what_the_table_of_the_readme_claims(paper: Robot) -> None:
    """On the cells of the paper's robot that tell most."""
    cells = grid(["nominal", "wheel-bias"], ["line", "spin", "circle"], [PAPER, PROPOSED])
    rows = run_cells(Benchmark(paper, 12.0), cells, SerialExecutor())
    for row in rows:
        if row.cell.controller == PROPOSED:
            assert row.figures is not None
            assert not row.figures.violations
            assert row.cell.reference != "line" or row.figures.final_lateral < NOTHING
    found = verdicts(rows, PROPOSED)
    assert len(found) == 12
    assert [verdict for verdict in found if verdict.worse_than_paper] == []
