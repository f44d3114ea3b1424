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

WIDTH, LOWEST, TALLEST = 480.0, 300.0, 560.0
MARGIN = 34.0
FRAMES = 40  # keyframes of the moving robots: 50 ms apart
NOSE = 0.07  # of the robot's size: the arrow that points ahead
AWAY = 20.0  # of a word from the place that it names
PAUSE = 1.2  # s for which they wait at the end
SQUARES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # m, of the grid
COUNT = 14  # of them across the picture, at most


@dataclass(frozen=True)
class Frame:
    """Where points of the floor (m) lie in the picture: x to the right, y up."""

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
    frame = _frame(np.vstack([ends, engine[:, :2], reduced[:, :2]]))
    parts = [_grid(frame)]
    parts += [_tracks(trial.footprint, engine, frame)]
    parts += [f'<path class="ribbon" d="{_line(frame.place(engine[:, :2]))}"/>']
    parts += [f'<path class="thread" d="{_line(frame.place(reduced[:, :2]))}"/>']
    parts += [_stand("start", outline, engine[0], frame)]
    parts += [_stand("end engine", outline, engine[-1], frame)]
    parts += [_stand("end reduced", outline, reduced[-1], frame)]
    parts += [_robot(kind, trial.footprint, outline, frame) for kind in ("engine", "reduced")]
    parts += [_word("start", engine[0], -AWAY, frame), _word("end", engine[-1], AWAY, frame)]
    parts += [_bar(frame)]
    told = trial.path.told(trial.path.gap)
    label = f"Both paths seen from above; they are at most {told} apart"
    box = f"0 0 {WIDTH:g} {frame.height:.0f}"
    svg = (
        f'<svg class="plan" viewBox="{box}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )
    duration = float(trial.t[-1])
    moves = (_moves(kind, pose, frame, duration) for kind, pose in _sides(engine, reduced))
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


def _frame(points: Array) -> Frame:
    """Return the frame that holds points (n, 2) in the middle of the picture."""
    low, high = points.min(axis=0), points.max(axis=0)
    wide, tall = np.maximum(high - low, 1e-6).tolist()
    inside = WIDTH - 2.0 * MARGIN
    height = min(max(inside * tall / wide + 2.0 * MARGIN, LOWEST), TALLEST)
    scale = min(inside / wide, (height - 2.0 * MARGIN) / tall)
    x, y = (0.5 * (low + high)).tolist()
    return Frame(x - 0.5 * WIDTH / scale, y + 0.5 * height / scale, scale, height)


def _line(points: Array) -> str:
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points.tolist())


def _square(frame: Frame) -> float:
    """Return the edge of the grid's squares, m."""
    across = WIDTH / frame.scale
    return next((edge for edge in SQUARES if across / edge <= COUNT), SQUARES[-1])


def _grid(frame: Frame) -> str:
    edge, lines = _square(frame), []
    right, bottom = frame.left + WIDTH / frame.scale, frame.top - frame.height / frame.scale
    for k in range(math.ceil(frame.left / edge), math.floor(right / edge) + 1):
        x = (k * edge - frame.left) * frame.scale
        lines.append(f"M{x:.2f} 0V{frame.height:.0f}")
    for k in range(math.ceil(bottom / edge), math.floor(frame.top / edge) + 1):
        y = (frame.top - k * edge) * frame.scale
        lines.append(f"M0 {y:.2f}H{WIDTH:g}")
    return f'<path class="grid" d="{"".join(lines)}"/>'


def _bar(frame: Frame) -> str:
    """Return the bar that tells the length of a square."""
    edge = _square(frame)
    long, text = edge * frame.scale, f"{edge:g} m" if edge >= 1.0 else f"{100 * edge:g} cm"
    x, y = WIDTH - 16.0, frame.height - 14.0
    return (
        f'<path class="bar" d="M{x - long:.2f} {y - 4:g}V{y:g}H{x:g}V{y - 4:g}"/>'
        f'<text class="small" x="{x - 0.5 * long:.2f}" y="{y - 8:g}" text-anchor="middle">'
        f"{text}</text>"
    )


def _tracks(footprint: Array, pose: Array, frame: Frame) -> str:
    """Return the way of every contact."""
    ways = np.array([_placed(footprint, at) for at in pose[::5]])
    lines = "".join(_line(frame.place(ways[:, k])) for k in range(len(footprint)))
    return f'<path class="track" d="{lines}"/>'


def _stand(kind: str, outline: Array, pose: Array, frame: Frame) -> str:
    """Return the outline of the contacts where the robot stands."""
    corners = _line(frame.place(_placed(outline, pose)))
    return f'<path class="stand {kind}" d="{corners}Z"/>'


def _robot(kind: str, footprint: Array, outline: Array, frame: Frame) -> str:
    """Return a robot at the picture's origin, which the keyframes move; it points along x."""
    flip = np.array([1.0, -1.0]) * frame.scale
    dots = "".join(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="3"/>' for x, y in footprint * flip)
    nose = NOSE * float(np.ptp(outline, axis=0).max()) * frame.scale
    arrow = f"M{nose:.2f} 0L{-0.6 * nose:.2f} {-0.6 * nose:.2f}V{0.6 * nose:.2f}Z"
    return (
        f'<g class="robot {kind}"><path class="hull" d="{_line(outline * flip)}Z"/>{dots}'
        f'<path class="nose" d="{arrow}"/></g>'
    )


def _word(text: str, pose: Array, ahead: float, frame: Frame) -> str:
    """Return a post at the root link's place, and a word so far ahead of it."""
    x, y = frame.place(pose[None, :2])[0]
    u, v = x + ahead * math.cos(pose[2]), y - ahead * math.sin(pose[2]) + 4.0
    return (
        f'<circle class="post" cx="{x:.2f}" cy="{y:.2f}" r="3.5"/>'
        f'<text class="small halo" x="{u:.2f}" y="{v:.2f}" text-anchor="middle">{text}</text>'
    )


def _moves(kind: str, pose: Array, frame: Frame, duration: float) -> str:
    """Return the keyframes of a robot: the actual poses, in real time, then a pause."""
    picked = np.unique(np.linspace(0, len(pose) - 1, FRAMES + 1).round().astype(int))
    turn = np.unwrap(pose[:, 2])
    share = 100.0 * duration / (duration + PAUSE) / max(len(pose) - 1, 1)
    steps = []
    for k, (x, y) in zip(picked.tolist(), frame.place(pose[picked, :2]).tolist(), strict=True):
        move = f"translate({x:.2f}px,{y:.2f}px) rotate({-math.degrees(turn[k]):.3f}deg)"
        steps.append((share * k, move))
    steps.append((100.0, steps[-1][1]))
    frames = "".join(f"{at:.2f}%{{transform:{move}}}" for at, move in _apart(steps))
    clock = f"{duration + PAUSE:g}s linear infinite"
    return (
        f"@keyframes roll-{kind}{{{frames}}}\n"
        f".robot.{kind}{{transform:{steps[0][1]};animation:roll-{kind} {clock}}}"
    )


def _apart(steps: list[tuple[float, str]]) -> list[tuple[float, str]]:
    """Return keyframes without those that repeat the moment of the next."""
    return [a for a, b in pairwise(steps) if b[0] - a[0] > 0.005] + [steps[-1]]
