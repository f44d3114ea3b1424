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
from tests.grids import cells

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^\$ rpctl (.*)$", TEXT, flags=re.MULTILINE)
DRIVE_FILE = re.findall(r"```toml\n(type = .*?)```", TEXT, flags=re.DOTALL)[0]
(OBSTACLES,) = re.findall(r"```toml\n([^`]*base_obstacles[^`]*)```", TEXT)
EXAMPLE = "".join(re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL))
WRITTEN = re.compile(r"(?:--out|--save-config|>) (\S+)")


def takes_up(line: str, earlier: str) -> bool:
    """Return whether a command reads what an earlier one writes, and does not write it itself."""
    written = {*WRITTEN.findall(earlier)} - {*WRITTEN.findall(line)}
    return any(file in line.split() for file in written)


LINES = [line for line in COMMANDS if not line.startswith("view")]
LAST = [line for line in LINES if not any(takes_up(other, line) for other in LINES)]
LONG = [line for line in LAST if line.startswith("compare")]
SHORT = [f"{line} --duration 2" for line in LONG]
IN_CI = [line for line in LAST if line not in LONG] + SHORT


@pytest.mark.parametrize("last", cells(LAST + SHORT, slow=IN_CI))
def test_commands(last: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As they are written, after those whose files they take up; `compare` for 2 s only in CI."""
    if any(word in last for word in ("contact", "referee", "export", "check", "onset")):
        pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    for line in (*(each for each in LINES if takes_up(last, each)), last):
        command, _, file = line.partition(" > ")
        result = CliRunner().invoke(app, shlex.split(command))
        assert result.exit_code == 0, result.output
        assert result.stdout.strip()
        assert not file or file.endswith((".tex", ".c", ".toml"))
        if file:
            Path(file).write_text(result.stdout, encoding="utf-8")


@pytest.mark.slow
def test_the_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed: list[str] = []
    exec(EXAMPLE, {"print": lambda *values: printed.append(" ".join(map(str, values)))})
    expected = re.findall(r"print\(.*?\)\s+# (.*)", EXAMPLE)
    assert printed == expected
    assert (tmp_path / "report.html").stat().st_size > 1e6
    assert (tmp_path / "wave.csv").read_text(encoding="utf-8").startswith("t,x,y,theta,")


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


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_files_that_are_named_exist(page: str) -> None:
    root = Path(__file__).parents[1]
    text = (root / page).read_text(encoding="utf-8")
    names = re.findall(r"`([\w/]+/|[\w/]*\w\.py)`", text)
    assert len(names) > 3
    folder, missing = root, []
    for name in names:  # a name without a folder is beside the one before, or in it
        places = [root / name, root / "rpctl" / name, folder / name]
        path = next((place for place in places if place.exists()), None)
        if path is None:
            missing.append(name)
        elif "/" in name:
            folder = path if path.is_dir() else path.parent
    assert not missing
