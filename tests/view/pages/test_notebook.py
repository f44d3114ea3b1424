from __future__ import annotations

import re
import shutil
import subprocess
import sys
from html import unescape
from typing import Any

import pytest

from rpctl import Run
from rpctl.errors import RunFileError
from rpctl.view import film as browser
from rpctl.view import film as notebook
from tests.runs import vary

EVIL = '"></iframe><script>alert(1)</script>'


def page_inside(html: str) -> str:
    """Return the page in a notebook's frame."""
    return unescape(html.partition('srcdoc="')[2].partition('" style')[0])


@pytest.fixture
def shown(paper_run: Run) -> dict[str, Any]:
    """Run a cell in IPython and return what it displays, by type."""
    shell = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell()
    shell.extension_manager.load_extension("rpctl")
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


def test_importing_rpctl_in_a_notebook_is_enough() -> None:
    pytest.importorskip("IPython")
    code = "import rpctl; html = get_ipython().display_formatter.formatters['text/html'];"
    code += "print(html.lookup_by_type('rpctl.simulation.run.run.Run'))"
    command = [sys.executable, "-m", "IPython", "--quick", "-c", code]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "load_ipython_extension" in printed


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
