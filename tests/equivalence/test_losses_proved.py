"""The certificate finds damping, friction and rotors that are not those of the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.robot.losses import Losses
from tests.dynamics.test_losses import lossy
from tests.vehicles import vehicle

ROTOR = (
    '<transmission name="t"><joint name="{joint}"/><actuator name="m">'
    '<drake:rotor_inertia value="2e-4"/><drake:gear_ratio value="30"/></actuator></transmission>'
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A base with casters, everything in it lossy, and a rotor in a joint that is none of ν."""
    text = vehicle("casters")
    wheel = next(iter(rpctl.load(_written(tmp_path_factory, text)).drive.wheels)).joint
    text = text.replace("</robot>", ROTOR.format(joint=wheel) + "</robot>")
    found = lossy(tmp_path_factory.mktemp("proved"), text)
    return rpctl.load(found.source, armature=True)


def _written(folder: pytest.TempPathFactory, text: str) -> Path:
    path = folder.mktemp("plain") / "robot.urdf"
    path.write_text(text)
    return path


def failed(robot: Robot) -> set[str]:
    proof = rpctl.verify(robot, samples=1)
    return {f"{row.name} / {row.against}" for row in proof.comparisons if not row.passed}


def test_all_derivations_agree_on_them(robot: Robot) -> None:
    """I n² = 2e-4 × 900 = 0.18 kg m²."""
    assert robot.armature.max() == pytest.approx(0.18)
    proof = rpctl.verify(robot, samples=2)
    assert not [row for row in proof.comparisons if not row.passed]
    rows = {(row.name, row.against): row for row in proof.checks}
    assert rows["losses ℓ", "Gibbs-Appell"].residual < 1e-14
    assert "the rate below which dry friction is smoothed" in proof.scope.shared
    if ("damping of ℓ", "MuJoCo") in rows:
        assert "friction is left out" in rows["damping of ℓ", "MuJoCo"].note


@pytest.mark.parametrize("which", ["damping", pytest.param("friction", marks=pytest.mark.thorough)])
def test_a_loss_that_is_not_the_files_is_found(robot: Robot, which: str) -> None:
    assert robot.losses is not None
    changed = {which: 1.001 * getattr(robot.losses, which)}
    found = failed(replace(robot, losses=replace(robot.losses, **changed)))
    assert {
        "losses ℓ / Gibbs-Appell",
        "inverse dynamics / ∂G/∂ν̇",
        "accelerations / Lagrange multipliers",
    } <= found
    assert "reduced bias h / Gibbs-Appell" not in found


def test_energy_that_is_lost_elsewhere_is_found(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The power at which losses are booked is less than that at which they brake."""
    from rpctl.equivalence import energy

    true = energy._lost
    monkeypatch.setattr(energy, "_lost", lambda *given: 0.99 * true(*given))
    assert failed(robot) == {"energy rate / power of τ", "power balance / work of τ"}


def test_a_rotor_that_is_not_the_files_is_found(robot: Robot) -> None:
    model = robot.model.copy()
    model.armature = 1.001 * np.array(model.armature)
    found = failed(replace(robot, model=model))
    assert {"full inertia / Gibbs-Appell", "reduced inertia M / Gibbs-Appell"} <= found


def test_nothing_lost_has_no_row(robot: Robot) -> None:
    ideal = rpctl.load(robot.source, losses=False)
    assert ideal.losses is None and not ideal.armature.any()
    assert not [row for row in rpctl.verify(ideal, samples=1).checks if "ℓ" in row.name]
    assert isinstance(robot.losses, Losses)
