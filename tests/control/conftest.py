"""The robots of all tests, as those that are loaded by name: what is built for one serves all."""

from __future__ import annotations

import pytest

from rpctl import Robot
from tests.control.catalogue import robot_of


@pytest.fixture(scope="session")
def paper() -> Robot:
    return robot_of("paper")


@pytest.fixture(scope="session")
def tiago() -> Robot:
    return robot_of("tiago")


@pytest.fixture(scope="session", params=["paper", "mixed_chain", "tiago"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return robot_of(request.param)
