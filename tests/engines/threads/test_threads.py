"""Users' threads, rebuilt: the referee names what they found, and mending it cures."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from rpctl.engines.engine import installed_engines

pytestmark = pytest.mark.thorough
DEMO = Path(__file__).parents[3] / "demos" / "referee_threads.py"
WORDS = {  # in the sentence: what the engine does, and the setting that mends it
    "four_wheels": ("a velocity motor holds each joint still", "VELOCITY_CONTROL, force=0"),
    "tracer": ("a velocity motor holds each joint still", "VELOCITY_CONTROL, force=0"),
    "rear_steered": ("a velocity motor holds each joint still", "VELOCITY_CONTROL, force=0"),
    "forklift": ("its supports drag on the ground with friction", "drake:mu_static"),
    "mecanum": ("solid wheels have lateral friction", "roller"),
}


def demo() -> ModuleType:
    spec = spec_from_file_location("referee_threads", DEMO)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


THREADS = demo()


@pytest.mark.parametrize("thread", THREADS.THREADS, ids=lambda thread: thread.robot)
def test_the_referee_names_the_cause_and_its_mending_cures(thread: Any, tmp_path: Path) -> None:
    engines, missing = installed_engines([thread.engine])
    if not engines:
        pytest.skip(missing[0])
    verdict = THREADS.judge(thread, engines[0], tmp_path)
    found = verdict.trace
    assert not verdict.agrees and found is not None
    causes = {name: cause for cause in found.causes for name in cause.names}
    assert causes[thread.cause].gaps  # it alone makes the engine disagree
    assert found.complete  # with the causes mended, and nothing else, it does as the model
    for words in WORDS[thread.robot]:
        assert words in verdict.line


@pytest.mark.parametrize("thread", THREADS.TURNS, ids=lambda thread: thread.robot)
def test_the_referee_tells_why_a_skid_steer_base_turns_too_little(
    thread: Any, tmp_path: Path
) -> None:
    engines, missing = installed_engines([thread.engine])
    if not engines:
        pytest.skip(missing[0])
    verdict = THREADS.judge(thread, engines[0], tmp_path)
    turn = verdict.turn
    assert turn is not None and turn.default is not None and turn.agrees
    assert turn.own == pytest.approx(0.8, rel=1e-6)  # 0.4 + 0.4²/0.4: the wheels are a square
    assert turn.mended.track == pytest.approx(turn.own, rel=0.01) and turn.mended.swing < 0.01
    assert turn.default.track > 2.0 * turn.own and turn.default.swing > 0.2
    said = verdict.turn_line
    assert thread.cause in said and "rpctl export" in said and "[drive] track = 0.8" in said


def test_every_thread_has_its_robot_and_its_words() -> None:
    assert {thread.robot for thread in THREADS.THREADS} == set(WORDS)
    assert len({name for thread in THREADS.THREADS for name in thread.cited.split(", ")}) >= 5
