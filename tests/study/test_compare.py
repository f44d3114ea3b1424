"""The benchmark: scenarios are what they say, figures those of the runs, verdicts fair."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl import Robot, UnifiedKinematic
from rpctl.cli.app import app
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.errors import UnknownNameError
from rpctl.reference.load import load_reference
from rpctl.reference.named import reference_by_name
from rpctl.simulation.config import Config, RunSettings
from rpctl.study.cells import CellRunner, Figures, References, Row, TimedLaw, run_cells
from rpctl.study.compare import (
    LAW_PAIRS,
    PAPER,
    PROPOSED,
    SCENARIOS,
    CompareCell,
    CompareRow,
    LawPair,
    Verdict,
    controllers,
    grid,
    proposed,
    verdicts,
)
from rpctl.study.executor import Executor
from tests.grids import cells
from tests.robots import SET_A, platform, write

NOTHING = 1e-3  # m: what is left of the lateral error on a line

KANAYAMA = LawPair("kanayama", "paper")
LINEARIZATION = LawPair("feedback-linearization", "paper")


LIFT = """<link name="load"><inertial><mass value="2"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="load"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 {up}"/>
  <limit lower="-0.2" upper="0.4" effort="{effort}" velocity="1"/></joint>"""
WHEEL = '<axis xyz="0 1 0"/>'


def changed(name: str, robot: Robot, reference: str = "eight") -> Config:
    """Return the configuration of a scenario."""
    return SCENARIOS[name].change(Config(), robot, load_reference(robot, reference))


def ran(robot: Robot, scenario: str, reference: str, law: LawPair) -> Figures:
    (cell,) = grid(robot, [scenario], [reference], [law], RunSettings(duration=0.1))
    return CellRunner(References(robot), timed=True)(cell)


def test_scenarios_are_what_they_say(paper: Robot) -> None:
    assert changed("nominal", paper) == Config()
    known = changed("arm-mass", paper).plant.controller_model
    assert known is not None
    for name, own, other in zip(
        paper.model.names, paper.model.inertias, known.model.inertias, strict=True
    ):
        share = 0.7 if name.startswith("arm_") else 1.0
        assert other.mass == pytest.approx(share * own.mass), name
    assert changed("wheel-bias", paper).plant.tau_bias == {"wheel_left_joint": 0.05 * 40.0}
    assert changed("delay", paper).plant.delay == 0.02
    halved = changed("half-limits", paper).limits.apply(paper)
    np.testing.assert_allclose(halved.effort_limits, 0.5 * paper.effort_limits)
    assert [joint.velocity for joint in halved.joints] == [j.velocity for j in paper.joints]


@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize(("effort", "left"), [(50.0, 25.0 + 0.5 * 2 * 9.81), (10.0, 10.0)])
def test_half_of_what_holding_leaves(tmp_path: Path, up: int, effort: float, left: float) -> None:
    """A lift that bears 19.62 N, pushing or pulling; wheels hold nothing. One too weak stays."""
    text = platform(SET_A, extra=LIFT.format(up=up, effort=effort))
    text = text.replace(WHEEL, f'{WHEEL}<limit effort="8" velocity="9"/>')
    robot = rpctl.load(write(tmp_path, text))
    line = reference_by_name(robot, "line")
    halved = SCENARIOS["half-limits"].change(Config(), robot, line).limits.apply(robot)
    limits = dict(zip(robot.actuators, halved.effort_limits, strict=True))
    assert limits == pytest.approx({"left_joint": 4.0, "right_joint": 4.0, "lift": left})


def test_a_robot_without_arm_or_wheels_says_so(tmp_path: Path) -> None:
    bare, fixed = rpctl.load(write(tmp_path, platform(SET_A))), rpctl.load("panda")
    assert ran(bare, "arm-mass", "line", PAPER).failure == "platform has no arm"
    assert ran(fixed, "wheel-bias", "eight", PAPER).failure == "panda has no driven wheel"
    assert list(changed("wheel-bias", bare, "line").plant.tau_bias.values()) == [1.0]
    found = ran(bare, "nominal", "line", proposed(bare))
    assert found.failure is None
    assert found.rms_end_effector is found.peak_effort is found.rms_effort is None
    assert ran(fixed, "nominal", "eight", PROPOSED).failure is None


def test_controllers_by_name() -> None:
    everything = controllers()
    assert {pair.kinematic for pair in everything} == set(KINEMATIC_LAWS)
    assert everything[: len(LAW_PAIRS)] == list(LAW_PAIRS)
    assert {pair.dynamic for pair in everything[len(LAW_PAIRS) :]} <= {"bounded"}
    asked = ["kanayama+integral", "paper+bounded", "paper", "paper"]
    assert list(map(str, controllers(asked))) == [
        "paper+paper", "kanayama+integral", "paper+bounded"]  # fmt: skip
    assert controllers(["unified"]) == [p for p in LAW_PAIRS if p.kinematic == "unified"]
    assert controllers(["kanayama", "paper"], "integral") == [
        LawPair("kanayama", "integral"),
        LawPair("paper", "integral"),
    ]
    assert controllers(["unified+bounded"], "paper") == [LawPair("unified", "bounded")]
    for name in ("papr", "paper+papr"):
        with pytest.raises(UnknownNameError, match="did you mean paper"):
            controllers([name])


def test_a_robot_that_leans_gets_laws_that_balance_it() -> None:
    robot = rpctl.load("balancer")
    assert list(map(str, controllers(robot=robot))) == ["unified+balance", "horizon+balance"]
    assert controllers(["kanayama"], robot=robot) == [LawPair("kanayama", "balance")]
    assert controllers(["paper+paper"], robot=robot) == [PAPER]  # and its row says why not


@pytest.mark.slow
def test_what_is_proposed_for_a_robot_that_leans_runs() -> None:
    robot = rpctl.load("balancer")
    found = ran(robot, "nominal", "line", proposed(robot))
    assert found.failure is None
    assert found.peak_effort is not None


def test_a_timed_law_does_as_the_law_does(paper: Robot) -> None:
    seconds: list[float] = []
    laws = (UnifiedKinematic(), rpctl.IntegralDynamic())
    config = rpctl.Config(*laws)
    plain = rpctl.track(paper, "eight", config, duration=0.1, initial_error=(0.1, 0.1, 0.1))
    timed = rpctl.track(
        paper,
        "eight",
        duration=0.1,
        initial_error=(0.1, 0.1, 0.1),
        kinematic=TimedLaw(laws[0], seconds),
        dynamic=TimedLaw(laws[1], seconds),
    )
    np.testing.assert_array_equal(plain.tau, timed.tau)
    assert len(seconds) == 2 * len(timed.t)
    assert min(seconds) >= 0.0 < sum(seconds)


def row(
    controller: LawPair,
    base: float,
    tip: float | None = 1.0,
    *broken: str,
    outcome: str = "tracked",
) -> CompareRow:
    cell = CompareCell("nominal", controller, RunSettings("line"))
    figures = Figures(outcome, rms_base=base, rms_end_effector=tip, violations=broken)
    return Row(cell, figures)


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
    return CliRunner().invoke(app, ["compare", "paper", "--workers", "1", *words])


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
    assert "did not run" in text and "where paper+paper works" in text


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


@pytest.mark.parametrize("ending", cells([signal.SIGINT, signal.SIGKILL], slow=[signal.SIGKILL]))
def test_no_process_is_left(ending: signal.Signals, tmp_path: Path) -> None:
    """A Ctrl-C reaches all processes, and exits 130; a kill reaches the first one only."""
    out = tmp_path / "out"
    words = ["-m", "rpctl", "compare", "paper", "--duration", "15", "--workers", "2"]
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
    (cell,) = grid(paper, ["nominal"], ["line"], [PAPER], RunSettings(duration=0.0215))
    assert cell.run.duration == pytest.approx(0.02)


@pytest.mark.thorough
def test_what_the_table_of_the_readme_claims(paper: Robot) -> None:
    """On the cells of the paper's robot that tell most."""
    run = RunSettings(duration=12.0, initial_error=(0.1, -0.1, 0.1))
    names = ["line", "spin", "circle"]
    cells = grid(paper, ["nominal", "wheel-bias"], names, [PAPER, PROPOSED], run)
    rows = run_cells(CellRunner(References(paper)), cells, Executor())
    for row in rows:
        if row.cell.controller == PROPOSED:
            assert not row.figures.violations
            assert row.figures.final_lateral is not None
            assert row.cell.run.reference != "line" or row.figures.final_lateral < NOTHING
    found = verdicts(rows, PROPOSED)
    assert len(found) == 12
    assert [verdict for verdict in found if verdict.worse_than_paper] == []
