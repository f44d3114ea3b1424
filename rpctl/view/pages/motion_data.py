"""The numbers that a page moves with: charts on one time axis, efforts and ground reactions."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.run.run import Run
from rpctl.view.charts import (
    BASE_SPEED_LABELS,
    NOISE,
    Chart,
    Line,
    charts,
    decades,
    noise_note,
    prefixed,
)
from rpctl.view.labels import shorten

MAX_POINTS = 2000  # of one line: a screen has no more columns
SAME_TIME_S = 1e-9  # s: times that differ by less are the same

Thin = Callable[[Array], Array]
Variants = list[tuple[str, Chart, list[Thin]]]  # label, chart and how its lines are thinned


def packed(values: NDArray[Any]) -> str:
    """Return numbers as base64 of float32, row after row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def chart_data(runs: Sequence[Run], names: Sequence[str]) -> dict[str, Any]:
    """Return the time axis and the charts of runs, ready for JSON.

    Of one run, a chart shows all lines of a kind. Of several, it shows one line of that kind, of
    every run, and its ``variants`` are the lines to choose from.

    Args:
        runs: At least one.
        names: What the runs are called.
    """
    times, thins = _axis([run.t - run.t[0] for run in runs])
    if len(runs) == 1:
        return drawn_charts(times, charts(runs[0]), thins[0])
    return _packed_charts(times, _by_line(runs, names, thins))


def drawn_charts(
    times: Array, drawn: Iterable[Chart], thin: Thin = lambda values: values
) -> dict[str, Any]:
    """Return charts on one time axis (n,), s, ready for JSON.

    Args:
        times: The axis.
        drawn: The charts.
        thin: Makes n values of those of a line.
    """
    return _packed_charts(times, ((c.title, c.note, [("", c, [thin])]) for c in drawn))


def _packed_charts(times: Array, charts: Iterable[tuple[str, str, Variants]]) -> dict[str, Any]:
    """Return charts, each with its title, note and variants, on one time axis (n,), s."""
    return {
        "x": packed(times),
        "charts": [
            {
                "title": title,
                "variants": [
                    {"label": label, **_variant(chart, note, drawn)}
                    for label, chart, drawn in variants
                ],
            }
            for title, note, variants in charts
        ],
    }


def _by_line(
    runs: Sequence[Run], names: Sequence[str], thins: list[Thin]
) -> list[tuple[str, str, Variants]]:
    """Regroup the charts of several runs: per chart and kind of line, one line for each run."""
    gathered: dict[str, dict[str, list[tuple[Chart, Line, int]]]] = {}
    for k, run in enumerate(runs):
        for chart in charts(run):
            for line in chart.lines:
                found = gathered.setdefault(chart.title, {}).setdefault(line.label, [])
                found.append((chart, line, k))
    result = []
    for title, kinds in gathered.items():
        variants: Variants = []
        for label, found in kinds.items():
            lines = tuple(
                replace(line, label=names[k], colour=k, shown=True) for _, line, k in found
            )
            chart = found[0][0]
            unit = lines[0].unit if "," in chart.unit else chart.unit
            chart = replace(chart, unit=unit, lines=lines, named=True)
            variants.append((label, chart, [thins[k] for _, _, k in found]))
        note = variants[0][1].note
        if next(iter(kinds.values()))[0][0].named:
            short = shorten(list(kinds))
            variants = [
                (name, chart, thinned)
                for name, (_, chart, thinned) in zip(short.names, variants, strict=True)
            ]
            note = "; ".join(filter(None, [note, short.shared]))
        result.append((title, note, variants))
    return result


def _variant(chart: Chart, note: str, thins: list[Thin]) -> dict[str, Any]:
    lines = chart.lines
    entry: dict[str, Any] = {"unit": chart.unit, "note": note, "limits": list(chart.limits)}
    if chart.errors:
        prefix, factor = prefixed(chart)
        entry["unit"] = ", ".join(f"{prefix}{unit}" for unit in chart.unit.split(", "))
        entry["note"] = "; ".join(filter(None, [note, noise_note(chart)]))
        entry |= {"factor": factor, "noise": NOISE, "decades": list(decades(lines))}
    if chart.named:
        short = shorten([line.label for line in lines])
        lines = tuple(
            replace(line, label=name) for line, name in zip(lines, short.names, strict=True)
        )
        entry["names"] = short.shared
    each_thin = thins * len(lines) if len(thins) == 1 else thins
    entry["lines"] = [_line(line, thin) for line, thin in zip(lines, each_thin, strict=True)]
    return entry


def _line(line: Line, thin: Thin) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "label": line.label,
        "unit": line.unit,
        "colour": line.colour,
        "shown": line.shown,
        "values": packed(thin(line.values)),
    }
    if line.reference is not None:
        entry["reference"] = packed(thin(line.reference))
    if line.band is not None:
        entry["band"] = [packed(thin(edge)) for edge in line.band]
    return entry


