from __future__ import annotations

import base64
import io
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rpctl import Robot, Run
from rpctl.view.report import write_report

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next((path for path in map(shutil.which, BROWSERS) if path), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on PATH")
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
LOCAL = ("file:", "data:", "blob:")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def report(paper: Robot, paper_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("browser") / "report.html"
    return write_report(paper_run, path, robot=paper)


@pytest.fixture
def page(browser: Any, report: Path) -> Iterator[Any]:
    """Open the report; in the end it has complained of nothing and fetched nothing."""
    context = browser.new_context(viewport={"width": 900, "height": 600})
    page = context.new_page()
    problems: list[str] = []
    page.on("console", lambda m: problems.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda r: None if r.url.startswith(LOCAL) else problems.append(r.url))
    page.goto(report.as_uri())
    wait(page, "window.rpctl && window.rpctl.ready")
    yield page
    context.close()
    assert problems == []


def wait(page: Any, condition: str) -> None:
    """Wait until a condition holds; Playwright's own wait runs text, which the page forbids."""
    for _ in range(600):
        if page.evaluate(f"Boolean({condition})"):
            return
        page.wait_for_timeout(50)
    pytest.fail(f"after 30 s still not: {condition}")


def draw(page: Any, time: float) -> np.ndarray[Any, Any]:
    """Return the picture (h, w, 4) of the scene at a time, s."""
    script = """(time) => { rpctl.pause(); rpctl.seek(time); rpctl.viewer.render();
        return rpctl.viewer.renderer.domElement.toDataURL(); }"""
    data = base64.b64decode(page.evaluate(script, time).partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA")).astype(int)


def hide(page: Any, name: str) -> None:
    page.evaluate(f"rpctl.viewer.scene.getObjectByName('{name}').visible = false")


def changed(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> int:
    return int((np.abs(a - b).max(axis=2) > 24).sum())


def test_robot_is_drawn_and_moves(page: Any, paper_run: Run) -> None:
    middle = 0.5 * float(paper_run.t[-1])
    hide(page, "trails")
    start, later = draw(page, 0.0), draw(page, middle)
    hide(page, "robots")
    empty = draw(page, 0.0)
    assert changed(start, empty) > 2000
    assert changed(later, empty) > 2000
    assert changed(start, later) > 1000


def test_animation_puts_the_robot_where_the_run_says(page: Any, paper_run: Run) -> None:
    for sample in (0, len(paper_run.t) // 2, len(paper_run.t) - 1):
        position = page.evaluate(
            """(time) => { rpctl.pause(); rpctl.seek(time);
            return rpctl.viewer.scene.getObjectByName('robot-1').position.toArray(); }""",
            float(paper_run.t[sample]),
        )
        assert position[:2] == pytest.approx(paper_run.q[sample, :2], abs=2e-3)


def test_trail_of_the_base_grows(page: Any, paper_run: Run) -> None:
    def drawn(time: float) -> float:
        page.evaluate("(time) => rpctl.seek(time)", time)
        return float(
            page.evaluate(
                "rpctl.viewer.scene.getObjectByName('trail-base').geometry.drawRange.count"
            )
        )

    page.evaluate("rpctl.pause()")
    end = float(paper_run.t[-1])
    assert drawn(0.0) == 0
    assert 0.4 < drawn(0.5 * end) / drawn(end) < 0.6


def test_scrubber_keys_and_play(page: Any, paper_run: Run) -> None:
    end = float(paper_run.t[-1])
    page.evaluate("rpctl.pause()")
    page.locator("#scrubber").evaluate(
        "(slider) => { slider.value = 1.25; slider.dispatchEvent(new Event('input')); }"
    )
    assert page.evaluate("rpctl.time()") == pytest.approx(1.25)
    page.keyboard.press("End")
    assert page.evaluate("rpctl.time()") == pytest.approx(end)
    page.keyboard.press("Home")
    assert page.evaluate("rpctl.time()") == 0.0
    page.keyboard.press("ArrowRight")
    assert page.evaluate("rpctl.time()") == pytest.approx(1.0)
    assert not page.evaluate("rpctl.playing()")
    page.get_by_role("button", name="Play").click()
    wait(page, "rpctl.time() > 1.2")
    page.keyboard.press("Space")
    assert not page.evaluate("rpctl.playing()")


def test_it_plays_by_itself(page: Any) -> None:
    wait(page, "rpctl.time() > 0.1")
    assert page.get_by_role("button", name="Pause").is_visible()


def test_still_for_those_who_ask_for_it(browser: Any, report: Path) -> None:
    context = browser.new_context(reduced_motion="reduce")
    page = context.new_page()
    page.goto(report.as_uri())
    wait(page, "window.rpctl && window.rpctl.ready")
    assert not page.evaluate("rpctl.playing()")
    context.close()


@pytest.mark.parametrize("view", ["home", "top", "follow"])
def test_every_camera_shows_the_whole_robot(page: Any, view: str) -> None:
    page.evaluate("rpctl.pause(); rpctl.seek(1.0)")
    page.evaluate(f"rpctl.camera('{view}')")
    outside = page.evaluate(
        """() => { const { viewer } = rpctl; viewer.render();
        const point = new MeshCat.THREE.Vector3();
        let worst = 0;
        viewer.scene.traverse((node) => {
          if (!node.name.startsWith('part-')) return;
          const position = node.geometry.attributes.position;
          for (let k = 0; k < position.count; k++) {
            point.fromBufferAttribute(position, k).applyMatrix4(node.matrixWorld);
            point.project(viewer.camera);
            worst = Math.max(worst, Math.abs(point.x), Math.abs(point.y)); } });
        return worst; }"""
    )
    assert 0.2 < outside < 1.0


@pytest.mark.parametrize("width", [1280, 390])
def test_page_fits_its_window(browser: Any, report: Path, width: int) -> None:
    context = browser.new_context(viewport={"width": width, "height": 844})
    page = context.new_page()
    page.goto(report.as_uri())
    wait(page, "window.rpctl && window.rpctl.ready")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    scene = page.locator("#scene canvas").bounding_box()
    assert scene is not None
    assert scene["width"] > 0.6 * width
    context.close()


def test_without_webgl_the_page_says_so(browser: Any, report: Path) -> None:
    plain = browser.browser_type.launch(
        executable_path=CHROMIUM, args=["--disable-3d-apis", *FLAGS]
    )
    page = plain.new_page()
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(report.as_uri())
    assert page.locator("#failure").is_visible()
    assert page.get_by_text("Base, rms").is_visible()
    assert not page.get_by_role("slider").is_visible()
    plain.close()
    assert problems == []
