"""The section of a certificate's page on the contact trial: a plan view, and charts over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.contact.record import ContactTrial
from rpctl.view.pages.contact_plan_view import plan_view
from rpctl.view.pages.page import asset, badge, escape

CHART_WIDTH, CHART_HEIGHT = 360.0, 170.0
LEFT_MARGIN, RIGHT_MARGIN, TOP_MARGIN, BOTTOM_MARGIN = 44.0, 12.0, 12.0, 24.0
MAX_LINES = 5  # lines of a chart: more cannot be told apart
HEADROOM_RATIO = 0.08  # of the range of values


def contact_section(trial: ContactTrial) -> tuple[str, str]:
    """Return the section of a trial as HTML, and its style."""
    ground, moves = plan_view(trial)
    drawn = "".join(
        f"<figure{_failing(trial, place)}><figcaption>{escape(title)}<span>{escape(unit)}</span>"
        f"</figcaption>{chart}</figure>"
        for place, (title, unit, chart) in enumerate(trial_charts(trial))
    )
    html = f"""<section class="trial">
<div class="head"><h2>Rolling on a plane</h2>{_badge(trial)}</div>
<p class="lead">{_lead(trial)}</p>
<div class="views"><figure class="ground">{ground}
<ul class="key"><li class="engine">MuJoCo: free body, friction</li>
<li class="reduced">reduced model: rolling as an equation</li></ul>{_notes(trial)}</figure>
<div class="charts">{drawn}</div></div>
</section>
"""
    return html, "\n" + asset("contact.css") + moves


def _lead(trial: ContactTrial) -> str:
    """Return what the reader sees, in a sentence or two."""
    apart = f"<strong>{escape(trial.path.format_value(trial.path.gap))}</strong>"
    close = f"the two paths stay within {apart} of each other"
    if not trial.path.passed:
        allowed = escape(trial.path.format_value(trial.path.band))
        close = f"the two paths come {apart} apart, where {allowed} is allowed"
    return (
        "The same robot as a free body with six degrees of freedom: no equation says that its "
        f"wheels roll, friction makes them. Over {trial.distance:.2f} m in {trial.t[-1]:g} s, "
        f"under the same efforts, {close}. Where the thin line lies inside the broad one, both "
        "agree."
    )


def _notes(trial: ContactTrial) -> str:
    """Return what the two sides share and what is not compared, a line each."""
    lines = "".join(f"<li>{escape(note)}</li>" for note in trial.notes)
    return f'<ul class="notes">{lines}</ul>' if lines else ""


def _badge(trial: ContactTrial) -> str:
    broken = sum(not check.passed for check in trial.checks)
    text = f"{broken} of {len(trial.checks)} gaps too wide" if broken else "both agree"
    return badge(not broken, text)


def _failing(trial: ContactTrial, place: int) -> str:
    """Return the CSS class of a failed chart; only the first, of the paths, has a check."""
    return ' class="failed"' if place == 0 and not trial.path.passed else ""


@dataclass(frozen=True)
class SeriesPair:
    """A quantity on both sides (n,)."""

    label: str
    reduced: Array
    engine: Array


def trial_charts(trial: ContactTrial) -> list[tuple[str, str, str]]:
    """Return the title, the unit and the HTML of each chart."""
    found = [("Distance between the two paths", "mm", _gap_chart(trial))]
    reduced, engine = trial.reduced, trial.engine
    if trial.determinate:
        pairs = _pairs(trial.contacts, reduced.load, engine.load)
        found.append(("Wheel loads", "N", _chart(trial.t, pairs)))
    else:
        pairs = _pairs(("along x", "along y"), reduced.force, engine.force)
        found.append(("Horizontal force of the ground", "N", _chart(trial.t, pairs)))
    torques = [k for k, slides in enumerate(trial.slides) if not slides]
    shown = torques or list(range(len(trial.joints)))
    if shown:
        names = [trial.joints[k] for k in shown]
        pairs = _most_varying(_pairs(names, reduced.efforts[:, shown], engine.efforts[:, shown]))
        title = "Torques of the joints" if torques else "Forces of the joints"
        found.append((title, "N·m" if torques else "N", _chart(trial.t, pairs)))
    return found


def _pairs(labels: Sequence[str], reduced: Array, engine: Array) -> list[SeriesPair]:
    return [SeriesPair(label, reduced[:, k], engine[:, k]) for k, label in enumerate(labels)]


def _most_varying(pairs: list[SeriesPair]) -> list[SeriesPair]:
    """Return the pairs that vary most, in their order."""
    spread = [float(np.ptp(pair.engine)) for pair in pairs]
    kept = sorted(np.argsort(spread)[::-1][:MAX_LINES].tolist())
    return [pairs[k] for k in kept]


def _gap_chart(trial: ContactTrial) -> str:
    """Return the distance between the paths over time, under its band."""
    apart = 1e3 * np.hypot(*(trial.reduced.pose - trial.engine.pose)[:, :2].T)
    band = 1e3 * trial.path.band
    most = float(np.nanmax(apart))
    axes = _Axes(trial.t, 0.0, 1.08 * max(band, most))
    ground, ceiling = axes.y(0.0), axes.y(band)
    area = f"{axes.line(apart)}V{ground:.2f}H{axes.x(0.0):.2f}Z"
    allowed = f"{trial.path.format_value(trial.path.band)} allowed"
    return axes.svg(
        f'<path class="allowed" d="M{LEFT_MARGIN:g} {ceiling:.2f}H{CHART_WIDTH - RIGHT_MARGIN:g}"/>'
        f'<text class="small" x="{CHART_WIDTH - RIGHT_MARGIN:g}" y="{ceiling + 14:.2f}" '
        f'text-anchor="end">{allowed}</text>'
        f'<path class="area" d="{area}"/><path class="gap" d="{axes.line(apart)}"/>',
        "Distance between the two paths over time",
    )


def _chart(t: Array, pairs: list[SeriesPair]) -> str:
    """Return quantities of both sides over time, and what their colours mean."""
    values = np.concatenate([np.append(pair.reduced, pair.engine) for pair in pairs])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    headroom = HEADROOM_RATIO * (high - low) or 1.0
    axes = _Axes(t, low - headroom, high + headroom)
    lines, names = [], []
    for k, pair in enumerate(pairs):
        colour = f"--line: var(--c{k})"
        lines.append(f'<path class="ribbon" style="{colour}" d="{axes.line(pair.engine)}"/>')
        lines.append(f'<path class="thread" style="{colour}" d="{axes.line(pair.reduced)}"/>')
        names.append(f'<li style="{colour}">{escape(pair.label)}</li>')
    svg = axes.svg("".join(lines), ", ".join(escape(pair.label) for pair in pairs))
    return f'{svg}<ul class="names">{"".join(names)}</ul>'


class _Axes:
    """Where times and values lie in a chart."""

    def __init__(self, t: Array, low: float, high: float) -> None:
        self._t, self._low, self._high = t, low, high

    def x(self, time: float) -> float:
        return LEFT_MARGIN + (CHART_WIDTH - LEFT_MARGIN - RIGHT_MARGIN) * time / float(self._t[-1])

    def y(self, value: float) -> float:
        fraction = (value - self._low) / (self._high - self._low)
        return CHART_HEIGHT - BOTTOM_MARGIN - (CHART_HEIGHT - TOP_MARGIN - BOTTOM_MARGIN) * fraction

    def line(self, values: Array) -> str:
        """Return the path of values (n,), those that are no numbers left out."""
        points = (
            f"{self.x(t):.2f} {self.y(value):.2f}"
            for t, value in zip(self._t.tolist(), values.tolist(), strict=True)
            if math.isfinite(value)
        )
        return "M" + "L".join(points)

    def svg(self, inside: str, label: str) -> str:
        """Return the chart with its axes."""
        parts = []
        for value in _ticks(self._low, self._high):
            y = self.y(value)
            parts.append(
                f'<path class="grid" d="M{LEFT_MARGIN:g} {y:.2f}H{CHART_WIDTH - RIGHT_MARGIN:g}"/>'
            )
            parts.append(
                f'<text class="small" x="{LEFT_MARGIN - 6:g}" y="{y + 4:.2f}" text-anchor="end">'
                f"{value:g}</text>"
            )
        end = float(self._t[-1])
        for time in (0.0, 0.5 * end, end):
            anchor = "end" if time == end else "middle" if time else "start"
            text = f"{time:g} s" if time == end else f"{time:g}"
            parts.append(
                f'<text class="small" x="{self.x(time):.2f}" y="{CHART_HEIGHT - 6:g}" '
                f'text-anchor="{anchor}">{text}</text>'
            )
        return (
            f'<svg viewBox="0 0 {CHART_WIDTH:g} {CHART_HEIGHT:g}" role="img" aria-label="{label}">'
            f"{''.join(parts)}{inside}</svg>"
        )


def _ticks(low: float, high: float) -> list[float]:
    """Return round values between two: at most six, at least three."""
    raw = (high - low) / 5.0
    size = 10.0 ** math.floor(math.log10(raw))
    step = size * next(k for k in (1.0, 2.0, 2.5, 5.0, 10.0) if k * size >= raw)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(k * step, 12) for k in range(first, last + 1)]
