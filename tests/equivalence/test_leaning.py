"""The certificate of robots that lean: all derivations agree, and a fault of one shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.arrays import Array
from rpctl.dynamics.leaning import LeaningProjection, LeaningProjector, find_formulas
from rpctl.equivalence import leaning_rows
from rpctl.robot.leaning import contact_arm
from tests.leaning import OWN

LEAST = {"Gibbs-Appell", "Lagrange multipliers", "Pinocchio, constrained", "the file's shapes"}


def failed(name: str) -> set[str]:
    proof = rpctl.verify(rpctl.load(name), samples=2)
    return {check.name for check in proof.checks if not check.passed}


@pytest.mark.parametrize("name", OWN)
def test_all_derivations_agree(name: str) -> None:
    proof = rpctl.verify(rpctl.load(name), samples=5)
    assert proof.passed
    assert {check.against for check in proof.checks} >= LEAST
    exact = [check for check in proof.checks if check.limit == 1e-12]
    assert len(exact) >= 9 and max(check.residual for check in exact) < 1e-12


def scaled(original: Callable[..., Array], factor: float) -> Callable[..., Array]:
    def made(*arguments: Any) -> Array:
        result = np.array(original(*arguments), dtype=float)
        result.reshape(-1)[:1] *= factor
        return result

    return made


FAULTS = {
    "a row": (LeaningProjector, "equations", 1.0 + 1e-6),
    "a row's rate": (LeaningProjector, "equations_rate", 1.001),
    "the drift": (LeaningProjection, "drift", 1.001),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_projection_shows(monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    owner, method, factor = FAULTS[fault]
    monkeypatch.setattr(owner, method, scaled(getattr(owner, method), factor))
    assert len(failed("wheel_legs")) >= 2


def test_a_contact_in_the_wrong_place_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """The dynamics' contact is 1 % too high; the file's rows have the wheel's own radius."""
    original = contact_arm
    monkeypatch.setattr(
        "rpctl.dynamics.leaning.contact_arm",
        lambda left, axle, sqrt: [0.99 * x for x in original(left, axle, sqrt)],
    )
    find_formulas.cache_clear()
    try:
        assert {"wheels' contact at S ν", "rolling wheels S ν"} <= failed("whipple")
    finally:
        find_formulas.cache_clear()


def test_the_oracle_has_rows_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    original = leaning_rows.LeaningRows._pitching
    monkeypatch.setattr(
        leaning_rows.LeaningRows, "_pitching", lambda rows, first: 1.001 * original(rows, first)
    )
    assert "base speeds ν" in failed("balancer")
