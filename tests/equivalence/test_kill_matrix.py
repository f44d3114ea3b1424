"""The certificate is no formality: every planted fault trips rows, every row is tripped alone."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.equivalence import planar
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.equivalence.state import draw_state
from tests.equivalence.kill_matrix import (
    FAULTS,
    GENERAL,
    MAX_ROWS_TRIPPED,
    OF_LOSSES,
    OF_ROLLING,
    PROBES,
    SAMPLES,
    CheckKey,
    in_module,
    tripped,
    victim,
)
from tests.proofs import failed

robot_of = cache(victim)
OWN = [name for name in FAULTS if not name.startswith("shared: ")]  # test_shared_faults.py: those
BELOW_ZERO = "file: an inertia below zero"  # nothing else trips M's definiteness


@cache
def rows_tripped(fault: str) -> frozenset[CheckKey]:
    """Return the rows that fail with one of ``FAULTS`` planted."""
    who, inject = FAULTS[fault]
    return frozenset((check.name, check.against) for check in tripped(robot_of(who), inject))


def rows(robot: Robot) -> set[CheckKey]:
    return {(check.name, check.against) for check in rpctl.verify(robot, samples=1).comparisons}


def test_the_general_robot_has_what_the_faults_need() -> None:
    robot = robot_of(GENERAL)
    assert {joint.kind for joint in robot.joints} == {"revolute", "prismatic", "continuous"}
    assert len(robot.mimics) == 1
    assert min(abs(wheel.offset) for wheel in robot.drive.wheels) > 1e-3
    assert min(abs(coordinate) for coordinate in robot.drive.point) > 1e-3


@pytest.mark.parametrize("who", sorted({who for who, _ in (*FAULTS.values(), *PROBES.values())}))
def test_without_a_fault_it_passes(who: str) -> None:
    assert not failed(rpctl.verify(robot_of(who), samples=SAMPLES))


@pytest.mark.parametrize("name", OWN)
def test_a_fault_trips_two_rows_or_more(name: str) -> None:
    assert len({row for row, _ in rows_tripped(name)}) >= 2


@pytest.mark.parametrize("name", OF_ROLLING)
def test_the_multipliers_have_rows_of_their_own(name: str) -> None:
    """Of the dynamics' rows, A or Ȧ v is wrong: the multipliers' path does not have them."""
    assert rows_tripped(name) >= {
        ("accelerations", "Lagrange multipliers"),
        ("accelerations", "Pinocchio, constrained"),
        ("constraint forces Aᵀ λ", "Lagrange multipliers"),
    }


@pytest.mark.parametrize("who", ["car", "swerve"])
def test_mujoco_has_followers_of_its_own(who: str) -> None:
    """Of Gibbs-Appell, the rate of what follows other swivels is wrong: MuJoCo's is not."""

    def faster(rate: planar.JointRate, *arguments: object) -> planar.JointRate:
        return rate._replace(row=1.001 * rate.row)

    found = tripped(robot_of(who), in_module(planar, "follower_rate", faster))
    assert {("reduced inertia M", "Gibbs-Appell")} <= {(c.name, c.against) for c in found}
    assert "MuJoCo" not in {check.against for check in found}


@pytest.mark.parametrize("name", OF_LOSSES)
def test_two_sources_question_the_losses(name: str) -> None:
    """The file's own numbers by Gibbs's function, and the file as MuJoCo reads it."""
    assert rows_tripped(name) >= {("losses ℓ", "Gibbs-Appell"), ("damping of ℓ", "MuJoCo")}


def test_every_row_is_tripped_by_a_fault_that_trips_few_others() -> None:
    """A row that is compared with itself, or whose limit is 1e9 times too wide, trips on none."""
    alone: set[CheckKey] = set()
    for who, inject in (*PROBES.values(), FAULTS[BELOW_ZERO]):
        found = {(check.name, check.against) for check in tripped(robot_of(who), inject)}
        assert found
        assert len(found) <= MAX_ROWS_TRIPPED
        alone |= found
    assert alone >= rows(robot_of(GENERAL)) | rows(robot_of("swerve"))


def test_a_fault_leaves_nothing_behind() -> None:
    """Each is planted and taken out again: the same certificate as before."""
    for who, inject in (*FAULTS.values(), *PROBES.values()):
        with inject(robot_of(who)):
            pass
    assert not failed(rpctl.verify(robot_of(GENERAL), samples=SAMPLES))


def test_the_worst_sample_is_kept(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """h is wrong at four of six samples, by sizes that neither rise nor fall."""
    wrong = {1: 1e-6, 2: 1e-8, 3: 1e-3, 4: 1e-5}
    states = {draw_state(paper, 0, k).q.tobytes(): size for k, size in wrong.items()}
    original = ReducedDynamics.bias

    def bias(self: ReducedDynamics, q: Array, nu: Array) -> Array:
        return original(self, q, nu) * (1.0 + states.get(q.tobytes(), 0.0))

    monkeypatch.setattr(ReducedDynamics, "bias", bias)
    proof = rpctl.verify(paper, samples=6, engines=())
    (check,) = (each for each in proof.checks if each.name == "reduced bias h")
    q, nu = draw_state(paper, 0, 3).q, draw_state(paper, 0, 3).nu
    h = original(ReducedDynamics(paper), q, nu)
    assert check.sample == 3
    size = GibbsAppell(paper).reduced(q, nu).h_size.max()
    assert check.residual == pytest.approx(1e-3 * np.abs(h).max() / size, rel=1e-6)
    assert check.entry == paper.quasi_velocities[int(np.abs(h).argmax())]
