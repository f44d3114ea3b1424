"""The catalogue: every name stands for a file, and the robots that rpctl models load."""

from __future__ import annotations

import pytest

import rpctl
from rpctl.errors import DriveError, UnknownNameError
from rpctl.robot.catalog import ENTRIES, find

NOT_YET = {"tiago_pro", "pr2"}  # mecanum wheels and steered casters


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_every_entry_has_a_file(entry: rpctl.robot.catalog.Entry) -> None:
    assert entry.path.is_file()


@pytest.mark.parametrize("name", sorted({e.name for e in ENTRIES} - NOT_YET))
def test_robots_load(name: str) -> None:
    robot = rpctl.load(name)
    assert robot.name == name
    assert robot.drive.type == ("fixed" if find(name).base == "fixed" else "differential")
    assert robot.dof == len(robot.actuators)


@pytest.mark.parametrize("name", sorted(NOT_YET))
def test_other_drives_are_refused_by_name(name: str) -> None:
    with pytest.raises(DriveError, match=r"\.urdf: "):
        rpctl.load(name)


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean .*tiago"):
        find("tiag0")
