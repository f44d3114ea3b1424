"""The speed table is written as it is measured, and the README's has the form of the writer's."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.bench.readme_table import (
    BEGIN,
    END,
    HEAD,
    README,
    SHOWN,
    in_readme,
    readme_table,
    rewrite,
)
from tests.bench.rows import Row, Section

SLOWER = Row("`rpctl verify tiago`", 4.0, "s", "rpctl verify tiago", goal=2.0)
FASTER = Row(
    "the loop with its log, compiled", 300.0, "times real time", "track", "MuJoCo", 60.0, 250.0
)
TIMED = Row("tiago: machine code, 1 lane", 0.4, "µs", "growth", "Python", 10.0, ratio_goal=20.0)
STEP = Row("tiago, effort: a step", 20.0, "µs", "controller", "virtual", 30.0)
TAIL = Row("tiago, effort: a step, 99 %", 25.0, "µs", "controller", "virtual", 45.0)
PLAN = Row("a sample, whole", 2.0, "ms", "horizon")
SAID = "Measured on a machine.\n"
TABLE = [Section("One", (FASTER, TIMED), "A note."), Section("Other", (STEP, TAIL, PLAN, SLOWER))]


def numbers(cell: str) -> float:
    """Return the number that a cell begins with."""
    return float(re.match(r"[\d.,e+-]+", cell)[0].replace(",", ""))  # type: ignore[index]


def cells(table: str) -> list[list[str]]:
    """Return the cells of a table in Markdown."""
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in table.splitlines()]


def test_what_is_written_is_read() -> None:
    text = json.dumps([section.to_dict() for section in TABLE], allow_nan=False)
    again = [Section.from_dict(each) for each in json.loads(text)]
    assert repr(again) == repr(TABLE)
    assert json.loads(text)[0]["rows"][0]["ratio"] == 5.0


def test_the_readme_has_the_writers_table() -> None:
    table, _, said = in_readme(README.read_text(encoding="utf-8")).partition("\n\n")
    head, rule, *lines = cells(table)
    assert head == [*HEAD]
    assert set(rule) == {"---"}
    assert [line[0] for line in lines] == [shown.text for shown in SHOWN]
    for _, own, _, its, ratio in lines:
        if ratio:
            quotients = numbers(its) / numbers(own), numbers(own) / numbers(its)
            assert numbers(ratio) == pytest.approx(quotients["real time" in own], rel=0.02)
    assert re.match(r"Measured (in full|quick) on \d+ × .*, load [\d.]+ to [\d.]+\.", said)


def test_only_the_table_is_rewritten(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}old\n{END}after\n", encoding="utf-8")
    for _ in range(2):
        rewrite(TABLE, SAID, readme)
    table = readme_table(TABLE, SAID)
    assert readme.read_text(encoding="utf-8") == f"before\n{BEGIN}{table}{END}after\n"
    assert table.endswith(f"|\n\n{SAID}")


def test_what_the_cells_say() -> None:
    """Steps of .4 µs are 2 500 000 a second; 300 times real time at 2 ms is 150 000 a second."""
    step, control, loop, plan, whole = cells(readme_table(TABLE, SAID).partition("\n\n")[0])[2:]
    assert step[1:] == ["0.400 µs", "2,500,000", "10.0 µs: in Python", "25.0×"]
    assert control[1:3] == ["20.0 µs (99 %: 25.0)", "50,000"]
    assert control[3:] == ["30.0 µs (99 %: 45.0): CasADi's virtual machine", "1.50×"]
    assert loop[1:3] == ["300 times real time", "150,000"]
    assert loop[3].startswith("60.0 times real time: MuJoCo")
    assert loop[4] == "5.00×"
    assert plan[1:3] == ["2.00 ms", "500"]
    assert "OCS2" in plan[3]
    assert whole == [whole[0], "4.00 s", "", "", ""]
    assert not plan[4]  # a figure of another machine has no ratio
