"""A certificate as one HTML page, to keep or to pass on; its contact trial as pictures.

No script may run on a certificate and none does: the robot moves by CSS keyframes, in real time,
and stands still where the reader asks for less motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from scipy.spatial import ConvexHull

from rpctl.arrays import Array
from rpctl.equivalence.contact.trial import ContactTrial
from rpctl.equivalence.scope import Condition
from rpctl.equivalence.verify import Certificate
from rpctl.files.writing import write_atomically
from rpctl.view.pages.page import Badge, render_page, still_chart
from rpctl.view.pages.panel import residual
from rpctl.view.still_chart import Axis, Mark, StillChart, axis_over

STYLES = ("report.css", "still_chart.css", "certificate.css")
PLAN_WIDTH, MIN_HEIGHT, MAX_HEIGHT = 480.0, 300.0, 560.0
PLAN_MARGIN = 34.0
KEYFRAME_COUNT = 40  # keyframes of the moving robots: 50 ms apart
ARROW_RATIO = 0.07  # of the robot's size: the arrow that points ahead
LABEL_DISTANCE = 20.0  # of a word from the place that it names
PAUSE_S = 1.2  # s for which they wait at the end
GRID_SIZES_M = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # m, of the grid
MAX_SQUARES = 14  # of them across the picture, at most
MAX_LINES = 5  # lines of a chart: more cannot be told apart


def write_certificate(certificate: Certificate, path: str | Path) -> Path:
    """Write a certificate as one HTML file that needs nothing else.

    Args:
        certificate: The certificate.
        path: The file; there whole or not at all.

    Returns:
        The path.
    """
    page = certificate_page(certificate)
    return write_atomically(path, page.encode("utf-8", "backslashreplace"))


def certificate_page(certificate: Certificate) -> str:
    """Return a certificate as a page."""
    return render_page(
        "certificate.html",
        title=f"{certificate.robot}: certificate of the dynamics",
        styles=STYLES,
        robot=certificate.robot,
        about=f"M(q) ν̇ + h(q, ν) = B(q) τ at {certificate.samples} random states, "
        f"seed {certificate.seed}",
        badge=Badge(certificate.passed, "verified" if certificate.passed else "not verified"),
        rows=list(_rows(certificate)),
        remarks=[f"Scope: {certificate.scope.line}"],
        idealised=certificate.idealised,
        **_trial(certificate.contact),
    )


def _trial(trial: ContactTrial | None) -> dict[str, Any]:
    """Return what the page shows of a contact trial."""
    if trial is None:
        return {"trial": None, "plan": None}
    broken = sum(not check.passed for check in trial.checks)
    text = f"{broken} of {len(trial.checks)} gaps too wide" if broken else "both agree"
    return {
        "trial": trial,
        "trial_badge": Badge(not broken, text),
        "plan": plan_view(trial),
        "charts": trial_charts(trial),
    }


def _rows(certificate: Certificate) -> Iterator[tuple[str, str, str, str]]:
    """Yield what is compared, with what, the residual, and where it is worst."""
    for check in certificate.checks:
        shown = residual(check.passed, check.residual, check.limit)
        if isinstance(check, Condition):
            yield check.name, check.against, f"{check.value}, limit {check.bound}", check.entry
            continue
        where = f"{check.entry}, sample {check.sample}" if check.residual > 0 else ""
        yield check.name, check.against, shown, "; ".join(filter(None, (where, check.note)))
    for check in certificate.declared:
        told = f"{check.residual:.1e}, declared"
        yield check.name, check.against, told, f"{check.entry}; {check.note}"
    for gap in certificate.contact.checks if certificate.contact is not None else ():
        sign, mark = ("≤", "") if gap.passed else (">", " ✗")
        shown = f"{gap.format_value(gap.gap)} {sign} {gap.format_value(gap.band)}{mark}"
        yield gap.name, gap.against, shown, f"{gap.entry} at {gap.time:.2f} s".strip()
    for skipped in certificate.skipped:
        yield skipped.name, skipped.against, "not compared", skipped.note


@dataclass(frozen=True)
class Viewport:
    """Where the floor (m; x to the right, y up) lies in the picture."""

    left: float  # m
    top: float  # m
    scale: float  # per m
    height: float  # of the picture

    @property
    def matrix(self) -> str:
        """What takes the floor to the picture, as SVG has it."""
        x, y = -self.left * self.scale, self.top * self.scale
        return f"matrix({self.scale:.3f} 0 0 {-self.scale:.3f} {x:.2f} {y:.2f})"


def plan_view(trial: ContactTrial) -> dict[str, Any]:
    """Return the ground seen from above as the template draws it, in m.

    Both motions are shown, and the robot along them: its keyframes move it about the origin.
    """
    outline = trial.footprint[ConvexHull(trial.footprint).vertices]
    engine, reduced = (_finite(motion.pose) for motion in (trial.engine, trial.reduced))
    ends = {"start": engine[0], "end engine": engine[-1], "end reduced": reduced[-1]}
    stands = {kind: _placed(outline, pose) for kind, pose in ends.items()}
    view = _fit_viewport(np.vstack([*stands.values(), engine[:, :2], reduced[:, :2]]))
    across, tall = PLAN_WIDTH / view.scale, view.height / view.scale
    square = next((e for e in GRID_SIZES_M if across / e <= MAX_SQUARES), GRID_SIZES_M[-1])
    columns = range(math.ceil(view.left / square), math.floor((view.left + across) / square) + 1)
    rows = range(math.ceil((view.top - tall) / square), math.floor(view.top / square) + 1)
    tracks = np.array([_placed(trial.footprint, pose) for pose in engine[::5]])
    motions = {"engine": engine, "reduced": reduced}
    return {
        "view": view,
        "width": PLAN_WIDTH,
        "gap": trial.path.format_value(trial.path.gap),
        "columns": [k * square for k in columns],
        "rows": [k * square for k in rows],
        "box": (view.left, view.top - tall, view.left + across, view.top),
        "tracks": [_line(way) for way in tracks.transpose(1, 0, 2)],
        "ways": {side: _line(pose[:, :2]) for side, pose in motions.items()},
        "stands": {kind: _line(corners) for kind, corners in stands.items()},
        "hull": _line(outline),
        "dots": trial.footprint.tolist(),
        "nose": ARROW_RATIO * float(np.ptp(outline, axis=0).max()),
        "posts": [_post(view, "start", engine[0], -1.0), _post(view, "end", engine[-1], 1.0)],
        "square": square,
        "moves": {side: _keyframes(trial.t, pose) for side, pose in motions.items()},
        "clock": float(trial.t[-1]) + PAUSE_S,
    }


def _post(view: Viewport, text: str, pose: Array, ahead: float) -> dict[str, Any]:
    """Return a post where the robot begins or ends, and a word beside it, in the picture."""
    x, y = (pose[0] - view.left) * view.scale, (view.top - pose[1]) * view.scale
    away = ahead * LABEL_DISTANCE
    text_place = x + away * math.cos(pose[2]), y - away * math.sin(pose[2]) + 4.0
    return {"text": text, "place": (x, y), "text_place": text_place}


def _keyframes(t: Array, pose: Array) -> list[tuple[float, float, float, float]]:
    """Return share of the time (%), place (m) and turn (degrees) of a robot, then a pause."""
    picked = np.unique(np.linspace(0, len(pose) - 1, KEYFRAME_COUNT + 1).round().astype(int))
    at, turn = 100.0 * t[picked] / (t[-1] + PAUSE_S), np.degrees(np.unwrap(pose[:, 2])[picked])
    frames = list(zip(at.tolist(), *pose[picked, :2].T.tolist(), turn.tolist(), strict=True))
    return [*frames, (100.0, *frames[-1][1:])]


def _finite(pose: Array) -> Array:
    """Return the poses up to the first that is no number."""
    whole = np.isfinite(pose).all(axis=1)
    return pose if whole.all() else pose[: max(1, int(whole.argmin()))]


def _placed(points: Array, pose: Array) -> Array:
    """Return points (n, 2) of the root link's frame on the floor."""
    x, y, turn = pose
    cos, sin = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]) + [x, y])


