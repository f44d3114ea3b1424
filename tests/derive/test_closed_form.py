"""The closed form: equal to the paper's, as short, the same both ways, and never endless."""

from __future__ import annotations

import shutil
import subprocess
import time
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.derive import closed_form as module
from rpctl.derive import equations
from rpctl.derive.closed_form import ClosedForm, closed_form
from rpctl.derive.equations import direction
from rpctl.derive.write import derive
from tests import symbolic_form
from tests.grids import cells
from tests.robots import SET_A, platform, write

SMALL = ["paper", "asr_twodof", "double_pendulum", "finger_edu"]
FORMS = list(product(SMALL, (False, True)))
QUICK_FORMS = {("double_pendulum", True)}  # of the paper's robot: the design's, exactly

SLIDER = """
  <link name="slide"><inertial><mass value="1.5"/><origin xyz="0.1 0.2 0"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="slide"/>
    <origin xyz="0.1 0 0.3" rpy="0 0 0.7853981633974483"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>"""

# What the legend calls a parameter, and the design's name for it.
OF = {
    "mass of base_link": "m0", "x of centre of mass of base_link": "d",
    "zz inertia of base_link": "J0", "mass of wheel_left_link, wheel_right_link": "m_w",
    "xx inertia of wheel_left_link, wheel_right_link": "I_d",
    "yy inertia of wheel_left_link, wheel_right_link": "I_s",
    "mass of arm_sleeve_link": "m1", "x of centre of mass of arm_sleeve_link": "c1",
    "zz inertia of arm_sleeve_link": "J1", "mass of arm_rail_link": "m2",
    "x of centre of mass of arm_rail_link": "c2", "zz inertia of arm_rail_link": "J2",
    "y of origin of wheel_left_joint, minus wheel_right_joint": "b",
    "x of origin of arm_revolute_joint": "l0",
    "radius of wheel_left_joint, wheel_right_joint": "r",
}  # fmt: skip


@cache
def form_of(name: str, parameters: bool = False) -> ClosedForm:
    """Return the closed form of a robot of the catalogue."""
    return closed_form(rpctl.load(name), parameters)


@pytest.fixture(scope="module")
def short() -> ClosedForm:
    return form_of("paper")


def assert_zero(matrix: sp.Matrix) -> None:
    assert sp.simplify(matrix.applyfunc(sp.expand)) == sp.zeros(*matrix.shape)


def upper(form: ClosedForm) -> list[sp.Expr]:
    n = form.M.rows
    return [form.M[i, j] for i in range(n) for j in range(i, n)]


