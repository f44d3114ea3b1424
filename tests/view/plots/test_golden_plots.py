"""What each curve of a figure is, on a run that is known on paper: name, place, sign, unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpctl import Run
from rpctl.view.plots import style
from rpctl.view.plots.figures import find_panels, tracking_figure
from tests import golden as made
from tests.golden import COUNT, TIMES, speeds
from tests.runs import vary
from tests.view.readers import Array, curves, labelled, panel

EFFORTS = np.array(made.EFFORTS)


def over_time(curve: Array) -> Array:
    """Return the values of a curve that is drawn over the run's time."""
    assert curve[:, 0] == pytest.approx(TIMES)
    return curve[:, 1]


def test_panels_and_where_they_stand(golden: Run) -> None:
    """Paths take a row of their own, the others half of one; what a run has not is left out."""
    figure = tracking_figure(golden)
    boxes = [axes.get_position() for axes in figure.axes]
    spans = [[0, 1] if box.width > 0.5 else [int(box.x0 > 0.5)] for box in boxes]
    bottoms = sorted({round(box.y0, 6) for box in boxes}, reverse=True)
    rows = [bottoms.index(round(box.y0, 6)) for box in boxes]
    assert spans == [[0, 1], *([[0], [1]] * 5)][: len(spans)]
    assert rows == [0, 1, 1, 2, 2, 3, 3, 4, 4, 5]
    none = np.empty((COUNT, 0))
    arm = vary(golden, quasi_velocities=("swing_joint", "slide_joint"), tip_margin=none)
    arm = vary(arm, nu=golden.nu[:, 2:], nu_ref=golden.log.nu_ref[:, 2:])
    names = [panel.name for panel, _ in find_panels(vary(arm, slip_ratio=none))]
    assert names == ["paths", "joints", "tip", "joint-speeds", "efforts", "efforts"]
    facts = replace(golden.robot, joint_names=(), units=(), lower_limits=(), upper_limits=())
    base = vary(replace(golden, robot=facts), ee=none, quasi_velocities=("v", "omega"))
    base = vary(base, e=golden.log.e[:, :3], nu=golden.nu[:, :2], nu_ref=golden.log.nu_ref[:, :2])
    names = [panel.name for panel, _ in find_panels(base)]
    assert names == ["paths", "base", "speeds", "efforts", "efforts", "tip-over", "grip"]


def test_speeds_and_their_references(golden: Run) -> None:
    """Solid what the robot did, dashed what the reference did; neither is what the law asked."""
    axes = panel(golden, "speeds")
    drawn = labelled(axes)
    assert over_time(drawn["forward, m/s"]) == pytest.approx(speeds(0.5, 0.1))
    assert over_time(drawn["steer, rad/s"]) == pytest.approx(speeds(0.5, -0.2))
    references = curves(axes, style.DESIRED)
    assert [over_time(c) for c in references] == [
        pytest.approx(speeds(-7.0, 0.1)), pytest.approx(speeds(-7.0, -0.2)),
    ]  # fmt: skip
    handles, named = axes.get_legend_handles_labels()
    assert named == ["forward, m/s", "steer, rad/s", "reference"]
    assert handles[-1].get_color() == style.DESIRED  # type: ignore[attr-defined]
    assert axes.get_ylabel() == "m/s or rad/s"
    joints = panel(golden, "joint-speeds")
    swing, slide, swing_ref, slide_ref = curves(joints)
    assert over_time(swing) == pytest.approx(speeds(0.5, 0.37))
    assert over_time(slide) == pytest.approx(speeds(0.5, -0.55))
    assert over_time(swing_ref) == pytest.approx(speeds(-7.0, 0.37))
    assert over_time(slide_ref) == pytest.approx(speeds(-7.0, -0.55))
    assert len(curves(joints, style.DESIRED)) == 2
    assert joints.get_ylabel() == "rad/s or m/s"


def test_efforts_of_the_right_actuators(golden: Run) -> None:
    figure = tracking_figure(golden, panels=["efforts"])
    shares, free = figure.axes
    low, high, *drawn = curves(shares)
    assert (low[:, 1].tolist(), high[:, 1].tolist()) == ([-100.0, -100.0], [100.0, 100.0])
    drawn_efforts = np.array([over_time(c) for c in drawn]).T * [0.4, 0.15, 0.2, 0.8]
    assert drawn_efforts == pytest.approx(EFFORTS[:, [0, 2, 3, 4]])
    assert shares.get_ylabel() == "effort, % of limit"
    assert shares.get_ylim() == pytest.approx((-112.0, 112.0))
    (wheel,) = curves(free)
    assert over_time(wheel) == pytest.approx(EFFORTS[:, 1])
    assert free.get_ylabel() == "effort, N·m"
    (legend,) = figure.legends
    looks = [
        (text.get_text(), line.get_color())
        for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    ]
    assert [name for name, _ in looks] == ["left_wheel", "right_wheel", "steer", "swing", "slide"]
    assert [colour for _, colour in looks] == [*style.CYCLE[:5]]
    assert [line.get_color() for line in shares.lines[2:]] == [style.CYCLE[i] for i in (0, 2, 3, 4)]
    assert free.lines[0].get_color() == style.CYCLE[1]
    loose = tracking_figure(vary(golden, effort_limits=(np.inf,) * 5), panels=["efforts"])
    turning, sliding = loose.axes
    assert len(loose.legends) == 1
    limited = tracking_figure(vary(golden, effort_limits=(80.0,) * 5), panels=["efforts"])
    assert (len(limited.axes), len(limited.legends)) == (1, 1)
    assert (turning.get_ylabel(), sliding.get_ylabel()) == ("effort, N·m", "effort, N")
    assert [over_time(c).tolist() for c in curves(turning)] == EFFORTS[:, :4].T.tolist()
    assert [over_time(c).tolist() for c in curves(sliding)] == [EFFORTS[:, 4].tolist()]


def test_errors_are_signed_on_linear_axes_and_sizes_on_logarithmic_ones(golden: Run) -> None:
    """Longitudinal 3, -.3, .3 ... m, drawn in m, with 0 in view; by choice their sizes."""
    expected = np.array([3.0, -0.3, 0.3, 0.05, -0.06, 0.03])
    for log, scale, values in ((False, "linear", expected), (True, "log", np.abs(expected))):
        (axes,) = tracking_figure(golden, panels=["base"], log=log).axes
        assert axes.get_yscale() == scale
        assert over_time(labelled(axes)["longitudinal, m"]) == pytest.approx(values)
        assert axes.get_ylabel() == "m or rad"
    assert panel(golden, "efforts").get_yscale() == "linear"
    small = vary(golden, e=2e-3 * golden.log.e)
    axes = panel(small, "base")
    assert over_time(labelled(axes)["longitudinal, mm"]) == pytest.approx(2.0 * expected)
    assert not any(text.get_text() for text in axes.texts)
    noise = panel(vary(golden, e=1e-9 * golden.log.e), "base")
    assert [text.get_text() for text in noise.texts] == ["all below 1 µm and 1 µrad"]
    assert noise.get_ylim() == pytest.approx((-1.16, 1.16))
