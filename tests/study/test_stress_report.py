"""A battery is the same in one process or many, stopped or not; its worst case is a file's run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from rpctl.errors import RpctlError
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.summary import summarize
from rpctl.study import cells
from rpctl.study.cells import CellRunner, References, figures_of, largest_tilt
from rpctl.study.stress_battery import JOURNAL_FILE, STRESSES, StressCell, run_battery
from rpctl.study.stress_report import StressReport, report_of
from tests.study.stress_samples import GOOD, battery, contents, patch_runs

TOLERANCE = 0.01


def test_a_battery_that_was_stopped_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    found = battery(combinations=3)
    patch_runs(monkeypatch)
    expected = run_battery(found, whole)
    first = patch_runs(monkeypatch, stop_after=17)
    with pytest.raises(KeyboardInterrupt):
        run_battery(found, stopped)
    journal = stopped / JOURNAL_FILE
    torn = journal.read_bytes()[:-25]  # as of a process that was killed while it wrote
    journal.write_bytes(torn)
    rest = patch_runs(monkeypatch)
    shown: list[tuple[int, int]] = []
    report = run_battery(found, stopped, None, lambda *each: shown.append(each), resume=True)
    assert report == expected
    assert (len(first), rest[0]) == (17, first[-1])
    assert len(rest) == len(found.cells) - 16
    assert shown[0] == (16, len(found.cells))
    assert shown[-1] == (len(found.cells), len(found.cells))
    assert contents(whole) == contents(stopped)


def test_a_larger_battery_takes_up_a_smaller_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch_runs(monkeypatch)
    small, large = battery("delay", laws=1), battery("delay", "payload", laws=2)
    run_battery(small, tmp_path)
    ran = patch_runs(monkeypatch)
    run_battery(large, tmp_path, resume=True)
    run_battery(small, tmp_path, resume=True)  # what it does not ask for is kept
    run_battery(large, tmp_path, resume=True)
    assert len(ran) == len(large.cells) - len(small.cells)


def test_what_a_folder_holds_is_not_mixed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    patch_runs(monkeypatch)
    found = battery("delay", laws=1)
    run_battery(found, tmp_path)
    with pytest.raises(RpctlError, match="add --resume to continue them, or give another --out"):
        run_battery(found, tmp_path)
    other = replace(found, run=replace(found.run, duration=3.0))
    with pytest.raises(RpctlError, match=r"something else: run.duration: 2.0 there, 3.0 here"):
        run_battery(other, tmp_path, resume=True)


def report(**verdicts: str) -> StressReport:
    """Return a report whose payloads (p0, p05, ...) ended as they are given, others well."""
    found = battery("payload", laws=1)
    names = {"p0": "", "p05": "payload=0.5", "p1": "payload=1.0", "p2": "payload=2.0",
             "p5": "payload=5.0"}  # fmt: skip
    outcomes = {names[key]: word for key, word in verdicts.items()}
    figures = {}
    for cell in found.cells:
        word = outcomes.get(cell.key.split(" ")[2], "tracked")
        figures[cell.key] = replace(GOOD, outcome=word)
    return report_of(found, figures, TOLERANCE)


@pytest.mark.parametrize(
    ("verdicts", "passes", "tracks"),
    [
        ({}, (0.0, 5.0), (0.0, 5.0)),
        ({"p2": "late"}, (0.0, 1.0), (0.0, 5.0)),
        ({"p1": "late", "p2": "stuck"}, (0.0, 0.5), (0.0, 1.0)),
        ({"p1": "refused"}, (0.0, 0.5), (0.0, 0.5)),
        ({"p0": "late"}, None, (0.0, 5.0)),
        ({"p0": "diverging"}, None, None),
    ],
)
def test_how_far_a_law_holds(
    verdicts: dict[str, str],
    passes: tuple[float, float] | None,
    tracks: tuple[float, float] | None,
) -> None:
    found = report(**verdicts)
    (reach,) = found.reaches()
    assert (reach["passes"], reach["tracks"]) == (passes, tracks)
    assert (found.nominal_failure is not None) == (tracks is None)


def test_a_ladder_with_two_ends_holds_on_both_sides() -> None:
    found = battery("radius", laws=1)
    figures = {cell.key: GOOD for cell in found.cells}
    figures[next(c.key for c in found.cells if "-2.0" in c.key)] = replace(GOOD, outcome="late")
    (reach,) = report_of(found, figures, TOLERANCE).reaches()
    assert reach["passes"] == (-1.0, 3.0)
    assert STRESSES["radius"].text(3.0) == "+3"


def test_the_worst_is_by_its_verdict_first() -> None:
    found = report(p1="stuck", p5="refused")
    far = next(row for row in found.rows if row.cell.levels == (("payload", 2.0),))
    rows = [
        replace(row, figures=replace(row.figures, late_base=9.0)) if row is far else row
        for row in found.rows
    ]
    (worst,) = replace(found, rows=tuple(rows)).worst()
    assert worst.cell.words == "payload 1 kg"
    with pytest.raises(RpctlError, match="none of the runs could start: on its way"):
        report(p0="refused", p05="refused", p1="refused", p2="refused", p5="refused")


@dataclass(frozen=True)
class Changed:
    """A cell with another configuration."""

    cell: StressCell
    run: RunSettings | None = None
    tau: float = 0.0

    def config(self, references: References) -> Config:
        """Return it."""
        config = self.cell.config(references)
        plant = replace(config.plant, tau_bias={"*": self.tau})
        return replace(config, run=self.run or config.run, plant=plant)


def test_a_run_that_cannot_be_made_says_why() -> None:
    found = battery("delay", laws=1, quick=True)
    runner, cell = CellRunner(References(found.robot)), found.cells[0]
    refused = runner(Changed(cell, RunSettings("no-such-reference")))
    assert refused.outcome == "refused"
    assert "no-such-reference" in refused.sentence
    ended = runner(Changed(cell, tau=1e9))
    assert (ended.outcome, ended.late_base) == ("ended", None)
    assert ended.time < 2.0
    assert "diverged" in ended.sentence


def test_wheels_that_hang_are_told_once_a_ladder() -> None:
    found = battery("radius", "payload", laws=2)
    low = {c.key for c in found.cells if dict(c.levels).get("radius", 0.0) < 0.0}
    figures = {c.key: replace(GOOD, hanging_wheels=("a", "b") if c.key in low else ())
               for c in found.cells}  # fmt: skip
    report = report_of(found, figures, TOLERANCE)
    (sentence,) = report.hanging("rolling")
    assert sentence.startswith(
        "radius -3, -2, -1 %: a, b carry no load from the start: the support"
    )
    assert report.to_dict()["hanging"] == {"rolling": [sentence]}
    always = {key: replace(GOOD, hanging_wheels=("a",)) for key in figures}
    (sentence,) = report_of(found, always, TOLERANCE).hanging("rolling")
    assert sentence.startswith("nothing stressed: a carry no load: the other")
    assert report_of(found, dict.fromkeys(figures, GOOD), TOLERANCE).hanging("rolling") == []


def test_a_robot_leans_by_the_turn_of_its_upright() -> None:
    """Turned about the vertical it has not leant; about any other axis by the angle."""
    yaw, pitch = 1.9, 0.3
    turned = pin.Quaternion(pin.utils.rpyToMatrix(0.0, 0.0, yaw)).coeffs()
    leant = pin.Quaternion(pin.utils.rpyToMatrix(0.0, pitch, yaw)).coeffs()
    poses = np.zeros((3, 7))
    poses[:, 3:] = [np.array([0.0, 0.0, 0.0, 1.0]), turned, leant]
    assert largest_tilt(poses[:2]) == pytest.approx(0.0, abs=1e-7)
    assert largest_tilt(poses) == pytest.approx(pitch)
    upright = pin.utils.rpyToMatrix(0.5 * np.pi, 0.0, 0.0)  # of a root link whose y axis is up
    poses[0, 3:] = pin.Quaternion(upright).coeffs()
    poses[1, 3:] = pin.Quaternion(pin.utils.rpyToMatrix(0.0, 0.0, yaw) @ upright).coeffs()
    assert largest_tilt(poses[:2]) == pytest.approx(0.0, abs=1e-7)
    assert largest_tilt(np.empty((3, 0))) == 0.0


def test_what_a_plant_shows_is_not_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    found = battery("delay", laws=1, quick=True)
    run = simulate(found.robot, found.cells[0].config(References(found.robot)))
    summary = summarize(run)
    ground = replace(summary.ground, would_slip=True, would_tip=True)
    monkeypatch.setattr(cells, "summarize", lambda run: replace(summary, ground=ground))
    for kind, slips, tips in (
        ("rolling", True, True),
        ("slipping", False, True),
        ("contact", False, False),
    ):
        plant = replace(run.config.plant, kind=kind)
        figures = figures_of(replace(run, config=replace(run.config, plant=plant)))
        assert (figures.would_slip, figures.would_tip) == (slips, tips)
    half = len(run.t) // 2
    late = np.hypot(run.log.e[half:, 0], run.log.e[half:, 1])
    assert figures.late_base == pytest.approx(np.sqrt(np.mean(late**2)), rel=1e-12)
    away = np.linalg.norm(run.log.ee - run.log.ee_ref, axis=1)[half:]
    assert figures.late_end_effector == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-12)
