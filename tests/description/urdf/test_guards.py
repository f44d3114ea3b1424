"""Every broken file of the corpus: the right words, at the right line, with the right weight."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.description.urdf.reader import read
from rpctl.errors import DescriptionError, Finding
from tests.description.corpus import BASE, CASES, UrdfCase


def findings(path: Path) -> tuple[Finding, ...]:
    try:
        return read(path).findings
    except DescriptionError as error:
        return error.findings


def test_the_base_file_is_clean(tmp_path: Path) -> None:
    (tmp_path / "base.urdf").write_text(BASE, encoding="utf-8")
    robot = rpctl.load(tmp_path / "base.urdf", strict=True)
    assert robot.findings == ()
    assert robot.dof == 4


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_is_wrong_is_told_at_its_line(case: UrdfCase, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(case.data)
    found = findings(path)
    matching = [f for f in found if case.message in f.message]
    assert [(f.severity, f.line) for f in matching] == [(case.severity, case.line)], found
    if case.severity == "error":
        with pytest.raises(DescriptionError) as caught:
            rpctl.load(path)
        place = f"{path}:{case.line}" if case.line else str(path)
        assert f"{place}: error: {matching[0].message}" in str(caught.value).splitlines()
    else:
        assert all(f.severity != "error" for f in found)
    if case.severity == "warning":
        with pytest.raises(DescriptionError):
            rpctl.load(path, strict=True)
