"""The command ``rpctl study`` as a user meets it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rpctl.arrays import Array
from rpctl.cli.app import app
from rpctl.cli.options import LoadOptions
from rpctl.cli.study import show_optimum
from tests.study.fake_rollouts import patch_rollouts

STUDY = """
[study]
count = 30
chunk = 15
worst = 2
duration = 1.0  # of the worst run, which the report simulates
[scatter]
"plant.delay" = { uniform = [0.0, 0.9] }
"plant.dropped" = { uniform = [0.0, 0.5] }
[optimize]
evaluations = 24
runs = 4
validation = 5
[optimize.parameters]
"dynamic.gain" = [1.0, 30.0]
"""


def run(*words: str) -> Any:
    return CliRunner().invoke(app, ["study", *words])


def error(numbers: Array, delay: Array, dropped: Array, gain: Array) -> Array:
    return np.asarray(delay + 0.1 * dropped + 1e-3 * (gain - 10.0) ** 2)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    patch_rollouts(monkeypatch, error, "dynamic.gain")
    path = tmp_path / "s.toml"
    path.write_text(STUDY)
    return str(path)


def test_a_study_is_run_written_and_told(file: str, tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    words = ["paper", file, "--home", "zero", "--workers", "1", "--no-html", "--out", out]
    shown = run(*words)
    assert shown.exit_code == 0, shown.output
    text = shown.stdout
    assert "paper: 30 runs, monte-carlo design of 2 parameters, seed 0" in text
    assert "success 100 % (95 % interval 88.4 to 100 %)   30 tracked" in text
    assert "what matters to base error, rms  rank correlation" in text
    assert max(map(len, text.split("\nworst by")[0].splitlines())) <= 100
    assert re.search(r"delay +0.9\d+ +0.9\d+ to 0.9\d+ +monotonic", text)
    assert text.index("delay  ") < text.index("share of samples lost")
    assert f"rpctl track paper --home zero --config {out}/worst-1.toml --out {out}/worst-1" in text
    assert {each.name for each in Path(out).iterdir()} >= {
        "runs.parquet", "study.json", "study.toml", "worst-1.toml", "worst-2.toml"}  # fmt: skip
    assert Path(out, "study.toml").read_text() == STUDY
    told = json.loads(run(*words, "--resume", "--json").stdout)
    assert told == json.loads(Path(out, "study.json").read_text())
    assert told["success"] == {"value": 1.0, "low": pytest.approx(0.025 ** (1 / 30)), "high": 1.0,
                               "thresholds": {}}  # fmt: skip
    assert told["sensitivities"][0]["ranking"] == ["plant.delay", "plant.dropped"]
    assert told["worst"][0]["config"] == f"{out}/worst-1.toml"
    refused = run(*words)
    assert refused.exit_code == 2
    assert "holds a study; add --resume" in refused.stderr


def test_settings_are_found_and_told(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    shown = run("paper", file, "--optimize", "--workers", "1", "--out", out)
    assert shown.exit_code == 0, shown.output
    assert "5 fresh runs" in shown.stdout
    assert "24 sets of settings were tried" in shown.stdout
    assert f"rpctl track paper --config {out}/optimized.toml --out {out}/optimized" in shown.stdout
    told = run("paper", file, "--optimize", "--workers", "1", "--out", out, "--resume", "--json")
    found = json.loads(told.stdout)
    assert found["settings"]["dynamic.gain"]["before"] == pytest.approx(6 / 11 * 0.8 / 0.051)
    change = found["validation"]["change"]
    assert ("\nbetter: " in shown.stdout) == (change["high"] < 0.0)
    found["validation"]["change"] = {"value": 1e-6, "low": -1e-6, "high": 2e-6}
    show_optimum(found, "rpctl track paper")
    told_so = capsys.readouterr().out
    assert "\nno clear difference: mean of base error, rms goes from" in told_so
    assert "use what was found: rpctl track paper --config" in told_so


def test_a_ctrl_c_tells_how_to_go_on(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(numbers: Array, delay: Array, dropped: Array, gain: Array) -> Array:
        if numbers[0] > 10:
            raise KeyboardInterrupt
        return error(numbers, delay, dropped, gain)

    patch_rollouts(monkeypatch, stopped, "dynamic.gain")
    words = ["paper", file, "--workers", "1", "--no-html", "--out", str(tmp_path / "out")]
    shown = run(*words)
    assert shown.exit_code == 130
    again = f"rpctl study paper {file} --out {tmp_path}/out --resume"
    assert again in shown.stderr.replace("\n", "")
    assert not Path(tmp_path, "out", "study.json").exists()
    patch_rollouts(monkeypatch, error, "dynamic.gain")
    assert run(*words, "--resume").exit_code == 0
    assert Path(tmp_path, "out", "study.json").exists()


def test_what_is_wrong_is_told_without_a_traceback(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text("[study]\ncuont = 3")
    good = tmp_path / "good.toml"
    good.write_text(STUDY)
    for words, text in (
        (["paper"], "no study file is given; `rpctl study ROBOT --template` prints one"),
        (["paper", str(path)], "study.cuont: setting 'cuont' is not known"),
        (["paper", str(tmp_path / "none.toml")], "none.toml"),
        (["paper", str(good), "--backend", "cobol"], "backend 'cobol' is not known"),
    ):
        shown = run(*words)
        assert shown.exit_code == 2
        assert text in shown.stderr
        assert "Traceback" not in shown.output


def test_load_options_are_told_as_they_were_given() -> None:
    assert LoadOptions().words() == []
    given = {"lock": ["arm_*=0.1", "x"], "density": 700.0, "xacro_args": ["a:=b"], "losses": True}
    assert LoadOptions(given).words() == [
        "--lock", "arm_*=0.1", "--lock", "x", "--density", "700.0", "--xacro-arg", "a:=b",
        "--no-losses"]  # fmt: skip