def _axis(time_axes: list[Array]) -> tuple[Array, list[Thin]]:
    """Return a common time axis (n,) and, for each run, a function that resamples its lines to it.

    A short run keeps its samples. Of a longer one, and of runs sampled at other times, each
    stretch of time gives its least and its largest value, in order, so that no peak is lost;
    after the end of a run its lines are NaN.
    """
    first = time_axes[0]
    alike = all(len(t) == len(first) and np.array_equal(t, first) for t in time_axes)
    if alike and len(first) <= MAX_POINTS:
        return first, [lambda values: values for _ in time_axes]
    end = max(float(t[-1]) for t in time_axes)
    gap = max(float(np.diff(t).max()) for t in time_axes if len(t) > 1)
    count = max(1, min(MAX_POINTS // 2, int(end / (2.0 * gap))))
    edges = np.linspace(0.0, end, count + 1)
    return np.linspace(0.0, end, 2 * count), [_extremes(t, edges) for t in time_axes]


def _extremes(t: Array, edges: Array) -> Thin:
    """Return a function that takes the extremes of values (K,) between each edge and the next."""
    starts = np.searchsorted(t, edges[:-1] - SAME_TIME_S)
    starts = starts[starts < len(t)]

    def thin(values: Array) -> Array:
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        falling = values[starts] > 0.5 * (low + high)
        pairs = np.full((len(edges) - 1, 2), np.nan)
        pairs[: len(starts)] = np.stack([low, high], 1)
        pairs[: len(starts)][falling] = np.stack([high, low], 1)[falling]
        return pairs.reshape(-1)

    return thin


def overlay(robot: Robot | RpctlError, run: Run, times: Array) -> dict[str, Any]:
    """Return the efforts and, where they were logged, the ground's reactions at frames.

    Efforts are shares of their limits; without a limit, of their maximum in the run.

    Args:
        robot: The robot of the run, or why it cannot be had: efforts colour nothing then.
        run: The run.
        times: Times of the frames (n,), s, from 0.
    """
    frames = np.searchsorted(run.t - run.t[0], times)
    most, limits = np.abs(run.tau).max(axis=0), np.array(run.robot.effort_limits)
    scale = np.where(np.isfinite(limits) & (limits > 0.0), limits, np.maximum(most, 1e-12))
    largest = np.maximum.reduceat(np.abs(run.tau), frames)  # up to the next frame
    return {
        "effort": {
            "joints": [
                0 if isinstance(robot, RpctlError) else robot.model.getJointId(name)
                for name in run.robot.actuators
            ],
            "share": packed(largest / scale),
        },
        "stance": _stance(run, frames),
    }


def contact_forces(run: Run, samples: Any = slice(None)) -> Array:
    """Return the force of the ground on each contact (n, n_contacts, 3), root link's axes, N.

    The lateral force of an axle is shared in proportion to its wheels' loads. Wheels that steer
    push in directions that the log does not hold: for them only the load is given.
    """
    loads, wheel_force = run.log.contact_load[samples], run.log.wheel_force[samples]
    force = np.zeros((*loads.shape, 3))
    force[:, :, 2] = loads
    if not set(run.robot.quasi_velocities) <= {*BASE_SPEED_LABELS, *run.robot.joint_names}:
        return force
    force[:, : wheel_force.shape[1], 0] = wheel_force
    for axle, lateral in zip(run.ground.axles, run.log.axle_force[samples].T, strict=True):
        load = np.maximum(loads[:, list(axle)], 0.0)
        load_fraction = load / np.maximum(load.sum(axis=1, keepdims=True), 1e-12)
        force[:, list(axle), 1] = load_fraction * lateral[:, None]
    cos, sin = np.cos(run.robot.drive.heading), np.sin(run.robot.drive.heading)
    force[:, :, :2] = force[:, :, :2] @ np.array([[cos, sin], [-sin, cos]])
    return force


def _stance(run: Run, frames: NDArray[np.int64]) -> dict[str, Any] | None:
    """Return contacts, forces, support polygon and zero-moment point in the root link's frame."""
    if not run.log.tip_margin.size:
        return None
    points = np.array(run.ground.points)
    x, y, cos, sin = run.q[frames, :4].T
    dx, dy = run.log.zmp[frames, 0] - x, run.log.zmp[frames, 1] - y
    stance: dict[str, Any] = {
        "height": run.robot.drive.ground,
        "points": np.round(points, 4).tolist(),
        "polygon": ConvexHull(points).vertices.tolist(),
        "pose": packed(np.column_stack([x, y, np.unwrap(np.arctan2(sin, cos))])),
        "zmp": packed(np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx])),
        "margin": packed(run.log.tip_margin[frames]),
    }
    if run.log.contact_load.size:
        stance["force"] = packed(contact_forces(run, frames))
        load = run.log.contact_load
        stance["largest"] = float(max(load.max(), -load.min()))
    return stance
