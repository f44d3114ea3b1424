"""How results are measured against each other, and the certificate that they make."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from rpctl.equivalence.certificate import (
    CONTACT_ORACLE,
    EPS,
    Check,
    Skipped,
    allowed,
    difference_step,
    rate,
    relative,
    worst,
)
from rpctl.equivalence.contact.trial import ContactMotion, ContactTrial, Gap
from rpctl.equivalence.scope import Scope
from rpctl.equivalence.verify import Certificate


def test_a_limit_grows_with_the_products_and_no_other_way() -> None:
    assert allowed(1e-12, 1.0, 1.0) == 1e-12  # 30 EPS is 6.7e-15
    assert allowed(1e-12, 1e4, 2.0) == pytest.approx(30.0 * EPS * 5e3, rel=1e-15)
    assert allowed(1e-12, 1e4, 0.0) == 1e-12


def test_a_deviation_is_relative_to_the_largest_entry() -> None:
    value, truth = np.array([[1.0, -8.0], [2.0, 4.0]]), np.array([[1.0, -8.0], [2.5, 4.0]])
    check = relative("M", "other", value, truth, ["a", "b"])
    assert (check.residual, check.limit, check.entry) == (0.0625, 1e-12, "b, a")
    assert not check.passed
    assert check.limit_ratio == pytest.approx(0.0625 / 1e-12)
    wide = relative("M", "other", value, truth, ["a", "b"], products=16.0 / EPS)
    assert wide.limit == pytest.approx(2.0 * 30.0, rel=1e-15)
    assert wide.passed
    assert Check("M", "other", 0.0625, 0.0625).passed
    assert not Check("M", "other", 0.0625, 0.0624).passed


def test_nothing_but_zeros_is_measured_as_it_is() -> None:
    check = relative("h", "other", np.array([0.0, 0.25]), np.zeros(2), ["a", "b"])
    assert (check.residual, check.limit, check.entry) == (0.25, 1e-12, "b")
    none = relative("h", "other", np.zeros(0), np.zeros(0), [])
    assert (none.residual, none.limit, none.entry) == (0.0, 1e-12, "")


@pytest.mark.parametrize("lost", [math.nan, math.inf, -math.inf])
def test_a_deviation_that_is_no_number_is_the_worst(lost: float) -> None:
    check = worst("h", "other", np.array([1e300, lost, 1.0]), 1e-12, ["a", "b", "c"])
    assert (check.residual, check.entry, check.passed) == (math.inf, "b", False)
    assert check.to_dict()["residual"] is None


def test_entries_beyond_the_names_have_their_number() -> None:
    gap = np.array([[0.0, 0.0, -3.0], [1.0, 2.0, 0.0]])
    check = worst("A", "other", gap, 1e-12, ["a", "b"])
    assert (check.residual, check.entry) == (3.0, "a, 2")


def test_a_rate_is_exact_for_a_polynomial_of_order_4() -> None:
    """d/dt (5 + 3 t − 2 t² + 7 t³ + t⁴) at 0 is 3, whatever the step."""
    for step in (0.5, 2.0):
        found = rate(lambda t: np.array([5 + 3 * t - 2 * t**2 + 7 * t**3 + t**4]), step)
        np.testing.assert_allclose(found, 3.0, rtol=1e-12)


def test_a_difference_turns_no_chain_by_more_than_its_step() -> None:
    assert difference_step(np.array([0.2, -0.3])) == 1e-3
    assert difference_step(np.array([3.0, -2.0])) == pytest.approx(1e-3 / 5.0)


SCOPE = Scope("all", (), (), None)


def certificate(*residuals: float, **others: object) -> Certificate:
    checks = tuple(Check(f"row {k}", "other", size, 1.0) for k, size in enumerate(residuals))
    return Certificate(robot="r", samples=1, seed=0, checks=checks, scope=SCOPE, **others)  # type: ignore[arg-type]


def test_a_certificate_passes_with_all_its_rows() -> None:
    assert certificate(0.5, 1.0).passed
    assert not certificate(0.5, 1.1, 0.2).passed
    assert not certificate(0.5, math.nan).passed
    assert certificate(0.5, 0.9, 0.2).worst.name == "row 1"
    skipped = certificate(0.5, skipped=(Skipped("a", "b", "c"),))
    assert skipped.passed
    assert json.loads(json.dumps(skipped.to_dict()))["contact"] is None


def rolled(residual: float) -> ContactTrial:
    still = ContactMotion(*(np.zeros((2, 3)) for _ in range(6)))
    return ContactTrial(
        checks=(Gap("path", CONTACT_ORACLE, residual, 1.0),), notes=("said of the trial",),
        contacts=(),
        determinate=True, joints=(), slides=(), footprint=np.zeros((0, 2)), t=np.zeros(2),
        reduced=still, engine=still,
    )  # fmt: skip


def test_a_certificate_fails_with_its_trial_on_the_ground() -> None:
    assert certificate(0.5, contact=rolled(0.5)).passed
    assert not certificate(0.5, contact=rolled(1.5)).passed
    assert not certificate(1.5, contact=rolled(0.5)).passed


def test_all_notes_are_told() -> None:
    noted = Check("row", "other", 0.0, 1.0, note="said of a row")
    proof = Certificate(
        robot="r", samples=1, seed=0, checks=(noted, Check("row 2", "other", 0.0, 1.0)),
        scope=SCOPE, contact=rolled(0.5),
        declared=(Check("declared", "shapes", 0.0, 1.0, note="said of numbers"),),
    )  # fmt: skip
    assert proof.notes == [
        ("other", "said of a row"),
        ("shapes", "said of numbers"),
        (CONTACT_ORACLE, "said of the trial"),
    ]
