"""The ground of a contact trial seen from above: both paths, and the robot that rolls along them.

No script may run on a certificate and none does: the robot moves by CSS keyframes, in real time,
and stands still where the reader asks for less motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from rpctl.arrays import Array
from rpctl.equivalence.contact.record import ContactTrial

PLAN_WIDTH, MIN_HEIGHT, MAX_HEIGHT = 480.0, 300.0, 560.0
PLAN_MARGIN = 34.0
KEYFRAME_COUNT = 40  # keyframes of the moving robots: 50 ms apart
ARROW_RATIO = 0.07  # of the robot's size: the arrow that points ahead
LABEL_DISTANCE = 20.0  # of a word from the place that it names
PAUSE_S = 1.2  # s for which they wait at the end
GRID_SIZES_M = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # m, of the grid
MAX_SQUARES = 14  # of them across the picture, at most


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


def plan_view(trial: ContactTrial) -> tuple[str, str]:
    """Return the picture as inline SVG, and the style that moves the robots in it."""
    outline = trial.footprint[ConvexHull(trial.footprint).vertices]
    engine, reduced = (_finite(motion.pose) for motion in (trial.engine, trial.reduced))
    ends = np.vstack([_placed(outline, pose) for pose in (engine[0], engine[-1], reduced[-1])])
    viewport = _fit_viewport(np.vstack([ends, engine[:, :2], reduced[:, :2]]))
    parts = [_grid(viewport)]
    parts += [_contact_paths(trial.footprint, engine, viewport)]
    parts += [f'<path class="ribbon" d="{_line(viewport.place(engine[:, :2]))}"/>']
    parts += [f'<path class="thread" d="{_line(viewport.place(reduced[:, :2]))}"/>']
    parts += [_outline_at("start", outline, engine[0], viewport)]
    parts += [_outline_at("end engine", outline, engine[-1], viewport)]
    parts += [_outline_at("end reduced", outline, reduced[-1], viewport)]
    parts += [_robot(kind, trial.footprint, outline, viewport) for kind in ("engine", "reduced")]
    parts += [
        _label("start", engine[0], -LABEL_DISTANCE, viewport),
        _label("end", engine[-1], LABEL_DISTANCE, viewport),
    ]
    parts += [_scale_bar(viewport)]
    gap_text = trial.path.format_value(trial.path.gap)
    label = f"Both paths seen from above; they are at most {gap_text} apart"
    box = f"0 0 {PLAN_WIDTH:g} {viewport.height:.0f}"
    svg = (
        f'<svg class="plan" viewBox="{box}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )
    duration = float(trial.t[-1])
    moves = (_keyframes(kind, pose, viewport, duration) for kind, pose in _sides(engine, reduced))
    return svg, "\n".join(moves)


def _sides(engine: Array, reduced: Array) -> tuple[tuple[str, Array], ...]:
    return ("engine", engine), ("reduced", reduced)


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


def _square(viewport: Viewport) -> float:
    """Return the edge of the grid's squares, m."""
    across = PLAN_WIDTH / viewport.scale
    return next((edge for edge in GRID_SIZES_M if across / edge <= MAX_SQUARES), GRID_SIZES_M[-1])


def _grid(viewport: Viewport) -> str:
    edge, lines = _square(viewport), []
    right, bottom = (
        viewport.left + PLAN_WIDTH / viewport.scale,
        viewport.top - viewport.height / viewport.scale,
    )
    for k in range(math.ceil(viewport.left / edge), math.floor(right / edge) + 1):
        x = (k * edge - viewport.left) * viewport.scale
        lines.append(f"M{x:.2f} 0V{viewport.height:.0f}")
    for k in range(math.ceil(bottom / edge), math.floor(viewport.top / edge) + 1):
        y = (viewport.top - k * edge) * viewport.scale
        lines.append(f"M0 {y:.2f}H{PLAN_WIDTH:g}")
    return f'<path class="grid" d="{"".join(lines)}"/>'


