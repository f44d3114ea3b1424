"""The command line as a user meets it: outputs, exit codes, messages."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rpctl import Plant, Run, summarize
from rpctl.cli.app import COMMANDS, app, load_command
from rpctl.cli.options import LOADED
from rpctl.cli.track_options import ResultOptions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.simulation.config import Config
from rpctl.view.film import BROWSER_NAMES
from rpctl.view.run_folder import RunFolder
from tests.grids import cells
from tests.robots import SET_A, platform, write

runner = CliRunner()


def run(*words: str) -> tuple[int, str, str]:
    result = runner.invoke(app, words)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def run_json(*words: str, code: int = 0) -> Any:
    exit_code, out, _ = run(*words, "--json")
    assert exit_code == code
    return json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def test_inspect_tells_what_tiago_is() -> None:
    output = run_json("inspect", "tiago")
    assert output["name"] == "tiago"
    assert output["dof"] == 12
    assert output["mass"] == pytest.approx(65.894, abs=1e-3)
    assert output["drive"]["type"] == "differential"
    assert [w["joint"] for w in output["drive"]["wheels"]] == output["actuators"][:2]
    assert [w["radius"] for w in output["drive"]["wheels"]] == [0.0985, 0.0985]
    assert output["drive"]["track"] == pytest.approx(0.4044)
    assert output["quasi_velocities"][:2] == ["v", "omega"]
    assert {"severity", "line", "message"} == output["findings"][0].keys()
    code, out, _ = run("inspect", "tiago")
    assert code == 0
    for word in ("differential", "0.0985", "0.4044", "65.89", "torso_lift_joint", "prismatic"):
        assert word in out


def test_inspect_locks() -> None:
    output = run_json("inspect", "tiago", "--lock", "head_*", "--lock", "torso_lift_joint=0.2")
    assert output["dof"] == 9
    assert output["locked"]["torso_lift_joint"] == 0.2


def test_limits_that_are_not_there_are_null(tmp_path: Path) -> None:
    output = run_json("inspect", str(write(tmp_path, platform(SET_A))))
    assert output["drive"]["wheels"][0]["effort"] is None


def test_strict_takes_warnings_as_errors(tmp_path: Path) -> None:
    path = write(tmp_path, platform(SET_A).replace('xyz="0 1 0"', 'xyz="0 2 0"', 1))
    assert run_json("inspect", str(path))["findings"][0]["severity"] == "warning"
    for command in ("inspect", "verify", "track"):
        code, out, err = run(command, str(path), "--strict")
        assert (code, out) == (2, "")
        assert err.startswith(f"{path}:") and ": error: axis of joint" in err


def test_density_estimates_what_the_file_lacks(tmp_path: Path) -> None:
    text = platform(SET_A)
    wheel = text[text.index('<link name="left_wheel">') : text.index("<collision>")]
    path = write(tmp_path, text.replace(wheel, '<link name="left_wheel">', 1))
    code, _, err = run("inspect", str(path))
    assert code == 2
    assert 'link "left_wheel" has no <inertial>' in err
    assert "--density KG_PER_M3" in err
    output = run_json("inspect", str(path), "--density", "1000")
    assert output["estimated_links"] == ["left_wheel"]
    assert output["mass"] == pytest.approx(30 + 1 + 1000 * 0.04 * math.pi * 0.15**2)
    assert "estimated" in run("inspect", str(path), "--density", "1000")[1]
    assert run_json("verify", str(path), "--density", "1000", "--samples", "2")["passed"]
    code, _, err = run("verify", str(path), "--density", "-1")
    assert (code, err.strip()) == (2, "density is -1; give kg/m3, as 1000 for water")


def test_verify_tells_each_check() -> None:
    output = run_json("verify", "paper", "--samples", "3", "--seed", "5")
    assert (output["passed"], output["samples"], output["seed"]) == (True, 3, 5)
    assert all(check["passed"] for check in output["checks"])
    code, out, _ = run("verify", "paper", "--samples", "2")
    assert code == 0
    assert "verified" in out


def test_verify_fails_with_1(monkeypatch: pytest.MonkeyPatch) -> None:
    inertia = ReducedDynamics.inertia
    monkeypatch.setattr(ReducedDynamics, "inertia", lambda self, q: 1.001 * inertia(self, q))
    output = run_json("verify", "paper", "--samples", "1", code=1)
    assert not output["passed"]
    code, out, _ = run("verify", "paper", "--samples", "1")
    assert code == 1
    assert "not verified" in out


def test_track_writes_everything(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "run"
    words = ("track", "paper", "--duration", "0.5", "--initial-error", "0.1,-0.1,0.1")
    output = run_json(*words, "--out", str(out))
    assert sorted(p.name for p in out.iterdir()) == [
        "report.html", "run.npz", "summary.json", "tracking.png",
    ]  # fmt: skip
    assert json.loads((out / "summary.json").read_text()) == output
    assert output["report"] == str(out / "report.html")
    assert output["limits_violated"] == []
    for key in (
        "rms_base_error", "final_base_error", "final_lateral_error", "rms_end_effector_error",
        "final_end_effector_error", "max_effort_ratio", "wall_time", "realtime_factor",
    ):  # fmt: skip
        assert isinstance(output[key], float), key


@pytest.mark.slow
def test_track_takes_a_table_and_names_the_folder_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{0.1 * k},{0.02 * k},0" for k in range(9))
    (tmp_path / "way.csv").write_text(f"t,x,y\n{rows}\n")
    words = ("track", "paper", "--reference", str(tmp_path / "way.csv"), "--samples", "0")
    output = run_json(*words, "--duration", "0.5")
    assert output["report"] == "runs/paper-way/report.html"
    (tmp_path / "way.csv").write_text(f"t,x,y\n{rows}\n0.9,oops,0\n")
    code, _, err = run(*words)
    assert code == 2
    assert err.startswith(f'{tmp_path / "way.csv"}:11: error: x "oops" is not a number')


def test_track_tells_people(tmp_path: Path) -> None:
    code, out, _ = run("track", "paper", "--duration", "0.5", "--out", str(tmp_path))
    assert code == 0
    for word in ("differential", "verified", "base", "end effector", "effort", "report.html"):
        assert word in out


@pytest.mark.slow
def test_track_says_where_a_run_ends_that_was_asked_for_longer(tmp_path: Path) -> None:
    words = ("track", "paper", "--duration", "0.0215", "--samples", "0", "--out", str(tmp_path))
    output = run_json(*words)
    note = "a duration of 0.0215 s is no whole number of control periods of 0.002 s: the run ends"
    assert f"{note} at 0.02 s" in output["notes"]
    assert output["duration"] == pytest.approx(0.02)
    assert f"{note} at 0.02 s" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert note in " ".join(run(*words)[1].split())


@pytest.mark.slow
def test_plot_writes_a_figure_beside_the_run(tmp_path: Path) -> None:
    run("track", "paper", "--duration", "0.2", "--samples", "0", "--out", str(tmp_path))
    assert run_json("plot", str(tmp_path)) == {"figure": str(tmp_path / "figure.pdf")}
    assert (tmp_path / "figure.pdf").read_bytes().startswith(b"%PDF")
    code, _, err = run("view", str(tmp_path), "--png", str(tmp_path / "a.png"), "--size", "3x")
    assert (code, "--size 3x" in err) == (2, True)


def test_track_asks_for_a_browser_before_it_simulates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    code, _, err = run("track", "paper", "--png", "--out", str(tmp_path / "run"))
    assert code == 2
    assert "rpctl[film]" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, BROWSER_NAMES)), reason="no chromium on PATH")
def test_track_draws_the_scene_if_asked(tmp_path: Path) -> None:
    run("track", "paper", "--duration", "0.2", "--samples", "0", "--png", "--out", str(tmp_path))
    assert (tmp_path / "scene.png").stat().st_size > 10_000


def test_a_robots_name_cannot_lead_out_of_the_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    path = write(tmp_path, platform(SET_A).replace('name="platform"', 'name="../../&lt;b>x"'))
    code, _, _ = run("track", str(path), "--duration", "0.05", "--samples", "0")
    assert code == 0
    assert [p.name for p in (tmp_path / "here" / "runs").iterdir()] == ["_..__b_x-eight"]


@pytest.mark.slow
def test_track_fails_with_1_where_a_limit_breaks(tmp_path: Path) -> None:
    words = ("track", "tiago", "--duration", "0.1", "--initial-error", "1,1,1", "--samples", "0")
    paper = ("--kinematic", "paper", "--dynamic", "paper")
    output = run_json(*words, *paper, "--out", str(tmp_path), code=1)
    assert output["max_effort_ratio"] > 1
    assert {broken["limit"] for broken in output["limits_violated"]} >= {"effort"}


@pytest.mark.slow
def test_track_tells_what_to_expect(tmp_path: Path) -> None:
    """Beside the nominal run, of which it says that the model follows itself."""
    config = tmp_path / "coarse.toml"
    config.write_text("[run]\nduration = 12.06\ncontrol_period = 0.02\nplant_step = 0.02\n")
    words = ("track", "paper", "--samples", "0", "--config", str(config))
    code, out, _ = run(*words, "--out", str(tmp_path / "run"))
    output = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (code, output["outcome"], output["nominal"]) == (0, "tracked", True)
    assert output["perturbed"]["duration"] == pytest.approx(4.02)
    assert output["perturbed"]["base_path"]["rms"] > 1.5 * output["base_path"]["rms"]
    text = " ".join(out.split())
    assert "the model follows itself" in text
    assert f"expect, {output['perturbed']['sentence']}" in text
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert f"Expect, {output['perturbed']['sentence']}." in page
    assert "The model follows itself" in page


def test_what_to_expect_is_left_out_where_somebody_chose_a_plant() -> None:
    bias, slow = Plant(tau_bias={"a": 1.0}), Plant(delay=0.01)
    assert ResultOptions().perturbs(Config())
    assert not ResultOptions(perturbed=False).perturbs(Config())
    assert not any(ResultOptions().perturbs(Config(plant=plant)) for plant in (bias, slow))


@pytest.mark.parametrize(
    ("outcome", "exit_code"),
    [("tracked", 0), ("late", 0), ("stuck", 1), ("diverging", 1), ("collided", 1)],
)
def test_the_outcome_decides_the_exit_code(
    outcome: str, exit_code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(self: ResultOptions, done: Run, folder: Path) -> RunFolder:
        summary = replace(summarize(done), outcome=outcome)
        return RunFolder(summary, folder / "report.html", 0, ())

    monkeypatch.setattr(ResultOptions, "write", write)
    words = ("track", "paper", "--duration", "0.02", "--samples", "0", "--out", str(tmp_path))
    assert run_json(*words, code=exit_code)["outcome"] == outcome


@pytest.mark.parametrize("dynamic", cells(("bounded", "integral"), slow={"bounded", "integral"}))
def test_track_tells_which_limit_bound(dynamic: str, tmp_path: Path) -> None:
    words = ["track", "tiago", "--duration", "0.1", "--initial-error", "1,1,1", "--samples", "0"]
    words += ["--dynamic", dynamic, "--out", str(tmp_path)]
    output = run_json(*words)
    assert output["limits_violated"] == []
    assert output["limits_bound"][0]["told"] in run(*words)[1]
    assert "effort limit bound from 0 s" in output["limits_bound"][0]["told"]
    assert output["limits_bound"][0]["told"] in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("inspect", "tiag0"), "did you mean"),
        (("inspect", "none.urdf"), "none.urdf: error: No such file or directory"),
        (("inspect", "tiago", "--lock", "hand"), "joint to lock 'hand' is not known"),
        (("inspect", "tiago", "--lock", "head_1_joint=x"), "'x' is not a number"),
        (("inspect",), "Missing argument"),
        (("inspect", "panda", "--drive", "differential"), "no differential drive"),
        (("inspect", "tiago", "--drive", "tank"), "drive 'tank' is not known"),
        (("inspect", "tiago", "--drive", "none.toml"), "none.toml: error: No such file"),
        (("verify", "paper", "--samples", "0"), "--samples"),
        (("track", "paper", "--reference", "eigth"), "did you mean eight"),
        (("track", "paper", "--reference", "none.csv"), "none.csv: error: No such file"),
        (("track", "paper", "--reference", "none.toml"), "none.toml: error: No such file"),
        (("track", "panda", "--reference", "waypoints"), "panda has a fixed base"),
        (("track", "paper", "--kinematic", "papers"), "did you mean paper"),
        (("track", "paper", "--dynamic", "x"), "dynamic law 'x' is not known"),
        (("track", "paper", "--initial-error", "1,2"), "give three numbers"),
        (("track", "paper", "--duration", "-1"), "duration is -1; give a positive number"),
        (("track", "paper", "--duration", "x"), "--duration"),
        (("track", "paper", "--max-megabytes", "0"), "--max-megabytes"),
        (("view", "nothing"), "robot or run 'nothing' is not known"),
        (("view", "nothing.npz"), "No such file"),
        (("view", "paper", "--lock", "x"), "joint to lock 'x' is not known"),
        (("view", "nothing.npz", "--png", "a.png"), "No such file"),
        (("view", "paper", "--png", "a.png"), "is no run"),
        (("view", "nothing.npz", "--fps", "20"), "--fps is for a picture or a film"),
        (("view", "nothing.npz", "--video", "a.mp4", "--at", "2"), "--at is for a picture"),
        (("plot", "nothing"), "No such file"),
        (("fly",), "No such command"),
    ],
)
def test_wrong_input_exits_2_with_one_message(words: tuple[str, ...], output: str) -> None:
    code, out, err = run(*words)
    assert code == 2
    assert output in " ".join(err.replace("│", " ").split())
    assert "Traceback" not in out + err


def test_a_reference_that_cannot_be_followed_is_refused_first(tmp_path: Path) -> None:
    """Before the dynamics are verified, and before anything is written."""
    saved = tmp_path / "saved.toml"
    code, out, err = run("track", "car", "--reference", "spin", "--save-config", str(saved))
    assert (code, out) == (2, "")
    assert "take line, reverse, circle or eight" in " ".join(err.split())
    assert not saved.exists()


def test_an_input_error_names_file_line_and_fix(tmp_path: Path) -> None:
    path = write(tmp_path, platform(SET_A).replace('value="30.0"', 'value="-1"'))
    code, _, err = run("verify", str(path))
    assert code == 2
    assert err.strip() == f'{path}:4: error: mass -1 of link "base" is negative; give its kg'


def test_nothing_is_written_where_the_input_is_wrong(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, _, _ = run("track", "paper", "--initial-error", "nan,0,0", "--out", str(out))
    assert code == 2
    assert not out.exists()


def test_an_unwritable_folder_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file" / "run")
    code, _, err = run("track", "paper", "--duration", "0.1", "--samples", "0", "--out", out)
    assert code == 2
    assert err.count("\n") == 1
    assert "file/run" in err
    assert "Not a directory" in err


@pytest.mark.slow
def test_view_writes_the_comparison_of_runs(tmp_path: Path) -> None:
    for name, duration in (("one", "0.1"), ("two", "0.2")):
        words = ("track", "paper", "--duration", duration, "--samples", "0")
        assert run(*words, "--out", str(tmp_path / name))[0] == 0
    page = tmp_path / "compare.html"
    runs = str(tmp_path / "one"), str(tmp_path / "two" / "run.npz")
    code, out, _ = run("view", *runs, "--html", str(page))
    assert code == 0
    assert out.strip() == f"wrote {page}"
    text = page.read_text(encoding="utf-8")
    assert "2 runs: one · two" in text
    assert str(tmp_path) not in text


def test_view_of_neither_a_robot_nor_a_run(tmp_path: Path) -> None:
    code, _, err = run("view", "papr")
    assert code == 2
    assert "robot or run 'papr' is not known; did you mean paper" in err
    code, _, err = run("view", str(tmp_path))
    assert code == 2
    assert f"{tmp_path}: a folder without a run.npz is no run, and no robot; give" in err
    code, _, err = run("view", "paper", "--lock", "nothing")
    assert code == 2
    assert "robot or run" not in err


def test_findings_are_told_in_sum() -> None:
    alike = [f for f in run_json("inspect", "tiago")["findings"] if "point mass" in f["message"]]
    assert len(alike) == 3
    shown = " ".join(run("inspect", "tiago")[1].split())
    assert shown.count("is a point mass") == 1
    for finding in alike[1:]:
        name = finding["message"].split('"')[1]
        assert f'"{name}" (line {finding["line"]})' in shown


def test_robots_lists_the_catalogue() -> None:
    names = [row["name"] for row in run_json("robots")]
    assert {"paper", "mixed_chain", "tiago", "panda"} <= set(names)
    assert "mixed_chain" in run("robots")[1]


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_and_begins_as_the_list_of_commands_says(command: str) -> None:
    code, out, _ = run(command, "--help")
    assert code == 0
    assert f"Example: rpctl {command}" in " ".join(out.split())
    assert load_command(command).help.splitlines()[0] == COMMANDS[command].summary


def test_options_of_a_dataclass_are_options_of_the_command() -> None:
    """Each comes once, in the order of the fields, and so does what is no dataclass."""
    names = [parameter.name for parameter in load_command("inspect").params]
    assert names == ["robot", *LOADED.names, "list_xacro_args", "as_json"]


def test_ctrl_c_exits_130_and_leaves_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["-m", "rpctl", "track", "tiago", "--duration", "600", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        # Jobs in the background inherit a Ctrl-C that is ignored.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "tiago" in line  # the drive is verified before anything is simulated
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in err
    assert not out.exists()


def test_derive_writes_each_format() -> None:
    _, text, _ = run("derive", "paper")
    assert "M13 = -S1*p1" in text
    assert "\\begin{document}" in run("derive", "paper", "--format", "latex")[1]
    assert "#include <math.h>" in run("derive", "paper", "--format", "c")[1]
    assert "def paper_dynamics" in run("derive", "paper", "--format", "python")[1]
    assert "kg" in run("derive", "paper", "--parameters")[1]
    assert run_json("derive", "paper")["text"].strip() == text.strip()


def test_derive_writes_a_file(tmp_path: Path) -> None:
    out = tmp_path / "paper.c"
    code, text, _ = run("derive", "paper", "--format", "c", "--out", str(out))
    assert (code, text) == (0, f"wrote {out}\n")
    assert out.read_text().strip() == run("derive", "paper", "--format", "c")[1].strip()
    code, _, error = run("derive", "paper", "--out", str(tmp_path / "none" / "paper.c"))
    assert code == 2
    assert "there is no folder" in error


def test_derive_says_what_is_too_large() -> None:
    code, _, err = run("derive", "tiago")
    assert code == 2
    assert "use --format c or python" in err
    assert run("derive", "paper", "--format", "pdf")[0] == 2


def test_a_certificate_can_be_a_page(tmp_path: Path) -> None:
    page = tmp_path / "certificate.html"
    assert (
        run("verify", "paper", "--samples", "2", "--engines", "none", "--html", str(page))[0] == 0
    )
    text = page.read_text(encoding="utf-8")
    assert "Gibbs-Appell" in text
    assert "verified" in text
    assert "https:" not in text
