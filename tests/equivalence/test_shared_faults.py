"""What all derivations once shared hides no fault: each of them fails two rows or more."""

from __future__ import annotations

import pytest

import rpctl
from tests.equivalence.shared_faults import FAULTS, caught


@pytest.mark.parametrize("name", FAULTS)
def test_a_shared_fault_is_caught(name: str) -> None:
    fault = FAULTS[name]
    found = caught(fault, rpctl.load(fault.victim))
    assert len({check.name for check in found}) >= 2
    assert {check.against for check in found} >= {"Gibbs-Appell", "MuJoCo"}


@pytest.mark.slow
def test_all_that_is_wrong_with_a_drive_is_seen_in_its_shapes() -> None:
    """Each number of a drive's record, off by 1e-6: the file's shapes tell which."""
    for name, fault in FAULTS.items():
        if name in ("inertial origins dropped", "a joint axis negated", "masses doubled"):
            continue
        (row,) = (c for c in caught(fault, rpctl.load(fault.victim)) if "geometry" in c.name)
        assert row.entry.endswith(" as drawn")
