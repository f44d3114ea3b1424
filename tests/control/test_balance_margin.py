"""How well robots that lean can be balanced."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import brentq
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.control import balance_margin
from rpctl.control.balance_margin import _largest, margin
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.leaning import MAX_TILT, LeaningRobot
from rpctl.robot.vary import set_limits


def of(name: str, effort: float | None = None) -> LeaningRobot:
    robot = rpctl.load(name)
    if effort is not None:
        robot = set_limits(robot, effort={"wheel_*": effort}, velocity={})
    assert isinstance(robot, LeaningRobot)
    return robot


def test_halving_finds_what_it_is_asked_for() -> None:
    assert _largest(lambda tilt: abs(tilt) < 0.7, -1.0) == pytest.approx(0.7, abs=MAX_TILT / 64)
    assert _largest(lambda tilt: tilt < 0.0, 1.0) == 0.0


@pytest.mark.slow
def test_weak_wheels_raise_from_where_their_efforts_reach() -> None:
    """At rest beyond that tilt, wheels that do all they can let it tilt further: it is lost."""
    robot, effort = of("balancer", 0.8), 0.8
    dynamics, still = ReducedDynamics(robot), np.zeros(robot.dof)

    def raising(tilt: float) -> float:
        q = robot.configuration(tilt=tilt)
        return float(dynamics.forward(q, still, np.array([effort, effort, 0.0]))[2])

    bound = float(brentq(raising, 0.0, 1.0))
    assert bound == pytest.approx(0.2, abs=0.02)
    assert 0.5 * bound < margin(robot).tilt < bound


@pytest.mark.slow
def test_inspect_tells_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(balance_margin, "HALVINGS", 1)
    result = CliRunner().invoke(app, ["inspect", "balancer", "--balance", "--json"])
    found = json.loads(result.stdout)["balance"]
    assert found["speed"] == 0.0
    assert found["tilt"] == 0.5 * MAX_TILT
    assert found["controllability"] > 1.0
    shown = CliRunner().invoke(app, ["inspect", "balancer", "--balance"])
    assert "balanced from up to 0.60 rad, standing" in " ".join(shown.output.split())


def test_what_stands_by_itself_is_refused() -> None:
    result = CliRunner().invoke(app, ["inspect", "paper", "--balance"])
    assert result.exit_code == 2
    assert "does not lean" in result.output
