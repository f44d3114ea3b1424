"""What several modules of tests of run files share."""

from __future__ import annotations

import pytest

from rpctl import Robot, Run, track, verify
from tests.run_files import Parts, parts_of


@pytest.fixture(scope="session")
def run(paper: Robot) -> Run:
    """A short run with a certificate."""
    return track(
        paper,
        "eight",
        duration=0.05,
        initial_error=(0.1, 0.0, 0.0),
        certificate=verify(paper, samples=1),
    )


@pytest.fixture(scope="session")
def parts(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Parts:
    """What its file holds."""
    return parts_of(run, tmp_path_factory.mktemp("parts"))
