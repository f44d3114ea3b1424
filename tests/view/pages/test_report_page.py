"""The page of a run in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.view.pages.report import write_report
from tests.view.chromium import (
    CLIPPED,
    changed,
    covering,
    opened,
    picture_at,
    wait,
)


@pytest.fixture(scope="module")
def report(paper: Robot, paper_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("browser") / "report.html"
    return write_report(paper_run, path, robot=paper)


@pytest.fixture(scope="module")
def comparison(paper: Robot, paper_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("browser") / "compare.html"
    error = (-0.3, 0.4, 0.2)
    other = rpctl.track(paper, "eight", duration=2.0, initial_error=error)
    return write_report([paper_run, other], path, names=["near", "far"])


@pytest.fixture(scope="module")
def shared(browser: Any, report: Path) -> Iterator[Any]:
    with opened(browser, report.as_uri()) as page:
        yield page


@pytest.fixture
def page(shared: Any) -> Any:
    """One page for many tests, paused at its start: what a test switches, it switches back."""
    shared.evaluate("rpctl.seek(0)")
    return shared


def show(page: Any, name: str, visible: bool) -> None:
    script = f"rpctl.viewer.scene.getObjectByName('{name}').visible = {str(visible).lower()}"
    page.evaluate(script)


@pytest.mark.slow
def test_robot_is_drawn_and_moves(page: Any, paper_run: Run) -> None:
    middle = 0.5 * float(paper_run.t[-1])
    show(page, "trails", False)
    start, later = picture_at(page, 0.0), picture_at(page, middle)
    show(page, "robots", False)
    empty = picture_at(page, 0.0)
    for name in ("trails", "robots"):
        show(page, name, True)
    assert changed(start, empty) > 2000
    assert changed(later, empty) > 2000
    assert changed(start, later) > 1000


@pytest.mark.slow
@pytest.mark.quick
def test_animation_puts_the_robot_where_the_run_says(page: Any, paper_run: Run) -> None:
    for sample in (0, len(paper_run.t) // 2, len(paper_run.t) - 1):
        position = page.evaluate(
            """(time) => { rpctl.pause(); rpctl.seek(time);
            return rpctl.viewer.scene.getObjectByName('robot-1').position.toArray(); }""",
            float(paper_run.t[sample]),
        )
        assert position[:2] == pytest.approx(paper_run.q[sample, :2], abs=2e-3)


@pytest.mark.slow
def test_scrubber_keys_and_play(page: Any, paper_run: Run) -> None:
    end = float(paper_run.t[-1])
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


def over(page: Any, title: str, share: float) -> tuple[float, float, float]:
    """Return where (x, y) a plot's share of the width is, px, after scrolling there; its time."""
    plot = page.locator(".chart", has=page.get_by_role("heading", name=title)).locator(".u-over")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    assert box is not None
    time = page.evaluate(
        """([title, share]) => { const { plot } = rpctl.charts.find((c) => c.title === title);
        return plot.posToVal(share * plot.over.clientWidth, "x"); }""",
        [title, share],
    )
    return box["x"] + share * box["width"], box["y"] + 0.5 * box["height"], float(time)


@pytest.mark.slow
def test_drag_zooms_all_plots_and_does_not_seek(page: Any, paper_run: Run) -> None:
    page.evaluate("rpctl.seek(0.25)")
    shown = "rpctl.charts.map((c) => [c.plot.scales.x.min, c.plot.scales.x.max])"
    left, y, start = over(page, "Base error", 0.4)
    right, _, end = over(page, "Base error", 0.8)
    page.mouse.move(left, y)
    page.mouse.down()
    page.mouse.move(0.5 * (left + right), y)
    page.mouse.move(right, y)
    page.mouse.up()
    for low, high in page.evaluate(shown):
        assert (low, high) == (pytest.approx(start, abs=0.02), pytest.approx(end, abs=0.02))
    assert page.evaluate("rpctl.time()") == pytest.approx(0.25)
    page.get_by_role("button", name="Whole time").click()
    assert all(pair == [0, paper_run.t[-1]] for pair in page.evaluate(shown))


