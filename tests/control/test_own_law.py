"""A law of a user's own file gets all that rpctl's laws get, and is run nowhere else."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import tomllib
from typer.testing import CliRunner

import rpctl
from rpctl import Command, Config, ReducedDynamics, Robot
from rpctl.cli.app import app
from rpctl.control.registry import read_law, settings_of
from rpctl.errors import DescriptionError, RpctlError
from rpctl.files.records import read_record
from rpctl.simulation.config import read_config, write_config
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.run.run import Run
from rpctl.study.executor import ProcessExecutor
from rpctl.study.runner import Runner, run_rows
from rpctl.study.store import experiment_identity
from rpctl.study.study_file import read_study
from tests.grids import cells

DEMO = Path(__file__).parents[2] / "demos" / "own_controller.py"
NAME = f"{DEMO}:PointAhead"
STUDY = f"""
[study]
count = 8
duration = 0.3
[run]
control_period = 0.01
[kinematic]
law = '{NAME}'
horizon = 0.5
[scatter]
"kinematic.ahead" = {{ uniform = [0.2, 0.4] }}
"run.initial_error.y" = {{ uniform = [-0.2, 0.2] }}
"""


def write(folder: Path, text: str, name: str = "file.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def derived(format: str, words: str) -> Callable[[Robot, Path], None]:
    def check(robot: Robot, folder: Path) -> None:
        found = CliRunner().invoke(app, ["derive", "paper", "--law", NAME, "--format", format])
        assert found.exit_code == 0, found.output
        assert words in re.sub(" +", " ", found.stdout)

    return check


def tracked(robot: Robot, folder: Path) -> None:
    config = Config(read_law("kinematic", NAME)).with_run(
        duration=0.5, initial_error=(0.1, 0.1, 0.2)
    )
    fast, slow = (simulate(robot, config, backend=name) for name in ("compiled", "pinocchio"))
    assert fast.notes == slow.notes == ()
    np.testing.assert_allclose(fast.log.q, slow.log.q, atol=1e-11)
    kept = Run.load(fast.save(folder / "run.npz")).config.kinematic
    assert settings_of(kept)["ahead"] == 0.3


def configured(robot: Robot, folder: Path) -> None:
    path = write(folder, f"[kinematic]\nlaw = '{NAME}'\nahead = 0.2\n")
    config = read_config(path)
    assert config.with_laws(NAME, None) == config != config.with_laws("paper", None)
    assert config.kinematic == type(read_law("kinematic", NAME))(ahead=0.2)
    again = write_config(config, folder / "again.toml")
    assert read_config(again) == config
    assert tomllib.loads(again.read_text())["kinematic"] == {
        "law": NAME, "ahead": 0.2}  # fmt: skip
    nested = f"[kinematic]\nlaw = 'end-effector'\n[kinematic.base]\nlaw = '{NAME}'\nahead = 0.2\n"
    within = read_config(write(folder, nested)).kinematic
    assert within.base == config.kinematic  # type: ignore[union-attr]


def studied(robot: Robot, folder: Path) -> None:
    """Machine code in this process, Python in another, which is sent the file's text."""
    own = write(folder, DEMO.read_text(), "own.py")
    text = STUDY.replace(str(DEMO), str(own))
    tables = []
    for backend in ("compiled", "pinocchio"):
        study = read_study(write(folder, text), robot, backend)
        runner, rows = Runner(robot, study.experiment), np.arange(8)
        assert (runner._prepared.lanes is not None) == (backend == "compiled")
        if backend == "compiled":
            tables.append(runner.rows(study.values, rows))
            before = experiment_identity(study.experiment, study.scatter)
            continue
        own.unlink()
        with ProcessExecutor(1) as executor:
            tables += list(run_rows(runner, rows, rows, study.values, executor, 8))
    errors = [table.merits["rms_base_error"] for table in tables]
    np.testing.assert_allclose(errors[0], errors[1], rtol=1e-8)
    assert len(set(errors[0].tolist())) == 8
    own.write_text(DEMO.read_text() + "\n# another\n")
    study = read_study(write(folder, text), robot)
    assert experiment_identity(study.experiment, study.scatter) != before


def rated(robot: Robot, folder: Path) -> None:
    """ν̇_d is the rate of ν_d along the motion."""
    dynamics, step, law = ReducedDynamics(robot), 1e-6, read_law("kinematic", NAME)
    start = law.start(dynamics, 0.002)
    motion = rpctl.load_reference(robot, "eight")
    q, nu = robot.configuration(x=-0.1, y=0.1, theta=0.4), np.array([0.3, -0.2, 0.1, 0.4])
    ends = [pin.integrate(robot.model, q, s * (dynamics.basis(q) @ nu)) for s in (step, -step)]
    ahead, behind = (
        start(dynamics, motion, 3.0 + s, end, nu).nu_d
        for s, end in zip((step, -step), ends, strict=True)
    )
    rate = start(dynamics, motion, 3.0, q, nu).nu_d_dot
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * step), atol=1e-7)


