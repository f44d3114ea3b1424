"""Whole loops on disk: the same loop is read, another one is built, and nothing else is loaded."""

from __future__ import annotations

import io
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Leash
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels import stored
from rpctl.robot.model import Robot
from rpctl.robot.variation import BuiltNumbers, Variation
from rpctl.robot.vary import scale_limits, scale_masses, set_limits
from rpctl.simulation.compiled import build
from rpctl.simulation.compiled.build import loop_key
from rpctl.simulation.compiled.loop import LoopShape
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import simulate

CONFIG = Config(dynamic=PaperDynamic(), run=RunSettings("circle", 0.1, (0.1, 0.0, 0.0)))
SHAPE = LoopShape(0.002, 0.002)
LAWS = UnifiedKinematic(), PaperDynamic()


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
    monkeypatch.setattr(build, "loop_program", lambda *given: pytest.fail("it was built anew"))
    assert np.array_equal(run(paper), first)
    monkeypatch.undo()
    monkeypatch.setenv("RPCTL_CACHE_DIR", str(tmp_path))
    for file in tmp_path.rglob("*.code"):
        file.write_bytes(file.read_bytes()[:-1])
    assert np.array_equal(run(paper), first)


def key(known: Robot, simulated: Robot, laws: tuple[Any, Any] = LAWS, **shape: Any) -> bytes:
    return loop_key((known, simulated), {}, laws, replace(SHAPE, **shape), 1)


def test_other_robots_laws_and_shapes_have_other_keys(paper: Robot) -> None:
    heavy = scale_masses(paper, "*", 1.01)
    others = BuiltNumbers(paper, [Variation(), Variation(track=1.1)])
    wider = SymbolicDynamics(paper, others).varied
    keys = {
        key(paper, paper),
        key(paper, heavy),
        key(heavy, paper),
        key(scale_limits(paper, effort=0.5), paper),
        key(paper, paper, (UnifiedKinematic(leash=None), PaperDynamic())),
        key(paper, paper, (UnifiedKinematic(), PaperDynamic(midpoint=True))),
        key(paper, paper, delayed=True),
        key(paper, paper, period=0.001),
        loop_key((paper, paper), wider, LAWS, SHAPE, 1),
        loop_key((paper, paper), {}, LAWS, SHAPE, 2),
    }
    assert len(keys) == 10
    assert key(replace(paper), paper) in keys
    other = UnifiedKinematic(horizon=0.7, leash=Leash(0.1, 0.2)), PaperDynamic(horizon_dyn=0.3)
    assert key(paper, paper, other) in keys  # numbers of laws are inputs


def test_a_limit_of_a_joint_that_nothing_drives_counts() -> None:
    robot = rpctl.load("casters")
    (name, *_) = set(robot.moving_joint_names) - set(robot.actuators)
    assert key(robot, robot) != key(set_limits(robot, velocity={name: 0.5}), robot)


def test_nothing_foreign_is_loaded() -> None:
    data = pickle.dumps(Path("/tmp"))
    with pytest.raises(pickle.UnpicklingError, match="no machine code comes with"):
        stored._Unpickler(io.BytesIO(data)).load()
    call = b"cbuiltins\neval\n(S'1'\ntR."
    with pytest.raises(pickle.UnpicklingError, match="no machine code comes with"):
        stored._Unpickler(io.BytesIO(call)).load()
