"""Who won which cell of a benchmark."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from rpctl.study.benchmark import Row
from rpctl.study.scenarios import PAPER, LawPair

MEASURES = {"rms_base": "base", "rms_end_effector": "end effector"}
TIE_RATIO = 1.01  # times the least error: as good, for all that a table shows


class Verdict(NamedTuple):
    """The proposed pair of laws against the others in one cell, by one rms error (m).

    A controller that did not track, broke a limit, or did not run has no error here.
    """

    scenario: str
    reference: str
    measure: str
    ours: float | None
    paper: float | None
    best: float
    by: LawPair

    @property
    def won(self) -> bool:
        """Whether no controller was better."""
        return self.ours is not None and self.ours <= TIE_RATIO * self.best

    @property
    def worse_than_paper(self) -> bool:
        """Whether the paper's laws work here, and better."""
        return self.paper is not None and (self.ours is None or self.ours > TIE_RATIO * self.paper)

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON says it."""
        return {
            **self._asdict(),
            "by": str(self.by),
            "won": self.won,
            "worse_than_paper": self.worse_than_paper,
        }


def group_rows(rows: Iterable[Row]) -> list[tuple[tuple[str, str], list[Row]]]:
    """Return the rows by scenario and reference, in order."""
    return [(key, list(group)) for key, group in groupby(rows, key=lambda row: row.cell[:2])]


def best(rows: Sequence[Row], measure: str) -> tuple[float, LawPair] | None:
    """Return the least error of the controllers that work, and whose it is."""
    errors = _errors(rows, measure)
    if not errors:
        return None
    by = min(errors, key=lambda controller: errors[controller])
    return errors[by], by


def verdicts(rows: Sequence[Row], proposed: LawPair) -> list[Verdict]:
    """Return the verdict on each scenario, reference and measure in which a controller works.

    Args:
        rows: Of a grid.
        proposed: The controller that rpctl proposes; none of the rows is its: no verdict.
    """
    found = []
    for (scenario, reference), group in group_rows(rows):
        for measure in MEASURES:
            least, errors = best(group, measure), _errors(group, measure)
            if least is not None and any(row.cell.controller == proposed for row in group):
                ours, paper = errors.get(proposed), errors.get(PAPER)
                found.append(Verdict(scenario, reference, measure, ours, paper, *least))
    return found


def _errors(rows: Sequence[Row], measure: str) -> dict[LawPair, float]:
    return {
        row.cell.controller: error
        for row in rows
        if row.figures is not None
        and row.figures.succeeded
        and (error := getattr(row.figures, measure)) is not None
    }
