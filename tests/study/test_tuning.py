"""What a bandwidth buys and costs: its figures against the loop's own, and the command."""

from __future__ import annotations

import cmath
import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from typer.testing import CliRunner

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.cli.app import app
from rpctl.control.bandwidth import gains_of
from rpctl.simulation.config import RunSettings
from rpctl.study.cells import CellRunner, References, Row
from rpctl.study.optimise import RATIOS, row_dict, tune_cells, tuning_bandwidths


def tuned(robot: Robot, bandwidth: float, seconds: float) -> dict[str, Any]:
    """Return what a bandwidth buys and costs."""
    (cell,) = tune_cells(robot, [bandwidth], RunSettings(duration=seconds))
    return row_dict(robot, Row(cell, CellRunner(References(robot))(cell)))


@pytest.mark.parametrize("bandwidth", [2.0, 10.0])
def test_figures_are_those_of_the_loop(paper: Robot, bandwidth: float) -> None:
    found = tuned(paper, bandwidth, 0.02)
    _, h, h1, gain = gains_of(bandwidth)
    assert (found["horizon"], found["horizon_dyn"], found["gain"]) == (h, h1, gain)
    a, b, k = 1.0 / h, 1.0 / h1, gain

    def loop(w: float) -> complex:
        s = 1j * w
        return ((a + b + k) * s**2 + (a * b + b * k + a * k) * s + a * b * k) / s**3

    crossover = brentq(lambda w: abs(loop(w)) - 1.0, a + b, 2.0 * (a + b + k))
    late = cmath.phase(-loop(crossover)) / crossover
    assert found["lateness"] + 0.001 == pytest.approx(late, rel=0.01)
    q = paper.configuration(joints=dict(zip(paper.joint_names, paper.home, strict=True)))
    M = ReducedDynamics(paper).inertia(q)
    joints = M[2:, 2:] - M[2:, :2] @ np.linalg.solve(M[:2, :2], M[:2, 2:])
    assert found["stiffness"] == pytest.approx(np.linalg.eigvalsh(joints)[0] / (h * h1))


def test_more_bandwidth_leaves_less_error(paper: Robot) -> None:
    slow, fast = (tuned(paper, bandwidth, 0.25) for bandwidth in (2.0, 12.0))
    assert fast["joint_error"] < 0.3 * slow["joint_error"]
    assert slow["succeeded"]
    assert 0.0 < fast["effort_ratio"] < 1.0


def test_the_usual_bandwidth_is_amid_those_tried(paper: Robot) -> None:
    usual = 0.8 / 0.051 / (2.0 * math.pi)
    assert tuning_bandwidths(paper)[RATIOS.index(1.0)] == pytest.approx(usual)
    with pytest.raises(RpctlError, match="no joint has a bandwidth"):
        tuning_bandwidths(rpctl.load("bicycle"))


def test_the_command_tells_and_refuses() -> None:
    words = ["tune", "paper", "--bandwidth", "3,6", "--duration", "0.05"]
    shown = CliRunner().invoke(app, words)
    assert shown.exit_code == 0
    assert "gains: 2.5 Hz (h 0.7 s, h1 0.18 s, k 8.6 1/s)" in " ".join(shown.output.split())
    told = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert [each["bandwidth"] for each in told["bandwidths"]] == [3.0, 6.0]
    for wrong in ("x", "0", "-1", "nan"):
        assert CliRunner().invoke(app, ["tune", "paper", "--bandwidth", wrong]).exit_code == 2
    assert math.isclose(told["duration"], 0.05)
