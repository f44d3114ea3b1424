"""The region of attraction: what counts as converged, what is drawn, and no start runs away."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.control.error import tracking_error
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.reference.named import reference_by_name
from rpctl.study.attraction import (
    RUN,
    Fraction,
    Placement,
    Start,
    converged,
    fractions,
    placement,
    start_errors,
)
from rpctl.study.cells import CellRunner, Figures, References, Row
from rpctl.view.plots import attraction as picture
from tests.grids import cells

FAR = (0.5, -1.0, 3.11)
HOME = Figures("tracked", final_base=1e-4, settled_at=12.0)
DRIVES = ("paper", "skid_steer", "mecanum", "omni", "car", "bicycle", "tricycle", "swerve",
          "twin_casters", "casters", "caster_drive")  # fmt: skip
REFERENCES = ("line", "reverse", "spin", "circle", "eight")
PAIRS = [(drive, law) for drive in DRIVES for law in KINEMATIC_LAWS]
GRID = [(*pair, REFERENCES[k % len(REFERENCES)]) for k, pair in enumerate(PAIRS)]
SLOW = [each for each in GRID if each[:2] == ("paper", "unified")]


def drawn_errors(count: int, seed: int) -> list[tuple[float, float, float]]:
    """Return errors drawn evenly from ±1.5 m and ±π."""
    edge = np.array([1.5, 1.5, math.pi])
    drawn = np.random.default_rng(seed).uniform(-edge, edge, (count, 3))
    return [(x, y, turn) for x, y, turn in drawn.tolist()]


def test_an_error_is_the_placement_seen_from_the_robot() -> None:
    """A robot 1 m behind and .5 m to the left of its reference, heading to the left."""
    robot = rpctl.load("paper")
    state = reference_by_name(robot, "line")(0.0)
    e = Placement(-1.0, 0.5, 0.5 * math.pi).error()
    assert e == pytest.approx((-0.5, -1.0, -0.5 * math.pi))
    q = robot.configuration(-1.0, 0.5, 0.5 * math.pi)
    np.testing.assert_allclose(tracking_error(robot, state, q)[:3], e, atol=1e-12)
    for error in drawn_errors(9, 3):
        assert placement(error).error() == pytest.approx(error)


def test_the_grid_fills_the_square_and_the_circle() -> None:
    found = np.array([placement(error) for error in start_errors(200)])
    assert len(found) == 200
    assert np.abs(found[:, :2]).max() == pytest.approx(1.5)
    assert len({tuple(row) for row in found.round(6)}) == 200
    headings = np.unique(found[:, 2].round(6))
    np.testing.assert_allclose(np.diff(headings), 0.25 * math.pi, atol=1e-5)
    assert len(start_errors(16)) == 16


def test_what_counts_as_converged() -> None:
    lost: list[dict[str, Any]] = [{"outcome": "diverging"}, {"violations": ("wheel effort",)},
                                  {"settled_at": None}]  # fmt: skip
    assert converged(HOME)
    assert not any(converged(replace(HOME, **change)) for change in lost)
    group = [HOME, replace(HOME, settled_at=20.0), replace(HOME, settled_at=None),
             replace(HOME, outcome="stuck"), Figures("refused")]  # fmt: skip
    start = Start("unified", None, RUN)
    (found,) = fractions([Row(start, each) for each in group])
    assert found == Fraction("unified", "eight", 5, 2, 2, 1, 20.0)
    assert found.undecided == 1


def test_colours_say_what_became_of_a_start() -> None:
    others = [replace(HOME, settled_at=None), replace(HOME, outcome="stuck"), Figures("refused")]
    times = picture.time_colours()
    soon, late = (picture.colour_of(replace(HOME, settled_at=t), times) for t in (4.0, 40.0))
    assert sum(soon) < sum(late)  # lighter
    slipped = replace(HOME, settled_at=4.0, outcome="slips")  # converged, as the figures count it
    assert picture.colour_of(slipped, times) == soon
    colours = [picture.colour_of(each, times) for each in others]
    assert colours == [picture.UNDECIDED, picture.FAILED, picture.NOT_TAKEN]


@pytest.mark.slow
def test_the_command_writes_what_it_found(tmp_path: Path) -> None:
    words = ["attraction", "omni", "--references", "line", "--starts", "16", "--duration", "0.1"]
    result = CliRunner().invoke(app, [*words, "--workers", "1", "--out", str(tmp_path), "--json"])
    assert result.exit_code == 0, result.output
    shown = json.loads(result.stdout)
    assert shown == json.loads((tmp_path / "attraction.json").read_text())
    assert (tmp_path / "attraction.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "attraction.pdf").read_bytes().startswith(b"%PDF")
    assert len(shown["starts"]) == 16
    (figures,) = shown["fractions"]
    assert figures["starts"] == 16 and figures["converged"] == 0 and figures["undecided"] == 16
    for words, told in (
        (["--laws", "unfied"], "did you mean"),
        (["--duration", "0"], "positive"),
    ):
        result = CliRunner().invoke(app, ["attraction", "omni", *words, "--out", str(tmp_path)])
        assert result.exit_code == 2
        assert told in result.output


def run_start(robot: str, law: str, reference: str, seconds: float, error: Any) -> Figures:
    """Return what becomes of a start, with samples at 50 Hz."""
    run = replace(RUN, reference=reference, duration=seconds, initial_error=error)
    run = replace(run, control_period=0.02, plant_step=0.02)
    return CellRunner(References(rpctl.load(robot)))(Start(law, "integral", run))


def test_a_run_away_is_told() -> None:
    """The paper's law has no leash: it ends far away, and no success is claimed."""
    ending = run_start("paper", "paper", "reverse", 12.0, FAR)
    assert not ending.succeeded and not converged(ending)


def no_run_away(ending: Figures) -> None:
    """Every start converges within limits, or says that it failed, or that it is late."""
    if converged(ending) or not ending.succeeded:
        return
    assert ending.outcome == "late", ending
    assert ending.final_base is not None and ending.final_base < 2.0, ending


def test_a_far_start_comes_home() -> None:
    """One that ran 23 m away before; the whole grid runs in ``make thorough``."""
    assert converged(run_start("paper", "unified", "reverse", 14.0, FAR))


@pytest.mark.parametrize(("drive", "law", "reference"), cells(GRID, slow=SLOW))
def test_no_start_runs_away(drive: str, law: str, reference: str) -> None:
    runner = CellRunner(References(rpctl.load(drive)))
    count = 4 if (drive, law, reference) in SLOW else 200
    run = replace(RUN, reference=reference, duration=60.0)
    rows = [
        Row(start, runner(start))
        for error in drawn_errors(count, 7)
        for start in [Start(law, "integral", replace(run, initial_error=error))]
    ]
    for row in rows:
        no_run_away(row.figures)
    (found,) = fractions(rows)
    if law == "unified" and found.refused == 0:
        assert found.converged >= 0.95 * found.starts, found
