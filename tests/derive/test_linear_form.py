"""What derive writes of robots that lean: a published table, a pendulum by hand, the motion."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl import ReducedDynamics, RpctlError
from rpctl.arrays import Array
from rpctl.cli.app import app
from rpctl.control.steady_motion import Posture
from rpctl.derive.linear_form import LinearForm, linear_form
from rpctl.derive.write import FORMATS, derive, derive_law
from rpctl.robot.leaning import LeaningRobot
from tests import urdf
from tests.dynamics import whipple
from tests.grids import cells
from tests.leaning import OWN, leaning
from tests.robots import write

GRAVITY = 9.81
FLIP = np.diag(
    [1.0, -1.0]
)  # the benchmark steers to the right, the catalogue's bicycle to the left


def off(ours: Any, theirs: Any) -> float:
    return float(np.abs(np.array(ours) - theirs).max() / np.abs(theirs).max())


def run(source: str) -> dict[str, Any]:
    """Return what written Python defines."""
    names: dict[str, Any] = {}
    exec(source, names)
    return names


def read(text: str) -> dict[str, Array]:
    """Return the matrices that a text shows."""
    found: dict[str, list[list[float]]] = {}
    name = ""
    for line in text.splitlines():
        if line.endswith(" ]"):
            head, _, row = line[:-1].partition("[")
            name = head.rstrip(" =").strip() or name
            found.setdefault(name, []).append([float(x) for x in row.split()])
    return {name: np.array(rows) for name, rows in found.items()}


def test_every_format_has_the_benchmark_s_published_entries() -> None:
    robot = leaning("whipple")
    texts = {format: derive(robot, format) for format in ("text", "latex", "python")}
    code, text = run(texts["python"]), read(texts["text"])
    assert code["c"] == ["roll", "steering_joint"] and "to the left positive" in texts["text"]
    for name, published in whipple.PUBLISHED._asdict().items():
        assert off(code[name], FLIP @ published @ FLIP) < 1e-12
        assert off(text[name], FLIP @ published @ FLIP) < 1e-12
    assert np.allclose(text["B"], [[0.0, 0.0], [0.0, 1.0]], atol=1e-15)
    assert r"K_2 = \begin{bmatrix}0 & -76.5973 \\" in texts["latex"]
    assert r"steering\_joint: steering, to the left positive, rad" in texts["latex"]


def test_a_bicycle_at_one_speed_is_the_same_in_first_order() -> None:
    """A of (roll, steering, v, their rates) is −M⁻¹ (g K0 + v² K2) and −M⁻¹ v C1."""
    form, speed = linear_form(leaning("whipple"), 4.6), 4.6
    M, C1, K0, K2 = (FLIP @ each @ FLIP for each in whipple.PUBLISHED)
    A = form.matrices["A"]
    assert list(form.unknowns)[2:] == ["v", "roll_rate", "steering_joint_dot"]
    assert off(A[3:, :2], -np.linalg.solve(M, GRAVITY * K0 + speed**2 * K2)) < 1e-10
    assert off(A[3:, 3:], -np.linalg.solve(M, speed * C1)) < 1e-10
    assert np.abs(A[2]).max() < 1e-9 and np.abs(A[:, 2]).max() < 1e-9


# A pendulum on two wheels: masses kg, inertias kg m², lengths m.
BODY, HIGH, PITCHING, YAWING = 8.0, 0.35, 0.4, 0.15
WHEEL, SPIN, ACROSS, RADIUS, TRACK = 0.9, 0.004, 0.0025, 0.09, 0.44


def pendulum(tmp_path: Path, ahead: float = 0.0) -> LeaningRobot:
    body = urdf.inertial(BODY, (0.5, PITCHING, YAWING), xyz=f"{ahead} 0 {HIGH}")
    parts = [urdf.link("body", body, urdf.shape('box size="0.1 0.2 0.2"', xyz=f"0 0 {HIGH}"))]
    for name, y in (("left", TRACK / 2), ("right", -TRACK / 2)):
        tyre = urdf.shape(f'cylinder radius="{RADIUS}" length="0.03"', rpy=urdf.ROUND)
        parts.append(urdf.link(f"{name}_wheel", urdf.inertial(WHEEL, (ACROSS, SPIN, ACROSS)), tyre))
        parts.append(
            urdf.joint(f"{name}_joint", "continuous", ("body", f"{name}_wheel"), (0, y, 0), "0 1 0")
        )
    robot = rpctl.load(write(tmp_path, urdf.robot("pendulum", *parts)))
    assert isinstance(robot, LeaningRobot)
    return robot


def test_a_pendulum_on_wheels_by_paper_and_pencil(tmp_path: Path) -> None:
    """(m + 2 m_w + 2 J/r²) v̇ + m l θ̈ = τ/r,  m l v̇ + (I + m l²) θ̈ − m g l θ = −τ, τ both."""
    robot = pendulum(tmp_path)
    found = run(derive(robot, "python"))
    assert "there\n" not in derive(robot)  # upright
    coupled = np.array([
        [BODY + 2 * WHEEL + 2 * SPIN / RADIUS**2, BODY * HIGH],
        [BODY * HIGH, PITCHING + BODY * HIGH**2],
    ])  # fmt: skip
    falls = np.linalg.solve(coupled, [0.0, BODY * GRAVITY * HIGH])
    pushed = np.linalg.solve(coupled, [1 / RADIUS, -1.0])
    turning = YAWING + 2 * (ACROSS + (WHEEL + SPIN / RADIUS**2) * TRACK**2 / 4)
    turned = TRACK / (2 * RADIUS) / turning
    assert found["x"] == ["pitch", "v", "omega", "pitch_rate"]
    assert found["u"] == ["left_joint", "right_joint"]
    A = [[0, 0, 0, 1], [falls[0], 0, 0, 0], [0, 0, 0, 0], [falls[1], 0, 0, 0]]
    B = [[0, 0], [pushed[0], pushed[0]], [-turned, turned], [pushed[1], pushed[1]]]
    assert off(found["A"], np.array(A)) < 1e-10
    assert off(found["B"], np.array(B)) < 1e-10


def motion(form: LinearForm, posture: Posture, x: Array, u: Array) -> Array:
    """Return ẋ of the nonlinear robot at a deviation x and u, by the order of the unknowns."""
    robot, count = posture.robot, len(posture.index)
    steady = posture.steady(form.speed or 0.0, 0.0, robot.home)
    split = len(steady.posture)
    q = posture.at(steady.posture + x[:split], robot.home + x[split:count])
    nu = steady.nu + x[count:]
    rates = posture.dynamics.forward(q, nu, steady.tau + u)
    return np.concatenate([nu[posture.index], rates])


@pytest.mark.parametrize(
    ("name", "speed"),
    cells([(name, 0.7) for name in OWN], [(name, 0.7) for name in OWN if name != "wheel_legs"]),
)
def test_A_and_B_are_the_slopes_of_the_motion(name: str, speed: float) -> None:
    robot = leaning(name)
    form, posture = linear_form(robot, speed), Posture(ReducedDynamics(robot))
    A, B = form.matrices["A"], form.matrices["B"]
    n, both = len(A), np.hstack([A, B])
    assert len(form.unknowns) == n and B.shape == (n, len(form.actuators))
    slopes = np.empty_like(both)
    for k, step in enumerate(1e-5 * np.eye(both.shape[1])):
        ahead, back = (motion(form, posture, each[:n], each[n:]) for each in (step, -step))
        slopes[:, k] = (ahead - back) / 2e-5
    assert np.abs(both - slopes).max() < 1e-6 * np.abs(both).max()


def test_the_pitch_that_balances_is_told(tmp_path: Path) -> None:
    """A centre of mass 5 cm ahead of the axle leans back until it stands above it."""
    robot, pitch = pendulum(tmp_path, ahead=0.05), -math.atan2(0.05, HIGH)
    assert linear_form(robot).steady["pitch"] == pytest.approx(pitch, abs=1e-8)
    assert f"forward positive, rad; {pitch:.6g} there" in derive(robot)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"format": "c"}, "leans: .* take --format text, latex or python"),
        ({"parameters": True}, "matrices are numbers; leave --parameters out"),
        ({"speed": float("nan")}, "not finite"),
    ],
)
def test_what_it_has_not_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(RpctlError, match=message):
        derive(leaning("balancer"), **given)


def test_others_have_no_speed_and_robots_that_lean_no_law() -> None:
    with pytest.raises(RpctlError, match=r"paper does not lean: .* leave --speed out"):
        derive(rpctl.load("paper"), speed=1.0)
    for format in FORMATS:
        with pytest.raises(RpctlError, match="leans on two wheels"):
            derive_law(leaning("balancer"), format=format)


def test_the_command_prints_what_it_wrote() -> None:
    found = json.loads(CliRunner().invoke(app, ["derive", "whipple", "--json"]).stdout)
    assert found["matrices"]["M"][0][0] == pytest.approx(80.81722, rel=1e-12)
    assert found["unknowns"] == linear_form(leaning("whipple")).unknowns
    assert found["speed"] is None and "c_ddot" in found["text"]
    refused = CliRunner().invoke(app, ["derive", "whipple", "--law", "unified", "--speed", "1"])
    assert refused.exit_code and "leave out --parameters and --speed" in refused.output