MADE: dict[str, Callable[[Robot, Path], None]] = {
    "text": derived("text", "ahead = 0.3 m Look-ahead"),
    "latex": derived("latex", r"$\mathit{ahead}$ & 0.3 m, Look-ahead"),
    "python": derived("python", "ahead = 0.3\n"),
    "c": derived("c", "const double ahead = 0.3; /* Look-ahead [m] */"),
    "track": tracked,
    "configuration": configured,
    "study": studied,
    "rate": rated,
}


# Of the formats one is formulas and the others are code; the study starts a process.
@pytest.mark.parametrize(
    "thing", cells(MADE, [n for n in MADE if n not in ("latex", "study")], slow=["study"])
)
def test_all_is_made_of_a_law_of_ones_own(thing: str, paper: Robot, tmp_path: Path) -> None:
    MADE[thing](paper, tmp_path)


FILE = """
import math
from dataclasses import dataclass
import rpctl

class Threshold(rpctl.BaseLaw):
    def unicycle(self, at):
        return (1.0 if at.e[0] > 0.1 else 0.0), 0.0

class Floats(rpctl.BaseLaw):
    def unicycle(self, at):
        return math.cos(at.e[0]), 0.0

class Half(rpctl.BaseLaw):
    pass

@dataclass(frozen=True)
class Short(rpctl.BaseLaw):
    short: float = 1.0
    def unicycle(self, at):
        return at.twist[0] + self.short * at.e[0], at.twist[2]

@dataclass(frozen=True)
class Twice(rpctl.BaseLaw):
    x1: float = 1.0
    def unicycle(self, at):
        return at.twist[0] + self.x1 * at.e[0], at.twist[2]
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.py:Law", r"none\.py: error: No such file"),
        ("own.py:Treshold", r"own\.py: class 'Treshold' is not known; did you mean Threshold\?"),
        ("own.py:Half", r"own\.py: Half is not a law; give a subclass of rpctl\.BaseLaw"),
        ("own.py:math", r"own\.py: math is not a law"),
        ("own.py:Threshold", r"of Threshold is not a formula: .*. Write it with rpctl\.math"),
        (
            "own.py:Floats",
            r"of Floats is not a formula: it gives NaN, as functions of Python's math do",
        ),
        ("own.py:Short", "Short: formulas and code have no symbol 'short' left for its setting"),
        ("own.py:Twice", "Twice: formulas and code have no symbol 'x1' left for its setting"),
        ("broken.py:Law", r"broken\.py:2: error: ZeroDivisionError: division by zero"),
        ("typo.py:Law", r"typo\.py:1: error: SyntaxError"),
    ],
)
def test_what_is_no_law_is_told(
    name: str, words: str, paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, FILE, "own.py")
    write(tmp_path, "x = 1\ny = x / 0\n", "broken.py")
    write(tmp_path, "class Law", "typo.py")
    with pytest.raises(RpctlError, match=words):
        rpctl.derive_law(paper, kinematic=name)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ahead = -1.0", "3: error: kinematic: ahead is -1; give a positive number"),
        ("ahed = 1.0", "3: error: kinematic.ahed: setting 'ahed' is not known; did you mean ahead"),
    ],
)
def test_settings_are_checked_as_all_others(line: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=re.escape(words)):
        read_config(write(tmp_path, f"[kinematic]\nlaw = '{NAME}'\n{line}\n"))


def test_only_what_a_user_names_is_run(tmp_path: Path) -> None:
    """A run's header, read as any record, cannot name code; nor can a dynamic law."""
    mark = tmp_path / "ran"
    evil = write(tmp_path, f"open({str(mark)!r}, 'w').close()\nclass Law: pass\n", "evil.py")
    for table in ("kinematic", "dynamic"):
        faults: list[str] = []
        assert read_record(Config, {table: {"law": f"{evil}:Law"}}, "", faults) is None
        assert f"{table}.law: {table} law" in faults[0]
    with pytest.raises(DescriptionError, match="dynamic law"):
        read_config(write(tmp_path, f"[dynamic]\nlaw = '{evil}:Law'\n"))
    assert not mark.exists()


def test_a_function_is_a_law_at_pythons_speed_which_is_said(paper: Robot) -> None:
    def own(*_: object) -> Command:
        return Command(np.zeros(4), np.zeros(4))

    run = rpctl.track(paper, "line", duration=0.5, kinematic=own)
    assert "ran in Python, not as machine code: the kinematic law own" in " ".join(run.notes)
    assert not np.any(run.log.nu_d)
