"""Robots that many tests share; loading is fast, but once is enough."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import Robot


@pytest.fixture(scope="session")
def tiago() -> Robot:
    return rpctl.load("tiago")


@pytest.fixture(scope="session")
def paper() -> Robot:
    return rpctl.load("paper")


@pytest.fixture(scope="session")
def mixed_chain() -> Robot:
    return rpctl.load("mixed_chain")


@pytest.fixture(scope="session", params=["paper", "mixed_chain", "tiago"])
def robot(request: pytest.FixtureRequest) -> Robot:
    """Each robot that the properties of the dynamics must hold for."""
    return rpctl.load(request.param)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20210601)
