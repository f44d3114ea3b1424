"""Drake and PyBullet, mended, and the reduced model: they share no line, and do the same."""

from __future__ import annotations

import pytest

import rpctl
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.engines.bullet import BulletEngine
from rpctl.engines.drake import DrakeEngine
from rpctl.engines.engine import ALL_MENDED
from rpctl.engines.referee import Referee
from tests.grids import cells

ENGINES: dict[str, type[BulletEngine | DrakeEngine]] = {
    "pybullet": BulletEngine,
    "pydrake": DrakeEngine,
}
ROBOTS = ("paper", "casters", "car", "tricycle", "skid_steer", "swerve", "caster_drive")
GRID = [(e, n) for e in ENGINES for n in (*ROBOTS, "twin_casters", "mixed_chain", "tiago")]
SLOW = [("pybullet", "car"), ("pydrake", "paper")]
BAND = 0.5  # of the referee's own bands: what is mended stays well within them


@pytest.mark.parametrize(("library", "name"), cells(GRID, slow=SLOW))
def test_mended_it_agrees_with_the_reduced_model(library: str, name: str) -> None:
    pytest.importorskip(library)
    engine = ENGINES[library]()
    judge = Referee(rpctl.load(name), FRICTION, 2.5)
    _, model = judge.motion(engine.tick)
    worst = judge.compare(model, judge.run(engine, ALL_MENDED))[0]
    assert worst.ratio < BAND, (worst.name, worst.gap, worst.words)
