"""Whole loops on disk: the same loop is read, another one is built, and nothing else is loaded."""

from __future__ import annotations

import io
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.unified import UnifiedKinematic
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_limits, scale_masses, set_limits
from rpctl.simulation.compiled import build, stored_loop
from rpctl.simulation.compiled.loop import LoopShape
from rpctl.simulation.compiled.stored_loop import loop_key
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop import simulate

CONFIG = Config(dynamic=PaperDynamic(), run=RunSettings("circle", 0.1, (0.1, 0.0, 0.0)))
SHAPE = LoopShape(0.002, 0.002)


def run(robot: Robot) -> np.ndarray:
    build._kept.clear()  # as in another process
    found = simulate(robot, CONFIG, collisions=False, backend="compiled")
    assert not found.notes
    return np.array(found.q)


def test_a_loop_that_was_built_before_is_read(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RPCTL_CACHE_DIR", str(tmp_path))
    first = run(paper)
    monkeypatch.setattr(build, "build_loop", lambda *given: pytest.fail("it was built anew"))
    assert np.array_equal(run(paper), first)
    monkeypatch.undo()
    monkeypatch.setenv("RPCTL_CACHE_DIR", str(tmp_path))
    for file in tmp_path.rglob("*.code"):
        file.write_bytes(file.read_bytes()[:-1])
    assert np.array_equal(run(paper), first)


def test_other_robots_laws_and_shapes_have_other_keys(paper: Robot) -> None:
    laws = UnifiedKinematic(), PaperDynamic()
    keys = {
        loop_key(paper, paper, laws, SHAPE),
        loop_key(paper, scale_masses(paper, "*", 1.01), laws, SHAPE),
        loop_key(scale_masses(paper, "*", 1.01), paper, laws, SHAPE),
        loop_key(scale_limits(paper, effort=0.5), paper, laws, SHAPE),
        loop_key(paper, paper, (UnifiedKinematic(leash=None), PaperDynamic()), SHAPE),
        loop_key(paper, paper, laws, replace(SHAPE, delayed=True)),
        loop_key(paper, paper, laws, replace(SHAPE, period=0.001)),
    }
    assert len(keys) == 7
    assert loop_key(replace(paper), paper, laws, SHAPE) in keys


def test_a_limit_of_a_joint_that_nothing_drives_counts() -> None:
    robot = rpctl.load("casters")
    (name, *_) = set(robot.moving_joint_names) - set(robot.actuators)
    other = set_limits(robot, velocity={name: 0.5})
    laws = UnifiedKinematic(), PaperDynamic()
    assert loop_key(robot, robot, laws, SHAPE) != loop_key(other, robot, laws, SHAPE)


def test_nothing_foreign_is_loaded() -> None:
    data = pickle.dumps(Path("/tmp"))
    with pytest.raises(pickle.UnpicklingError, match="a loop has no"):
        stored_loop._Unpickler(io.BytesIO(data)).load()
    call = b"cbuiltins\neval\n(S'1'\ntR."
    with pytest.raises(pickle.UnpicklingError, match="a loop has no"):
        stored_loop._Unpickler(io.BytesIO(call)).load()
