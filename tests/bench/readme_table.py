"""The README's speed table: some rows of the whole one, between two markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tests.bench.rows import MORE_IS_BETTER, Row, Section, in_words, markdown_table

README = Path(__file__).parents[2] / "README.md"
BEGIN, END = "<!-- speed table -->\n", "<!-- end -->\n"
HEAD = ("", "rpctl", "steps a second", "beside it", "ratio")


class Shown(NamedTuple):
    """A row of the README: what it says, and which row of the whole table it is."""

    text: str
    name: str
    peer: str = ""  # what the peer is called
    steps: float = 0.0  # in a unit of the figure; 0: its steps are not counted
    tail: str = ""  # the row that has its 99 %
    source: str = ""  # what others publish of theirs, on a machine of their own


A_US, A_MS = 1e6, 1e3
SHOWN = (
    Shown("forward step in Python", "tiago: `ReducedDynamics.forward`", "NumPy projection", A_US),
    Shown("forward step, machine code", "tiago: machine code, 1 lane", "in Python", A_US),
    Shown("forward step, 8 side by side, each", "tiago: machine code, 8 lanes", "in Python", A_US),
    Shown(
        "`Controller.step`, default laws",
        "tiago, effort: a step",
        "CasADi's virtual machine",
        A_US,
        "tiago, effort: a step, 99 %",
    ),
    Shown(
        "closed loop at 2 ms with its log, **rolling without contact**",
        "the loop with its log, compiled",
        "MuJoCo **on contact**, controller in Python",
        500.0,
    ),
    Shown(
        "**both on contact**: `--plant contact`, the same world in MuJoCo",
        "the loop on contact in MuJoCo",
        "controller in Python",
        500.0,
    ),
    Shown(
        "1000 runs of 10 s at 1 kHz, one core, **without contact**",
        "1000 runs of 10 s at 1 kHz, TIAGo",
        "MuJoCo's rollout **on contact**, open loop",
        1e7,
    ),
    Shown(
        "100 000 runs of 10 s at 2 ms, one core, the paper's robot",
        "100000 runs of 10 s at 2 ms, the paper's robot",
        steps=5e8,
    ),
    Shown(
        "plan of the horizon law, 12 speeds, 20 steps, dynamic model",
        "a sample, whole",
        steps=A_MS,
        tail="a sample, whole, 99 %",
        source="10 ms asked of [OCS2's wheeled arm](docs/concepts/speed.md), 8 speeds, kinematic",
    ),
    Shown("`rpctl verify tiago`, whole process", "`rpctl verify tiago`"),
    Shown(
        "`rpctl track tiago --reference line --duration 40`, whole process",
        "`rpctl track tiago --reference line --duration 40`",
    ),
)


def readme_table(sections: Sequence[Section], said: str) -> str:
    """Return the README's table in Markdown; rows that were not measured are left out.

    Args:
        sections: The whole table.
        said: Where and how it was measured; comes below.
    """
    rows = {row.name: row for section in sections for row in section.rows}
    lines = [_cells(shown, rows) for shown in SHOWN if shown.name in rows]
    return f"{markdown_table(HEAD, lines)}\n{said}"


def _cells(shown: Shown, rows: Mapping[str, Row]) -> tuple[str, ...]:
    row = rows[shown.name]
    own = f"{in_words(row.figure)} {row.unit}"
    if shown.tail in rows:
        own += f" (99 %: {in_words(rows[shown.tail].figure)})"
    steps = ""
    if shown.steps:
        more = row.unit in MORE_IS_BETTER
        rate = shown.steps * row.figure if more else shown.steps / row.figure
        steps = f"{float(f'{rate:.3g}'):,.0f}"
    if not shown.peer:
        return shown.text, own, steps, shown.source, ""
    its = f"{in_words(row.peer_figure)} {row.unit}"
    if shown.tail in rows and rows[shown.tail].peer:
        its += f" (99 %: {in_words(rows[shown.tail].peer_figure)})"
    return shown.text, own, steps, f"{its}: {shown.peer}", f"{in_words(row.ratio)}×"


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


def rewrite(sections: Sequence[Section], said: str, readme: Path = README) -> None:
    """Put the table of a run between the README's markers.

    Args:
        sections: The whole table.
        said: Where and how it was measured.
        readme: The README.
    """
    text = readme.read_text(encoding="utf-8")
    old = BEGIN + in_readme(text) + END
    readme.write_text(
        text.replace(old, BEGIN + readme_table(sections, said) + END), encoding="utf-8"
    )