def _fit_viewport(points: Array) -> Viewport:
    """Return the frame that holds points (n, 2) in the middle of the picture."""
    low, high = points.min(axis=0), points.max(axis=0)
    wide, tall = np.maximum(high - low, 1e-6).tolist()
    inside = PLAN_WIDTH - 2.0 * PLAN_MARGIN
    height = min(max(inside * tall / wide + 2.0 * PLAN_MARGIN, MIN_HEIGHT), MAX_HEIGHT)
    scale = min(inside / wide, (height - 2.0 * PLAN_MARGIN) / tall)
    x, y = (0.5 * (low + high)).tolist()
    return Viewport(x - 0.5 * PLAN_WIDTH / scale, y + 0.5 * height / scale, scale, height)


def _line(points: Array) -> str:
    return "M" + "L".join(f"{x:.4f} {y:.4f}" for x, y in points.tolist())


@dataclass(frozen=True, eq=False)
class TrialChart:
    """A chart of a trial: the unit beside its title, and whether its check failed."""

    chart: StillChart
    unit: str
    failed: bool = False

    @property
    def html(self) -> Markup:
        """The chart."""
        return still_chart(self.chart)


def trial_charts(trial: ContactTrial) -> list[TrialChart]:
    """Return the distance between the two paths, and forces and efforts on both sides."""
    charts = [_gap_chart(trial)]
    reduced, engine = trial.reduced, trial.engine
    if trial.determinate:
        pairs = trial.contacts, reduced.load, engine.load
        charts.append(_pairs_chart(trial.t, "Wheel loads", "N", *pairs))
    else:
        pairs = ("along x", "along y"), reduced.force[:, :2], engine.force[:, :2]
        charts.append(_pairs_chart(trial.t, "Horizontal force of the ground", "N", *pairs))
    torques = [k for k, slides in enumerate(trial.slides) if not slides]
    shown = torques or list(range(len(trial.joints)))
    if shown:
        spread = np.ptp(engine.efforts[:, shown], axis=0)
        most = [shown[k] for k in sorted(np.argsort(spread)[::-1][:MAX_LINES].tolist())]
        names = [trial.joints[k] for k in most]
        title = "Torques of the joints" if torques else "Forces of the joints"
        efforts = names, reduced.efforts[:, most], engine.efforts[:, most]
        charts.append(_pairs_chart(trial.t, title, "N·m" if torques else "N", *efforts))
    return charts


