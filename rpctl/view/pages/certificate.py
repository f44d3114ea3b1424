"""A certificate as one HTML page, to keep or to pass on; its contact trial as pictures.

No script may run on a certificate and none does: the robot moves by CSS keyframes, in real time,
and stands still where the reader asks for less motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from scipy.spatial import ConvexHull

from rpctl.arrays import Array
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.contact.trial import ContactTrial
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
    links, shared = certificate.estimated_links, certificate.shared
    remarks = []
    if links:
        told = f"mass and inertia of {', '.join(links)}"
        remarks.append(f"Estimated, at a density, not given by the URDF: {told}")
    if shared:
        remarks.append(f"Shared by all derivations: {'; '.join(shared)}")
    return render_page(
        "certificate.html",
        title=f"{certificate.robot}: certificate of the dynamics",
        styles=STYLES,
        robot=certificate.robot,
        about=f"M(q) ν̇ + h(q, ν) = B(q) τ at {certificate.samples} random states, "
        f"seed {certificate.seed}",
        badge=Badge(certificate.passed, "verified" if certificate.passed else "not equivalent"),
        rows=list(_rows(certificate)),
        remarks=remarks,
        idealised=certificate.idealised,
        **_trial(certificate.contact),
    )


def _trial(trial: ContactTrial | None) -> dict[str, Any]:
    """Return what the page shows of a contact trial."""
    if trial is None:
        return {"trial": None, "moves": ""}
    broken = sum(not check.passed for check in trial.checks)
    text = f"{broken} of {len(trial.checks)} gaps too wide" if broken else "both agree"
    plan = plan_view(trial)
    return {
        "trial": trial,
        "trial_badge": Badge(not broken, text),
        "plan": plan,
        "moves": plan["moves"],
        "charts": trial_charts(trial),
    }


def _rows(certificate: Certificate) -> Iterator[tuple[str, str, str, str]]:
    """Yield what is compared, with what, the residual, and where it is worst."""
    for check in certificate.checks:
        shown = residual(check.passed, check.residual, check.limit)
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
    """Map from points of the floor (m; x to the right, y up) to the picture."""

    left: float
    top: float
    scale: float  # per m
    height: float  # of the picture

    def place(self, points: Array) -> Array:
        """Return points (n, 2) of the floor in the picture."""
        return np.column_stack(
            [(points[:, 0] - self.left) * self.scale, (self.top - points[:, 1]) * self.scale]
        )


class Post(NamedTuple):
    """A marker where the robot begins or ends, and a word beside it."""

    text: str
    x: float
    y: float
    text_x: float
    text_y: float


def plan_view(trial: ContactTrial) -> dict[str, Any]:
    """Return the ground seen from above as the template draws it: paths of an SVG, and posts.

    Both motions are shown, and the robot along them: its keyframes move it about the origin.
    """
    outline = trial.footprint[ConvexHull(trial.footprint).vertices]
    engine, reduced = (_finite(motion.pose) for motion in (trial.engine, trial.reduced))
    ends = np.vstack([_placed(outline, pose) for pose in (engine[0], engine[-1], reduced[-1])])
    view = _fit_viewport(np.vstack([ends, engine[:, :2], reduced[:, :2]]))
    motions = {"engine": engine, "reduced": reduced}
    stands = {"start": engine[0], "end engine": engine[-1], "end reduced": reduced[-1]}
    tracks = np.array([_placed(trial.footprint, pose) for pose in engine[::5]])
    square, to_picture = _square(view), np.array([1.0, -1.0]) * view.scale
    nose = ARROW_RATIO * float(np.ptp(outline, axis=0).max()) * view.scale
    duration = float(trial.t[-1])
    apart = trial.path.format_value(trial.path.gap)
    return {
        "width": PLAN_WIDTH,
        "height": view.height,
        "label": f"Both paths seen from above; they are at most {apart} apart",
        "grid": _grid(view, square),
        "tracks": "".join(_line(view.place(way)) for way in tracks.transpose(1, 0, 2)),
        "ways": {side: _line(view.place(pose[:, :2])) for side, pose in motions.items()},
        "stands": {
            kind: _line(view.place(_placed(outline, pose))) + "Z" for kind, pose in stands.items()
        },
        "hull": _line(outline * to_picture) + "Z",
        "dots": (trial.footprint * to_picture).round(2).tolist(),
        "nose": f"M{nose:.2f} 0L{-0.6 * nose:.2f} {-0.6 * nose:.2f}V{0.6 * nose:.2f}Z",
        "posts": [
            _post(view, "start", engine[0], -LABEL_DISTANCE),
            _post(view, "end", engine[-1], LABEL_DISTANCE),
        ],
        "bar": round(square * view.scale, 2),
        "bar_text": f"{square:g} m" if square >= 1.0 else f"{100 * square:g} cm",
        "moves": Markup(
            "\n".join(_keyframes(view, side, pose, duration) for side, pose in motions.items())
        ),
    }


def _square(view: Viewport) -> float:
    """Return the edge of the grid's squares, m."""
    across = PLAN_WIDTH / view.scale
    return next((edge for edge in GRID_SIZES_M if across / edge <= MAX_SQUARES), GRID_SIZES_M[-1])


