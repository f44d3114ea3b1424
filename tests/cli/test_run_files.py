"""Run files on the command line: a damaged one is one line and exit code 2; less room if asked."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpctl import Robot, track
from rpctl.cli.app import app
from tests.run_files import parts_of

runner = CliRunner()


@pytest.mark.parametrize("command", [["view"], ["view", "--png", "a.png"], ["plot"]])
def test_a_damaged_run_is_one_line_and_exit_code_2(
    paper: Robot, tmp_path: Path, command: list[str]
) -> None:
    path, parts = tmp_path / "run.npz", parts_of(track(paper, "line", duration=0.01), tmp_path)
    for data in (
        parts.changed(t=parts.arrays["t"][::-1]).whole(),
        b"PK\x03\x04 and no more",
        b"",
    ):
        path.write_bytes(data)
        result = runner.invoke(app, [command[0], str(path), *command[1:]])
        assert result.exit_code == 2
        assert str(path) in result.stderr.replace("\n", "")
        assert "Traceback" not in result.output
