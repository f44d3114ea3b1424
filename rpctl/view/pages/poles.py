"""The section of a report on the linear loop about the reference motion, as HTML."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.linear_loop import STILL, LoopPoles, loop_poles
from rpctl.simulation.run import Run
from rpctl.view.pages.page import badge, definitions, escape, section

WIDTH, HEIGHT, EDGE = 240, 48, 4  # of the drawing, pixels
NO_SWING = 0.99  # damping of poles that are equal but for rounding
LOW_DAMPING = 0.4  # below it a loop overshoots by a quarter and swings on
HOW = (
    "Eigenvalues of the sampled loop, efforts held for a control period, linearised about the "
    "reference at instants at which it moves. They judge motions that change slowly beside them."
)


def poles_section(run: Run, robot: Robot | RpctlError) -> str:
    """Return the section on the poles of a run's loop; empty where its robot cannot be had."""
    if isinstance(robot, RpctlError):
        return ""
    try:
        poles = loop_poles(run, robot)
    except RpctlError as error:
        return section("Linear loop", f'<p class="quiet">{escape(f"None: {error}.")}</p>')
    stable = bool(poles.decay.min() > -STILL)
    rows = [("Slowest pole", _slowest(poles)), ("Least damped", _least_damped(poles))]
    body = definitions(rows) + _drawing(poles.t, poles.decay)
    body += f'<ul class="notes"><li>{escape(verdict(poles))}</li></ul>'
    mark = badge(stable, "stable" if stable else "unstable")
    return section("Linear loop" + mark, body + f'<p class="quiet">{escape(HOW)}</p>')


def verdict(poles: LoopPoles) -> str:
    """Return what a designer would say of the poles, in one sentence."""
    worst = float(poles.decay.min())
    if worst < -STILL:
        grown = poles.t[poles.decay < -STILL]
        return (
            f"Errors grow near the reference between {grown[0]:.3g} and {grown[-1]:.3g} s: other "
            "gains or a shorter control period are needed."
        )
    if worst < STILL:
        return "An error stays as it is: the law does not act on it while the reference moves so."
    if poles.damping.min() < LOW_DAMPING:
        return "Errors decay, but swing several times: more damping would serve."
    return f"Errors decay at all instants, the slowest by 63 % within {1.0 / worst:.3g} s."


def _slowest(poles: LoopPoles) -> str:
    k = int(poles.decay.argmin())
    rate = float(poles.decay[k])
    shown = 0.0 if abs(rate) < STILL else -rate
    return f"{shown:.3g} 1/s at {poles.t[k]:.3g} s"


def _least_damped(poles: LoopPoles) -> str:
    k = int(poles.damping.argmin())
    if poles.damping[k] > NO_SWING:
        return "none oscillates"
    return f"ζ = {poles.damping[k]:.2f} at {poles.t[k]:.3g} s"


def _drawing(t: Array, decay: Array) -> str:
    """Return a drawing of the slowest decay rate along the run, zero at its foot."""
    if len(t) < 2:
        return ""
    top = max(float(decay.max()), STILL)
    x = EDGE + (WIDTH - 2 * EDGE) * (t - t[0]) / (t[-1] - t[0])
    y = HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * np.clip(decay, 0.0, None) / top
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    label = f"Slowest decay rate from {t[0]:.3g} to {t[-1]:.3g} s, at most {top:.3g} 1/s"
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)}">'
        f"<title>{escape(label)}</title>"
        f'<path d="M{EDGE} {HEIGHT - EDGE}H{WIDTH - EDGE}" stroke="currentColor" opacity=".3"/>'
        f'<polyline points="{points}" fill="none" stroke="currentColor"/></svg>'
    )
