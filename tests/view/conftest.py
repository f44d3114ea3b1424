"""Short runs of two robots, shared by the tests of what is drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl import Robot, Run
from tests.view.samples import short_run, write_cart


@pytest.fixture
def cart(tmp_path: Path) -> Robot:
    return rpctl.load(write_cart(tmp_path))


@pytest.fixture(scope="session")
def paper_run(paper: Robot) -> Run:
    return short_run(paper)


@pytest.fixture(scope="session")
def tiago_run(tiago: Robot) -> Run:
    return short_run(tiago)


@pytest.fixture(scope="session")
def ur5() -> Robot:
    return rpctl.load("ur5")


@pytest.fixture(scope="session")
def ur5_run(ur5: Robot) -> Run:
    return short_run(ur5, 1.0)