def _grid(view: Viewport, edge: float) -> str:
    """Return the lines of the grid."""
    right, bottom = view.left + PLAN_WIDTH / view.scale, view.top - view.height / view.scale
    columns = range(math.ceil(view.left / edge), math.floor(right / edge) + 1)
    rows = range(math.ceil(bottom / edge), math.floor(view.top / edge) + 1)
    across = [(k * edge - view.left) * view.scale for k in columns]
    down = [(view.top - k * edge) * view.scale for k in rows]
    lines = [f"M{x:.2f} 0V{view.height:.0f}" for x in across]
    return "".join([*lines, *(f"M0 {y:.2f}H{PLAN_WIDTH:g}" for y in down)])


def _post(view: Viewport, text: str, pose: Array, ahead: float) -> Post:
    x, y = view.place(pose[None, :2])[0].tolist()
    aside = x + ahead * math.cos(pose[2]), y - ahead * math.sin(pose[2]) + 4.0
    return Post(text, *(round(each, 2) for each in (x, y, *aside)))


def _keyframes(view: Viewport, side: str, pose: Array, duration: float) -> str:
    """Return the keyframes of a robot: the actual poses, in real time, then a pause."""
    picked = np.unique(np.linspace(0, len(pose) - 1, KEYFRAME_COUNT + 1).round().astype(int))
    turn = np.unwrap(pose[:, 2])
    percent_per_sample = 100.0 * duration / (duration + PAUSE_S) / max(len(pose) - 1, 1)
    steps = []
    for k, (x, y) in zip(picked.tolist(), view.place(pose[picked, :2]).tolist(), strict=True):
        move = f"translate({x:.2f}px,{y:.2f}px) rotate({-math.degrees(turn[k]):.3f}deg)"
        steps.append((percent_per_sample * k, move))
    steps.append((100.0, steps[-1][1]))
    frames = "".join(f"{at:.2f}%{{transform:{move}}}" for at, move in _without_repeats(steps))
    clock = f"{duration + PAUSE_S:g}s linear infinite"
    return (
        f"@keyframes roll-{side}{{{frames}}}\n"
        f".robot.{side}{{transform:{steps[0][1]};animation:roll-{side} {clock}}}"
    )


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
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points.tolist())


def _without_repeats(steps: list[tuple[float, str]]) -> list[tuple[float, str]]:
    """Return keyframes without those that repeat the moment of the next."""
    return [a for a, b in pairwise(steps) if b[0] - a[0] > 0.005] + [steps[-1]]


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
    known = np.isfinite(apart)
    colour = "good" if path.passed else "bad"
    allowed = np.full(2, 1e3 * path.band)
    marks = (
        Mark(t[known], apart[known], colour, np.zeros(known.sum()), opacity=0.16),
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
