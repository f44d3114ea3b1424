"""The command line as a user meets it: outputs, exit codes, messages."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rpctl import Plant, Run, summarize
from rpctl.cli.app import COMMANDS, WITHOUT_JSON, app, load_command
from rpctl.cli.options import LOADED, PANELS
from rpctl.cli.track import ResultOptions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.simulation.config import Config
from rpctl.view import run_folder
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


def test_strict_takes_warnings_as_errors(tmp_path: Path) -> None:
    path = write(tmp_path, platform(SET_A).replace('xyz="0 1 0"', 'xyz="0 2 0"', 1))
    assert run_json("inspect", str(path))["findings"][0]["severity"] == "warning"
    for command in ("inspect", "verify", "track"):
        code, out, err = run(command, str(path), "--strict")
        assert (code, out) == (2, "")
        assert err.startswith(f"{path}:") and ": error: axis of joint" in err


ASKED = """
import os, sys
from rpctl.__main__ import main
sys.argv = ["rpctl", "robots"]
try:
    main()
finally:
    print("threads", os.environ["OPENBLAS_NUM_THREADS"], os.environ["OMP_NUM_THREADS"])
"""


def test_libraries_compute_in_one_thread_unless_the_user_says_otherwise() -> None:
    """Threads for small matrices wait for each other, and that took half of a run's time."""
    given = {**os.environ, "OMP_NUM_THREADS": "3"}
    given.pop("OPENBLAS_NUM_THREADS", None)
    done = subprocess.run(
        [sys.executable, "-c", ASKED], env=given, capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines()[-1] == "threads 1 3", done.stderr


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


def test_track_asks_for_a_browser_before_it_simulates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "playwright", None)
    code, _, err = run("track", "paper", "--png", "--out", str(tmp_path / "run"))
    assert code == 2
    assert "'playwright<" in err
    assert not list(tmp_path.iterdir())


def test_what_to_expect_is_left_out_where_somebody_chose_a_plant() -> None:
    bias, slow = Plant(tau_bias={"a": 1.0}), Plant(delay=0.01)
    assert ResultOptions().perturbs(Config())
    assert not ResultOptions(perturbed=False).perturbs(Config())
    assert not any(ResultOptions().perturbs(Config(plant=plant)) for plant in (bias, slow))


@pytest.mark.parametrize(
    ("outcome", "exit_code"),
    cells(
        [("tracked", 0), ("late", 0), ("stuck", 1), ("diverging", 1), ("collided", 1)],
        [("late", 0), ("stuck", 1)],
    ),
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


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("inspect", "tiag0"), "did you mean"),
        (
            ("inspect", "."),
            ".: error: this is a folder; give one of the URDF or .xacro files in it",
        ),
        (("inspect", "tiago", "--lock", "hed_*"), "did you mean head_*"),
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
        (("view", "runs/nothere"), "runs/nothere: no such file or folder; give a run's folder"),
        (("view", "paper", "--lock", "x"), "joint to lock 'x' is not known"),
        (("view", "nothing.npz", "--png", "a.png"), "No such file"),
        (("view", "paper", "--png", "a.png"), "is not a run"),
        (("view", "nothing.npz", "--fps", "20"), "--fps needs a picture or a film"),
        (("view", "nothing.npz", "--video", "a.mp4", "--at", "2"), "--at needs a picture"),
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


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_and_begins_as_the_list_of_commands_says(command: str) -> None:
    code, out, _ = run(command, "--help")
    assert code == 0
    assert f"Example: rpctl {command}" in " ".join(out.split())
    assert load_command(command).help.splitlines()[0] == COMMANDS[command].summary


def test_each_command_takes_json_or_says_why_not() -> None:
    options = {name: {o for p in load_command(name).params for o in p.opts} for name in COMMANDS}
    assert {name for name in COMMANDS if "--json" not in options[name]} == {*WITHOUT_JSON}


def test_view_says_in_json_what_it_wrote(tmp_path: Path) -> None:
    page = tmp_path / "robot.html"
    assert run_json("view", "paper", "--html", str(page)) == {"page": str(page)}
    assert page.exists()


def test_options_of_a_dataclass_are_options_of_the_command() -> None:
    """Each comes once, in the order of the fields, and so does what is no dataclass."""
    names = [parameter.name for parameter in load_command("inspect").params]
    assert names == ["robot", "list_xacro_args", "balance", "sarif_file", "as_json", *LOADED.names]


def test_help_has_panels_and_the_robot_s_comes_last() -> None:
    options = [each for each in load_command("track").params if each.name != "robot"]
    panels = [each.rich_help_panel for each in options]
    assert list(dict.fromkeys(panels)) == [None, *PANELS]
    assert panels.count(None) < 6
    assert "[plant] of the configuration" in " ".join(
        run("track", "--help")[1].replace("│", " ").split()
    )


@pytest.mark.usefixtures("undrawn")
def test_a_second_run_leaves_the_first_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("track", "paper", "--duration", "0.02", "--samples", "0", "--no-perturbed")
    folders = [Path(run_json(*words)["report"]).parent for _ in range(3)]
    assert [str(each) for each in folders] == [f"runs/paper-eight{end}" for end in ("", "-2", "-3")]
    assert all((folder / "run.npz").exists() for folder in folders)
    assert run_json(*words, "--out", str(folders[1]))["report"] == f"{folders[1]}/report.html"


@pytest.mark.usefixtures("undrawn")
def test_ctrl_c_while_the_report_is_drawn_leaves_run_and_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw = run_folder.write_folder

    def write_folder(*given: Any) -> RunFolder:
        os.kill(os.getpid(), signal.SIGINT)
        return draw(*given)

    monkeypatch.setattr(run_folder, "write_folder", write_folder)
    words = ("track", "paper", "--duration", "0.02", "--samples", "0", "--no-perturbed")
    code, _, err = run(*words, "--out", str(tmp_path))
    assert code == 130
    assert err.splitlines()[-1] == "interrupted"
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "report.html", "run.npz", "summary.json", "tracking.png",
    ]  # fmt: skip


@pytest.mark.usefixtures("undrawn")
def test_a_picture_without_its_extra_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "playwright", None)
    words = ("track", "paper", "--duration", "0.02", "--samples", "0", "--no-perturbed")
    run_json(*words, "--out", str(tmp_path))
    code, _, err = run("view", str(tmp_path), "--png", str(tmp_path / "a.png"))
    assert code == 2
    assert "pip install 'av<" in err and "'playwright<" in err


def test_derive_says_what_is_too_large() -> None:
    code, _, err = run("derive", "tiago")
    assert code == 2
    assert "use --format c or python" in err
    assert run("derive", "paper", "--format", "pdf")[0] == 2
