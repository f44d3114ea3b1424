"""Exports for tests that are not about the proofs: few states, and no motion but standing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import rpctl
from rpctl.engines.mujoco import export, trial
from rpctl.engines.mujoco.export import MjcfExport
from rpctl.equivalence.certificate import Skipped
from rpctl.simulation.mjcf_file import export_mjcf


@contextmanager
def quickly() -> Iterator[None]:
    """Let exports compare one state, and no motion."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "VERIFIED_SAMPLES", 1)
        patch.setattr(trial, "_plan", lambda dynamics: Skipped("rolls", "the file", "not asked"))
        yield


def export_quickly(robot: rpctl.Robot, path: Path) -> MjcfExport:
    """Export a robot, which must pass."""
    with quickly():
        found = export_mjcf(robot, path)
    assert found.written, [check for check in found.checks if not check.passed]
    return found
