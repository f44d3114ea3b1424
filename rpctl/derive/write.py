"""``derive``: a robot's equations of motion as text, LaTeX, Python or C."""

from __future__ import annotations

from rpctl.errors import RpctlError, UnknownNameError
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
    if format not in FORMATS:
        raise UnknownNameError("format", format, FORMATS)
    if format in ("python", "c"):
        if parameters:
            raise RpctlError(f"--format {format} has numbers only; leave --parameters out")
        from rpctl.derive.codegen import c_source, python_source

        return c_source(robot) if format == "c" else python_source(robot)
    from rpctl.derive.closed_form import closed_form
    from rpctl.derive.latex import to_latex
    from rpctl.derive.text import to_text

    if robot.drive.swivels:
        raise RpctlError(
            f"{robot.name}: wheels that swivel divide by sines and cosines of their angles, so the "
            "closed form is too long to read; take the code: --format python or c"
        )
    form = closed_form(robot, parameters)
    return to_latex(form) if format == "latex" else to_text(form)
