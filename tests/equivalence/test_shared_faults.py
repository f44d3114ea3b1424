"""What all derivations once shared hides no fault: each of them fails two rows or more."""

from __future__ import annotations

import pytest

import rpctl
from tests.equivalence.shared_faults import FAULTS, caught

OF_THE_TREE = {"inertial origins dropped", "a joint axis negated", "masses doubled"}


@pytest.mark.parametrize("name", FAULTS)
def test_a_shared_fault_is_caught(name: str) -> None:
    fault = FAULTS[name]
    found = caught(fault, rpctl.load(fault.victim))
    assert len({check.name for check in found}) >= 2
    assert {check.against for check in found} >= {"Gibbs-Appell", "MuJoCo"}
    if name not in OF_THE_TREE:  # what is wrong with a drive is seen in its shapes
        (row,) = (check for check in found if "geometry" in check.name)
        assert row.entry.endswith(" as drawn")
