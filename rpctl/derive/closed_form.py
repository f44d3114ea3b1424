"""The closed form of a small robot: what [MS21] derives by hand, for any drive and arm.

The recursion of :mod:`rpctl.equivalence.gibbs_appell` runs over exact polynomials; the result is
written as short as a few changes of variables and layouts make it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count

import sympy as sp

from rpctl.derive.equations import Equations, Parameter, by_recursion, cyclic_joints
from rpctl.derive.polynomial import TooLargeError
from rpctl.derive.short_form import ShortForm, shortest_form
from rpctl.derive.substitution import candidate_forms, with_angle_sums
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

MAX_JOINTS = 4  # of the arm; beyond it a closed form fills pages
MAX_TERMS = 600  # of all polynomials together
SIZE_ADVICE = "use --format c or python, which take any robot, or freeze joints with --lock NAME"


@dataclass(frozen=True)
class Coordinate:
    """A position's symbol, the joint that has it, and its unit."""

    symbol: sp.Symbol
    joint: str
    unit: str


@dataclass(frozen=True)
class ClosedForm:
    """M ν̇ + h = B τ + ℓ in symbols.

    Attributes:
        robot: Name of the robot.
        coordinates: Positions of the joints that the form may contain.
        rates: ν, in the order of ``robot.quasi_velocities``: the base's (m/s, rad/s), whose names
            are the drive's, and the joints'; a joint's rate is its position's symbol with ``_dot``.
        actuators: Names of τ.
        M: Inertia (n, n), symmetric.
        h: Bias (n, 1); the paper's Re is −h.
        B: Actuation map (n, n_act).
        losses: ℓ (n, 1), of damping and friction; zeros where nothing is lost.
        definitions: Symbols in M and h and what they are, each in terms of those before it.
        parameters: Symbols that stand for numbers of the URDF; none unless asked for.
    """

    robot: str
    coordinates: tuple[Coordinate, ...]
    rates: tuple[sp.Symbol, ...]
    actuators: tuple[str, ...]
    M: sp.ImmutableMatrix
    h: sp.ImmutableMatrix
    B: sp.ImmutableMatrix
    losses: sp.ImmutableMatrix
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...]
    parameters: tuple[Parameter, ...]

    def expanded(self) -> tuple[sp.Matrix, sp.Matrix]:
        """Return M and h with the definitions put in: functions of positions and rates alone."""
        M, h = sp.Matrix(self.M), sp.Matrix(self.h)
        for symbol, value in reversed(self.definitions):
            M, h = (x.xreplace({symbol: value}) for x in (M, h))
        return M, h


def closed_form(robot: Robot, parameters: bool = False) -> ClosedForm:
    """Derive a robot's equations in closed form; [MS21, Eq. 1-5].

    Numbers are exact: a float is the decimal that it prints as, and an entry of a direction
    within 1e-9 of 0, ±1/2, ±√2/2, ±√3/2 or ±1 is that. Where other directions occur, coefficients
    are rounded to 13 digits.

    Args:
        robot: The robot.
        parameters: Whether masses, lengths and inertias stay symbols.

    Raises:
        RpctlError: Nothing moves, or the form would be too long or take too long.
    """
    if robot.dof == 0:
        raise RpctlError(f"{robot.name}: nothing moves, so there is no equation of motion")
    if len(robot.joints) > MAX_JOINTS:
        raise RpctlError(
            f"{robot.name}: a closed form is for arms of at most {MAX_JOINTS} joints, and this "
            f"one has {len(robot.joints)}; {SIZE_ADVICE}"
        )
    try:
        equations = by_recursion(robot, parameters)
        return _renamed(_form(robot, equations, _shortest(equations)))
    except TooLargeError:
        raise RpctlError(
            f"{robot.name}: it has no closed form that one would read; {SIZE_ADVICE}"
        ) from None


def _shortest(equations: Equations) -> ShortForm:
    forms = candidate_forms(equations)
    if forms[0].size > MAX_TERMS:
        raise TooLargeError
    if len(equations.angles) > 1:
        forms += [with_angle_sums(form, equations) for form in forms]
    return shortest_form(forms)


def _form(robot: Robot, equations: Equations, short: ShortForm) -> ClosedForm:
    n, cyclic = robot.dof, cyclic_joints(robot)
    upper = [(i, j) for i in range(n) for j in range(i, n)]
    M = sp.zeros(n, n)
    for (i, j), entry in zip(upper, short.entries, strict=False):
        M[i, j] = M[j, i] = entry
    kinds = {joint.name: joint.kind for joint in robot.description.joints}
    B = [equations.space.expression(x, {}) for row in equations.B for x in row]
    return ClosedForm(
        robot=robot.name,
        coordinates=tuple(
            Coordinate(symbol, name, "m" if kinds[name] == "prismatic" else "rad")
            for name, symbol in equations.positions.items()
            if name not in cyclic
        ),
        rates=equations.rates,
        actuators=robot.actuators,
        M=sp.ImmutableMatrix(M),
        h=sp.ImmutableMatrix(n, 1, short.entries[len(upper) :]),
        B=sp.ImmutableMatrix(n, len(robot.actuators), B),  # n rows where nothing drives, too
        losses=_losses(equations),
        definitions=short.definitions,
        parameters=equations.parameters,
    )


def _losses(equations: Equations) -> sp.ImmutableMatrix:
    """Return ℓ (n, 1): each joint's damping and smooth friction on its own rate, onto ν."""
    total, shown = sp.zeros(len(equations.rates), 1), equations.space.expression
    for row, numbers in equations.losses:
        onto = sp.Matrix([shown(entry, {}) for entry in row])
        damping, friction, smooth = (shown(number, {}) for number in numbers)
        rate = sum(a * b for a, b in zip(onto, equations.rates, strict=True))
        total -= onto * (damping * rate + friction * rate / sp.sqrt(rate**2 + smooth**2))
    return sp.ImmutableMatrix(total)


def _renamed(form: ClosedForm) -> ClosedForm:
    """Return the form with the parameters that occur in it, and these numbered: m1, m2, l1, …"""
    values = (value for _, value in form.definitions)
    used = sp.Tuple(form.M, form.h, form.B, form.losses, *values).free_symbols
    kept = [parameter for parameter in form.parameters if parameter.symbol in used]
    letters = [str(parameter.symbol).partition("_")[0] for parameter in kept]
    numbers = {x: count(1) if x not in "rg" or letters.count(x) > 1 else [""] for x in letters}
    places = {letter: iter(each) for letter, each in numbers.items()}
    names = {
        parameter.symbol: sp.Symbol(f"{letter}{next(places[letter])}", real=True)
        for parameter, letter in zip(kept, letters, strict=True)
    }
    return replace(
        form,
        M=form.M.xreplace(names),
        h=form.h.xreplace(names),
        B=form.B.xreplace(names),
        losses=form.losses.xreplace(names),
        definitions=tuple((symbol, value.xreplace(names)) for symbol, value in form.definitions),
        parameters=tuple(replace(p, symbol=names[p.symbol]) for p in kept),
    )
