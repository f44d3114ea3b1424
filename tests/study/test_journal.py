"""The journal: records come back as they were; what is torn or changed is done again."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from rpctl import RpctlError
from rpctl.study.store import Journal

IDENTITY: dict[str, Any] = {"robot": {"name": "r2"}, "seed": 1, "ends": [0.0, math.inf]}
RECORDS: list[dict[str, Any]] = [
    {"cell": "x", "error": 0.1},
    {"cell": "y", "error": math.inf},
    {"cell": "ż"},
]


def journal(folder: Path, **changes: Any) -> Journal:
    return Journal(folder / "runs.jsonl", {**IDENTITY, **changes}, "a study")


def test_records_come_back_as_they_were(tmp_path: Path) -> None:
    assert journal(tmp_path).begin(resume=False) == []
    for record in RECORDS:
        journal(tmp_path).add(record)
    assert journal(tmp_path).begin(resume=True) == RECORDS
    journal(tmp_path).rewrite(RECORDS[:1])
    assert journal(tmp_path).begin(resume=True) == RECORDS[:1]


@pytest.mark.parametrize("fault", ["cut", "changed", "foreign"])
def test_a_line_that_is_not_whole_is_left_out(tmp_path: Path, fault: str) -> None:
    journal(tmp_path).begin(resume=False)
    for record in RECORDS:
        journal(tmp_path).add(record)
    path = tmp_path / "runs.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    lines[2] = {"cut": lines[2][:-9] + "\n", "changed": lines[2].replace('"y"', '"z"'),
                "foreign": "[3]\n"}[fault]  # fmt: skip
    path.write_text("".join(lines))
    assert journal(tmp_path).begin(resume=True) == [RECORDS[0], RECORDS[2]]
    assert len(path.read_text().splitlines()) == 3


def test_a_folder_is_not_taken_over(tmp_path: Path) -> None:
    journal(tmp_path).begin(resume=False)
    with pytest.raises(RpctlError, match="holds a study; add --resume to continue it, or give"):
        journal(tmp_path).begin(resume=False)
    with pytest.raises(RpctlError, match=r"else: seed: 1 there, 2 here; give another --out"):
        journal(tmp_path, seed=2).begin(resume=True)
    with pytest.raises(RpctlError, match=r"robot\.name: r2 there, d2 here"):
        journal(tmp_path, robot={"name": "d2"}).begin(resume=True)
    with pytest.raises(RpctlError, match="more: nothing there, 3 here"):
        journal(tmp_path, more=3).begin(resume=True)
    (tmp_path / "runs.jsonl").write_text("torn")
    with pytest.raises(RpctlError, match="seed: nothing there, 1 here"):
        journal(tmp_path).begin(resume=True)
