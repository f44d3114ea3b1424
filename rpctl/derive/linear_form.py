"""What a robot that leans is near a straight run upright: matrices of numbers, to read or to use.

Of a bicycle they are those of [MPRS07], of its roll and its steering c at all speeds v,

    M c̈ + v C1 ċ + (g K0 + v² K2) c = B τ.

Of other robots, and of a bicycle at one speed, they are A and B of ẋ = A x + B u; x holds what is
balanced, the arm and the quasi-velocities, u the efforts, each less what the steady motion has.

[MPRS07] J. P. Meijaard, J. M. Papadopoulos, A. Ruina, A. L. Schwab, "Linearized dynamics equations
for the balance and steer of a bicycle: a benchmark and review", Proc. R. Soc. A 463, 2007.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.steady_motion import ERRORS, STEADY, Posture
from rpctl.derive.text import escaped, rendered
from rpctl.dynamics.derivatives import linearize
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, printable
from rpctl.robot.inspection import meanings
from rpctl.robot.leaning import GRAVITY, LeaningRobot

ROUNDING = 1e-12  # of a matrix's largest entry: what is smaller is 0
SECOND_ORDER = {
    "text": "M c_ddot + v C1 c_dot + (g K0 + v^2 K2) c = B tau, at any speed v",
    "latex": r"M \ddot c + v\,C_1 \dot c + (g K_0 + v^2 K_2)\,c = B \tau",
}
FIRST_ORDER = {"text": "x_dot = A x + B u", "latex": r"\dot x = A x + B u"}


class LinearForm(NamedTuple):
    """The linear equations of a robot that leans.

    Attributes:
        robot: Its name.
        speed: That of P, m/s; None: they hold at all speeds.
        equations: They, as text and as LaTeX.
        unknowns: What is balanced, then what x holds besides: names, and what they are.
        steady: Where the unknowns are 0, and the efforts (by actuator) that keep them there.
        actuators: Names of the efforts.
        matrices: By name, in order.
    """

    robot: str
    speed: float | None
    equations: Mapping[str, str]
    unknowns: Mapping[str, str]
    steady: Mapping[str, float]
    actuators: tuple[str, ...]
    matrices: Mapping[str, Array]


def linear_form(robot: LeaningRobot, speed: float | None = None) -> LinearForm:
    """Return the linear equations of a robot that leans, its arm at home.

    Args:
        robot: The robot.
        speed: That of P, m/s. None: of a bicycle without an arm the equations at all speeds, of
            other robots those of standing.

    Raises:
        UnfitLawError: Nothing drives its wheels, its steering or its arm.
        RpctlError: No steady motion has that speed.
    """
    if speed is None and robot.rolls_sideways and not robot.joints:
        return _bicycle(robot)
    posture, speed = Posture(ReducedDynamics(robot)), speed or 0.0
    steady = posture.steady(speed, 0.0, robot.home)
    A, B = posture.linear(steady)
    places = _places(robot)
    rates = {_rate(name): words for name, words in meanings(robot).items()}
    at = np.concatenate([steady.posture, robot.home, steady.tau])
    at[np.abs(at) <= STEADY] = 0.0
    there = zip((*places, *robot.actuators), at.tolist(), strict=True)
    return LinearForm(
        robot.name, speed, FIRST_ORDER, places | rates, dict(there), robot.actuators,
        {"A": _clean(A[ERRORS:, ERRORS:]), "B": _clean(B[ERRORS:])},
    )  # fmt: skip


def _bicycle(robot: LeaningRobot) -> LinearForm:
    """Return the equations of a bicycle's roll and steering at all speeds."""
    dynamics, q = ReducedDynamics(robot), robot.configuration()
    M, along = dynamics.inertia(q), dynamics.basis(q)

    def at(speed: float) -> tuple[Array, Array]:
        nu = np.array([speed, *np.zeros(robot.dof - 1)])
        A, _ = linearize(robot, q, nu, np.zeros(len(robot.actuators)))
        M_A = -M @ A[robot.nv :]
        return M_A[1:, robot.nv + 1 :], (M_A[:, : robot.nv] @ along)[1:, 1:]

    (_, standing), (C1, rolling) = at(0.0), at(1.0)
    matrices = {"M": M[1:, 1:], "C1": C1, "K0": standing / GRAVITY, "K2": rolling - standing}
    matrices["B"] = dynamics.actuation(q)[1:]
    return LinearForm(
        robot.name, None, SECOND_ORDER, _places(robot), {}, robot.actuators,
        {name: _clean(matrix) for name, matrix in matrices.items()},
    )  # fmt: skip


def _places(robot: LeaningRobot) -> dict[str, str]:
    """Return names and meanings of the tilt, of the steering and of the arm's positions."""
    tilt = ("roll", "to the right") if robot.rolls_sideways else ("pitch", "forward")
    found = {tilt[0]: f"of the root link, {tilt[1]} positive, rad"}
    for swivel in robot.drive.steered:
        q = robot.configuration(joints={swivel.joint: 1e-3})
        ahead = np.array([1.0, *np.zeros(robot.dof - 1)])
        side = "left" if ReducedDynamics(robot).twist(q, ahead)[2] > 0.0 else "right"
        found[swivel.joint] = f"steering, to the {side} positive, rad"
    units = {joint.name: "m" if joint.kind == "prismatic" else "rad" for joint in robot.joints}
    return found | {name: f"position, {unit}" for name, unit in units.items()}


def _rate(name: str) -> str:
    return name if name in ("v", "omega") or name.endswith("_rate") else f"{name}_dot"


def _clean(matrix: Array) -> Array:
    """Return a matrix without its rounding."""
    least = ROUNDING * np.abs(matrix).max(initial=0.0)
    return np.where(np.abs(matrix) > least, matrix, 0.0)


def write_linear(form: LinearForm, format: str) -> str:
    """Return linear equations as text, LaTeX or Python.

    Raises:
        RpctlError: The format is that of the nonlinear equations alone.
    """
    if format == "c":
        raise RpctlError(
            f"{form.robot} leans: its equations are written as linear matrices; take --format "
            "text, latex or python"
        )
    if format == "latex":
        size = max(matrix.shape[1] for matrix in form.matrices.values())
        body = rendered("linear.tex.jinja", {"form": form}, escaped=escaped)
        return rendered("document.tex.jinja", {"columns": size, "body": body})
    name = "linear.py.jinja" if format == "python" else "linear.txt.jinja"
    return rendered(name, {"form": form}, rows=_rows, printable=printable)


def _rows(matrix: Array) -> list[str]:
    """Return the rows of a matrix with aligned columns."""
    texts = [[f"{x:.13g}" for x in row] for row in matrix.tolist()]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    return ["  ".join(x.rjust(w) for x, w in zip(row, widths, strict=True)) for row in texts]
