"""Findings in sum: what differs in names and numbers only is one line that names all places."""

from __future__ import annotations

from rpctl.description.urdf.findings import condense
from rpctl.errors import Finding


def limit(joint: str, line: int | None, number: str = "1e+16") -> Finding:
    return Finding("warning", line, f'joint "{joint}" has the limit {number} rad; take it out')


def test_one_idiom_is_one_line() -> None:
    (found,) = condense([limit("b", 30), limit("a", 10), limit("c", 20, "-2.5e3")])
    assert found == Finding(
        "warning",
        10,
        'joint "a" has the limit 1e+16 rad; take it out (and so "c" (line 20), "b" (line 30))',
    )


def test_the_weightiest_come_first() -> None:
    error = Finding("error", 99, "no wheels; give some")
    remark = Finding("info", 1, "lines are those of the expanded text")
    rare = Finding("warning", 2, "no name; give one")
    often = [limit("a", 50), limit("b", 60)]
    found = condense([remark, rare, *often, error])
    assert [each.line for each in found] == [99, 50, 2, 1]
