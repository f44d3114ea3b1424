"""Laws that are written: they say what the laws say, and cost what they tell."""

from __future__ import annotations

import ctypes
import json
import math
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import sympy as sp
from typer.testing import CliRunner

import rpctl
from rpctl import (
    FeedbackLinearization,
    Kanayama,
    PaperDynamic,
    PaperKinematic,
    ReducedDynamics,
    ReferenceState,
    Robot,
    Samson,
    UnifiedKinematic,
)
from rpctl.arrays import Array
from rpctl.cli.app import app
from rpctl.control.error import Leash
from rpctl.derive.law_program import LawProgram, law_program, law_sheet
from rpctl.derive.write import c_law, derive_law, identifier, python_law
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.robot.losses import Losses
from tests.grids import cells
from tests.robots import SET_A, four_wheels, platform, write
from tests.vehicles import KINDS, vehicle

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
PERIOD = 0.005  # s
EXACT = 1e-12  # relative to the largest entry
SINGLE = 2e-5  # of float, after a few thousand operations
LEASHED = UnifiedKinematic(horizon=0.5, beta=1.1, leash=Leash(0.4, 0.9))
LAWS = {
    "paper": PaperKinematic(),
    "smooth": PaperKinematic(smoothing=0.2, leash=Leash()),
    "unified": UnifiedKinematic(),
    "bare": UnifiedKinematic(leash=None, bend=0.0),
    "leashed": LEASHED,
    "kanayama": Kanayama(),
    "linearizing": FeedbackLinearization(),
    "samson": Samson(),
}
ROBOTS = ["paper", "platform", "mecanum", "skid-steer", "tiago", "panda", "mixed_chain"]
ROBOTS += ["loader", *KINDS]
GRID = [(robot, law) for robot in ROBOTS for law in LAWS]
QUICK = {
    ("paper", "linearizing"),
    ("paper", "samson"),
    ("mecanum", "leashed"),
    ("bicycle", "unified"),
    ("loader", "unified"),  # of a base that bends, one tracks front and rear
}
SLOW = {
    ("paper", "kanayama"),
    ("omni", "bare"),
    ("car-like", "paper"),
}

Outputs = tuple[Array, Array, Array]
Evaluate = Callable[[Array, Array, ReferenceState], Outputs]


class Sample(NamedTuple):
    """A state, its reference, and what the laws make of them."""

    q: Array
    nu: Array
    state: ReferenceState
    truth: Outputs


def made(name: str, folder: Path) -> Robot:
    if name in ("skid-steer", "mecanum"):
        return four_wheels(folder, name)
    if name == "platform":
        return rpctl.load(write(folder, platform(SET_A)))
    return rpctl.load(write(folder, vehicle(name)) if name in KINDS else name)


def reference_near(robot: Robot, q: Array, rng: np.random.Generator) -> ReferenceState:
    """A reference at any distance, at rest at times, with a direction or without."""
    n, off = len(robot.joints), rng.choice([1e-4, 0.1, 1.0, 3.0])
    twist, rate = rng.normal(size=(2, 3)) * rng.choice([0.0, 1.0], p=[0.2, 0.8])
    if not robot.drive.omnidirectional:
        twist[1] = rate[1] = 0.0
    direction = 0.7 * np.array([twist, rate, rng.normal(size=3)])
    if not twist.any():
        direction[0] = rng.choice([-1.0, 1.0]), 0.0, rng.normal()
    joints, rates, accelerations = rng.normal(size=(3, n))
    pose = robot.base_pose(q) + off * rng.normal(size=3)
    given = direction if rng.random() < 0.5 else None
    return ReferenceState(pose, twist, rate, joints, rates, accelerations, given)


def samples(
    robot: Robot, law: Any, dynamic: PaperDynamic, rng: np.random.Generator, count: int
) -> list[Sample]:
    dynamics, found = ReducedDynamics(robot), []
    for _ in range(count):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        state = reference_near(robot, q, rng)
        command = law(dynamics, lambda t, state=state: state, 0.0, q, nu)
        tau = dynamic(dynamics, q, nu, command)
        found.append(Sample(q, nu, state, (tau, command.nu_d, command.nu_d_dot)))
    return found


def pose_of(q: Array) -> Array:
    return np.array([q[0], q[1], math.atan2(q[3], q[2])])


def executed(program: LawProgram) -> Evaluate:
    names: dict[str, Any] = {}
    robot = program.law.robot
    exec(python_law(program), names)
    law = names[f"{identifier(robot.name)}_law"]

    def evaluate(q: Array, nu: Array, state: ReferenceState) -> Outputs:
        read = [robot.joint_position(q, name) for name in program.positions]
        tau, nu_d, nu_d_dot = law(pose_of(q).tolist(), read, nu.tolist(), state)
        return np.array(tau), np.array(nu_d), np.array(nu_d_dot)

    return evaluate


