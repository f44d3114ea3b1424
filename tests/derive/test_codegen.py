"""Generated code: it compiles without a warning, stands alone, and says what Pinocchio says."""

from __future__ import annotations

import ast
import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.derive.program import program
from rpctl.derive.write import c_source, comment, derive, identifier, python_source
from rpctl.errors import RpctlError
from tests.grids import cells
from tests.random_robots import random_robot
from tests.robots import SET_A, platform, write
from tests.vehicles import KINDS, vehicle

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
ROBOTS = ("paper", "mixed_chain", "tiago", "panda", "asr_twodof", "allegro")
EXACT = 1e-12
FORWARD = 1e-9  # of a solve with M; these robots' M have condition numbers up to 1e5

Evaluate = Callable[[Array, Array], tuple[Array, Array, Array]]
Forward = Callable[[Array, Array, Array], Array]


def compiled(robot: Robot, folder: Path) -> tuple[Evaluate, Forward]:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler is installed")
    (folder / "model.c").write_text(c_source(robot))
    command = ["cc", *STRICT, "-shared", "-fPIC", "-o", "model.so", "model.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library, name = ctypes.CDLL(str(folder / "model.so")), identifier(robot.name)
    n, m = robot.dof, len(robot.actuators)

    def given(*arrays: Array) -> list[Any]:
        return [a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in arrays]

    def evaluate(q: Array, nu: Array) -> tuple[Array, Array, Array]:
        M, h, B = np.full((n, n), np.nan), np.full(n, np.nan), np.full((n, m), np.nan)
        getattr(library, f"{name}_dynamics")(*given(q, nu, M, h, B))
        return M, h, B

    def forward(q: Array, nu: Array, tau: Array) -> Array:
        nu_dot = np.full(n, np.nan)
        assert getattr(library, f"{name}_forward")(*given(q, nu, tau, nu_dot)) == 0
        return nu_dot

    return evaluate, forward


def executed(robot: Robot) -> tuple[Evaluate, Forward]:
    names: dict[str, Any] = {}
    exec(python_source(robot), names)
    dynamics = names[f"{identifier(robot.name)}_dynamics"]
    solve = names[f"{identifier(robot.name)}_forward"]

    def evaluate(q: Array, nu: Array) -> tuple[Array, Array, Array]:
        M, h, B = map(np.array, dynamics(q.tolist(), nu.tolist()))
        return M, h, B

    return evaluate, lambda *x: np.array(solve(*(a.tolist() for a in x)))


def check(robot: Robot, evaluate: Evaluate, forward: Forward, rng: np.random.Generator) -> None:
    dynamics, positions = ReducedDynamics(robot), program(robot).positions
    for _ in range(10):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        tau = rng.normal(size=len(robot.actuators))
        read = np.array([robot.joint_position(q, name) for name in positions])
        M, h, B = evaluate(read, nu)
        for value, truth in (
            (M, dynamics.inertia(q)),
            (h, dynamics.bias(q, nu)),
            (B, dynamics.actuation(q)),
        ):
            np.testing.assert_allclose(value, truth, rtol=0, atol=EXACT * abs(truth).max())
        truth = dynamics.forward(q, nu, tau)
        nu_dot = forward(read, nu, tau)
        np.testing.assert_allclose(nu_dot, truth, rtol=0, atol=FORWARD * abs(truth).max())


@pytest.mark.parametrize("name", cells(ROBOTS, {"paper"}, {"tiago"}))
def test_c(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    robot = rpctl.load(name)
    check(robot, *compiled(robot, tmp_path), rng)


@pytest.mark.parametrize("name", cells(ROBOTS, {"mixed_chain"}))
def test_python(name: str, rng: np.random.Generator) -> None:
    robot = rpctl.load(name)
    check(robot, *executed(robot), rng)


@pytest.mark.parametrize("seed", cells(range(8), {0}, {1}))
def test_random_robots(seed: int, tmp_path: Path, rng: np.random.Generator) -> None:
    """Any drive and tree, mimics with factors and offsets among them."""
    text = random_robot(np.random.default_rng([3, seed]))
    robot = rpctl.load(write(tmp_path, text))
    check(robot, *executed(robot), rng)


@pytest.mark.parametrize("kind", cells(KINDS, (), {"casters"}))
def test_every_kind_of_wheel(kind: str, tmp_path: Path, rng: np.random.Generator) -> None:
    robot = rpctl.load(write(tmp_path, vehicle(kind)))
    check(robot, *executed(robot), rng)


def test_wheels_that_swivel_have_no_closed_form_to_read(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, vehicle("bicycle")))
    with pytest.raises(RpctlError, match="take the code: --format python or c"):
        derive(robot)


def test_round_wheels_are_left_out_and_code_stands_alone(paper: Robot) -> None:
    assert program(paper).positions == ("arm_revolute_joint", "arm_prismatic_joint")
    source = derive(paper, "c")
    assert re.findall(r"#include.*", source) == ["#include <math.h>"]
    tree = ast.parse(derive(paper, "python"))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [getattr(node, "module", None) for node in imported] == ["math"]


@pytest.mark.slow
def test_a_large_robot_stays_small(tiago: Robot) -> None:
    assert program(tiago).positions == tiago.actuators  # its wheels' inertias have products
    source = derive(tiago, "c")
    assert source.count("\n") < 2000
    calls = re.findall(r"(?:sin|cos)\(q\[\d+\]\)", source)
    assert len(calls) == len(set(calls)) <= 2 * tiago.dof  # each once


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("*/ #include <stdio.h>", "robot___include__stdio_h_"),
        ("2wheels", "robot_2wheels"),
        ("müller bot", "m_ller_bot"),
        ("", "robot"),
        ("___", "robot"),
        ("x" * 300, "x" * 40),
    ],
)
def test_names_become_identifiers(name: str, safe: str) -> None:
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", identifier(name))
    assert identifier(name) == safe or name.startswith("*/")


def test_names_cannot_leave_a_comment(tmp_path: Path, rng: np.random.Generator) -> None:
    hostile = "*/ system(0); /* ??/ \\ &quot;&quot;&quot; x"
    urdf = platform(SET_A).replace('name="platform"', f'name="{hostile}"')
    urdf = urdf.replace("left_joint", "left*/joint&quot;&quot;&quot;")
    robot = rpctl.load(write(tmp_path, urdf))
    source = c_source(robot)
    assert source.count("*/") == 2 and "system(" not in source and "\\" not in source
    check(robot, *executed(robot), rng)
    assert not set(comment('a*/"\\\n?')) & set('*/"\\\n?')
