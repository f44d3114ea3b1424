"""Whole loops on disk: the same loop is read, another one is built, and nothing else is loaded."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Leash
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.fragment import LimitNames
from rpctl.control.law import Limit
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import DiffersError
from rpctl.kernels import cache, stored
from rpctl.kernels.program import Buffer, Leave, Program
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
        key(on_the_moon(paper), paper),
    }
    assert len(keys) == 11
    assert key(replace(paper), paper) in keys
    other = UnifiedKinematic(horizon=0.7, leash=Leash(0.1, 0.2)), PaperDynamic(horizon_dyn=0.3)
    assert key(paper, paper, other) in keys  # numbers of laws are inputs


def on_the_moon(robot: Robot) -> Robot:
    model = robot.model.copy()
    model.gravity.linear = np.array([0.0, 0.0, -1.62])
    return replace(robot, model=model)


def test_a_limit_of_a_joint_that_nothing_drives_counts() -> None:
    robot = rpctl.load("casters")
    (name, *_) = set(robot.moving_joint_names) - set(robot.actuators)
    assert key(robot, robot) != key(set_limits(robot, velocity={name: 0.5}), robot)


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("posix", "system"),
        ("rpctl.kernels.cache", "os.system"),
        ("rpctl.kernels.cache", "os"),
        ("rpctl.kernels.cache", "cached"),
        ("rpctl.kernels.stored", "MODULES"),
    ],
)
def test_nothing_foreign_is_loaded(module: str, name: str) -> None:
    text = json.dumps([{"record": 0}, [[module, name, {"command": "true"}]]])
    with pytest.raises(stored.DAMAGED):
        stored.from_json(text)


def test_records_are_read_as_they_were_written() -> None:
    """What two places share is one object afterwards, and named tuples stay so."""
    buffer = Buffer("x", 3)
    names = LimitNames((Limit("a", "effort"),), ("b",))
    thing = ({"k": [buffer, buffer]}, (1, 2.5, None, "s"), Program((Leave(buffer),)), names)
    found = stored.from_json(stored.as_json(thing))
    first, second = found[0]["k"]
    assert first is second is found[2].body[0].flag and first.size == 3
    assert found[1] == thing[1] and found[3] == names
    assert isinstance(found[3].labels[0], Limit)


@pytest.mark.parametrize("damage", ["{", "[1]", '[{"record": 9}, []]', '[{"a": 1, "b": 2}, []]'])
def test_a_damaged_file_with_a_right_digest_is_made_anew(
    damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RPCTL_CACHE_DIR", str(tmp_path))
    calls: list[int] = []

    def make() -> tuple[str, list[Program]]:
        calls.append(1)
        return "beside", []

    sound = stored._joined([damage.encode()])
    cache.cached(bytes(32), lambda: sound)
    for _ in range(2):
        assert stored.stored(bytes(32), make) == ("beside", [])
    assert len(calls) == 1


def test_a_cut_off_file_is_made_anew() -> None:
    with pytest.raises(ValueError, match="cut off"):
        stored._parted(stored._joined([b"abc", b"de"])[:-1])


def test_without_a_home_nothing_is_kept_where_rpctl_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RPCTL_CACHE_DIR", raising=False)
    monkeypatch.setattr(cache, "cache_folder", lambda: Path("~/.cache/rpctl"))
    assert cache.cached(bytes(32), lambda: b"x") == b"x"
    assert not list(tmp_path.iterdir())


def test_a_loop_with_another_robots_limits_is_not_used(paper: Robot) -> None:
    weak, config = rpctl.set_limits(paper, effort={"wheel_*": 2.0}), Config()
    loop = build.compiled_loop(ReducedDynamics(paper), ReducedDynamics(paper), config)
    with pytest.raises(DiffersError, match="asks wheel_left_joint for more than its limit"):
        build.require_equal(loop, ReducedDynamics(weak), ReducedDynamics(weak), config)


def test_a_loop_that_answers_nothing_is_not_used(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    dynamics = ReducedDynamics(paper)
    loop = build.compiled_loop(dynamics, dynamics, Config())
    monkeypatch.setattr(build, "_by_machine", lambda *given: None)
    with pytest.raises(DiffersError, match="answers no state near home"):
        build.require_equal(loop, dynamics, dynamics, Config())