@pytest.mark.slow
def test_scene_legend_hides_what_it_names(page: Any) -> None:
    page.evaluate("rpctl.seek(1)")
    for name, node in (
        ("Reference robot", "reference-1"),
        ("End effector", "trail-tip"),
        ("Ground reactions", "stance-loads"),
        ("Support, zero-moment point", "stance-polygon"),
    ):
        entry = page.locator(".legend").get_by_role("button", name=name)
        visible = f"rpctl.viewer.scene.getObjectByName('{node}').visible"
        assert page.evaluate(visible)
        entry.click()
        assert not page.evaluate(visible)
        assert entry.get_attribute("aria-pressed") == "false"
        entry.click()
        assert page.evaluate(visible)


@pytest.mark.slow
def test_efforts_colour_the_joints(page: Any, paper: Robot, paper_run: Run) -> None:
    shares = np.abs(paper_run.tau) / np.array(paper_run.robot.effort_limits)
    shares[paper_run.t < 0.5] = 0.0  # the efforts of the first moments last less than a frame
    sample, actuator = np.unravel_index(shares.argmax(), shares.shape)
    joint = paper.model.getJointId(paper_run.robot.actuators[actuator])
    colour = f"""() => {{ let found;
        rpctl.viewer.scene.getObjectByName('robot-{joint}').traverse((node) => {{
          if (node.material) found = found || node.material.color.toArray(); }});
        return found; }}"""
    page.evaluate("(time) => { rpctl.pause(); rpctl.seek(time); }", float(paper_run.t[sample]))
    own, scale = np.array(page.evaluate(colour)), page.locator("[data-key=effort]")
    assert not scale.is_visible()
    switch = page.get_by_role("button", name="Effort as colour")
    switch.click()
    coloured = np.array(page.evaluate(colour))
    ramp, ticks = (scale.locator(each).bounding_box() for each in ("i", "span"))
    assert (ramp["x"], ramp["width"]) == (ticks["x"], ticks["width"])
    assert ticks["y"] >= ramp["y"] + ramp["height"]
    switch.click()
    assert not scale.is_visible()
    np.testing.assert_array_equal(page.evaluate(colour), own)
    part = 0.92 * min(2.0 * float(shares[sample, actuator]), 1.0)
    amber = np.array([0xF2, 0xB7, 0x05]) / 255
    assert part > 0.05
    np.testing.assert_allclose(coloured, own + part * (amber - own), atol=0.02)


@pytest.mark.slow
def test_ground_reactions_stand_at_the_contacts(page: Any, paper_run: Run) -> None:
    sample = len(paper_run.t) // 2
    bases, lengths = page.evaluate(
        """(time) => { rpctl.pause(); rpctl.seek(time); rpctl.viewer.render();
        const loads = rpctl.viewer.scene.getObjectByName('stance-loads');
        const robots = loads.parent.parent;
        const place = (arrow) => robots.worldToLocal(
          arrow.getWorldPosition(new MeshCat.THREE.Vector3())).toArray();
        return [loads.children.map(place),
          loads.children.map((arrow) => arrow.children[1].position.y)]; }""",
        float(paper_run.t[sample]),
    )
    x, y, cos, sin = paper_run.q[sample, :4]
    points = np.array(paper_run.ground.points) @ np.array([[cos, sin], [-sin, cos]]) + [x, y]
    np.testing.assert_allclose(np.array(bases)[:, :2], points, atol=3e-3)
    order = np.argsort(paper_run.log.contact_load[sample])
    np.testing.assert_array_equal(np.argsort(lengths), order)


