"""The picture of a contact trial shows what both sides did, each its own."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.check import CONTACT_ORACLE
from rpctl.equivalence.contact.trial import ContactMotion, ContactTrial, Gap
from rpctl.view.pages.certificate import TrialChart, certificate_page, trial_charts

COUNT = 201
T = np.linspace(0.0, 2.0, COUNT)
PIXEL = 0.011  # of a picture's unit: points are written to a hundredth
BAR = 0.05  # what the bar's own two ends, so rounded, make of the picture's width


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


def points(svg: str, kind: str) -> list[Array]:
    """Return the points (n, 2) of every path of a class."""
    found = re.findall(rf'class="{kind}" d="M([^"Z]*)', svg)
    return [
        np.array([[float(x) for x in pair.split()] for pair in text.split("L")]) for text in found
    ]


def plan_view(trial: ContactTrial) -> tuple[str, str]:
    """Return the ground from above as SVG, and the page, whose style moves the robots."""
    page = certificate_page(Certificate("robot", 1, 0, (), contact=trial))
    return "<svg" + page.partition('<svg class="plan"')[2].partition("</svg>")[0], page


def scale(svg: str) -> float:
    """Return the units of the picture per m, by the bar: the edge of a square that it names."""
    found = re.search(r'class="bar" d="M-([\d.]+) -4V0H0V-4"', svg)
    label = re.search(r'y="-8" text-anchor="middle">([\d.]+) (c?m)</text>', svg)
    assert found is not None
    assert label is not None
    metres = float(label[1]) * (0.01 if label[2] == "cm" else 1.0)
    return float(found[1]) / metres


def test_both_paths_are_the_actual_ones(trial: ContactTrial) -> None:
    svg, _ = plan_view(trial)
    (engine,), (reduced,) = points(svg, "ribbon"), points(svg, "thread")
    size = scale(svg)
    for drawn, side in ((engine, trial.engine), (reduced, trial.reduced)):
        expected = side.pose[:, :2] * [size, -size]
        np.testing.assert_allclose(drawn - drawn[0], expected - expected[0], atol=BAR)
    np.testing.assert_allclose(reduced[-1] - engine[-1], [0.2 * size, 0.0], atol=BAR)
    np.testing.assert_allclose(reduced[0], engine[0], atol=PIXEL)


def test_the_robots_stand_where_they_end(trial: ContactTrial) -> None:
    """A quarter turn on, the ball at (.4, 0) m ahead of the root lies .4 m to its left."""
    svg, _ = plan_view(trial)
    size = scale(svg)
    (path,) = points(svg, "ribbon")
    corners = {kind: points(svg, f"stand {kind}")[0] for kind in ("start", "end engine")}
    ends = {"start": (path[0], [0.4, 0.0]), "end engine": (path[-1], [0.0, -0.4])}
    for kind, (root, arm) in ends.items():
        tip = root + size * np.array(arm)
        assert np.abs(corners[kind] - tip).max(axis=1).min() < BAR
    shifted = points(svg, "stand end reduced")[0] - corners["end engine"]
    np.testing.assert_allclose(shifted, np.tile([0.2 * size, 0.0], (3, 1)), atol=BAR)


def test_tracks_are_those_of_the_contacts(trial: ContactTrial) -> None:
    svg, _ = plan_view(trial)
    (text,) = re.findall(r'class="track" d="([^"]*)"', svg)
    ways = [
        np.array([[float(x) for x in pair.split()] for pair in way.split("L")])
        for way in text.split("M")[1:]
    ]
    (path,), size = points(svg, "ribbon"), scale(svg)
    assert len(ways) == 3
    for way, (x, y) in zip(ways, trial.footprint, strict=True):
        np.testing.assert_allclose(way[0] - path[0], [size * x, -size * y], atol=BAR)
        np.testing.assert_allclose(way[-1] - path[-1], [-size * y, -size * x], atol=BAR)


def box(svg: str) -> tuple[float, float]:
    """Return a picture's width and height."""
    (found,) = re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    return float(found[0]), float(found[1])


def test_the_grid_counts_from_the_worlds_origin(trial: ContactTrial) -> None:
    """The root link starts there, so two lines cross at the start; the rest are squares apart."""
    svg, _ = plan_view(trial)
    (text,), (width, height) = re.findall(r'class="grid" d="([^"]*)"', svg), box(svg)
    upright = [float(x) for x in re.findall(r"M([-\d.]+) 0V", text)]
    level = [float(y) for y in re.findall(r"M0 ([-\d.]+)H", text)]
    (path,) = points(svg, "ribbon")
    square = 0.2 * scale(svg)  # at most 14 of them across 1.75 m
    for lines, start, size in ((upright, path[0, 0], width), (level, path[0, 1], height)):
        assert min(abs(line - start) for line in lines) < BAR
        np.testing.assert_allclose(np.abs(np.diff(lines)), square, atol=BAR)
        assert -BAR <= min(lines) < square
        assert size + BAR >= max(lines) > size - square


