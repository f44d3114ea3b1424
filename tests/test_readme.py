"""The README's commands and its example run as they are written."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.simulation.config import read_config

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^\$ rpctl (.*)$", TEXT, flags=re.MULTILINE)
DRIVE_FILE = re.findall(r"```toml\n(type = .*?)```", TEXT, flags=re.DOTALL)[0]
(OBSTACLES,) = re.findall(r"```toml\n([^`]*base_obstacles[^`]*)```", TEXT)
EXAMPLES = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)

pytestmark = pytest.mark.slow


def test_there_is_something_to_run() -> None:
    assert len(COMMANDS) >= 6
    assert len(EXAMPLES) == 1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all commands: some take up what others wrote."""
    return tmp_path_factory.mktemp("readme")


@pytest.mark.parametrize("line", [c for c in COMMANDS if not c.startswith("view")])
def test_commands(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    command, _, file = line.partition(" > ")
    result = CliRunner().invoke(app, shlex.split(command))
    assert result.exit_code == 0, result.output
    assert result.stdout.strip()
    assert not file or file.endswith((".tex", ".c"))


def test_the_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed: list[str] = []
    exec(EXAMPLES[0], {"print": lambda *values: printed.append(" ".join(map(str, values)))})
    expected = re.findall(r"print\(.*?\)\s+# (.*)", EXAMPLES[0])
    assert printed == expected
    assert (tmp_path / "report.html").stat().st_size > 1e6


def test_the_drive_file(tmp_path: Path) -> None:
    (tmp_path / "drive.toml").write_text(DRIVE_FILE, encoding="utf-8")
    expected = rpctl.load("tricycle", drive=tmp_path / "drive.toml").drive
    found = rpctl.load("tricycle").drive
    assert [(w.joint, w.driven) for w in expected.wheels] == [
        (w.joint, w.driven) for w in found.wheels
    ]
    assert [(s.joint, s.role) for s in expected.swivels] == [
        (s.joint, s.role) for s in found.swivels
    ]


def test_the_obstacles(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text(OBSTACLES, encoding="utf-8")
    law = read_config(tmp_path / "run.toml").kinematic
    assert isinstance(law, rpctl.Horizon)
    assert law.base_obstacles == (rpctl.Disc(1.0, 1.1, 0.15), rpctl.HalfPlane(0, 1, -0.95))
