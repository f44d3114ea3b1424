from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html import unescape
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Run
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.scope import Scope
from rpctl.errors import RunFileError
from rpctl.study.experiment import Experiment, RunTable
from rpctl.view import film as browser
from rpctl.view import film as notebook
from tests.grids import cells as grid
from tests.runs import vary

SCOPE = Scope("all", (), (), None)
EVIL = '"></iframe><script>alert(1)</script>'


def page_inside(html: str) -> str:
    """Return the page in a notebook's frame."""
    return unescape(html.partition('srcdoc="')[2].partition('" style')[0])


@pytest.fixture
def shown(paper_run: Run) -> dict[str, Any]:
    """Run a cell in IPython and return what it displays, by type."""
    shell = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell()
    shell.user_ns["run"] = paper_run
    cell = shell.run_cell("run", store_history=False)
    assert cell.success
    data, _ = shell.display_formatter.format(cell.result)
    return dict(data)


def test_a_cell_shows_the_scene(shown: dict[str, Any]) -> None:
    assert shown["text/plain"] == "Run(paper, eight, 3 s)"
    html = shown["text/html"]
    assert "<p>paper, eight, 3 s; final error: base " in html
    assert 'sandbox="allow-scripts"' in html
    assert len(html) < 3_000_000
    assert "const { viewer, duration, show } = player;" in page_inside(html)


@pytest.mark.parametrize("first", grid(("rpctl", "IPython"), ["rpctl"], ["IPython"]))
def test_a_robot_is_shown_whichever_is_imported_first(first: str) -> None:
    pytest.importorskip("IPython")
    code = f"import {first}, rpctl; from IPython.core.interactiveshell import *;"
    code += "shell = InteractiveShell(); robot = rpctl.load('paper');"
    code += "print(shell.display_formatter.format(robot)[0]['text/html'])"
    command = [sys.executable, "-c", code]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "<b>paper</b>: differential drive" in printed


def cells(html: str) -> list[list[str]]:
    """Return the rows of all tables, without their heads."""
    rows = re.findall("<tr>(<td.*?)</tr>", html)
    return [[unescape(re.sub("<.*?>", "", cell)) for cell in row.split("</td>")] for row in rows]


def test_a_robot_shows_its_wheels_speeds_and_limits() -> None:
    robot = rpctl.load("paper")
    rows = cells(robot._repr_html_())
    assert ["wheel_left_joint", "0.15 m", "root link", "yes", ""] in rows  # r and τ of [MS21]
    assert ["omega", "rad/s", "–", "–", ""] in rows
    assert ["arm_prismatic_joint", "m/s", "0.35 m", "0.95 m", ""] in rows
    assert ["arm_prismatic_joint", "120 N", "0.6 m/s", ""] in rows
    assert "38 kg, 4 quasi-velocities" in robot._repr_html_()  # 30 + 2 of wheels + 4 + 2


def test_a_summary_shows_the_errors_and_what_became_of_the_run(paper_run: Run) -> None:
    summary = replace(
        paper_run.summary, outcome="late", rms_base_error=0.0125, rms_end_effector_error=0.5
    )
    html = summary._repr_html_()
    rows = {row[0]: row[1:] for row in cells(html)}
    assert "<b>late</b>" in html
    assert rows["base"][0] == "12.5 mm"
    assert rows["end effector"][0] == "500 mm"
    peak = summary.efforts[-1]
    assert cells(html)[-1] == [peak.actuator, f"{peak.peak:.4g}", f"{peak.limit:.4g}", ""]
    bare = replace(summary, rms_end_effector_error=None)._repr_html_()
    assert "end effector" not in {row[0] for row in cells(bare)}


def test_rollouts_show_outcomes_and_quantiles() -> None:
    index, names = np.arange(4), ("run.size",)
    merits = {"rms_base_error": np.array([0.1, 0.3, math.inf, 0.2])}
    outcomes = ("tracked", "away", "away", "tracked")
    table = RunTable(index, {}, merits, {}, np.zeros(0), outcomes, ("",) * 4)
    made = rpctl.Rollouts(
        experiment=Experiment(rpctl.Config()),
        names=names,
        parameters=np.ones((4, 1)),
        results=table,
    )
    html = made._repr_html_()
    assert "<b>4 runs</b>: 50.0 % succeeded; run.size differ" in html
    assert cells(html) == [
        ["tracked", "2", ""],
        ["away", "2", ""],
        ["base error, rms", "0.2 m", "∞ m", "∞ m", ""],
    ]


def test_a_certificate_shows_its_rows() -> None:
    checks = (Check("M", "G", 2e-15, 1e-12), Check("h", "G", math.inf, 1e-12))
    proof = rpctl.Certificate(robot=EVIL, samples=3, seed=5, checks=checks, scope=SCOPE)
    html = proof._repr_html_()
    assert "not verified</b> at 3 random states, seed 5" in html
    assert cells(html) == [
        ["M", "G", "2e-15", "1e-12", "yes", ""],
        ["h", "G", "inf", "1e-12", "NO", ""],
    ]
    assert "<script>" not in html


def test_names_cannot_leave_a_table(paper_run: Run) -> None:
    assert "<script>" not in replace(rpctl.load("paper"), name=EVIL)._repr_html_()
    assert "<script>" not in replace(paper_run.summary, outcome_sentence=EVIL)._repr_html_()


def test_names_from_files_cannot_leave_the_frame(paper_run: Run) -> None:
    html = notebook.show(vary(paper_run, name=EVIL))
    assert "<script>" not in html
    assert html.count("<iframe") == html.count("</iframe>") == 1
    assert "alert(1)</script>" not in page_inside(html)


def test_a_run_that_cannot_be_drawn_is_told(
    paper_run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise RunFileError("cart.urdf: is another robot")

    monkeypatch.setattr(Run, "load_robot", refuse)
    html = notebook.show(paper_run)
    assert "cannot be drawn" in html
    assert "cart.urdf" in html


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, browser.BROWSER_NAMES)), reason="no chromium on PATH")
def test_the_frame_plays(shown: dict[str, Any], paper_run: Run) -> None:
    pytest.importorskip("playwright", reason="playwright is not installed")
    problems: list[str] = []
    with browser.open_page(shown["text/html"], 800, 600) as page:
        page.on("console", lambda m: problems.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        frame = page.frame_locator("iframe")
        frame.locator("canvas").wait_for()
        robot = "() => player.viewer.scene.getObjectByName('robot-1').position.toArray()"
        inside = page.frames[1]
        assert inside.evaluate(robot)[:2] == pytest.approx(paper_run.q[0, :2], abs=2e-3)
        frame.get_by_role("slider").press("End")
        scene, bar = (frame.locator(each).bounding_box() for each in ("canvas", ".bar"))
        assert scene is not None
        assert bar is not None
        assert scene["y"] + scene["height"] <= bar["y"]
        assert inside.evaluate(robot)[:2] == pytest.approx(paper_run.q[-1, :2], abs=2e-3)
        frame.get_by_role("button", name="Play").click()
        frame.get_by_role("button", name="Pause").wait_for()
    assert problems == []
    assert re.search(r"aspect-ratio: 1\.7778", shown["text/html"])
