"""Which runs a battery has, that each is a file's, and that worse is worse."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.control.controller import default_laws
from rpctl.simulation.config import Config, RunSettings, read_config, write_config
from rpctl.study.cells import CellRunner, References
from rpctl.study.compare import PAPER, LawPair
from rpctl.study.stress_battery import (
    STRESSES,
    Battery,
    StressCell,
    default_pairs,
)
from tests.robots import add_losses
from tests.study.stress_samples import battery

DELAY = STRESSES["delay"]


def test_the_cells_are_each_level_once_and_pairs() -> None:
    found = battery("payload", "delay", "friction", combinations=7, seed=3)
    cells = found.cells
    assert len({cell.key for cell in cells}) == len(cells) == 2 * (1 + 4 + 4 + 7)
    assert [cell.levels for cell in cells[:3]] == [(), (("payload", 0.5),), (("payload", 1.0),)]
    pairs = [cell for cell in cells if len(cell.levels) == 2]
    assert [cell.levels for cell in pairs[:7]] == [cell.levels for cell in pairs[7:]]
    assert len({cell.seed for cell in pairs[:7]}) == 7
    assert {cell.seed for cell in cells if len(cell.levels) < 2} == {3}
    for cell in pairs:
        (first, kg), (second, ms) = cell.levels
        assert (first, second) == ("payload", "delay")
        assert 0.0 < kg < 5.0
        assert 0.0 < ms < 50.0
    other = battery("payload", "delay", combinations=7, seed=4).cells
    assert {c.levels for c in other if len(c.levels) == 2}.isdisjoint(c.levels for c in pairs)


def test_more_combinations_keep_those_of_fewer() -> None:
    few, many = (battery(combinations=n, laws=1).cells for n in (3, 9))
    assert {cell.key for cell in few} < {cell.key for cell in many}
    drawn = [level for cell in many for name, level in cell.levels if name == "encoders"]
    assert all(10 <= bits <= 16 and bits == int(bits) for bits in drawn)


def test_what_means_nothing_is_left_out_and_says_why() -> None:
    found = battery()
    assert dict(found.left_out) == {
        ("rolling", "friction"): "its wheels cannot slip",
        ("rolling", "losses"): "its file has no damping or friction of joints",
    }
    rubbing = add_losses(found.robot, {}, {"wheel_left_joint": 0.1})
    assert not replace(found, robot=rubbing, plants=("slipping",)).left_out
    tireless: Any = SimpleNamespace(effort_limits=np.array([math.inf, math.inf]))
    assert STRESSES["effort"].why_not(tireless) == "its file has no effort limits"
    arm = replace(found, robot=rpctl.load("arm")).left_out
    assert arm["rolling", "radius"] == "its base is fixed"
    assert ("rolling", "payload") not in arm


def test_a_level_changes_what_it_says_alone() -> None:
    found = battery(seed=5)
    nominal = found.cells[0].config(References(found.robot))
    assert nominal == Config(run=found.run, plant=replace(nominal.plant, seed=5))
    robot, plant = found.robot, nominal.plant

    def changed(name: str, level: float) -> Config:
        return STRESSES[name].apply(nominal, level)

    for name, level, expected in (
        ("delay", 20.0, {"delay": 0.02}),
        ("radius", -3.0, {"radii": {"*": 0.97}}),
        ("encoders", 12.0, {"encoder_bits": 12}),
        ("effort", 0.5, {"effort": 0.5}),
        ("losses", 3.0, {"losses": 3.0}),
        ("slope", 45.0, {"slope": (0.25 * math.pi, 0.0)}),
        ("slope-across", 45.0, {"slope": (0.0, 0.25 * math.pi)}),
    ):
        assert changed(name, level) == replace(nominal, plant=replace(plant, **expected)), name
    assert changed("friction", 0.2) == nominal.with_run(friction=0.2)
    noise = changed("noise", 1.0).plant.noise  # of a lidar in a map, and of encoders
    assert (noise.position, noise.heading, noise.joints) == (0.01, 0.005, 0.0005)
    assert (noise.speed, noise.turn_rate, noise.joint_rates) == (0.01, 0.01, 0.005)
    assert changed("noise", 4.0).plant.noise.heading == pytest.approx(0.02)
    load = changed("payload", 2.0).plant.payload
    assert (load.mass, load.link_of(robot)) == (2.0, robot.end_effector)
    for stress in STRESSES.values():
        assert stress.nominal in stress.levels
        same = stress.apply(nominal, stress.nominal)
        assert replace(same, plant=replace(same.plant, radii={})) == nominal, stress.name
    assert changed("radius", 0.0).plant.simulated_robot(robot) is robot


def test_a_robot_without_an_arm_carries_its_payload_itself() -> None:
    robot = rpctl.load("bicycle")
    cell = StressCell("rolling", PAPER, (("payload", 2.0),), 0, RunSettings())
    load = cell.config(References(robot)).plant.payload
    assert (load.mass, load.link_of(robot)) == (2.0, robot.description.root)


@pytest.mark.slow
def test_every_cell_is_a_file(tmp_path: Path) -> None:
    found = battery(combinations=4, quick=True, laws=1)
    for cell in found.cells:
        config = cell.config(References(found.robot))
        assert read_config(write_config(config, tmp_path / "cell.toml")) == config


def test_laws_are_the_robot_s_own_first() -> None:
    robot = rpctl.load("paper")
    own, paper, *_ = default_pairs(robot)
    assert own == LawPair("unified", "integral")
    theirs = rpctl.PaperKinematic(), rpctl.PaperDynamic()
    for pair, laws in ((own, default_laws(robot)), (paper, theirs)):
        config = StressCell("rolling", pair, (), 0, RunSettings()).config(References(robot))
        assert (config.kinematic, config.dynamic) == laws
    assert default_pairs(rpctl.load("balancer")) == (LawPair("unified", "balance"),)


def errors_along(found: Battery) -> list[float]:
    """Return the errors of the paper's laws along the only ladder of a battery."""
    runner, (stress,) = CellRunner(References(found.robot)), found.stresses
    cells = {cell.levels: cell for cell in found.cells if cell.law == PAPER}
    levels = [((stress.name, level),) if level != stress.nominal else () for level in stress.levels]
    return [runner(cells[each]).late_error for each in levels]


@pytest.mark.slow
def test_errors_grow_along_a_ladder() -> None:
    """The paper's laws have nothing against a constant force: they give way in proportion."""
    found = battery("slope", laws=2)
    levels = (0.0, 2.0, 8.0)
    found = replace(found, stresses=(replace(STRESSES["slope"], levels=levels),))
    flat, *steep = errors_along(found)
    assert flat < 0.01 * steep[0]
    forces = [math.sin(math.radians(angle)) for angle in levels[1:]]
    np.testing.assert_allclose(np.divide(steep, steep[0]), np.divide(forces, forces[0]), rtol=0.1)
