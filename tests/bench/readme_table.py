"""The README's speed table: some rows of the whole one, between two markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tests.bench.rows import Row, Section, in_words, markdown_table

README = Path(__file__).parents[2] / "README.md"
BEGIN, END = "<!-- speed table -->\n", "<!-- end -->\n"
HEAD = ("", "rpctl", "beside it", "ratio")


class Shown(NamedTuple):
    """A row of the README: what it says, and which row of the whole table it is."""

    text: str
    name: str
    peer: str = ""  # what the peer is called


SHOWN = (
    Shown("forward step in Python", "tiago: `ReducedDynamics.forward`", "NumPy projection"),
    Shown("forward step, machine code", "tiago: machine code, 1 lane", "in Python"),
    Shown("forward step, 8 side by side, each", "tiago: machine code, 8 lanes", "in Python"),
    Shown("`Controller.step`, default laws", "tiago, effort: a step", "CasADi's virtual machine"),
    Shown(
        "closed loop at 2 ms with its log",
        "the loop with its log, compiled",
        "MuJoCo, controller in Python",
    ),
    Shown(
        "1000 runs of 10 s at 1 kHz, one core",
        "1000 runs of 10 s at 1 kHz, TIAGo",
        "MuJoCo's rollout, open loop",
    ),
    Shown(
        "100 000 runs of 10 s at 2 ms, one core, the paper's robot",
        "100000 runs of 10 s at 2 ms, the paper's robot",
    ),
    Shown("sample of the horizon law, N = 20", "a sample, whole"),
    Shown("`rpctl verify tiago`, whole process", "`rpctl verify tiago`"),
    Shown(
        "`rpctl track tiago --reference line --duration 40`, whole process",
        "`rpctl track tiago --reference line --duration 40`",
    ),
)


def readme_table(sections: Sequence[Section]) -> str:
    """Return the README's table in Markdown; rows that were not measured are left out.

    Args:
        sections: The whole table.
    """
    rows = {row.name: row for section in sections for row in section.rows}
    lines = [_cells(shown, rows) for shown in SHOWN if shown.name in rows]
    return markdown_table(HEAD, lines)


def _cells(shown: Shown, rows: Mapping[str, Row]) -> tuple[str, ...]:
    row = rows[shown.name]
    own = f"{in_words(row.figure)} {row.unit}"
    if not shown.peer:
        return shown.text, own, "", ""
    its = f"{in_words(row.peer_figure)} {row.unit} ({shown.peer})"
    return shown.text, own, its, f"{in_words(row.ratio)}×"


def in_readme(text: str) -> str:
    """Return what stands between the markers of a README.

    Args:
        text: The README.

    Raises:
        ValueError: It does not have each marker once, one after the other.
    """
    before, _, rest = text.partition(BEGIN)
    table, end, after = rest.partition(END)
    if not end or BEGIN in rest or END in before + after:
        raise ValueError(f"the README needs one {BEGIN.strip()} and one {END.strip()} after it")
    return table


def rewrite(sections: Sequence[Section], readme: Path = README) -> None:
    """Put the table of a run between the README's markers.

    Args:
        sections: The whole table.
        readme: The README.
    """
    text = readme.read_text(encoding="utf-8")
    old = BEGIN + in_readme(text) + END
    readme.write_text(text.replace(old, BEGIN + readme_table(sections) + END), encoding="utf-8")
