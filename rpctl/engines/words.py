"""The referee's line on an engine, and on each of its causes."""

from __future__ import annotations

import math
from typing import Any

from rpctl.engines.comparison import EngineGap
from rpctl.engines.referee import Cause, EngineVerdict, beyond
from rpctl.engines.turning import SWINGS, near


def line(verdict: EngineVerdict) -> str:
    """Return what the referee says of an engine, in one line."""
    head = f"{verdict.engine} {verdict.version}"
    if verdict.trace is None:
        return f"{head}: agrees with the reduced model"
    symptom = beyond(verdict.gaps)[0].words
    found = verdict.trace
    if found.mended.fault:
        return f"{head}: {symptom}; all mended it still does not run: {found.mended.fault}"
    parts = [cause_words(cause, verdict.friction) for cause in found.causes]
    said = f"{head}: {symptom}: {'; also '.join(parts)}" if parts else f"{head}: {symptom}"
    if found.cured:
        said += f"; with that mended it still {found.cured[0].words}"
    if found.remaining:
        said += f"; all mended it still {found.remaining[0].words}, which no setting explains"
    return said


def turn_line(verdict: EngineVerdict) -> str:
    """Return what the referee says of a skid-steer base's turn in place; empty if nothing."""
    turn = verdict.turn
    if turn is None or not turn.agrees:
        return ""
    head, mended = f"{verdict.engine} {verdict.version}", f"{turn.mended.track:.2f} m"
    known = (
        f"(the reduced model: {turn.declared:.2f} m as declared; its own wheels' places: "
        f"{turn.own:.2f} m)"
    )
    default = turn.default
    if default is not None and near(default.track, turn.mended.track):
        said = f"{head}: turns in place as on a track of {mended} {known}"
    elif default is not None and math.isfinite(default.track):
        hops = " and its wheels hop" if default.swing > SWINGS else ""
        said = (
            f"{head}: turns in place as on a track of {default.track:.2f} m{hops}; as on "
            f"{mended} once mended {known}: {turn.setting}"
        )
    else:
        said = f"{head}: does not turn in place; as on {mended} once mended {known}: {turn.setting}"
    if near(turn.declared, turn.mended.track):
        return said
    return f"{said}; declare [drive] track = {turn.mended.track:.3g}"


def cause_words(cause: Cause, friction: float) -> str:
    """Return a cause, what it does alone, and the setting that mends it.

    Args:
        cause: The cause.
        friction: Coefficient of the ground, written where a setting says MU.
    """
    fault = ", and ".join(switch.fault for switch in cause.switches)
    does = f" (alone: {cause.gaps[0].words})" if cause.gaps else " (with the others only)"
    return f"{fault}{does}; {setting(cause, friction)}"


def verdict_to_dict(verdict: EngineVerdict) -> dict[str, Any]:
    """Return a verdict as plain values for JSON; what is infinite is None."""
    found = verdict.trace
    return {
        "engine": verdict.engine,
        "version": verdict.version,
        "agrees": verdict.agrees,
        "traced": verdict.traced,
        "line": line(verdict),
        "gaps": [_gap_to_dict(gap) for gap in verdict.gaps],
        "causes": [
            {
                "switches": list(cause.names),
                "fault": "; ".join(switch.fault for switch in cause.switches),
                "setting": setting(cause, verdict.friction),
                "alone": [_gap_to_dict(gap) for gap in cause.gaps],
            }
            for cause in (found.causes if found else ())
        ],
        "remaining": [_gap_to_dict(gap) for gap in (found.remaining if found else ())],
        "notes": list(verdict.notes),
        "turn": _turn_to_dict(verdict),
    }


def _turn_to_dict(verdict: EngineVerdict) -> dict[str, Any] | None:
    turn = verdict.turn
    if turn is None:
        return None
    default = turn.default.track if turn.default is not None else math.inf
    return {
        "track": default if math.isfinite(default) else None,
        "mended": turn.mended.track if math.isfinite(turn.mended.track) else None,
        "declared": turn.declared,
        "own": turn.own,
        "agrees": turn.agrees,
        "line": turn_line(verdict),
    }


def setting(cause: Cause, friction: float) -> str:
    """Return the setting that mends a cause.

    Args:
        cause: The cause.
        friction: Coefficient of the ground, written where a setting says MU.
    """
    settings = "; ".join(switch.setting for switch in cause.switches)
    return settings.replace("MU", f"{friction:g}")


def _gap_to_dict(gap: EngineGap) -> dict[str, Any]:
    size = gap.gap if math.isfinite(gap.gap) else None
    return {
        "name": gap.name,
        "gap": size,
        "band": gap.band,
        "unit": gap.unit,
        "agrees": gap.agrees,
        "words": gap.words,
    }
