"""The figures of merit of a run beside the scene, as HTML: errors, lag, outcome, limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

from rpctl.simulation.collision_facts import clearance_text, collision_texts
from rpctl.simulation.outcome import SUCCESSES
from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary, Violation
from rpctl.simulation.texts import lag, length
from rpctl.view.charts import has_base
from rpctl.view.pages.page import badge, definitions, escape, section

MERIT_LABELS = {
    "rms_base_error": "Base, rms",
    "final_base_error": "Base, final",
    "final_lateral_error": "Base, final lateral",
    "rms_base_path_error": "Base off its path, rms",
    "base_lag": "Base behind, at most",
    "rms_end_effector_error": "End effector, rms",
    "final_end_effector_error": "End effector, final",
    "rms_end_effector_path_error": "End effector off its path, rms",
}
HEADLINE = ("rms_base_error", "rms_base_path_error", "rms_end_effector_error")
NOMINAL = "The model follows itself: the simulated robot is the one that the controller knows."


def merits(run: Run, summary: Summary) -> dict[str, str]:
    """Return the run's figures of merit as texts by their keys; a fixed base has none of a base."""
    base, tip = summary.base_path, summary.end_effector_path
    figures: dict[str, float | None] = {
        **{key: getattr(summary, key) for key in MERIT_LABELS if hasattr(summary, key)},
        "rms_base_path_error": base.rms,
        "rms_end_effector_path_error": None if tip is None else tip.rms,
    }
    texts = {key: length(figure) for key, figure in figures.items() if is_finite(figure)}
    if is_finite(base.largest_lag):
        texts["base_lag"] = lag(base.largest_lag, base.largest_lag_distance)
    return {
        key: texts[key]
        for key in MERIT_LABELS
        if key in texts and (has_base(run) or "end_effector" in key)
    }


def headline_rows(run: Run, summary: Summary) -> list[tuple[str, str]]:
    """Return the few figures that stand above everything else, with their labels."""
    known = merits(run, summary)
    rows = [(MERIT_LABELS[key], known[key]) for key in HEADLINE if key in known]
    if is_finite(summary.max_effort_ratio):
        rows.append(("Effort / limit", f"{100.0 * summary.max_effort_ratio:.0f} %"))
    return rows


def merits_section(run: Run, summary: Summary) -> str:
    """Return the section of the figures of merit."""
    rows = [(MERIT_LABELS[key], text) for key, text in merits(run, summary).items()]
    if is_finite(summary.max_effort_ratio):
        rows.append(("Largest effort / limit", f"{100.0 * summary.max_effort_ratio:.0f} %"))
    if is_finite(summary.realtime_factor):
        rows.append(("Simulated at", f"{summary.realtime_factor:.3g} × real time"))
    marks = outcome_badge(summary) + limits_badge(summary.limits_violated)
    sentences = [f"{summary.outcome.capitalize()}: {summary.outcome_sentence}."]
    sentences += [NOMINAL] if summary.nominal else []
    if run.recording is not None and run.recording["sentence"]:
        sentences.append(f"The reference: {run.recording['sentence']}.")
    if run.perturbed is not None:
        sentences.append(f"Expect, {run.perturbed['sentence']}.")
    sentences += [_violation(each) for each in summary.limits_violated]
    sentences += [f"{each.sentence}." for each in summary.limits_bound]
    sentences += [f"{each}." for each in collision_texts(summary.collisions)]
    if summary.clearances:
        sentences.append(f"Nearest to {', '.join(map(clearance_text, summary.clearances))}.")
    sentences += [f"{each[:1].upper()}{each[1:]}." for each in summary.collision_notes]
    if summary.energy_sentence:
        sentences.append(f"{summary.energy_sentence[0].upper()}{summary.energy_sentence[1:]}.")
    if summary.ground.sentence:
        sentences.append(f"On the ground: {summary.ground.sentence}.")
    if summary.felt_ground is not None:
        sentences.append(f"In the plant: {summary.felt_ground.sentence}.")
    details = "".join(f"<li>{escape(text)}</li>" for text in sentences)
    body = f'<ul class="notes">{details}</ul>'
    return section("Tracking error" + marks, definitions(rows) + body)


def outcome_badge(summary: Summary) -> str:
    """Return the badge of what became of a run."""
    return badge(summary.outcome in SUCCESSES, summary.outcome)


def certificate_badge(certificate: Mapping[str, Any], text: str = "verified") -> str:
    """Return the badge of a certificate."""
    passed = bool(certificate["passed"])
    return badge(passed, text if passed else "not equivalent")


def limits_badge(broken: Sequence[Violation]) -> str:
    """Return the badge of the limits that were broken."""
    return badge(not broken, "limits broken" if broken else "within limits")


def _violation(broken: Violation) -> str:
    return (
        f"{broken.joint}: {broken.limit} {broken.value:.4g}, allowed "
        f"{broken.allowed:.4g}, from {broken.first_time:.2f} s"
    )


def is_finite(figure: float | None) -> TypeGuard[float]:
    """Return whether a figure of merit is a finite number."""
    return figure is not None and math.isfinite(figure)
