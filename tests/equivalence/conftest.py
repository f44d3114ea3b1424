"""What several tests of the contact trial compare with."""

from __future__ import annotations

import pytest

from rpctl import Robot
from rpctl.equivalence.contact.trial import ContactTrial, contact_trial


@pytest.fixture(scope="session")
def trial(paper: Robot) -> ContactTrial:
    """The paper's robot itself, rolling in MuJoCo and by the reduced model."""
    found = contact_trial(paper)
    assert isinstance(found, ContactTrial), found
    return found
