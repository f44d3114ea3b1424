"""What a certificate says of the equations alone: robots of random numbers need not stand."""

from __future__ import annotations

from rpctl.equivalence.certificate import Check
from rpctl.equivalence.verify import Certificate


def failed(proof: Certificate) -> list[Check]:
    """Return the comparisons that failed."""
    return [check for check in proof.comparisons if not check.passed]