def test_the_picture_holds_all_and_wastes_nothing(trial: ContactTrial) -> None:
    svg, _ = plan_view(trial)
    drawn = [*points(svg, "ribbon"), *points(svg, "thread")]
    for kind in ("start", "end engine", "end reduced"):
        drawn += points(svg, f"stand {kind}")
    every, size = np.vstack(drawn), np.array(box(svg))
    np.testing.assert_allclose(every.min(axis=0), size - every.max(axis=0), atol=1.0)  # centred
    assert every.min() == pytest.approx(34.0, abs=1.0)


def keyframes(css: str, kind: str) -> Array:
    """Return the share, x, y and turn of every keyframe of a robot (n, 4)."""
    (block,) = re.findall(rf"@keyframes roll-{kind}\{{(.*)\}}", css)
    frame = r"([\d.]+)%\{transform:translate\(([-\d.]+)px,([-\d.]+)px\) rotate\(([-\d.]+)deg\)\}"
    return np.array([[float(x) for x in found] for found in re.findall(frame, block)])


def test_the_robots_move_as_they_did_in_real_time(trial: ContactTrial) -> None:
    svg, css = plan_view(trial)
    for kind, line in (("engine", "ribbon"), ("reduced", "thread")):
        frames, (path,) = keyframes(css, kind), points(svg, line)
        (seconds,) = re.findall(rf"animation:roll-{kind} ([\d.]+)s linear infinite", css)
        at = frames[:-1, 0] * float(seconds) / 100.0
        picked = np.round(at / 0.01).astype(int)
        np.testing.assert_allclose(at, T[picked], atol=1e-3)
        np.testing.assert_allclose(frames[:-1, 1:3], path[picked], atol=PIXEL)
        np.testing.assert_allclose(frames[:-1, 3], -45.0 * T[picked], atol=1e-2)
        assert picked[[0, -1]].tolist() == [0, COUNT - 1]
        assert frames[-1].tolist() == [100.0, *frames[-2, 1:]]
        assert len(frames) == 42


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


def test_forces_are_shown_where_no_joint_turns(trial: ContactTrial) -> None:
    sliding = dataclasses.replace(trial, slides=(True, True))
    assert trial_charts(sliding)[-1].chart.title == "Forces of the joints"
    without = dataclasses.replace(trial, joints=(), slides=())
    assert len(trial_charts(without)) == 2


def test_the_five_joints_that_vary_most_are_shown(trial: ContactTrial) -> None:
    sizes = np.array([1.0, 7.0, 3.0, 2.0, 6.0, 5.0, 4.0])
    busy = {
        name: dataclasses.replace(getattr(trial, name), efforts=np.outer(T, sizes))
        for name in ("reduced", "engine")
    }
    names = tuple(f"joint_{size:g}" for size in sizes)
    many = dataclasses.replace(trial, joints=names, slides=(False,) * 7, **busy)
    shown = [mark.label for mark in chart(many, "Torques of the joints").chart.marks if mark.label]
    assert shown == ["joint_7", "joint_3", "joint_6", "joint_5", "joint_4"]


def test_the_page_tells_the_trial(trial: ContactTrial) -> None:
    certificate = Certificate("robot", 1, 0, (), contact=trial)
    page = certificate_page(certificate)
    assert "within <strong>200 mm</strong>" in page
    assert "<td>200 mm ≤ 300 mm</td><td>at 1.50 s</td>" in page
    assert "<td>0 mrad ≤ 1 mrad</td>" in page
    assert '<span class="badge good">both agree</span>' in page
    assert "rollers &amp; &lt;such&gt;" in page
    for foreign in ("<script", "<img", "url(", "http"):
        assert foreign not in page.replace("http-equiv", "")


def test_a_gap_too_wide_is_told(trial: ContactTrial) -> None:
    failed = dataclasses.replace(trial, checks=(row("path", 0.2, 0.1), *trial.checks[1:]))
    certificate = Certificate("robot", 1, 0, (), contact=failed)
    page = certificate_page(certificate)
    assert "the two paths come <strong>200 mm</strong> apart, where 100 mm is allowed" in page
    assert '<span class="badge bad">1 of 3 gaps too wide</span>' in page
    assert "<td>200 mm &gt; 100 mm ✗</td>" in page
    first, *others = re.findall(r"<figure([^>]*)><figcaption>", page)
    assert first == ' class="failed"'
    assert not any(others)
    assert "not equivalent" in page


def test_a_certificate_without_a_trial_has_no_picture() -> None:
    assert "<svg" not in certificate_page(Certificate("robot", 1, 0, ()))


def test_a_path_that_breaks_off_is_drawn_as_far_as_it_goes(trial: ContactTrial) -> None:
    parts = {name: values.copy() for name, values in vars(trial.reduced).items()}
    for values in parts.values():
        values[120:] = np.nan
    lost = dataclasses.replace(
        trial, reduced=ContactMotion(**parts), checks=(row("path", math.inf, 0.3),)
    )
    svg, css = plan_view(lost)
    assert "nan" not in css.partition("<main>")[2]
    assert "∞" in css or "inf" in css
    (thread,) = points(svg, "thread")
    assert len(thread) == 120
    assert keyframes(css, "reduced")[-2, 3] == pytest.approx(-45.0 * T[119], abs=1e-2)
