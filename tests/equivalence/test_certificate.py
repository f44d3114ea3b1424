"""The certificate: sound robots pass, planted errors are caught, results reproduce."""

from __future__ import annotations

import json
from functools import cache

import pytest

import rpctl
from rpctl import Robot, RpctlError, verify
from rpctl.arrays import Array
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.contact.mujoco_body import mujoco_absence
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.equivalence.state import draw_state
from rpctl.robot.catalog import names
from tests.grids import cells

ROBOTS = names()
# Springs that their URDFs do not tell bear their arms.
WEAK = {name: ["holds its joints at home"] for name in ("pr2", "baxter")}


@cache
def proved(name: str) -> rpctl.Certificate:
    """Return the certificate of a robot of the catalogue."""
    return verify(rpctl.load(name), samples=5, seed=1)


@pytest.mark.parametrize("name", cells(ROBOTS, ("paper", "tiago", "mecanum", "car")))
def test_robots_of_the_catalogue_pass(name: str) -> None:
    assert failed(proved(name)) == WEAK.get(name, [])


@pytest.mark.parametrize("name", cells(ROBOTS))
def test_robots_of_the_catalogue_pass_at_a_hundred_states(name: str) -> None:
    assert failed(verify(rpctl.load(name), samples=100)) == WEAK.get(name, [])


def failed(proof: rpctl.Certificate) -> list[str]:
    return [check.name for check in proof.checks if not check.passed]


def test_every_comparison_is_there(paper: Robot) -> None:
    proof = verify(paper, samples=1, engines=())
    assert [(check.name, check.against) for check in proof.checks] == [
        ("drive's geometry", "the file's shapes"),
        ("full inertia", "Gibbs-Appell"),
        ("full bias", "Gibbs-Appell"),
        ("reduced inertia M", "Gibbs-Appell"),
        ("M, entry by entry", "Gibbs-Appell"),
        ("reduced bias h", "Gibbs-Appell"),
        ("actuation B", "Gibbs-Appell"),
        ("rolling wheels S ν", "Gibbs-Appell"),
        ("inverse dynamics", "∂G/∂ν̇"),
        ("inverse dynamics along ν", "G itself"),
        ("Coriolis C ν + g", "h"),
        ("Ṁ − 2C skew-symmetric", "differences"),
        ("M positive definite", "least eigenvalue"),
        ("accelerations", "Lagrange multipliers"),
        ("accelerations", "Pinocchio, constrained"),
        ("constraint forces Aᵀ λ", "Lagrange multipliers"),
        ("basis drift Ṡ ν", "differences"),
        ("forward ∘ inverse", "identity"),
        ("energy rate", "power of τ"),
        ("power balance", "work of τ"),
        ("wheels' contact at S ν", "the file's shapes"),
        ("base speeds ν", "the file's shapes"),
        ("stands at home", "gravity"),
        ("holds its joints at home", "gravity"),
    ]


def test_what_is_not_installed_never_passes(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_engine, "installed", lambda: False)
    proof = verify(paper, samples=1, trials=["contact", "onset"])
    assert [(row.name, row.against) for row in proof.skipped] == [
        ("reduced dynamics", "MuJoCo"),
    ]
    assert {row.note for row in proof.skipped} == {mujoco_absence()}
    undone = [check for check in proof.checks if not check.passed]
    assert [(row.name, row.entry) for row in undone] == [
        ("motion on the ground", mujoco_absence()),
        ("onset of slipping and tipping", mujoco_absence()),
    ]
    assert not proof.passed and proof.contact is None and proof.onset is None
    assert json.loads(json.dumps(proof.to_dict(), allow_nan=False))["onset"] is None


def test_an_engine_that_refuses_says_why(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: object, *arguments: object) -> None:
        raise mujoco_engine.EngineRefused("link a has no mass")

    monkeypatch.setattr(mujoco_engine, "installed", lambda: True)
    monkeypatch.setattr(mujoco_engine.MujocoEngine, "__init__", refuse)
    assert verify(paper, samples=1).skipped[0].note == "refused: link a has no mass"


def test_unknown_engines_are_told(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="engine 'ode' is not known"):
        verify(paper, samples=1, engines=("ode",))


def test_the_seed_reproduces_and_matters(paper: Robot) -> None:
    once, again, other = (verify(paper, samples=3, seed=seed) for seed in (4, 4, 5))
    assert once == again != other


def test_nothing_proves_nothing(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="0 samples prove nothing"):
        verify(paper, samples=0)
    with pytest.raises(RpctlError, match=r"1,000,000,000 samples, over .* RPCTL_MAX_STATES"):
        verify(paper, samples=10**9)


@pytest.mark.parametrize(
    ("method", "group"), [("full", "full tree"), ("reduced", "Gibbs-Appell equations")]
)
def test_an_oracle_that_breaks_down_at_one_state_answers_at_the_others(
    paper: Robot, monkeypatch: pytest.MonkeyPatch, method: str, group: str
) -> None:
    """Many states are walked at once; the rows of the others are there, and the worst is theirs."""
    original, bad = getattr(GibbsAppell, method), draw_state(paper, 0, 1).q

    def broken(self: GibbsAppell, q: Array, u: Array) -> object:
        if (q == bad).all(axis=-1).any():
            raise RpctlError("no answer")
        return original(self, q, u)

    sound = verify(paper, samples=3, engines=())
    monkeypatch.setattr(GibbsAppell, method, broken)
    proof = verify(paper, samples=3, engines=())
    (row,) = (check for check in proof.checks if not check.passed)
    assert (row.name, row.against, row.entry, row.sample) == ("computed", group, "no answer", 1)
    assert {(c.name, c.against) for c in proof.checks} == {
        ("computed", group), *((c.name, c.against) for c in sound.checks)
    }  # fmt: skip


def test_json_names_all_that_is_held_where_the_line_counts(tiago: Robot) -> None:
    """Gibbs and MuJoCo share that list: a joint that is not on it would be questioned by none."""
    scope = proved("tiago").scope
    (held,) = [each for each in scope.to_dict()["assumes"] if each.startswith("held: ")]
    assert len(tiago.locked) == 36
    assert held.removeprefix("held: ").split(", ") == list(tiago.locked)
    assert held not in scope.line and "and 32 more" in scope.line
