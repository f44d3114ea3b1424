"""The contact trial tells of contacts that do not end at one height."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.contact.trial import ContactTrial, contact_trial
from tests.robots import SET_A, ball, platform, write

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)


@pytest.mark.parametrize(("z", "expected"), [(0.05, None), (0.046, "0.46°")])
def test_a_support_off_the_wheels_ground_tilts_the_robot(
    tmp_path: Path, z: float, expected: str | None
) -> None:
    """A ball half a metre ahead that ends 4 mm below: atan(4/500) = .458°."""
    trial = contact_trial(rpctl.load(write(tmp_path, platform(SET_A, extra=ball(0.5, z=z)))))
    assert isinstance(trial, ContactTrial)
    tilts = [note for note in trial.notes if "out of the level" in note]
    assert len(tilts) == (expected is not None)
    assert all(note.startswith(f"it stands {expected} out of the level") for note in tilts)