def _gap_chart(trial: ContactTrial) -> TrialChart:
    """Return the distance between the paths over time, and how far apart they may be."""
    title, path, t = "Distance between the two paths", trial.path, trial.t
    apart = 1e3 * np.hypot(*(trial.reduced.pose - trial.engine.pose)[:, :2].T)
    colour = "good" if path.passed else "bad"
    allowed = np.full(2, 1e3 * path.band)
    marks = (
        Mark(t, apart, colour, filled=True, opacity=0.16),
        Mark(t, apart, colour, width=1.8),
        Mark(t[[0, -1]], allowed, "soft", width=1.2, dashed=True),
    )
    high = 1.08 * max(float(allowed[0]), float(np.nanmax(apart)))
    chart = StillChart(title, _time(t), Axis(0.0, high), marks, summary=f"{title} over time")
    unit = f"{path.format_value(path.band)} allowed"
    return TrialChart(chart, unit, failed=not path.passed)


def _pairs_chart(
    t: Array, title: str, unit: str, names: Sequence[str], reduced: Array, engine: Array
) -> TrialChart:
    """Return quantities (n, count) of both sides over time: broad of the engine, thin inside."""
    marks = []
    for k, name in enumerate(names):
        marks.append(Mark(t, engine[:, k], f"c{k}", opacity=0.35, width=6.0))
        marks.append(Mark(t, reduced[:, k], f"c{k}", width=1.4, label=name))
    axis = axis_over(np.append(reduced, engine), log=False, zero=False)
    return TrialChart(
        StillChart(title, _time(t), axis, tuple(marks), summary=", ".join(names)), unit
    )


def _time(t: Array) -> Axis:
    return Axis(float(t[0]), float(t[-1]), "t, s")
