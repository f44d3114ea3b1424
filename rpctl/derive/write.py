"""``derive`` and ``derive_law``: equations of motion, or a law, as text, LaTeX, Python or C."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.registry import dynamic_by_name, kinematic_by_name
from rpctl.control.twist_law import BaseLaw
from rpctl.derive.closed_form import ClosedForm, closed_form
from rpctl.derive.codegen import c_law, c_source, python_law, python_source
from rpctl.derive.law_program import law_program, law_sheet
from rpctl.derive.steps import Operations
from rpctl.derive.text import law_latex, law_text, to_latex, to_text
from rpctl.errors import RpctlError, require_known
from rpctl.robot.model import Robot

FORMATS = ("text", "latex", "python", "c")


def derive(robot: Robot, format: str = "text", parameters: bool = False) -> str:
    """Derive M ν̇ + h = B τ and write it; [MS21, Eq. 1-5].

    Args:
        robot: The robot.
        format: ``"text"`` or ``"latex"``, the closed form of a small robot; ``"python"`` or
            ``"c"``, code with no dependencies for a robot of any size.
        parameters: Whether masses, lengths and inertias stay symbols; not for code.

    Raises:
        RpctlError: Nothing moves, or the closed form would be too long.
        UnknownNameError: The format is not known.
    """
    require_known("format", [format], FORMATS)
    if format in ("python", "c"):
        if parameters:
            raise RpctlError(f"--format {format} has numbers only; leave --parameters out")
        return c_source(robot) if format == "c" else python_source(robot)
    if robot.drive.swivels:
        raise RpctlError(
            f"{robot.name}: wheels that swivel divide by sines and cosines of their angles, so the "
            "closed form is too long to read; take the code: --format python or c"
        )
    form = closed_form(robot, parameters)
    return to_latex(form) if format == "latex" else to_text(form)


PRECISIONS = ("double", "float")
NOT_CLOSED = {  # what has no closed form, and why
    "Horizon": "solves a quadratic program at each sample",
    "EndEffector": "solves for the arm's rates within its limits at each sample",
    "BoundedDynamic": "solves a quadratic program where a limit binds",
    "IntegralDynamic": "remembers its integral and solves a quadratic program where a limit binds",
}


class DerivedLaw(NamedTuple):
    """A law that is written: its text, and what a sample costs; None for formulas to read."""

    text: str
    operations: Operations | None


def derive_law(
    robot: Robot,
    kinematic: Any = "unified",
    dynamic: Any = "paper",
    format: str = "text",
    precision: str = "double",
    period: float = USUAL_PERIOD,
) -> DerivedLaw:
    """Write a kinematic law, its analytic ν̇_d and the dynamic law in closed form.

    Settings are constants with names. The law is that near its reference: the stage for far starts
    of bases that cannot turn on the spot remembers its way, and is left out.

    Args:
        robot: The robot.
        kinematic: The name of a law that is a formula (``"unified"``, ``"own.py:MyLaw"``), or
            such a law with settings of its own.
        dynamic: ``"paper"``, or that law with settings of its own.
        format: ``"text"`` or ``"latex"`` to read; ``"python"`` or ``"c"``, code without
            dependencies, without loops and without memory.
        precision: Of the numbers in C, ``"double"`` or ``"float"``.
        period: Control period, s; the joints' prediction times follow from it unless they are set.

    Raises:
        RpctlError: The laws have no closed form, or nothing drives the robot.
        UnknownNameError: A law, the format or the precision is not known.
    """
    require_known("format", [format], FORMATS)
    require_known("precision", [precision], PRECISIONS)
    if precision != "double" and format != "c":
        raise RpctlError(f"--format {format} has no precision to choose; take --format c")
    law = kinematic_by_name(kinematic) if isinstance(kinematic, str) else kinematic
    efforts = dynamic_by_name(dynamic) if isinstance(dynamic, str) else dynamic
    sheet = law_sheet(robot, *closed_laws(robot, law, efforts), period)
    if format in ("text", "latex"):
        write = law_text if format == "text" else law_latex
        return DerivedLaw(write(sheet, _form(robot)), None)
    program = law_program(sheet)
    text = python_law(program) if format == "python" else c_law(program, precision == "float")
    return DerivedLaw(text, program.operations)


def closed_laws(robot: Robot, law: Any, efforts: Any) -> tuple[BaseLaw, PaperDynamic]:
    """Return the laws, which have a closed form on this robot."""
    if robot.dof == 0:
        raise RpctlError(f"{robot.name}: nothing moves, so there is no law to write")
    if not isinstance(law, BaseLaw):
        raise RpctlError(f"{_refusal(law)}; take --law unified or paper")
    if type(efforts) is not PaperDynamic:
        raise RpctlError(
            f"{_refusal(efforts)}; take --dynamic paper, and keep the efforts' limits beside it"
        )
    if efforts.midpoint:
        raise RpctlError(
            "PaperDynamic(midpoint=True) looks half a period ahead; leave midpoint out"
        )
    return law, efforts


def _refusal(law: object) -> str:
    name = type(law).__name__
    return f"{name} {NOT_CLOSED.get(name, 'is none of those that are written in closed form')}"


def _form(robot: Robot) -> ClosedForm | None:
    """Return a robot's closed form; None if it is too long to read."""
    with suppress(RpctlError):
        return None if robot.drive.swivels else closed_form(robot)
    return None