@pytest.mark.slow
def test_light_and_dark(browser: Any, report: Path) -> None:
    paper = "getComputedStyle(document.body).backgroundColor"
    trail = "rpctl.viewer.scene.getObjectByName('trail-base').material.color.getHexString()"
    stroke = "rpctl.charts[0].plot.series.at(-1).stroke()"
    looks = f"[{paper}, {trail}, {stroke}]"
    with opened(browser, report.as_uri(), color_scheme="light") as page:
        light = page.evaluate(looks)
        page.get_by_role("button", name="Dark page").click()
        switched = page.evaluate(looks)
    with opened(browser, report.as_uri(), color_scheme="dark") as page:
        dark = page.evaluate(looks)
        page.keyboard.press("d")
        assert page.evaluate(looks) == light
    assert switched == dark
    assert all(a != b for a, b in zip(light, dark, strict=True))


@pytest.mark.slow
def test_comparison_shows_both_runs(browser: Any, comparison: Path) -> None:
    with opened(browser, comparison.as_uri()) as page:
        show(page, "trails", False)
        both = picture_at(page, 0.0)
        page.locator(".legend").get_by_role("button", name="far").click()
        one = picture_at(page, 0.0)
        page.locator(".legend").get_by_role("button", name="near").click()
        none = picture_at(page, 0.0)
        assert changed(both, one) > 500
        assert changed(one, none) > 500
        names = page.locator(".chart").first.locator(".key .label").all_inner_texts()
        assert names == ["near", "far"]
        choice = page.get_by_label("Quantity shown in Joint errors")
        before = page.evaluate("[...rpctl.charts[2].plot.data[1]].slice(0, 9)")
        choice.select_option(index=1)
        assert page.evaluate("[...rpctl.charts[2].plot.data[1]].slice(0, 9)") != before


@pytest.mark.parametrize("width", [1280, pytest.param(400, marks=pytest.mark.slow), 320])
def test_page_fits_its_window(browser: Any, report: Path, width: int) -> None:
    with opened(browser, report.as_uri(), viewport={"width": width, "height": 844}) as page:
        page.get_by_role("button", name="Effort as colour").click()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert covering(page, "#scene") == []
        assert page.evaluate(CLIPPED, ".legend button, .key .label") == []
        scene = page.locator("#scene canvas").bounding_box()
        plot = page.locator(".chart .u-over").first.bounding_box()
        assert scene is not None
        assert plot is not None
        assert scene["width"] > 0.5 * width
        assert plot["width"] > min(0.6 * width, 200)
        assert plot["x"] + plot["width"] <= width
        if width > 860:
            assert page.evaluate("document.documentElement.scrollHeight") <= 844
        if width < 860:  # the plots lie under the scene, which stays in view beside them
            page.locator(".chart").nth(4).scroll_into_view_if_needed()
            assert page.get_by_role("slider").is_visible()
            assert page.evaluate("document.querySelector('.stage').getBoundingClientRect().y") == 0


@pytest.mark.slow
def test_errors_are_linear_until_a_logarithm_is_chosen(page: Any, paper_run: Run) -> None:
    """From -1 µm at least; a line below zero is drawn below it, by choice its size."""
    card = page.locator(".chart", has_text="Base error").first
    state = """() => { const { plot } = rpctl.charts[0], { y } = plot.scales;
      const line = plot.series.findIndex((each) => each.line === 2);
      return [y.distr || 1, y.min, Math.min(...plot.data[line])]; }"""
    distribution, low, least = page.evaluate(state)
    assert distribution == 1
    assert low <= -1e-6
    assert least == pytest.approx(float(paper_run.log.e[:, 1].min()), rel=1e-5)
    card.locator("button.scale").click()
    distribution, low, least = page.evaluate(state)
    assert distribution == 3
    assert low > 0.0 and least > 0.0
    assert card.locator(".unit").inner_text().endswith(", absolute value")
    card.locator("button.scale").click()
    assert page.evaluate(state)[0] == 1
    efforts = page.locator(".chart", has_text="Efforts").first
    assert "% of limit" in efforts.locator(".unit").inner_text()
    told = efforts.locator(".key b").all_inner_texts()
    assert told and all(text.endswith(" %") for text in told)
