"""Robots out of scale pass with every row, their faults are found, no other limit has moved."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, draw_state
from rpctl.arrays import Array
from rpctl.dynamics.projection import Projection
from rpctl.equivalence import checks, energy
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.mujoco_engine import installed
from rpctl.equivalence.shape_checks import SHAPES
from rpctl.errors import RpctlError
from tests.equivalence.fault_injection import Injection, in_function, in_method, rolling_of
from tests.equivalence.ill_scaled import NASTY
from tests.grids import cells
from tests.proofs import failed

SMALL = 1e-6  # relative: a fault that the certificate of any robot must find
CONSTANT = {  # limits of robots whose numbers are in scale; 1e-12 for the rows left out
    "M, entry by entry": 1e-10,
    "accelerations": 1e-10,
    "constraint forces Aᵀ λ": 1e-10,
    "forward ∘ inverse": 1e-10,
    "Ṁ − 2C skew-symmetric": 1e-6,
    "basis drift Ṡ ν": 1e-6,
    "energy rate": 1e-6,
    "power balance": 1e-6,
}


def rows(checked: tuple[Check, ...]) -> set[tuple[str, str]]:
    return {(c.name, c.against) for c in checked if c.against not in (SHAPES, checks.MUJOCO)}


@pytest.fixture(scope="module")
def of_paper(paper: Robot) -> rpctl.Certificate:
    """The certificate of a robot in scale."""
    return rpctl.verify(paper, samples=1)


@pytest.fixture(scope="module")
def ordinary(of_paper: rpctl.Certificate) -> set[tuple[str, str]]:
    """The rows of a robot in scale."""
    return rows(of_paper.comparisons)


QUICK = {"tip of 1e5 kg", "track of 500 m", "caster with 2 mm of trail", "wheels in kg mm²"}
SLOW = {"chain of 40, R P", "tip of 1e8 kg", "nothing driven but the arm", "1 mm long"}


@pytest.mark.parametrize("name", cells(NASTY, QUICK, SLOW))
def test_a_robot_out_of_scale_passes_with_every_row(
    tmp_path: Path, ordinary: set[tuple[str, str]], name: str
) -> None:
    proof = rpctl.verify(NASTY[name](tmp_path), samples=3)
    assert not failed(proof)
    assert rows(proof.comparisons) == ordinary


def larger(original: Callable[..., Any], *arguments: Any) -> Any:
    return original(*arguments) * (1.0 + SMALL)


def a_percent(original: Callable[..., float], *arguments: Any) -> float:
    return 1.01 * original(*arguments)


def last_sign(original: Callable[..., Projection], *arguments: Any) -> Projection:
    at = dataclasses.replace(original(*arguments))
    vars(at)["B"] = at.B * np.append(np.ones(at.B.shape[1] - 1), -1.0)
    return at


def first_wheel(robot: Robot) -> Robot:
    wheels = list(robot.drive.wheels)
    wheels[0] = dataclasses.replace(wheels[0], radius=wheels[0].radius * (1.0 + SMALL))
    return dataclasses.replace(robot, drive=dataclasses.replace(robot.drive, wheels=tuple(wheels)))


ENERGY = in_method("energy", a_percent)
ACCELERATION = in_method("forward", larger)
FORCE = in_method("_inertial", larger)  # h and inverse dynamics
ACTUATION = in_method("at", last_sign)
RADIUS = rolling_of(first_wheel)
ENERGIES = {"power balance", "energy rate"}
MOTIONS = {"accelerations", "forward ∘ inverse"}


PLANTED: dict[tuple[str, str], tuple[Injection, set[str]]] = {
    ("chain of 60", "energy"): (ENERGY, ENERGIES),
    ("chain of 60", "acceleration"): (ACCELERATION, MOTIONS),
    ("chain of 60", "force"): (FORCE, {"inverse dynamics", "forward ∘ inverse"}),
    ("tip of 1e5 kg", "energy"): (ENERGY, ENERGIES),
    ("tip of 1e5 kg", "acceleration"): (ACCELERATION, MOTIONS),
    ("masses 1e-6 to 1e5 kg", "energy"): (ENERGY, ENERGIES),
    ("masses 1e-6 to 1e5 kg", "acceleration"): (ACCELERATION, MOTIONS),
    ("track of 50 m", "force"): (
        FORCE, {"inverse dynamics", "forward ∘ inverse", "reduced bias h"}
    ),
    ("track of 50 m", "radius"): (
        RADIUS, {"reduced inertia M", "actuation B", "rolling wheels S ν"}
    ),
    ("1 mm long", "energy"): (ENERGY, ENERGIES),
    ("1 mm long", "acceleration"): (ACCELERATION, MOTIONS),
    ("origin 100 m away", "radius"): (RADIUS, {"actuation B", "rolling wheels S ν"}),
    ("wheels in kg mm²", "radius"): (
        RADIUS, {"reduced inertia M", "actuation B", "rolling wheels S ν"}
    ),
    ("front wheel drives alone", "actuation"): (
        ACTUATION, {"actuation B", "forward ∘ inverse"} | ENERGIES
    ),
    ("nothing driven but the arm", "energy"): (ENERGY, ENERGIES),
    ("one wheel of two driven", "acceleration"): (ACCELERATION, MOTIONS),
}  # fmt: skip
TELLING = {  # each fault, where its limit is widest
    ("tip of 1e5 kg", "energy"), ("masses 1e-6 to 1e5 kg", "acceleration"),
    ("track of 50 m", "force"), ("origin 100 m away", "radius"),
    ("front wheel drives alone", "actuation"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "fault"), cells(PLANTED, TELLING, {("chain of 60", "energy")}))
def test_its_faults_are_found(tmp_path: Path, name: str, fault: str) -> None:
    inject, found = PLANTED[name, fault]
    robot = NASTY[name](tmp_path)
    with inject(robot) as faulty:
        proof = rpctl.verify(faulty, samples=2)
    assert found <= {check.name for check in failed(proof)}


@pytest.mark.parametrize("name", cells(["paper", "tiago"], ["paper"]))
def test_limits_of_ordinary_robots_are_constants(name: str) -> None:
    for check in rpctl.verify(rpctl.load(name), samples=3).comparisons:
        if check.against != SHAPES:
            assert check.limit == CONSTANT.get(check.name, 1e-12), check


def test_what_a_seed_draws_is_as_ever(paper: Robot) -> None:
    rng, state = np.random.default_rng([3, 5]), draw_state(paper, 3, 5)
    np.testing.assert_array_equal(state.q, paper.random_configuration(rng))
    for drawn, size in ((state.v, paper.nv), (state.nu, 4), (state.nu_dot, 4), (state.push, 4)):
        np.testing.assert_array_equal(drawn, rng.normal(size=size))


GROUPS = {  # the name on the certificate, and the number of rows
    "full_tree": ("full tree", 2),
    "reduced": ("comparison", 7),
    "coriolis": ("Coriolis terms", 2),
    "definite": ("M", 1),
    "multipliers": ("multipliers", 3),
    "consistent": ("consistency", 3),
    "motion": ("motion", 1),
    "engine": ("MuJoCo", 3),
}


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_that_breaks_down_hides_no_other(
    paper: Robot, of_paper: rpctl.Certificate, monkeypatch: pytest.MonkeyPatch, group: str
) -> None:
    original = getattr(checks, group)

    def broken(*arguments: Any) -> Iterator[Check]:
        yield next(original(*arguments))
        raise RpctlError("no more")

    if group == "engine" and not installed():
        pytest.skip("MuJoCo is not installed")
    label, count = GROUPS[group]
    whole = {(check.name, check.against) for check in of_paper.checks}
    monkeypatch.setattr(checks, group, broken)
    proof = rpctl.verify(paper, samples=2)
    (failed_row,) = (check for check in proof.checks if not check.passed)
    assert (failed_row.name, failed_row.against, failed_row.entry) == ("computed", label, "no more")
    left = {(check.name, check.against) for check in proof.checks} - {("computed", label)}
    assert left < whole or count == 1
    assert len(whole - left) == count - 1


def test_an_inertia_that_is_not_positive_definite_is_told_by_its_row(paper: Robot) -> None:
    def turned(original: Callable[..., Array], *arguments: Any) -> Array:
        M = original(*arguments).copy()
        M[0, 1] = M[1, 0] = 1.1 * np.sqrt(M[0, 0] * M[1, 1])  # |M₀₁|² > M₀₀ M₁₁
        return M

    with in_method("inertia", turned)(paper):
        proof = rpctl.verify(paper, samples=1)
    assert "M positive definite" in {check.name for check in proof.checks if not check.passed}


def test_a_negative_inertia_is_told_by_its_row_and_computed_no_further(paper: Robot) -> None:
    with in_method("inertia", lambda f, *arguments: -f(*arguments))(paper):
        proof = rpctl.verify(paper, samples=1)
    tripped = {check.name: check for check in failed(proof)}
    assert {"M positive definite", "reduced inertia M", "computed"} <= tripped.keys()
    assert tripped["computed"].entry == "the inertia M is not positive definite"


def test_a_motion_that_never_converges_fails(paper: Robot) -> None:
    with in_function(energy._rates, lambda original, *given: np.nan * original(*given))(paper):
        proof = rpctl.verify(paper, samples=1)
    (failed_row,) = (check for check in proof.checks if not check.passed)
    assert (failed_row.name, failed_row.against) == ("computed", "motion")
    assert "no step of the motion" in failed_row.entry
