"""``rpctl inspect``: what it says of a drive, to people and as JSON."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from markupsafe import escape
from rich.console import Console
from typer.testing import CliRunner

import rpctl
from rpctl.cli import inspect, verify
from rpctl.cli.app import app
from rpctl.view.pages.certificate import write_certificate
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle

WIDTH = 100  # columns

runner = CliRunner()


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Console:
    """Return the console that is printed on: a terminal of common width."""
    console = Console(width=WIDTH, record=True, force_terminal=True, highlight=False)
    for module in (inspect, verify):
        monkeypatch.setattr(module, "console", lambda: console)
    return console


def inspect_json(path: Path, *words: str) -> dict[str, Any]:
    result = runner.invoke(app, ["inspect", str(path), "--json", *words])
    assert result.exit_code == 0, result.stderr
    output: dict[str, Any] = json.loads(result.stdout)
    return output


def test_what_is_idealised_is_said(tmp_path: Path, page: Console) -> None:
    """A right wheel 4 mm above the left one: 2 mm off the ground between them, and 40 mm wide."""
    text = platform(SET_A).replace('xyz="0 -0.75 0.15"', 'xyz="0 -0.75 0.154"')
    path = write(tmp_path, text)
    robot = rpctl.load(path)
    inspect.show_robot(robot)
    output = inspect_json(path)["idealised"]
    assert [(each["what"], round(each["value"], 9), each["unit"]) for each in output] == [
        ("contact height", 2.0, "mm"),
        ("thin wheels", 40.0, "mm"),
    ]
    certificate = rpctl.verify(robot, samples=1, engines=())
    verify.show_certificate(certificate)
    assert list(certificate.idealised) == [each["sentence"] for each in output]
    assert certificate.to_dict()["idealised"] == list(certificate.idealised)
    shown = " ".join(page.export_text().split())
    for sentence in certificate.idealised:
        assert shown.count(f"idealised {sentence}") == 2
    html = write_certificate(certificate, tmp_path / "page.html").read_text(encoding="utf-8")
    for sentence in certificate.idealised:
        assert f"<li>{escape(sentence)}.</li>" in html
    bare = dataclasses.replace(certificate, idealised=())
    assert (
        "dealised"
        not in write_certificate(bare, tmp_path / "page.html")
        .read_text(encoding="utf-8")
        .partition("<body>")[2]
    )


@pytest.mark.parametrize(
    ("kind", "speed"),
    [("steered", "rolling speed of fl_wheel, m/s"),
     ("twin", "rolling speed of fl_l_wheel and fl_r_wheel on average, m/s"),
     ("tricycle", "forward speed of P, m/s")],
)  # fmt: skip
def test_json_says_what_v_is(tmp_path: Path, kind: str, speed: str) -> None:
    output = inspect_json(write(tmp_path, vehicle(kind)))
    assert output["meanings"]["v"] == speed
    assert list(output["meanings"]) == output["quasi_velocities"]
    assert output["drive"]["evidence"]
    swivels = {swivel["joint"]: swivel for swivel in output["drive"]["swivels"]}
    for wheel in output["drive"]["wheels"]:
        assert wheel["why"].startswith("turns without limits about a level axle")
        assert wheel["swivel"] is None or wheel["swivel"] in swivels
    assert all(swivel["role"] and swivel["why"] for swivel in swivels.values())
