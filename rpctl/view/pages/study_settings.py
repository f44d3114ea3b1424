"""What a study varies, and the settings that a search found, as sections of its report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpctl.study.optimum_words import optimum_sentence
from rpctl.study.study_result import StudyResult
from rpctl.study.words import number, parameter_words
from rpctl.view.pages.page import escape, section

DISTRIBUTIONS = {
    "uniform": "uniform, {0} to {1}",
    "log-uniform": "log-uniform, {0} to {1}",
    "normal": "normal, {0} ± {1}",
    "choice": "one of {all}",
}


def optimum_section(result: StudyResult) -> str:
    """Return the settings that ``--optimize`` found beside those of the file; none: nothing."""
    if result.optimum is None:
        return ""
    settings: Mapping[str, Mapping[str, Any]] = result.optimum["settings"]
    rows = "".join(_found_row(name, each) for name, each in settings.items())
    heads = "".join(f"<th>{head}</th>" for head in ("setting", "in the file", "found", "range"))
    text = optimum_sentence(result.optimum).text
    sentence = escape(text[:1].upper() + text[1:])
    table = f'<table class="runs"><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>'
    return section("Settings found", f'<p>{sentence}</p><div class="wide">{table}</div>')


def _found_row(name: str, found: Mapping[str, Any]) -> str:
    words = parameter_words(name)
    before = "–" if found["before"] is None else number(found["before"])
    low, high = found["range"]
    return (
        f'<tr><th title="{escape(name)}">{escape(str(words))}</th><td>{before}</td>'
        f"<td>{number(found['after'])}</td><td>{number(low)} to {number(high)}</td></tr>"
    )


def settings_section(result: StudyResult) -> str:
    """Return what differed from run to run, and the versions that computed it."""
    rows = "".join(
        f'<tr><th title="{escape(name)}">{escape(parameter_words(name).name)}</th>'
        f"<td>{escape(_distribution(each, parameter_words(name).unit))}</td></tr>"
        for name, each in result.scatter.items()
    )
    versions = result.details["identity"]["versions"]
    made = " · ".join(f"{name} {version}" for name, version in versions.items())
    body = f'<div class="wide"><table class="runs">{rows}</table></div>'
    return section("What differs", f'{body}<p class="quiet">{escape(made)}</p>')


def _distribution(found: object, unit: str) -> str:
    """Return a distribution as a study file says it, in words, without ends that it has not."""
    if not isinstance(found, Mapping):
        return f"{found} {unit}".rstrip()
    parts = []
    for kind, args in found.items():
        values = args if isinstance(args, list) else [args]
        said = DISTRIBUTIONS.get(kind, "{kind} {all}") if len(values) > 1 else "{kind} {all}"
        shown = [number(each) if _is_number(each) else str(each) for each in values]
        text = said.format(*shown, kind=kind.replace("-", " "), all=", ".join(shown), unit=unit)
        if kind == "normal" and any(_is_bounded(each) for each in values[2:]):
            text += f", within {shown[2]} to {shown[3]}"
        parts.append(f"{text} {unit}".rstrip())
    return "; ".join(parts)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _is_bounded(value: object) -> bool:
    return not (isinstance(value, float) and np.isinf(value))
