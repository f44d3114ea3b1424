"""The command ``rpctl stress`` as a user meets it."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.cli.stress import BatteryOptions
from rpctl.errors import UnknownNameError
from rpctl.study.cells import CellRunner, Figures
from rpctl.study.stress_battery import JOURNAL_FILE, StressCell
from tests.grids import cells
from tests.study.stress_samples import GOOD, contents, patch_runs

FILES = ("stress.json", "stress.csv", "envelope.png", "stress.html", "worst-1.toml", JOURNAL_FILE)


def run(*words: str) -> Any:
    return CliRunner().invoke(app, ["stress", *words])


def test_a_battery_is_run_written_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    patch_runs(monkeypatch)
    out = tmp_path / "out"
    words = ["paper", "--home", "zero", "--plants", "rolling", "--laws", "default,paper+paper"]
    words += ["--stresses", "payload,friction,radius,losses", "--workers", "1", "--out", str(out)]
    shown = run(*words)
    assert shown.exit_code in (0, 1), shown.output
    told = json.loads((out / "stress.json").read_text())
    text = shown.stdout
    table = text[: text.index("replay one")]
    assert max(map(len, table.splitlines())) <= 100
    assert "paper: 42 runs of 10 s on eight, seed 0" in text
    assert re.search(r"payload kg +0 +0.5 +1 +2 +5", text)
    assert re.search(r"radius % +-3 +-2 +-1 +0 +\+1 +\+2 +\+3", text)
    assert "left out: friction (its wheels cannot slip), losses (its file has no" in text
    assert f"rpctl track paper --home zero --config {out}/worst-1.toml --out {out}/worst-1" in text
    assert f"rpctl view {out}/worst-1" in text
    cells = told["cells"]
    marks = [sum(cell["verdict"] == name for cell in cells if len(cell["levels"]) < 2)
             for name in ("pass", "degrade", "fail")]  # fmt: skip
    assert sum(marks) == 2 * (1 + 4 + 6)
    ladders = table[: table.index("two at once")]
    assert sum(ladders.count(sign) for sign in "✓~✗") == 2 * (5 + 7)  # the nominal one in both
    with (out / "stress.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [cell["verdict"] for cell in cells]
    double = next(row for row in rows if row["and_stress"])
    assert (double["stress"], float(double["level"])) == next(
        iter(next(c for c in cells if len(c["levels"]) > 1)["levels"].items())
    )
    assert (out / "envelope.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "stress.html").read_text()
    assert f"rpctl track paper --home zero --config {out}/worst-2.toml --out {out}/worst-2" in page
    again = run(*words, "--resume", "--json")
    assert json.loads(again.stdout) == told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--plants", "rollin"], "plant 'rollin' is not known; did you mean rolling?"),
        (["--laws", "pid"], "kinematic law 'pid' is not known"),
        (["--laws", "unified+pid"], "dynamic law 'pid' is not known"),
        (["--stresses", "payloud"], "stress 'payloud' is not known; did you mean payload?"),
        (["--duration", "0"], "duration"),
        (["--tolerance", "-1"], "--tolerance"),
        (["--reference", "ate"], "ate"),
    ],
)
def test_bad_arguments_are_refused(words: list[str], message: str, tmp_path: Path) -> None:
    shown = run("paper", *words, "--workers", "1", "--out", str(tmp_path / "out"))
    assert shown.exit_code == 2
    assert message in shown.stderr
    assert "Traceback" not in shown.output
    assert not (tmp_path / "out" / "stress.json").exists()


@pytest.mark.parametrize(
    ("law", "outcome", "code"),
    cells(
        [
            ("unified", "stuck", 1),
            ("paper", "stuck", 0),
            ("unified", "late", 0),
            ("unified", "refused", 1),
        ],
        [("paper", "stuck", 0), ("unified", "refused", 1)],
    ),
)
def test_it_ends_with_1_if_the_first_law_fails_unstressed(
    law: str, outcome: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(runner: CellRunner, cell: StressCell) -> Figures:
        bad = cell.law.kinematic == law and not cell.levels
        return Figures(outcome, "it stands", 1.0, late_base=1.0) if bad else GOOD

    monkeypatch.setattr(CellRunner, "__call__", found)
    words = ["--plants", "rolling", "--stresses", "delay", "--workers", "1", "--quick"]
    shown = run("paper", *words, "--out", str(tmp_path))
    assert shown.exit_code == code
    assert ("rolling unified+integral nothing stressed: " in shown.stdout) == (code == 1)


def test_the_choice_of_a_battery() -> None:
    robot = rpctl.load("paper")
    quick = BatteryOptions(quick=True).battery(robot)
    assert (quick.plants, len(quick.laws), quick.combinations) == (("rolling",), 2, 2)
    assert max(len(stress.levels) for stress in quick.stresses) == 3
    named = BatteryOptions(laws="paper+paper,default", stresses="delay", combinations=0, quick=True)
    assert list(map(str, named.battery(robot).laws)) == ["paper+paper", "unified+integral"]
    assert [stress.levels for stress in named.battery(robot).stresses] == [(0.0, 50.0)]
    assert BatteryOptions().battery(robot).combinations == 10
    with pytest.raises(UnknownNameError):
        BatteryOptions(plants="ice").battery(robot)


@pytest.mark.slow
def test_a_ctrl_c_tells_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["paper", "--stresses", "payload,delay", "--combinations", "1", "--seed", "3",
             "--tolerance", "0.02", "--quick", "--workers", "1"]  # fmt: skip
    patch_runs(monkeypatch)
    run(*words, "--out", str(tmp_path / "whole"))
    patch_runs(monkeypatch, stop_after=3)
    out = tmp_path / "out"
    shown = run(*words, "--out", str(out))
    assert shown.exit_code == 130
    again = (
        "rpctl stress paper --stresses payload,delay --combinations 1 --seed 3 --quick "
        f"--tolerance 0.02 --out {out} --resume"
    )
    assert again in shown.stderr
    assert not (out / "stress.json").exists()
    ran = patch_runs(monkeypatch)
    run(*again.split()[2:], "--workers", "1")
    assert len(ran) == 2 * 4 - 3
    found, wanted = contents(out, FILES), contents(tmp_path / "whole", FILES)
    where = str(tmp_path / "whole").encode(), str(out).encode()  # in the page's commands
    assert found == {name: data.replace(*where) for name, data in wanted.items()}


@pytest.mark.slow
def test_a_worst_case_is_replayed_by_its_file(tmp_path: Path) -> None:
    words = ["--plants", "rolling", "--stresses", "payload,slope", "--laws", "paper+paper"]
    words += ["--quick"]
    more = ["--duration", "1", "--combinations", "1", "--workers", "1", "--out", str(tmp_path)]
    shown = run("paper", *words, *more)
    line = next(line for line in shown.stdout.splitlines() if "worst-1.toml --out" in line)
    replay = line.partition(";")[0].split()
    assert replay[:2] == ["rpctl", "track"]
    CliRunner().invoke(app, [*replay[1:], "--samples", "0"])
    found = json.loads((tmp_path / "worst-1" / "summary.json").read_text())
    told = json.loads((tmp_path / "stress.json").read_text())["cells"]
    worst = max(told, key=lambda c: (c["verdict"] == "fail", c["end_effector_error"]))
    assert found["outcome"] == worst["outcome"]
    log = rpctl.Run.load(tmp_path / "worst-1" / "run.npz").log
    late = slice(len(log.t) // 2, None)
    squares = (log.ee - log.ee_ref)[late] ** 2
    assert float(squares.sum(axis=1).mean() ** 0.5) == pytest.approx(
        worst["end_effector_error"], rel=1e-12
    )
