"""Short runs of two robots, shared by the tests of what is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import rpctl
from rpctl import Robot, Run
from tests.view.chromium import chromium
from tests.view.samples import short_run, write_cart


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave to `make thorough` what needs a real browser and is marked neither quick nor slow."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            marks = {mark.name for mark in item.iter_markers()}
            if not marks & {"quick", "slow", "thorough"}:
                item.add_marker(pytest.mark.thorough)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One browser a file: films, which start their own, bear no other beside it."""
    with chromium() as browser:
        yield browser


@pytest.fixture
def cart(tmp_path: Path) -> Robot:
    return rpctl.load(write_cart(tmp_path))


@pytest.fixture
def cart_run(cart: Robot) -> Run:
    return short_run(cart, 0.1)


@pytest.fixture(scope="session")
def paper_run(paper: Robot) -> Run:
    return short_run(paper)


@pytest.fixture(scope="session")
def tiago_run(tiago: Robot) -> Run:
    return short_run(tiago, 0.2)


@pytest.fixture(scope="session")
def ur5() -> Robot:
    return rpctl.load("ur5")


@pytest.fixture(scope="session")
def ur5_run(ur5: Robot) -> Run:
    return short_run(ur5, 1.0)
