"""Names as legends show them, on pages and on paper."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpctl import Run
from rpctl.robot.model import Robot
from rpctl.view.labels import FITTING_LENGTH, ShortNames, fold, shorten
from rpctl.view.pages.motion_data import chart_data
from rpctl.view.pages.report import write_report
from rpctl.view.plots.figures import tracking_figure
from tests.grids import every
from tests.runs import vary
from tests.view.chromium import CLIPPED, opened

ARM = tuple(
    f"summit_xl_arm_{part}_joint"
    for part in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "hand_tilt")
)


@pytest.mark.parametrize(
    ("names", "short", "shared"),
    [
        (ARM, "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 hand_tilt",
         "summit_xl_arm_…_joint"),
        (("torso_lift_joint", "arm_1_joint"), "torso_lift arm_1", ""),
        (("summit_xl_arm_1_joint", "summit_xl_arm_2_joint"), "arm_1 arm_2", "summit_xl_…_joint"),
        (("wheel_left_joint", "wheel_right_joint"), "wheel_left wheel_right", ""),  # they fit
        (("a_very_long_name_joint",), "a_very_long_name", ""),  # of one, all would be shared
        (("robot_base_lift", "robot_base_lift_joint"), "lift lift_joint", "robot_base_…"),
        (("robot_arm_upper", "robot_arm_upper_roll"), "upper upper_roll", "robot_arm_…"),
        (("1_joint", "2_joint"), "1_joint 2_joint", ""),
        (("robot_arm_upper_joint", "robot_arm_elbow"), "upper elbow", "robot_arm_…"),
        (("left/front_wheel_motor", "left/rear_wheel_motor"), "front_wheel_motor rear_wheel_motor",
         "left/…"),
        (("leftfrontwheelmotor", "leftrearmotor"), "leftfrontwheelmotor leftrearmotor", ""),
        (("_joint", "x_joint"), "_joint x", ""),
        ((), "", ""),
    ],
)  # fmt: skip
def test_names_lose_what_they_share(names: tuple[str, ...], short: str, shared: str) -> None:
    assert shorten(names) == ShortNames(tuple(short.split()), shared)


@pytest.mark.parametrize("seed", range(20))
def test_short_names_can_be_told_apart_and_completed(seed: int) -> None:
    random = np.random.default_rng(seed)
    words = ["arm", "left", "1", "2", "joint", "wheel", "robot_xl", "a"]
    prefix = "_".join(random.choice(words, random.integers(0, 4)))
    names = ["_".join(random.choice(words, random.integers(1, 4))) for _ in range(6)]
    names = [f"{prefix}_{name}".strip("_") for name in names]
    short = shorten(names)
    assert len(set(short.names)) == len(set(names))
    assert all(any(map(str.isalpha, s)) or s == n for s, n in zip(short.names, names, strict=True))
    left, _, right = short.shared.partition("…")
    for name, stem in zip(names, short.names, strict=True):
        assert name in (f"{left}{stem}{right}", f"{left}{stem}_joint")
    assert not short.shared or max(map(len, names)) > FITTING_LENGTH


def renamed(run: Run, names: Sequence[str]) -> Run:
    """Return the run with other names for its actuators, in their order."""
    new = dict(zip(run.robot.actuators, names, strict=False))
    keys = ("actuators", "joint_names", "quasi_velocities")
    return vary(run, **{k: tuple(new.get(n, n) for n in getattr(run.robot, k)) for k in keys})


@pytest.fixture(scope="module")
def long_run(golden: Run) -> Run:
    """A run of five joints with long names."""
    return renamed(golden, ARM)


def test_charts_say_once_what_their_names_share(long_run: Run) -> None:
    charts = {chart["title"]: chart for chart in chart_data([long_run], ["one"])["charts"]}
    (efforts,) = charts["Efforts"]["variants"]
    assert [line["label"] for line in efforts["lines"]] == [
        "shoulder_pan",
        "elbow",
        "wrist_1",
        "wrist_2",
    ]
    assert efforts["names"] == "summit_xl_arm_…_joint"
    assert "names" not in charts["Base error"]["variants"][0]
    compared = {c["title"]: c for c in chart_data([long_run] * 2, ["one", "two"])["charts"]}
    labels = [variant["label"] for variant in compared["Efforts"]["variants"]]
    assert labels == ["shoulder_pan", "elbow", "wrist_1", "wrist_2"]
    assert compared["Efforts"]["variants"][0]["note"] == "dashed: limits; summit_xl_arm_…_joint"
    assert [line["label"] for line in compared["Efforts"]["variants"][0]["lines"]] == ["one", "two"]
    runs = chart_data([long_run] * 2, ["summit_xl_of_monday", "summit_xl_of_friday"])["charts"]
    variant = next(chart for chart in runs if chart["title"] == "Base error")["variants"][0]
    assert [line["label"] for line in variant["lines"]] == ["monday", "friday"]
    assert variant["names"] == "summit_xl_of_…"


@pytest.mark.parametrize(("column", "share"), every(4, product((True, False), repeat=2)))
def test_legends_on_paper_are_whole(long_run: Run, column: bool, share: bool) -> None:
    longest = [f"{letter}_name_that_{60 * 'n'}" for letter in "abcde"]
    run = long_run if share else renamed(long_run, longest)
    figure = tracking_figure(run, column=column)
    figure.draw_without_rendering()
    width, height = figure.get_size_inches() * figure.dpi
    (common,) = figure.legends
    legends = [common, *filter(None, (axes.get_legend() for axes in figure.axes))]
    for legend in legends:
        box = legend.get_window_extent()
        assert -1 <= box.x0 < box.x1 <= width + 1
        assert -1 <= box.y0 < box.y1 <= height + 1
    outlines = []
    for axes in figure.axes:
        around = axes.get_tightbbox()
        assert around is not None
        assert around.y0 > common.get_window_extent().y1 - 1
        assert -1 <= around.x0 < around.x1 <= width + 1
        assert around.y1 <= height + 1
        outlines.append(around)
    assert not any(one.overlaps(other) for one, other in combinations(outlines, 2))
    title = common.get_title().get_text()
    assert title == ("summit_xl_arm_…_joint" if share else "")


@pytest.mark.parametrize(
    ("name", "folded"),
    [
        ("short", "short"),
        ("front_left_wheel", "front_left_\nwheel"),
        ("force / (friction · load)", "force /\n(friction ·\nload)"),
        ("abcdefghijklmnop_q", "abcdefghijkl\nmnop_q"),
        ("a-b", "a-b"),
    ],
)
def test_names_are_folded_at_their_separators(name: str, folded: str) -> None:
    assert fold(name, 12) == folded


@pytest.mark.parametrize("width", [1280, 400, 320])
def test_legends_of_a_report_are_whole(
    browser: Any, paper: Robot, paper_run: Run, tmp_path: Path, width: int
) -> None:
    run = renamed(paper_run, [f"a_robot_of_many_words_{k}_arm" for k in "abcdefghi"])
    path = write_report([run, paper_run], tmp_path / "report.html", names=["a" * 70, "b_" * 40])
    with opened(browser, path.as_uri(), viewport={"width": width, "height": 800}) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(CLIPPED, ".legend button, .key .label, .keys .names") == []
