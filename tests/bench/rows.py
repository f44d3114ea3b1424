"""Rows of the speed table, how they are timed, and how they are written."""

from __future__ import annotations

import math
import time
import timeit
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass

MORE_IS_BETTER = ("times real time", "runs/s")  # units; of all others less is better


@dataclass(frozen=True)
class Row:
    """A figure beside that of a peer in the same run.

    Attributes:
        name: What is measured.
        figure: Its value.
        unit: Of both figures.
        command: What measures it alone, or does it.
        peer: Who does the same; empty for none.
        peer_figure: The peer's value.
        goal: What the figure should reach.
        ratio_goal: What the ratio should reach.
    """

    name: str
    figure: float
    unit: str
    command: str
    peer: str = ""
    peer_figure: float = math.nan
    goal: float | None = None
    ratio_goal: float | None = None

    @property
    def ratio(self) -> float:
        """How many times better than the peer; NaN without one."""
        if self.unit in MORE_IS_BETTER:
            return self.figure / self.peer_figure
        return self.peer_figure / self.figure

    @property
    def met(self) -> bool | None:
        """Whether it reaches its goals; None without one."""
        found = []
        if self.goal is not None:
            more = self.unit in MORE_IS_BETTER
            found.append(self.figure >= self.goal if more else self.figure <= self.goal)
        if self.ratio_goal is not None:
            found.append(self.ratio >= self.ratio_goal)
        return all(found) if found else None


@dataclass(frozen=True)
class Section:
    """Rows of one subject.

    Attributes:
        title: The subject.
        rows: Its rows.
        note: What to know of them, a sentence or two.
    """

    title: str
    rows: tuple[Row, ...]
    note: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return it as JSON has it; what is missing is null."""
        rows = [{**asdict(row), "ratio": row.ratio, "met": row.met} for row in self.rows]
        for row in rows:
            for name, value in row.items():
                if isinstance(value, float) and math.isnan(value):
                    row[name] = None
        return {"title": self.title, "note": self.note, "rows": rows}

    @classmethod
    def from_dict(cls, values: dict[str, object]) -> Section:
        """Return what :meth:`to_dict` gave."""
        rows = []
        for row in values["rows"]:  # type: ignore[attr-defined]
            kept = {name: row[name] for name in Row.__dataclass_fields__}
            if kept["peer_figure"] is None:
                kept["peer_figure"] = math.nan
            rows.append(Row(**kept))
        return cls(str(values["title"]), tuple(rows), str(values["note"]))


def cpu_seconds(call: Callable[[], object], number: int = 1, rounds: int = 5) -> float:
    """Return the least processor time of a call, s.

    Args:
        call: What is timed.
        number: Calls of a round.
        rounds: Rounds, of which the fastest counts.
    """
    best = min(timeit.repeat(call, timer=time.process_time, number=number, repeat=rounds))
    return best / number


def in_words(value: float) -> str:
    """Return a figure with three digits, without powers of ten where it needs none."""
    rounded = float(f"{value:.3g}")
    if rounded == 0.0 or not math.isfinite(rounded):
        return f"{rounded:g}"
    if abs(rounded) < 1e-3:
        return f"{rounded:.2e}"
    digits = max(0, 2 - math.floor(math.log10(abs(rounded))))
    return f"{rounded:.{digits}f}" if abs(rounded) < 1e4 else f"{rounded:,.0f}"


def markdown_table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown.

    Args:
        head: Titles of its columns.
        lines: Its cells, line by line.
    """
    rows = [head, ["---"] * len(head), *lines]
    return "".join("| " + " | ".join(row) + " |\n" for row in rows)


def markdown(sections: Sequence[Section], circumstances: str) -> str:
    """Return the whole table.

    Args:
        sections: Its sections.
        circumstances: Where and how it was measured.
    """
    parts = ["# Speed\n\n", circumstances, "\n"]
    head = ("", "figure", "unit", "peer", "its figure", "ratio", "goal", "command")
    for section in sections:
        parts += [f"\n## {section.title}\n\n", f"{section.note}\n\n" if section.note else ""]
        parts.append(markdown_table(head, [_cells(row) for row in section.rows]))
    return "".join(parts)


def _cells(row: Row) -> tuple[str, ...]:
    peer, ratio = (in_words(row.peer_figure), in_words(row.ratio)) if row.peer else ("", "")
    command = f"`{row.command}`"
    return row.name, in_words(row.figure), row.unit, row.peer, peer, ratio, _goal(row), command


def _goal(row: Row) -> str:
    more = "≥" if row.unit in MORE_IS_BETTER else "≤"
    wanted = [] if row.goal is None else [f"{more} {in_words(row.goal)}"]
    wanted += [] if row.ratio_goal is None else [f"ratio ≥ {in_words(row.ratio_goal)}"]
    return ", ".join(wanted) + ("" if row.met is None else "" if row.met else " (missed)")
