"""A certificate as one HTML page, to keep or to pass on, with the picture of its contact trial.

No script may run on it and none does. The picture shows both paths from above, their distance, and
what both exert.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull

from rpctl.arrays import Array
from rpctl.equivalence.contact.trial import ContactMotion, ContactTrial
from rpctl.equivalence.scope import Condition
from rpctl.equivalence.verify import Certificate
from rpctl.files.writing import write_atomically
from rpctl.view.labels import literal
from rpctl.view.pages.page import Badge, render_page
from rpctl.view.pages.panel import SYMBOLS, residual
from rpctl.view.palette import light
from rpctl.view.plots import style
from rpctl.view.plots.figures import svg_address

STYLES = ("report.css", "certificate.css")
HEADS = "Compared", "With", "Residual", "Worst at"


def write_certificate(certificate: Certificate, path: str | Path) -> Path:
    """Write a certificate as one HTML file that needs nothing else.

    Args:
        certificate: The certificate.
        path: The file; there whole or not at all.

    Returns:
        The path.
    """
    return write_atomically(path, certificate_page(certificate).encode("utf-8", "backslashreplace"))


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
        heads=HEADS,
        remarks=[f"Scope: {certificate.scope.line}", f"Symbols: {SYMBOLS}"],
        idealised=certificate.idealised,
        **_trial(certificate.contact),
    )


def _trial(trial: ContactTrial | None) -> dict[str, Any]:
    """Return what the page shows of a contact trial."""
    if trial is None:
        return {"trial": None}
    broken = sum(not check.passed for check in trial.checks)
    text = f"{broken} of {len(trial.checks)} gaps too wide" if broken else "both agree"
    return {
        "trial": trial,
        "trial_badge": Badge(not broken, text),
        "pictures": [svg_address(figure) for figure in contact_figures(trial)],
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


PLAN_IN, CHART_IN, PANEL_IN = 5.4, 4.0, 1.9  # inches: widths of plan and charts, a chart's height
MOST_LINES = 5  # joints in a chart: more cannot be told apart
TRACK_STRIDE = 5  # samples between two points of a contact's track
BROAD: dict[str, Any] = {"lw": 6.0, "alpha": 0.35, "solid_capstyle": "round"}  # MuJoCo's lines
THIN: dict[str, Any] = {"lw": 1.4}  # the reduced model's, inside


@style.own_settings()
def contact_figures(trial: ContactTrial) -> list[Figure]:
    """Return both paths from above, and beside it their distance, forces and efforts over time.

    MuJoCo's lines are broad, the reduced model's thin: where both agree these lie inside those.
    """
    reduced, engine = trial.reduced, trial.engine
    parts = [_load_part(trial)]
    torques = [k for k, slides in enumerate(trial.slides) if not slides]
    shown = torques or list(range(len(trial.joints)))
    if shown:
        spread = np.ptp(engine.efforts[:, shown], axis=0)
        most = [shown[k] for k in sorted(np.argsort(spread)[::-1][:MOST_LINES].tolist())]
        names = [trial.joints[k] for k in most]
        title = "Torques of the joints (N·m)" if torques else "Forces of the joints (N)"
        parts.append((title, names, reduced.efforts[:, most], engine.efforts[:, most]))
    plan, charts = (
        Figure((width, PANEL_IN * (1 + len(parts))), layout="constrained", facecolor=style.PAPER)
        for width in (PLAN_IN, CHART_IN)
    )
    draw_plan(trial, plan.add_subplot())
    panels = charts.subplots(1 + len(parts))
    draw_distance(trial, panels[0])
    for part, axes in zip(parts, panels[1:], strict=True):
        draw_pairs(trial.t, *part, axes)
    return [plan, charts]


def _load_part(trial: ContactTrial) -> tuple[str, Sequence[str], Array, Array]:
    """Return what the ground exerts: each contact's load if statics say it, else the whole."""
    reduced, engine = trial.reduced, trial.engine
    if trial.determinate:
        return "Wheel loads (N)", trial.contacts, reduced.load, engine.load
    title = "Horizontal force of the ground (N)"
    return title, ("along x", "along y"), reduced.force[:, :2], engine.force[:, :2]


def draw_plan(trial: ContactTrial, axes: Axes) -> None:
    """Draw the ground seen from above: paths, the robot at the ends, and its contacts' tracks."""
    outline = trial.footprint
    if len(outline) > 2:
        outline = outline[ConvexHull(outline).vertices]
    engine, reduced = _finite(trial.engine), _finite(trial.reduced)
    tracks = np.array([style.placed(trial.footprint, pose) for pose in engine[::TRACK_STRIDE]])
    for track in tracks.transpose(1, 0, 2):
        axes.plot(*track.T, color=style.DESIRED, lw=0.8, ls=(0, (2, 4)))
    axes.plot(*engine[:, :2].T, color=style.TIP, label="MuJoCo: free body, friction", **BROAD)
    equation = "reduced model: rolling as an equation"
    axes.plot(*reduced[:, :2].T, color=style.BASE, label=equation, **THIN)
    axes.fill(*style.placed(outline, engine[0]).T, fill=False, ec=style.DESIRED, lw=1.0)
    axes.fill(*style.placed(outline, engine[-1]).T, color=style.TIP, alpha=0.25, lw=0.0)
    axes.fill(*style.placed(outline, reduced[-1]).T, fill=False, ec=style.BASE, lw=1.4)
    for word, pose in (("start", engine[0]), ("end", engine[-1])):
        axes.plot(*pose[:2], marker="o", ms=5.0, mfc=style.PAPER, mec=style.INK)
        axes.annotate(word, pose[:2], (6.0, 6.0), textcoords="offset points",
                      fontsize=style.SMALL_PT, color=style.INK)  # fmt: skip
    style.style_axes(axes, "Seen from above (m)")
    axes.set_aspect("equal", adjustable="datalim")
    style.add_legend(axes)


def draw_distance(trial: ContactTrial, axes: Axes) -> None:
    """Draw how far apart the two paths are, and how far they may be."""
    path = trial.path
    apart = 1e3 * np.hypot(*(trial.reduced.pose - trial.engine.pose)[:, :2].T)
    colour = light("good" if path.passed else "bad")
    axes.fill_between(trial.t, apart, color=colour, alpha=0.16, lw=0.0)
    axes.plot(trial.t, apart, color=colour, **THIN)
    axes.axhline(1e3 * path.band, color=style.DESIRED, **style.LIMIT_STYLE)
    allowed = path.format_value(path.band)
    style.style_axes(axes, f"Distance between the two paths (mm), {allowed} allowed")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time, s")


def draw_pairs(
    t: Array, title: str, names: Sequence[str], reduced: Array, engine: Array, axes: Axes
) -> None:
    """Draw quantities (n, count) of both sides over time: broad of the engine, thin inside."""
    for k, name in enumerate(names):
        colour = style.line_style(k)["color"]
        axes.plot(t, engine[:, k], color=colour, **BROAD)
        axes.plot(t, reduced[:, k], color=colour, label=literal(name), **THIN)
    style.style_axes(axes, title)
    axes.set_xlabel("time, s")
    style.add_legend(axes)


def _finite(motion: ContactMotion) -> Array:
    """Return the poses up to the first that is no number."""
    whole = np.isfinite(motion.pose).all(axis=1)
    return motion.pose if whole.all() else motion.pose[: max(1, int(whole.argmin()))]
