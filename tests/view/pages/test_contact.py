"""The picture of a contact trial shows what both sides did, each its own."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from rpctl.arrays import Array
from rpctl.equivalence.certificate import CONTACT_ORACLE
from rpctl.equivalence.contact.trial import ContactMotion, ContactTrial, Gap
from rpctl.equivalence.scope import Scope
from rpctl.equivalence.verify import Certificate
from rpctl.view.pages.certificate import certificate_page, contact_figures, draw_distance, draw_plan
from rpctl.view.palette import light
from rpctl.view.plots import style

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


def drawn(draw: Callable[..., object], *given: Any) -> Any:
    """Return what is drawn."""
    axes = Figure().add_subplot()
    draw(*given, axes)
    return axes


def lines_with(axes: Any, colour: str) -> list[Array]:
    """Return the points (n, 2) of the lines of a colour."""
    return [line.get_xydata() for line in axes.lines if line.get_color() == colour]


def test_paths_robots_and_tracks_stand_where_they_are(trial: ContactTrial) -> None:
    """A quarter turn on, the ball at (.4, 0) m ahead of the root lies .4 m to its left."""
    axes = drawn(draw_plan, trial)
    (engine,), (reduced,) = lines_with(axes, style.TIP), lines_with(axes, style.BASE)
    np.testing.assert_array_equal(engine, trial.engine.pose[:, :2])
    np.testing.assert_array_equal(reduced, trial.reduced.pose[:, :2])
    outlines = [patch.get_xy() for patch in axes.patches]
    tips = (0.4, 0.0), (1.0, 1.4), (1.2, 1.4)  # at the start, at MuJoCo's end, at the model's
    for outline, tip in zip(outlines, tips, strict=True):
        assert np.abs(outline - tip).max(axis=1).min() < 1e-9
    tracks = lines_with(axes, style.DESIRED)
    for way, (x, y) in zip(tracks, trial.footprint, strict=True):
        np.testing.assert_allclose(way[[0, -1]], [[x, y], [1.0 - y, 1.0 + x]], atol=1e-9)
    words = [(text.get_text(), text.xy) for text in axes.texts]
    assert words[0][0] == "start" and words[1][0] == "end"
    np.testing.assert_allclose([place for _, place in words], [[0.0, 0.0], [1.0, 1.0]], atol=1e-9)


def test_the_gap_is_drawn_under_its_band(trial: ContactTrial) -> None:
    """It grows to 200 mm where 300 mm are allowed."""
    axes = drawn(draw_distance, trial)
    line, band = (each.get_ydata() for each in axes.lines)
    np.testing.assert_allclose(line, 100.0 * T, atol=1e-9)
    assert list(band) == [300.0, 300.0]
    assert axes.get_title(loc="left").endswith("300 mm allowed")
    assert axes.get_ylim()[1] > 300.0


@pytest.mark.parametrize(
    ("title", "determinate", "part", "columns"),
    [
        ("Wheel loads (N)", True, "load", [0, 1, 2]),
        ("Horizontal force of the ground (N)", False, "force", [0, 1]),
        ("Torques of the joints (N·m)", True, "efforts", [0]),
    ],
)
def test_charts_hold_both_sides(
    trial: ContactTrial, title: str, determinate: bool, part: str, columns: list[int]
) -> None:
    _, charts = contact_figures(dataclasses.replace(trial, determinate=determinate))
    (axes,) = (each for each in charts.axes if each.get_title(loc="left") == title)
    for lines, side in ((axes.lines[0::2], trial.engine), (axes.lines[1::2], trial.reduced)):
        values = [line.get_ydata() for line in lines]
        np.testing.assert_array_equal(values, getattr(side, part)[:, columns].T)


def test_a_gap_too_wide_is_told(trial: ContactTrial) -> None:
    failed = dataclasses.replace(trial, checks=(row("path", 0.2, 0.1), *trial.checks[1:]))
    certificate = Certificate(
        robot="robot", samples=1, seed=0, checks=(), scope=SCOPE, contact=failed
    )
    page = certificate_page(certificate)
    assert "the two paths come <strong>200 mm</strong> apart, beyond the allowed 100 mm" in page
    assert '<span class="badge bad">1 of 3 gaps too wide</span>' in page
    assert '<td data-head="Residual">200 mm &gt; 100 mm ✗</td>' in page
    axes = drawn(draw_distance, failed)
    assert (
        axes.lines[0].get_color()
        == light("bad")
        != drawn(draw_distance, trial).lines[0].get_color()
    )
    assert "not verified" in page


def test_a_path_that_breaks_off_is_drawn_as_far_as_it_goes(trial: ContactTrial) -> None:
    parts = {name: values.copy() for name, values in vars(trial.reduced).items()}
    for values in parts.values():
        values[120:] = np.nan
    lost = dataclasses.replace(
        trial, reduced=ContactMotion(**parts), checks=(row("path", math.inf, 0.3),)
    )
    page = certificate_page(
        Certificate(robot="robot", samples=1, seed=0, checks=(), scope=SCOPE, contact=lost)
    )
    assert "∞" in page or "inf" in page
    axes = drawn(draw_plan, lost)
    (reduced,) = lines_with(axes, style.BASE)
    assert len(reduced) == 120
    outline, x = axes.patches[-1].get_xy(), reduced[-1, 0]  # the robot stands where it got to
    assert outline[:, 0].min() < x < outline[:, 0].max()
