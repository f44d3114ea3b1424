"""The texts beside several runs, as HTML: a column a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary
from rpctl.view.charts import has_base
from rpctl.view.pages.summary_panel import (
    MERIT_LABELS,
    certificate_badge,
    is_finite,
    keyboard_section,
    legend_entry,
    limits_badge,
    merits,
    notes_section,
    obstacle_entries,
    setting_texts,
)

PALETTE_SIZE = 12  # colours --c0 to --c11 of the style sheet


def compare_panel(
    runs: Sequence[Run],
    names: Sequence[str],
    summaries: Sequence[Summary],
    notes: Sequence[str],
) -> str:
    """Return the panel of several runs: figures of merit, settings, notes, keys."""
    texts = [merits(run, summary) for run, summary in zip(runs, summaries, strict=True)]
    rows = [(label, [text.get(key, "–") for text in texts]) for key, label in MERIT_LABELS.items()]
    effort_ratios = [summary.max_effort_ratio for summary in summaries]
    rows.append(
        ("Largest effort / limit", [f"{v:.0%}" if is_finite(v) else "–" for v in effort_ratios])
    )
    rows = [(label, cells) for label, cells in rows if set(cells) != {"–"}]
    marks = [
        ("Limits", [limits_badge(summary.limits_violated) for summary in summaries]),
        (
            "Dynamics",
            ["–" if r.certificate is None else certificate_badge(r.certificate) for r in runs],
        ),
    ]
    return "\n".join(
        (
            _table("Tracking error", names, [*rows, *marks]),
            _table("Settings", names, _settings(runs)),
            notes_section(notes),
            keyboard_section(),
        )
    )


def compare_legend(runs: Sequence[Run], names: Sequence[str]) -> str:
    """Return what is drawn in the scene: every run, what they follow and keep clear of, ghost."""
    entries = [
        legend_entry(
            f"run-{k + 1}", name if k else f"{name} (solid)", f"color: var(--c{k % PALETTE_SIZE})"
        )
        for k, name in enumerate(names)
    ]
    if any(has_base(run) or run.log.ee.shape[1] for run in runs):
        entries.append(legend_entry("desired", "Desired"))
    entries += obstacle_entries(runs)
    return "".join([*entries, legend_entry("ghost", "Reference robot", shown=False)])


def _settings(runs: Sequence[Run]) -> list[tuple[str, list[str]]]:
    """Return the settings by label; those in which the runs differ stand first, in bold."""
    columns = [{"Robot": run.robot.name, **setting_texts(run.settings)} for run in runs]
    labels = dict.fromkeys(label for column in columns for label in column)
    rows = [(label, [column.get(label, "–") for column in columns]) for label in labels]
    rows.sort(key=lambda row: len(set(row[1])) == 1)
    return [
        (label, [f"<b>{escape(c)}</b>" if len(set(cells)) > 1 else escape(c) for c in cells])
        for label, cells in rows
    ]


def _table(title: str, names: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Return a section with a column a run; the cells are HTML already."""
    head = "".join(
        f'<th scope="col"><i style="color: var(--c{k % PALETTE_SIZE})"></i>{escape(name)}</th>'
        for k, name in enumerate(names)
    )
    body = "".join(
        f'<tr><th scope="row">{escape(label)}</th>'
        + "".join(f"<td>{cell}</td>" for cell in cells)
        + "</tr>"
        for label, cells in rows
    )
    return (
        f'<section><h2>{escape(title)}</h2><div class="wide"><table class="runs">'
        f"<thead><tr><td></td>{head}</tr></thead><tbody>{body}</tbody></table></div></section>"
    )
