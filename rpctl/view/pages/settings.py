"""The settings of a run in words: reference, laws, plant, as their records call them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from pathlib import PurePath
from typing import Any

from rpctl.control.approach import Approach
from rpctl.control.error import Leash
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS, name_of, settings_of
from rpctl.files.records import IN_PYTHON, FieldType, fields_of
from rpctl.simulation.merits.obstacles import OBSTACLE_SETTINGS
from rpctl.simulation.run.run import Run
from rpctl.view.scene.stage import obstacle_texts

GAINS = "gains: "  # how the sentence on the gains begins
GAINS_LABEL = "Gains"  # of that sentence, too long for a row
NESTED_LAWS = ("base", "inner", "fallback")  # laws within laws
REPORT_LABELS = {  # of what a law says of itself after a run
    "softened": "Solves with a softened bound",
    "largest_lag": "Reference read late by, s",
}
Rows = Iterator[tuple[str, str]]  # label and text


def setting_texts(run: Run) -> dict[str, str]:
    """Return the settings of a run as texts by their labels."""
    rows: dict[str, str] = {}
    for group, pairs in _groups(run):
        for label, text in pairs:
            rows[f"{label} ({group})" if label in rows else label] = text
    return rows


def _groups(run: Run) -> Iterator[tuple[str, Rows]]:
    """Yield the settings of a run, label and text, in groups, in the order that is shown."""
    config, output = run.config, run.config.output
    yield "run", _record_rows(config.run, labelled=True)
    for group in ("kinematic", "dynamic") if output is None else ("kinematic",):
        law = getattr(config, group)
        yield group, iter([(f"{group.capitalize()} law", name_of(law)), *_law_rows(law)])
        yield group, iter(obstacle_texts(law).items())
    if output is not None:
        yield "output", iter([("Output", "velocity"), *_record_rows(output, changed=True)])
    gains = [each for each in run.law_sentences if each.startswith(GAINS)]
    yield "gains", ((GAINS_LABEL, each.removeprefix(GAINS)) for each in gains)
    yield "plant", _record_rows(config.plant, changed=True)
    if run.controller_model:
        yield "plant", iter([("Believed", setting_text(run.controller_model))])
    report = run.kinematic_report.items()
    yield "report", ((REPORT_LABELS.get(k, _plain_label(k)), setting_text(v)) for k, v in report)


def _law_rows(law: object) -> Rows:
    """Yield the settings of a law, and of laws within it; obstacles stand elsewhere."""
    laws = (*KINEMATIC_LAWS.values(), *DYNAMIC_LAWS.values())
    known = {name: each for kind in laws for name, each in fields_of(kind).items()}
    for name, value in settings_of(law).items():
        label = _label(name, known.get(name))
        if isinstance(value, Leash | Approach):
            yield f"{label} (m, rad)", setting_text((value.distance, value.heading))
        elif name in NESTED_LAWS and value is not None:
            yield label, name_of(value)
            yield from _law_rows(value)
        elif name in OBSTACLE_SETTINGS or isinstance(value, Mapping) or is_dataclass(value):
            continue
        elif not _is_empty(value):
            yield label, setting_text(value)


def _record_rows(
    record: Any, above: str = "", *, changed: bool = False, labelled: bool = False
) -> Rows:
    """Yield the settings in a record and in those that it holds.

    Args:
        record: The record.
        above: What their labels begin with.
        changed: Whether only those are told that are not as by default.
        labelled: Whether only those are told that have a label.
    """
    kind: Any = type(record)
    for name, each in fields_of(kind).items():
        value = getattr(record, name)
        if each.setting is IN_PYTHON or _is_empty(value) or value is False:
            continue
        if (changed and value == each.default) or (labelled and not each.setting.label):
            continue
        if isinstance(value, Mapping):
            for key, item in value.items():
                yield above + _label(name, each, f" of {key}"), setting_text(item)
        elif is_dataclass(value):
            yield from _record_rows(value, f"{above}{_label(name, each)}: ", changed=True)
        elif isinstance(value, tuple) and is_dataclass(value[0]):
            for k, item in enumerate(value, 1):
                yield from _record_rows(item, f"{_label(name, each)} {k}: ", changed=True)
        else:
            yield above + _label(name, each), setting_text(value)


def _is_empty(value: object) -> bool:
    return value is None or value in ((), [], "")


def _label(name: str, field: FieldType | None, of: str = "") -> str:
    """Return what a setting is called, and its unit."""
    label = f"{(field and field.setting.label) or _plain_label(name)}{of}"
    return f"{label}, {field.setting.unit}" if field and field.setting.unit else label


def _plain_label(name: str) -> str:
    return name.replace("_", " ").capitalize()


def setting_text(value: Any) -> str:
    """Return a setting as text; of a file only its name, as reports are passed on."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(setting_text(item) for item in value)
    text = str(value)
    return PurePath(text).name if PurePath(text).is_absolute() else text