def compiled(program: LawProgram, folder: Path, single: bool = False) -> Evaluate:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler is installed")
    robot, real = program.law.robot, np.float32 if single else np.float64
    (folder / "law.c").write_text(c_law(program, single))
    command = ["cc", *STRICT, "-shared", "-fPIC", "-o", "law.so", "law.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    law = getattr(ctypes.CDLL(str(folder / "law.so")), f"{identifier(robot.name)}_law")

    def evaluate(q: Array, nu: Array, state: ReferenceState) -> Outputs:
        read = np.array([robot.joint_position(q, name) for name in program.positions])
        direction = np.zeros((3, 3)) if state.direction is None else state.direction
        parts = [state.pose, state.twist, state.twist_dot, direction.ravel(), state.joints,
                 state.joint_rates, state.joint_accelerations]  # fmt: skip
        given = [x.astype(real) for x in (pose_of(q), read, nu, np.concatenate(parts))]
        sizes = (len(robot.actuators), robot.dof, robot.dof)
        results = [np.full(size, np.nan, dtype=real) for size in sizes]
        law(*(ctypes.c_void_p(a.ctypes.data) for a in (*given, *results)))
        tau, nu_d, nu_d_dot = (result.astype(float) for result in results)
        return tau, nu_d, nu_d_dot

    return evaluate


def check(evaluate: Evaluate, found: list[Sample], exact: float = EXACT) -> None:
    for sample in found:
        for value, truth in zip(
            evaluate(sample.q, sample.nu, sample.state), sample.truth, strict=True
        ):
            assert np.isfinite(truth).all()
            size = max(1.0, float(np.abs(truth).max(initial=0.0)))
            np.testing.assert_allclose(value, truth, rtol=0, atol=exact * size)


@pytest.mark.parametrize(("name", "law"), cells(GRID, QUICK, SLOW))
def test_code_says_what_the_laws_say(
    name: str, law: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    robot, dynamic = made(name, tmp_path), PaperDynamic(0.12)
    program = law_program(law_sheet(robot, LAWS[law], dynamic))
    found = samples(robot, LAWS[law], dynamic, rng, 12)
    check(executed(program), found)
    if name != "mecanum":  # one compiler less
        check(compiled(program, tmp_path), found)


def test_losses_and_rotors_count(tmp_path: Path, rng: np.random.Generator) -> None:
    """Losses are made up for at the speeds wanted, by the driven wheels' joints as by the arm's."""
    robot = made("mecanum", tmp_path)
    model, size = robot.model.copy(), np.append(np.zeros(3), rng.uniform(0.5, 2.0, robot.nv - 3))
    model.armature = 0.1 * size
    losses = Losses(0.4 * size, 0.9 * size, np.full(robot.nv, 0.01))
    robot = replace(robot, model=model, losses=losses)
    program = law_program(law_sheet(robot, LEASHED, PaperDynamic()))
    check(executed(program), samples(robot, LEASHED, PaperDynamic(), rng, 20))


def test_float_is_as_near_as_float_can_be(
    paper: Robot, tmp_path: Path, rng: np.random.Generator
) -> None:
    program = law_program(law_sheet(paper, LEASHED, PaperDynamic()))
    source = c_law(program, single=True)
    assert "double" not in source
    assert not re.search(r"\d\.\d+(?![\df])", source[source.index("{") :]), "a double constant"
    near = [
        sample for sample in samples(paper, LEASHED, PaperDynamic(), rng, 40)
        if np.abs(sample.state.pose[2] - paper.base_pose(sample.q)[2]) < 3.0
    ]  # fmt: skip
    assert len(near) > 20
    check(compiled(program, tmp_path, single=True), near, SINGLE)


def test_the_count_is_that_of_the_text(paper: Robot) -> None:
    """Operators and calls of the C file, counted by reading it."""
    written = derive_law(paper, kinematic="unified", format="c")
    assert written.operations is not None
    body = re.sub(r"/\*.*?\*/", "", written.text[written.text.index("_law(") :], flags=re.S)
    body = re.sub(r"[(=,] ?-|return -", "(NEG ", body[body.index("{") :].replace("->", "."))
    constants = len(re.findall(r"\(NEG [\d.]", body))  # the sign of a number is no operation
    found = written.operations
    assert found.additions == body.count(" + ") + body.count(" - ") + body.count("NEG") - constants
    assert found.multiplications == body.count(" * ")
    assert found.divisions == body.count(" / ")
    assert found.roots == len(re.findall(r"\bsqrt\(", body))
    assert found.functions == len(re.findall(r"\b(?:sin|cos|tanh|atan2|asin|floor|fabs)\(", body))
    assert found.choices == body.count(" ? ")
    assert str(found) in written.text
    assert not re.search(r"\b(for|while|goto|malloc)\b", body)


def test_formulas_to_read_are_the_law(paper: Robot, rng: np.random.Generator) -> None:
    """The text's lines, read by SymPy and put in, one after the other."""
    text, law = derive_law(paper, kinematic="unified").text, UnifiedKinematic()
    (sample,) = samples(paper, law, PaperDynamic(), rng, 1)
    state = sample.state
    direction = np.zeros((3, 3)) if state.direction is None else state.direction
    x, y, theta = pose_of(sample.q)
    values: dict[str, Any] = {"x": x, "y": y, "theta": theta}
    values |= dict(zip(("x_r", "y_r", "theta_r"), state.pose, strict=True))
    for row, suffix in ((state.twist, ""), (state.twist_dot, "_dot")):
        values |= {f"{k}_r{suffix}": v for k, v in zip(("v", "vl", "omega"), row, strict=True)}
    for row, letter in zip(direction, ("g", "gdot"), strict=False):
        values |= {f"{letter}_{k}": v for k, v in zip(("v", "l", "omega"), row, strict=True)}
    values |= dict(zip(("v", "omega", "theta1_dot", "eta1_dot"), sample.nu, strict=True))
    for k, joint in enumerate(("theta1", "eta1")):
        values[joint] = paper.joint_positions(sample.q)[k]
        for suffix, row in (("_r", state.joints), ("_r_dot", state.joint_rates),
                            ("_r_ddot", state.joint_accelerations)):  # fmt: skip
            values[joint + suffix] = row[k]
    for line in text[: text.index("tau of least effort")].splitlines():
        if match := re.fullmatch(r"  (\w+) = ([-\d.e]+)( .*)?", line):
            values.setdefault(match[1], float(match[2]))
        elif match := re.fullmatch(r"  (\w+) = (.*)", line):
            formula = sp.sympify(match[2], locals={k: sp.Symbol(k) for k in values})
            numbers = {sp.Symbol(k): v for k, v in values.items() if not isinstance(v, tuple)}
            put = [sp.sympify(part).xreplace(numbers) for part in
                   (formula if isinstance(formula, tuple) else (formula,))]  # fmt: skip
            found = tuple(float(each) for each in put)
            values[match[1]] = found if isinstance(formula, tuple) else found[0]
    _, nu_d, nu_d_dot = sample.truth
    np.testing.assert_allclose(values["nu_d"], nu_d, atol=1e-9 * max(1, abs(nu_d).max()))
    np.testing.assert_allclose(
        values["nu_d_dot"], nu_d_dot, atol=1e-9 * max(1, abs(nu_d_dot).max())
    )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"kinematic": "horizon"}, "Horizon solves a quadratic program at each sample; take --law"),
        ({"kinematic": "end-effector"}, "EndEffector solves .*; take --law unified or paper"),
        ({"dynamic": "bounded"}, "BoundedDynamic solves .* where a limit binds; take --dynamic"),
        (
            {"dynamic": "integral"},
            "IntegralDynamic remembers its integral .*; take --dynamic",
        ),
        ({"format": "python", "precision": "float"}, "no precision to choose; take --format c"),
    ],
)
def test_what_cannot_be_written_is_refused_by_name(
    paper: Robot, settings: dict[str, Any], words: str
) -> None:
    with pytest.raises(RpctlError, match=words):
        derive_law(paper, **settings)


@pytest.mark.parametrize("settings", [{"format": "fortran"}, {"precision": "half"},
                                      {"kinematic": "unify"}, {"dynamic": "papre"}])  # fmt: skip
def test_unknown_names_are_listed(paper: Robot, settings: dict[str, Any]) -> None:
    with pytest.raises(UnknownNameError):
        derive_law(paper, **settings)


def test_the_command_writes_and_tells_the_cost(tmp_path: Path) -> None:
    out = tmp_path / "law.c"
    asked = ["derive", "paper", "--law", "paper", "--format", "c", "--out", str(out), "--json"]
    found = CliRunner().invoke(app, asked)
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)
    assert told["law"] == "paper" and told["dynamic"] == "paper"
    assert out.read_text() == told["text"] and "void paper_law(" in told["text"]
    assert set(told["operations"]) >= {"additions", "multiplications", "divisions", "functions"}
