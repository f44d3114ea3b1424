"""What a report's page holds of a run that is known on paper: charts, efforts, ground reactions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rpctl import Run
from rpctl.view.charts import charts, error_span
from rpctl.view.pages.motion_data import chart_data
from tests import golden as made
from tests.golden import COUNT, TIMES, part, speeds
from tests.runs import vary
from tests.view.readers import floats

EFFORTS = np.array(made.EFFORTS)
FLOAT32 = 1e-6  # relative: what a page holds is rounded so
SHARES = 100.0 * EFFORTS / np.array([40.0, 1.0, 15.0, 20.0, 80.0])
# Title, unit of the axis, limits; label, unit told, what is drawn, its reference.
Drawn = tuple[str, str, Any, Any]
CHARTS: dict[str, tuple[str, list[float], list[Drawn]]] = {
    "Base error": ("m, rad", [], [
        ("distance", "m", [5.0, 0.5, 0.5, 0.13, 0.1, 0.05], None),
        ("longitudinal", "m", [3.0, -0.3, 0.3, 0.05, -0.06, 0.03], None),
        ("lateral", "m", [4.0, 0.4, -0.4, 0.12, -0.08, -0.04], None),
        ("heading", "rad", made.HEADING_ERRORS, None),
    ]),
    "End-effector error": ("m, rad", [], [
        ("position", "m", [0.7, 0.3, 0.07, 0.03, 0.07, 0.03], None),
        ("orientation", "rad", [0.06, 0.05, 0.04, 0.03, 0.02, 0.01], None),
    ]),
    "Joint errors": ("rad, m", [], [
        ("swing", "rad", made.SWING_ERRORS, None),
        ("slide", "m", made.SLIDE_ERRORS, None),
    ]),
    "Base speeds": ("m/s", [], [("forward", "m/s", speeds(0.5, 0.1), speeds(-7.0, 0.1))]),
    "Joint speeds": ("rad/s, m/s", [], [
        ("swing", "rad/s", speeds(0.5, 0.37), speeds(-7.0, 0.37)),
        ("slide", "m/s", speeds(0.5, -0.55), speeds(-7.0, -0.55)),
    ]),
    "Other speeds": ("rad/s", [], [
        ("steer", "rad/s", speeds(0.5, -0.2), speeds(-7.0, -0.2)),
    ]),
    "Efforts": ("% of limit", [-100.0, 100.0], [
        ("left_wheel", "%", SHARES[:, 0], None),
        ("steer", "%", SHARES[:, 2], None),
        ("swing", "%", SHARES[:, 3], None),
        ("slide", "%", SHARES[:, 4], None),
    ]),
    "Efforts without limits, N·m": ("N·m", [], [("right_wheel", "N·m", EFFORTS[:, 1], None)]),
    "Tip-over margin": ("m", [0.0], [
        ("zero-moment point to edge", "m", made.TIP_MARGINS, None),
    ]),
    "Grip used": ("%", [100.0], [
        ("force / (friction · load)", "%", [10.0, 20.0, 15.0, 40.0, 30.0, 5.0], None),
    ]),
    "Ground loads": ("N", [], [
        ("front_wheel", "N", speeds(80.0, 1.0), None),
        ("left_wheel", "N", speeds(60.0, 0.0), None),
        ("right_wheel", "N", speeds(120.0, -1.0), None),
    ]),
}  # fmt: skip


def charts_of(*runs: Run) -> dict[str, Any]:
    """Return the charts of runs by title, as a page decodes them."""
    data = chart_data(runs, [f"run {k}" for k in range(len(runs))])
    return {"x": floats(data["x"]), **{chart["title"]: chart for chart in data["charts"]}}


def note_of(chart: dict[str, Any]) -> Any:
    return chart["variants"][0]["note"]


def lines(chart: dict[str, Any], variant: int = 0) -> dict[str, dict[str, Any]]:
    return {line["label"]: line for line in chart["variants"][variant]["lines"]}


def test_each_line_is_what_its_label_says(golden: Run) -> None:
    charts = charts_of(golden)
    np.testing.assert_allclose(charts.pop("x"), TIMES, rtol=FLOAT32)
    assert list(charts) == list(CHARTS)
    for title, (unit, limits, expected) in CHARTS.items():
        (variant,) = charts[title]["variants"]
        assert (variant["unit"], variant["limits"]) == (unit, limits), title
        assert [line["label"] for line in variant["lines"]] == [label for label, *_ in expected]
        for line, (_, unit_told, values, reference) in zip(variant["lines"], expected, strict=True):
            assert line["unit"] == unit_told
            assert line["shown"] == (line["label"] != "distance")
            assert floats(line["values"]) == pytest.approx(values, rel=FLOAT32)
            assert ("reference" in line) == (reference is not None)
            if reference is not None:
                assert floats(line["reference"]) == pytest.approx(reference, rel=FLOAT32)
    notes = {title: note_of(chart) for title, chart in charts.items() if note_of(chart)}
    assert notes == {
        "Base error": "positive: reference ahead, to the left",
        "Joint errors": "reference minus actual",
        "Base speeds": "dashed: reference",
        "Joint speeds": "dashed: reference",
        "Other speeds": "dashed: reference",
        "Efforts": "dashed: limits",
        "Tip-over margin": "tips below the dashed line",
        "Grip used": "friction 0.7, slips above 100",
    }


def test_a_grip_beyond_bounds_is_cut_and_that_is_told(golden: Run) -> None:
    slip = np.array(made.SLIP_RATIOS)
    slip[3] = 3.0
    at_most = charts_of(vary(golden, slip_ratio=slip))["Grip used"]
    assert note_of(at_most) == "friction 0.7, slips above 100"
    slip[3] = 4.0
    chart = charts_of(vary(golden, slip_ratio=slip))["Grip used"]
    (line,) = lines(chart).values()
    assert floats(line["values"]) == pytest.approx([10.0, 20.0, 15.0, 300.0, 30.0, 5.0])
    assert note_of(chart) == "friction 0.7, slips above 100 (drawn up to 300)"


def test_range_of_an_errors_axis(golden: Run) -> None:
    """From a fifth of what it settles at to twice the largest, of the lines that are shown."""
    charts = charts_of(golden)
    assert charts["Base error"]["variants"][0]["decades"] == pytest.approx([0.2 * 0.03, 8.0])
    assert charts["Joint errors"]["variants"][0]["decades"] == pytest.approx([0.2 * 0.01, 2.0])
    ranged = {t for t in CHARTS if "decades" in charts[t]["variants"][0]}
    assert ranged == {"Base error", "End-effector error", "Joint errors"}
    longer = charts_of(part(golden, np.tile(np.arange(COUNT), 4), t=0.1 * np.arange(4 * COUNT)))
    # Settled: the median over the last fifth, of 0.3, 0.05, 0.06 and 0.03 m.
    assert longer["Base error"]["variants"][0]["decades"] == pytest.approx([0.2 * 0.055, 8.0])
    settled = vary(golden, e=golden.log.e * np.array([1.0] * 5 + [1e-9])[:, None])
    assert charts_of(settled)["Base error"]["variants"][0]["decades"] == pytest.approx([8e-6, 8.0])
    coarse = vary(golden, e=np.full((COUNT, 5), -0.5))
    assert charts_of(coarse)["Base error"]["variants"][0]["decades"] == pytest.approx([0.01, 1.0])
    perfect = vary(golden, e=np.zeros((COUNT, 5)))
    low, high = charts_of(perfect)["Base error"]["variants"][0]["decades"]
    assert (low, high) == pytest.approx((1e-6, 1e-5))


@pytest.mark.parametrize(("largest", "limits"), [(19.0, []), (21.0, [-100.0, 100.0])])
def test_efforts_far_from_their_limits_fill_their_chart(
    golden: Run, largest: float, limits: list[float]
) -> None:
    """Below a fifth of its limit each; then the limits are told, and not drawn."""
    run = vary(golden, tau=EFFORTS * largest / np.abs(SHARES[:, [0, 2, 3, 4]]).max())
    chart = charts_of(run)["Efforts"]
    assert chart["variants"][0]["limits"] == limits
    assert note_of(chart) == ("dashed: limits" if limits else "limits: ±100 %")


def test_noise_is_not_shown_as_an_error(golden: Run) -> None:
    """Of 0.9 µm at most it is told, and the axis reaches to 1 µm either way; 1.1 µm is an error."""
    for size, told, top in ((9e-7, "; all below 1 µm and 1 µrad", 1e-6), (1.1e-6, "", 1.1e-6)):
        e = golden.log.e / np.abs(golden.log.e).max() * size
        run = vary(golden, e=e)
        (variant,) = charts_of(run)["Base error"]["variants"]
        assert variant["note"] == f"positive: reference ahead, to the left{told}"
        assert (variant["noise"], variant["unit"], variant["factor"]) == (1e-6, "µm, µrad", 1e6)
        (chart,) = (each for each in charts(run) if each.title == "Base error")
        low, high = error_span(chart.lines)
        assert high - low == pytest.approx(1.16 * (top + max(1e-6, -e[:, :3].min())))
    only = vary(golden, e=np.full((COUNT, 5), [2.0, 0.0, 0.0, 0.0, 5e-7]))
    assert note_of(charts_of(only)["Joint errors"]) == (
        "reference minus actual; all below 1 µrad and 1 µm"
    )


@pytest.mark.parametrize(("size", "prefix"), [(0.2, ""), (0.05, "m"), (5e-5, "µ"), (5e-8, "µ")])
def test_the_unit_of_an_error_suits_its_size(golden: Run, size: float, prefix: str) -> None:
    e = np.full((COUNT, 5), size)
    (variant,) = charts_of(vary(golden, e=e))["Joint errors"]["variants"]
    assert variant["unit"] == f"{prefix}rad, {prefix}m"
    assert variant["factor"] == {"": 1.0, "m": 1e3, "µ": 1e6}[prefix]


def test_each_run_of_several_keeps_its_own_lines_and_references(golden: Run) -> None:
    other = vary(golden, nu=golden.nu + 100.0, nu_ref=golden.log.nu_ref - 100.0, tau=0.5 * EFFORTS)
    charts = charts_of(golden, other)
    joints = charts["Joint speeds"]
    assert [variant["label"] for variant in joints["variants"]] == ["swing", "slide"]
    assert [variant["unit"] for variant in joints["variants"]] == ["rad/s", "m/s"]
    assert note_of(joints) == "dashed: reference"
    drawn = lines(joints, 1)
    assert [*drawn] == ["run 0", "run 1"]
    assert [line["colour"] for line in drawn.values()] == [0, 1]
    first, second = (drawn[name] for name in drawn)
    assert floats(first["values"]) == pytest.approx(speeds(0.5, -0.55))
    assert floats(first["reference"]) == pytest.approx(speeds(-7.0, -0.55))
    assert floats(second["values"]) == pytest.approx(speeds(100.5, -0.55))
    assert floats(second["reference"]) == pytest.approx(speeds(-107.0, -0.55))
    efforts = charts["Efforts"]["variants"][3]
    assert (efforts["label"], efforts["unit"]) == ("slide", "% of limit")
    assert floats(efforts["lines"][1]["values"]) == pytest.approx(0.5 * SHARES[:, 4])
    loose = vary(other, effort_limits=(np.inf, *golden.robot.effort_limits[1:]))
    mixed = charts_of(golden, loose)
    assert [*lines(mixed["Efforts"], 0)] == ["run 0"]  # the other's wheel has no limit
    alone = mixed["Efforts without limits, N·m"]["variants"]
    assert [[line["label"] for line in variant["lines"]] for variant in alone] == [
        ["run 0", "run 1"],
        ["run 1"],
    ]
    distance = charts["Base error"]["variants"][0]
    assert all(line["shown"] for line in distance["lines"])
    assert distance["decades"] == pytest.approx([0.2 * 0.05, 10.0])
