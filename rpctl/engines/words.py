"""The referee's line on an engine, and on each of its causes."""

from __future__ import annotations

import math
from typing import Any

from rpctl.engines.causes import Cause, beyond
from rpctl.engines.comparison import EngineGap
from rpctl.engines.referee import EngineVerdict


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
