"""The picture of a contact trial shows what both sides did, each its own."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.equivalence.certificate import CONTACT_ORACLE
from rpctl.equivalence.contact.trial import ContactMotion, ContactTrial, Gap
from rpctl.equivalence.scope import Scope
from rpctl.equivalence.verify import Certificate
from rpctl.view.pages.certificate import (
    TrialChart,
    certificate_page,
    plan_view,
    trial_charts,
)

SCOPE = Scope("all", (), (), None)
COUNT = 201
T = np.linspace(0.0, 2.0, COUNT)


def motion(drift: float) -> ContactMotion:
    """Return a quarter turn to the left, of radius 1 m, that drifts ``drift`` m to the right."""
    turn = 0.25 * math.pi * T
    pose = np.column_stack([np.sin(turn) + drift * T, 1.0 - np.cos(turn), turn])
    load = np.column_stack([100.0 + 10.0 * T, 90.0 - 5.0 * T, 80.0 + 0.0 * T]) * (1.0 + drift)
    force = np.column_stack([5.0 * T, -3.0 * T, 270.0 + 0.0 * T]) * (1.0 + drift)
    efforts = np.column_stack([np.sin(T), 50.0 * np.cos(T)]) * (1.0 + drift)
    return ContactMotion(pose, load, force, pose[:, :2] + 0.1, efforts, np.zeros((COUNT, 0)))


def row(name: str, gap: float, band: float, unit: str = "m") -> Gap:
    where = {"sample": 150, "entry": "", "time": 1.5}
    return Gap(name, CONTACT_ORACLE, gap / band, 1.0, **where, gap=gap, band=band, unit=unit)  # type: ignore[arg-type]


@pytest.fixture
def trial() -> ContactTrial:
    return ContactTrial(
        checks=(row("path", 0.2, 0.3), row("heading", 0.0, 1e-3, "rad"), row("casters", 0.0, 1.0)),
        notes=("rollers & <such>",),
        contacts=("left", "right", "ball"),
        determinate=True,
        joints=("arm", "lift"),
        slides=(False, True),
        footprint=np.array([[0.0, 0.3], [0.0, -0.3], [0.4, 0.0]]),
        t=T,
        reduced=motion(0.1),
        engine=motion(0.0),
    )


def path(text: str) -> Array:
    """Return the points (n, 2) of a path of straight lines."""
    return np.array([[float(x) for x in pair.split()] for pair in text.strip("M").split("L")])


def test_paths_robots_and_tracks_stand_where_they_are(trial: ContactTrial) -> None:
    """A quarter turn on, the ball at (.4, 0) m ahead of the root lies .4 m to its left."""
    plan = plan_view(trial)
    for name in ("engine", "reduced"):
        pose = getattr(trial, name).pose
        np.testing.assert_allclose(path(plan["ways"][name]), pose[:, :2], atol=1e-4)
    stands = {kind: path(text) for kind, text in plan["stands"].items()}
    ends = {"start": (0.4, 0.0), "end engine": (1.0, 1.4), "end reduced": (1.2, 1.4)}
    for kind, tip in ends.items():
        assert np.abs(stands[kind] - tip).max(axis=1).min() < 1e-4
    for way, (x, y) in zip(map(path, plan["tracks"]), trial.footprint, strict=True):
        np.testing.assert_allclose(way[[0, -1]], [[x, y], [1.0 - y, 1.0 + x]], atol=1e-4)


def test_the_picture_holds_all_and_its_grid_counts_from_the_origin(trial: ContactTrial) -> None:
    plan = plan_view(trial)
    texts = [*plan["ways"].values(), *plan["stands"].values()]
    every, view = np.vstack([path(text) for text in texts]), plan["view"]
    places = (every - [view.left, view.top]) * [view.scale, -view.scale]
    size = np.array([plan["width"], view.height])
    np.testing.assert_allclose(places.min(axis=0), size - places.max(axis=0), atol=0.1)  # centred
    assert places.min() == pytest.approx(34.0, abs=0.1)
    left, bottom, right, top = plan["box"]
    for lines, low, high in ((plan["columns"], left, right), (plan["rows"], bottom, top)):
        assert lines == pytest.approx(0.2 * np.round(np.array(lines) / 0.2))
        assert low <= lines[0] < low + 0.2
        assert high - 0.2 < lines[-1] <= high
    start, end = plan["posts"]
    assert start["place"] == pytest.approx((-view.left * view.scale, view.top * view.scale))
    assert (start["text"], end["text"]) == ("start", "end")


def test_the_robots_move_as_they_did_in_real_time(trial: ContactTrial) -> None:
    plan = plan_view(trial)
    for name in ("engine", "reduced"):
        frames, pose = np.array(plan["moves"][name]), getattr(trial, name).pose
        at = frames[:-1, 0] * plan["clock"] / 100.0
        picked = np.round(at / 0.01).astype(int)
        np.testing.assert_allclose(at, T[picked])
        np.testing.assert_allclose(frames[:-1, 1:3], pose[picked, :2])
        np.testing.assert_allclose(frames[:-1, 3], 45.0 * T[picked])
        assert picked[[0, -1]].tolist() == [0, COUNT - 1]
        assert frames[-1].tolist() == [100.0, *frames[-2, 1:]]
        assert len(frames) == 42
    page = certificate_page(Certificate("robot", 1, 0, (), SCOPE, contact=trial))
    (block,) = re.findall(r"@keyframes roll-reduced\{(.*)\}", page)
    assert block.startswith("0.00%{transform:translate(0.0000px,0.0000px) rotate(0.000deg)}")
    assert block.count("%") == 42


def chart(trial: ContactTrial, title: str) -> TrialChart:
    (found,) = (each for each in trial_charts(trial) if each.chart.title == title)
    return found


def test_the_gap_is_drawn_under_its_band(trial: ContactTrial) -> None:
    """It grows to 200 mm where 300 mm are allowed."""
    gap = chart(trial, "Distance between the two paths")
    area, line, band = gap.chart.marks
    np.testing.assert_allclose(line.y, 100.0 * T, atol=1e-9)
    np.testing.assert_allclose(area.y, line.y)
    assert band.y.tolist() == [300.0, 300.0]
    assert gap.unit == "300 mm allowed"
    assert gap.chart.y.high > 300.0


@pytest.mark.parametrize(
    ("title", "determinate", "part", "columns"),
    [
        ("Wheel loads", True, "load", [0, 1, 2]),
        ("Horizontal force of the ground", False, "force", [0, 1]),
        ("Torques of the joints", True, "efforts", [0]),
    ],
)
def test_charts_hold_both_sides(
    trial: ContactTrial, title: str, determinate: bool, part: str, columns: list[int]
) -> None:
    shown = chart(dataclasses.replace(trial, determinate=determinate), title).chart
    for marks, side in ((shown.marks[0::2], trial.engine), (shown.marks[1::2], trial.reduced)):
        np.testing.assert_array_equal([mark.y for mark in marks], getattr(side, part)[:, columns].T)
        assert [mark.colour for mark in marks] == [f"c{k}" for k in range(len(columns))]
    every = np.concatenate([mark.y for mark in shown.marks])
    assert shown.y.low <= every.min() < every.max() <= shown.y.high


def test_a_gap_too_wide_is_told(trial: ContactTrial) -> None:
    failed = dataclasses.replace(trial, checks=(row("path", 0.2, 0.1), *trial.checks[1:]))
    certificate = Certificate("robot", 1, 0, (), SCOPE, contact=failed)
    page = certificate_page(certificate)
    assert "the two paths come <strong>200 mm</strong> apart, where 100 mm is allowed" in page
    assert '<span class="badge bad">1 of 3 gaps too wide</span>' in page
    assert "<td>200 mm &gt; 100 mm ✗</td>" in page
    first, *others = re.findall(r"<figure([^>]*)><figcaption>", page)
    assert first == ' class="failed"'
    assert not any(others)
    assert "not verified" in page


def test_a_path_that_breaks_off_is_drawn_as_far_as_it_goes(trial: ContactTrial) -> None:
    parts = {name: values.copy() for name, values in vars(trial.reduced).items()}
    for values in parts.values():
        values[120:] = np.nan
    lost = dataclasses.replace(
        trial, reduced=ContactMotion(**parts), checks=(row("path", math.inf, 0.3),)
    )
    page = certificate_page(Certificate("robot", 1, 0, (), SCOPE, contact=lost))
    assert "nan" not in page.partition("<main>")[2]
    assert "∞" in page or "inf" in page
    plan = plan_view(lost)
    assert len(path(plan["ways"]["reduced"])) == 120
    assert plan["moves"]["reduced"][-1][3] == pytest.approx(45.0 * T[119])