def _scale_bar(viewport: Viewport) -> str:
    """Return the scale bar: the length of a square of the grid."""
    edge = _square(viewport)
    long, text = edge * viewport.scale, f"{edge:g} m" if edge >= 1.0 else f"{100 * edge:g} cm"
    x, y = PLAN_WIDTH - 16.0, viewport.height - 14.0
    return (
        f'<path class="bar" d="M{x - long:.2f} {y - 4:g}V{y:g}H{x:g}V{y - 4:g}"/>'
        f'<text class="small" x="{x - 0.5 * long:.2f}" y="{y - 8:g}" text-anchor="middle">'
        f"{text}</text>"
    )


def _contact_paths(footprint: Array, pose: Array, viewport: Viewport) -> str:
    """Return the path of every contact."""
    ways = np.array([_placed(footprint, at) for at in pose[::5]])
    lines = "".join(_line(viewport.place(ways[:, k])) for k in range(len(footprint)))
    return f'<path class="track" d="{lines}"/>'


def _outline_at(kind: str, outline: Array, pose: Array, viewport: Viewport) -> str:
    """Return the outline of the contacts where the robot stands."""
    corners = _line(viewport.place(_placed(outline, pose)))
    return f'<path class="stand {kind}" d="{corners}Z"/>'


def _robot(kind: str, footprint: Array, outline: Array, viewport: Viewport) -> str:
    """Return a robot at the picture's origin, which the keyframes move; it points along x."""
    flip = np.array([1.0, -1.0]) * viewport.scale
    dots = "".join(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="3"/>' for x, y in footprint * flip)
    nose = ARROW_RATIO * float(np.ptp(outline, axis=0).max()) * viewport.scale
    arrow = f"M{nose:.2f} 0L{-0.6 * nose:.2f} {-0.6 * nose:.2f}V{0.6 * nose:.2f}Z"
    return (
        f'<g class="robot {kind}"><path class="hull" d="{_line(outline * flip)}Z"/>{dots}'
        f'<path class="nose" d="{arrow}"/></g>'
    )


def _label(text: str, pose: Array, ahead: float, viewport: Viewport) -> str:
    """Return a marker at the root link's position, and a text at a distance (m) ahead of it."""
    x, y = viewport.place(pose[None, :2])[0]
    u, v = x + ahead * math.cos(pose[2]), y - ahead * math.sin(pose[2]) + 4.0
    return (
        f'<circle class="post" cx="{x:.2f}" cy="{y:.2f}" r="3.5"/>'
        f'<text class="small halo" x="{u:.2f}" y="{v:.2f}" text-anchor="middle">{text}</text>'
    )


def _keyframes(kind: str, pose: Array, viewport: Viewport, duration: float) -> str:
    """Return the keyframes of a robot: the actual poses, in real time, then a pause."""
    picked = np.unique(np.linspace(0, len(pose) - 1, KEYFRAME_COUNT + 1).round().astype(int))
    turn = np.unwrap(pose[:, 2])
    percent_per_sample = 100.0 * duration / (duration + PAUSE_S) / max(len(pose) - 1, 1)
    steps = []
    for k, (x, y) in zip(picked.tolist(), viewport.place(pose[picked, :2]).tolist(), strict=True):
        move = f"translate({x:.2f}px,{y:.2f}px) rotate({-math.degrees(turn[k]):.3f}deg)"
        steps.append((percent_per_sample * k, move))
    steps.append((100.0, steps[-1][1]))
    frames = "".join(f"{at:.2f}%{{transform:{move}}}" for at, move in _without_repeats(steps))
    clock = f"{duration + PAUSE_S:g}s linear infinite"
    return (
        f"@keyframes roll-{kind}{{{frames}}}\n"
        f".robot.{kind}{{transform:{steps[0][1]};animation:roll-{kind} {clock}}}"
    )


def _without_repeats(steps: list[tuple[float, str]]) -> list[tuple[float, str]]:
    """Return keyframes without those that repeat the moment of the next."""
    return [a for a, b in pairwise(steps) if b[0] - a[0] > 0.005] + [steps[-1]]