def test_it_is_the_design_s_exactly(short: ClosedForm) -> None:
    M, h = short.expanded()
    design_M, design_h = symbolic_form.design(symbolic_form.NUMBERS).expanded()
    assert_zero(M - design_M)
    assert_zero(h - design_h)
    assert sp.Matrix(short.B) == sp.Matrix(
        [[sp.Rational(20, 3)] * 2 + [0, 0], [-5, 5, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )


def test_it_is_as_short_as_the_design_s(short: ClosedForm) -> None:
    parts = [*upper(short), *(-entry for entry in short.h)]
    parts += [value for _, value in short.definitions]
    operations = sum(int(sp.count_ops(part)) for part in parts)
    assert operations <= symbolic_form.design(symbolic_form.NUMBERS).operations()


def test_it_names_what_the_design_names(short: ClosedForm) -> None:
    values = {str(symbol): str(value) for symbol, value in short.definitions}
    assert values["Omega1"] == "omega + theta1_dot"
    assert values["rho1"] == "eta1 - 1/5"
    assert values["p1"] == "2*rho1 + 1"
    assert values["J1"] == "2*rho1**2 + 21/50"


def test_the_parameters_form_is_the_design_s(short: ClosedForm) -> None:
    form = form_of("paper", parameters=True)
    names = {p.symbol: symbolic_form.PARAMETERS[OF[p.of]] for p in form.parameters}
    M, h = (x.xreplace(names) for x in form.expanded())
    design_M, design_h = symbolic_form.design(symbolic_form.PARAMETERS).expanded()
    assert_zero(M - design_M)
    assert_zero(h - design_h)
    assert len(form.parameters) == 15  # heights and the other inertias have dropped out
    numbers = {p.symbol: sp.Rational(repr(p.value)) for p in form.parameters}
    assert_zero(form.expanded()[0].xreplace(numbers) - short.expanded()[0])
    units = {str(p.symbol): p.unit for p in form.parameters}
    assert (units["m1"], units["l1"], units["I1"], units["r"]) == ("kg", "m", "kg m^2", "m")


def test_the_platform_has_the_published_inertia(tmp_path: Path) -> None:
    form = closed_form(rpctl.load(write(tmp_path, platform(SET_A))))
    b, r = (sp.Rational(repr(SET_A[key])) for key in "br")
    T = sp.Matrix([[r / 2, r / 2], [-r / (2 * b), r / (2 * b)]])  # (v, ω) from wheel rates
    M = T.T * sp.Matrix(form.M) * T
    np.testing.assert_allclose(
        np.array(M.evalf(), dtype=float), [[0.37955, -0.01455], [-0.01455, 0.37955]], atol=5e-6
    )
    v, omega = form.rates
    k = sp.Rational(repr(SET_A["m_c"])) * sp.Rational(repr(SET_A["d"]))
    assert sp.Matrix(form.h) == sp.Matrix([-k * omega**2, k * omega * v])


@pytest.mark.parametrize(("name", "parameters"), cells(FORMS, QUICK_FORMS))
def test_it_is_what_pinocchio_says(name: str, parameters: bool, rng: np.random.Generator) -> None:
    check_numbers(rpctl.load(name), form_of(name, parameters), rng)


@pytest.mark.parametrize("parameters", cells((False, True), {False}))
def test_slanted_rails_and_mimics(
    tmp_path: Path, parameters: bool, rng: np.random.Generator
) -> None:
    slider = rpctl.load(write(tmp_path, platform(SET_A, right_sign=-1, extra=SLIDER)))
    form = closed_form(slider, parameters)
    assert form.M.has(sp.sqrt(2))  # a slant of 45 degrees is exact
    check_numbers(slider, form, rng)
    panda = rpctl.load("panda", lock={"panda_joint[1-5]": 0.3, "panda_joint[67]": 0.0})
    check_numbers(panda, closed_form(panda, parameters), rng)


def check_numbers(robot: Robot, form: ClosedForm, rng: np.random.Generator) -> None:
    dynamics = ReducedDynamics(robot)
    symbols = [c.symbol for c in form.coordinates] + list(form.rates)
    numbers = {p.symbol: p.value for p in form.parameters}
    M, h = (x.xreplace(numbers) for x in form.expanded())
    evaluate = sp.lambdify(symbols, [M, h, form.B.xreplace(numbers)], "numpy")
    for _ in range(5):
        q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
        positions = [robot.joint_position(q, c.joint) for c in form.coordinates]
        M_, h_, B_ = evaluate(*positions, *nu)
        expected = dynamics.bias(q, nu)
        np.testing.assert_allclose(M_, dynamics.inertia(q), atol=1e-12 * abs(M_).max())
        np.testing.assert_allclose(h_[:, 0], expected, atol=1e-11 * max(1.0, abs(expected).max()))
        np.testing.assert_allclose(B_, dynamics.actuation(q), atol=1e-12 * abs(B_).max(initial=0.0))


def test_directions_are_exact_where_they_are_simple() -> None:
    assert direction(0.70710678) != direction(np.sqrt(0.5))
    assert direction(np.cos(np.pi / 2)) == 0
    assert direction(-0.5000000001) == -sp.Rational(1, 2)
    assert str(direction(np.sin(np.pi / 3))) == "root3/2"
    assert direction(0.6) == sp.Rational(3, 5)


@pytest.mark.parametrize("format", ["text", "latex"])
def test_large_robots_are_refused_at_once(tiago: Robot, format: str) -> None:
    start = time.monotonic()
    with pytest.raises(RpctlError, match=r"--format c or python.*--lock") as caught:
        derive(tiago, format)
    assert caught.value.exit_code == 2
    assert time.monotonic() - start < 2.0


@pytest.mark.slow
def test_budgets_stop_what_the_joint_count_lets_through(
    mixed_chain: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_JOINTS", 10)
    start = time.monotonic()
    with pytest.raises(RpctlError, match="no closed form that one would read"):
        derive(mixed_chain)
    assert time.monotonic() - start < 20.0
    monkeypatch.setattr(equations, "MAX_TIME_S", 0.0)
    with pytest.raises(RpctlError, match="no closed form that one would read"):
        derive(rpctl.load("paper"))


def test_text(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "rpctl.derive.write.closed_form", lambda robot, given=False: form_of(robot.name, given)
    )
    text = derive(paper)
    assert text.startswith("paper: M nu_dot + h = B tau\n")
    assert "theta1  position of arm_revolute_joint [rad]" in text
    assert "  M12 = M13 = -S1*p1\n" in text
    assert "m4 = 2 kg" in derive(paper, parameters=True)


def test_usage_is_explained(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="did you mean python"):
        derive(paper, "pyton")
    with pytest.raises(RpctlError, match="leave --parameters out"):
        derive(paper, "c", parameters=True)


@pytest.mark.parametrize(("name", "parameters"), cells(FORMS, (), {("paper", True)}))
def test_latex_compiles(name: str, parameters: bool, tmp_path: Path) -> None:
    compile_latex(derive(rpctl.load(name), "latex", parameters), tmp_path)


def test_latex_of_hostile_names(tmp_path: Path) -> None:
    name = r"a_b%\input{/etc/passwd}$^~#é"
    urdf = platform(SET_A).replace('name="platform"', f'name="{name}"')
    source = derive(rpctl.load(write(tmp_path, urdf)), "latex")
    assert r"\input" not in source
    assert r"a\_b\%" in source
    compile_latex(source, tmp_path)


def compile_latex(source: str, folder: Path) -> None:
    assert source.startswith("\\documentclass") and source.isascii()
    if shutil.which("pdflatex") is None:
        pytest.skip("pdflatex is not installed")
    (folder / "form.tex").write_text(source)
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "form.tex"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout
