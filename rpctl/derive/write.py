"""``derive`` and ``derive_law``: equations of motion, or a law, as text, LaTeX, Python or C."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import casadi
import numpy as np

from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.estimation import state_calls
from rpctl.control.registry import configuration, read_law
from rpctl.control.twist_law import BaseLaw
from rpctl.derive.closed_form import ClosedForm, closed_form
from rpctl.derive.law_program import LawProgram, law_program, law_sheet
from rpctl.derive.linear_form import linear_form, write_linear
from rpctl.derive.program import (
    C_FLOAT,
    FUNCTIONS,
    PYTHON,
    C,
    Language,
    Node,
    Operations,
    count_operations,
    joint_symbols,
    program,
    steps_of,
    symbolic_configuration,
    write_steps,
)
from rpctl.derive.text import law_latex, law_text, rendered, to_latex, to_text
from rpctl.dynamics.symbols.basis import SymbolicConfiguration
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import RpctlError, require_known
from rpctl.robot.coordinates import BASE_NQ
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import BASE_NV, Robot

FORMATS = ("text", "latex", "python", "c")


def derive(
    robot: Robot, format: str = "text", parameters: bool = False, speed: float | None = None
) -> str:
    """Derive M ν̇ + h = B τ and write it; [MS21, Eq. 1-5].

    Of a robot that leans the linear equations near a straight run upright are written, see
    :mod:`rpctl.derive.linear_form`.

    Args:
        robot: The robot.
        format: ``"text"`` or ``"latex"``, the closed form of a small robot; ``"python"`` or
            ``"c"``, code with no dependencies for a robot of any size.
        parameters: Whether masses, lengths and inertias stay symbols; not for code.
        speed: Of a robot that leans, m/s.

    Raises:
        RpctlError: Nothing moves, the closed form would be too long, or a robot that leans is asked
            for what only others have, or the other way round.
        UnknownNameError: The format is not known.
    """
    require_known("format", [format], FORMATS)
    if isinstance(robot, LeaningRobot):
        if parameters:
            raise RpctlError(
                f"{robot.name} leans: its matrices are numbers; leave --parameters out"
            )
        return write_linear(linear_form(robot, speed), format)
    if speed is not None:
        raise RpctlError(
            f"{robot.name} does not lean: its equations hold at any speed; leave --speed out"
        )
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


PLACES = ("q", "measured", "before")  # configurations, of what estimates a state
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
    *,
    config: Any = None,
    kinematic: Any = None,
    dynamic: Any = None,
    format: str = "text",
    precision: str = "double",
    period: float | None = None,
) -> DerivedLaw:
    """Write a kinematic law, its analytic ν̇_d and the dynamic law in closed form.

    Settings become named constants. The approach of bases that cannot turn on the spot has memory
    and is left out, so the text is the law for small errors.

    Args:
        robot: The robot.
        config: A :class:`rpctl.Config`, or the path of its TOML file, with laws and period; the
            other arguments take precedence.
        kinematic: A law that is a formula, or its name (``"unified"``, ``"own.py:MyLaw"``);
            default: ``"unified"``.
        dynamic: :class:`rpctl.PaperDynamic`, or ``"paper"`` (default).
        format: ``"text"`` or ``"latex"`` to read; ``"python"`` or ``"c"`` for code without
            dependencies, loops and memory.
        precision: Type of the numbers in C, ``"double"`` or ``"float"``.
        period: Control period, s, on which default prediction times depend; default: 2 ms.

    Returns:
        ``text``, and for code ``operations``, the number of operations per sample.

    Raises:
        RpctlError: The laws have no closed form, or nothing drives the robot.
        UnknownNameError: A law, the format or the precision is not known.
    """
    require_known("format", [format], FORMATS)
    require_known("precision", [precision], PRECISIONS)
    if precision != "double" and format != "c":
        raise RpctlError(f"--format {format} has no precision to choose; take --format c")
    if config is not None:
        config = configuration(config, robot, kinematic, dynamic)
        kinematic, dynamic = config.kinematic, config.dynamic
        period = config.run.control_period if period is None else period
    laws = closed_laws(robot, kinematic or "unified", dynamic or "paper")
    sheet = law_sheet(robot, *laws, USUAL_PERIOD if period is None else period)
    if format in ("text", "latex"):
        write = law_text if format == "text" else law_latex
        return DerivedLaw(write(sheet, _form(robot)), None)
    program = law_program(sheet)
    text = python_law(program) if format == "python" else c_law(program, precision == "float")
    return DerivedLaw(text, program.operations)


def closed_laws(robot: Robot, law: Any, efforts: Any) -> tuple[BaseLaw, PaperDynamic]:
    """Return laws, or those of such names, which have a closed form on this robot."""
    law, efforts = read_law("kinematic", law), read_law("dynamic", efforts)
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


LINEAR_SPEEDS = ("v", "vx", "vy")  # speeds of the base in m/s
UNITS = {"q": ("rad", "m"), "nu": ("rad/s", "m/s"), "tau": ("N m", "N")}
NAME_LENGTH = 40  # of the identifiers made from a robot's name


def c_source(robot: Robot) -> str:
    """Return C99 with no dependency but ``math.h``.

    It has ``NAME_dynamics(q, nu, M, h, B)``, which fills row-major M (dof, dof), h (dof,) and
    B (dof, n_act) of M ν̇ + h = B τ, and ``NAME_forward(q, nu, tau, nu_dot)``. Where joints have
    losses, ``NAME_losses(q, nu, l)`` fills ℓ (dof,), and ``forward`` has it on the right.
    """
    robot.require_level()
    return rendered("model.c.jinja", _model(robot, C))


def python_source(robot: Robot) -> str:
    """Return Python that imports ``math`` alone.

    It has ``NAME_dynamics(q, nu)``, which returns M (dof, dof), h (dof,) and B (dof, n_act) of
    M ν̇ + h = B τ as lists, and ``NAME_forward(q, nu, tau)``. Where joints have losses,
    ``NAME_losses(q, nu)`` returns ℓ (dof,), and ``forward`` has it on the right.
    """
    return rendered("model.py.jinja", _model(robot, PYTHON))


def c_law(program: LawProgram, single: bool = False) -> str:
    """Return C99 with no dependency but ``math.h``.

    It has ``NAME_law(pose, q, nu, r, tau, nu_d, nu_d_dot)`` and ``NAME_reference``, the type of
    ``*r``; no loop, no memory but the stack.

    Args:
        program: The law.
        single: Whether its numbers are ``float`` rather than ``double``.
    """
    return rendered("law.c.jinja", _law(program, C_FLOAT if single else C))


def c_estimate(program: LawProgram, efforts: bool) -> DerivedLaw:
    """Return C99 of what estimates a state, and what a step of its motion costs.

    It has ``NAME_moving(s)`` and ``NAME_correcting(s)``, which change ``*s``, a ``NAME_estimate``,
    as :class:`~rpctl.control.estimation.StateKernel` its buffers; in the place of q it has the pose
    of the root link and the law's positions.

    Args:
        program: The law.
        efforts: Whether efforts move the robot, or only the disturbance.
    """
    robot, positions = program.law.robot, program.positions
    calls, buffers = state_calls(SymbolicDynamics(robot), efforts)
    sizes = {name: each.size for name, each in buffers.items() if name not in calls}
    sizes |= dict.fromkeys(PLACES, BASE_NV + len(positions))
    names, functions, costs = {each: name for name, each in buffers.items()}, {}, []
    for name, call in calls.items():
        given = {
            each: casadi.SX.sym(each, sizes[each]) for each in map(names.__getitem__, call.inputs)
        }
        read = [
            _configuration(robot, positions, x) if each in PLACES else x
            for each, x in given.items()
        ]
        written = map(names.__getitem__, call.outputs)
        found = dict(zip(written, call.function.call(read), strict=True))
        ends = [_place(robot, positions, x) if each in PLACES else x for each, x in found.items()]
        column = casadi.cse(casadi.densify(casadi.vertcat(*ends)))
        nodes, results = steps_of({f"s->{each}": x for each, x in given.items()}, column)
        lines, text = write_steps(nodes, results, C)
        targets = [f"s->{each}[{i}]" for each in found for i in range(sizes[each])]
        functions[name] = lines, dict(zip(targets, map(text, results), strict=True))
        costs.append(count_operations(nodes))
    said = {"name": identifier(robot.name), "title": comment(robot.name)}
    shown = rendered("estimate.c.jinja", {**said, "sizes": sizes, "functions": functions})
    return DerivedLaw(shown, costs[0])


def _configuration(robot: Robot, names: Sequence[str], place: Any) -> Any:
    """Return q (nq, 1) of the root link's pose and of some positions, one column."""
    at = dict(zip(names, casadi.vertsplit(place)[BASE_NV:], strict=True))
    q = symbolic_configuration(robot, {**dict.fromkeys(joint_symbols(robot), 0.0), **at})
    q[:BASE_NQ] = casadi.vertcat(place[:2], casadi.cos(place[2]), casadi.sin(place[2]))
    return q


def _place(robot: Robot, names: Sequence[str], q: Any) -> Any:
    """Return the root link's pose and positions, one column, of q (nq, 1)."""
    at = SymbolicConfiguration(q)
    positions = [at.position(robot.entries[name]) for name in names]
    return casadi.vertcat(q[:2], casadi.atan2(q[3], q[2]), *positions)


def python_law(program: LawProgram) -> str:
    """Return Python that imports ``math`` alone.

    It has ``NAME_law(pose, q, nu, r)``, which returns τ (n_act,), ν_d (dof,) and ν̇_d (dof,) as
    lists; ``r`` has the attributes of ``rpctl.ReferenceState``.
    """
    text = rendered("law.py.jinja", _law(program, PYTHON))
    return text.replace("r->direction", "direction").replace("r->", "r.")


def _model(robot: Robot, language: Language) -> dict[str, Any]:
    """Return what the templates of the dynamics say."""
    steps, n, m = program(robot), robot.dof, len(robot.actuators)
    given, text = write_steps(steps.nodes, steps.terms, language)
    texts = np.array([text(node) for node in steps.terms], dtype=object)
    lost, loss = write_steps(steps.loss_nodes, steps.losses, language)
    return {
        "name": identifier(robot.name),
        "title": comment(robot.name),
        "entries": _entries(robot, steps.positions),
        "n": n,
        "m": m,
        "given": given,
        "M": texts[: n * n].reshape(n, n).tolist(),
        "h": texts[n * n : n * n + n].tolist(),
        "B": texts[n * n + n :].reshape(n, m).tolist(),
        "lost": lost,
        "losses": [loss(node) for node in steps.losses],
        "unused": _unused(steps.nodes, ("q", "nu")),
        "unused_by_losses": _unused(steps.loss_nodes, ("q", "nu")),
        "imported": _functions((*steps.nodes, *steps.loss_nodes, ("sqrt",))),
    }


def _law(program: LawProgram, language: Language) -> dict[str, Any]:
    """Return what the templates of a law say."""
    law, robot = program.law, program.law.robot
    results = program.results.items()
    wanted = [node for _, nodes in results for node in nodes]
    given, text = write_steps(program.nodes, wanted, language, program.named, "t")
    read = {node[1] for node in program.nodes if node[0] == "input"}
    settings = [
        (
            str(each.symbol),
            repr(each.place),
            f"{comment(each.of)} [{each.unit}]".removesuffix(" []"),
        )
        for each in law.settings
        if str(each.symbol) in read
    ]
    return {
        "name": identifier(robot.name),
        "title": comment(robot.name),
        "entries": _entries(robot, program.positions),
        "operations": program.operations,
        "period": f"{law.period:g}",
        "real": "float" if language is C_FLOAT else "double",
        "suffix": language.suffix,
        "n_joints": len(robot.joints),
        "settings": settings,
        "given": given,
        "outputs": [
            (name, [text(node) for node in nodes]) for name, nodes in program.results.items()
        ],
        "unused": _unused(program.nodes, ("pose", "q", "nu", "r")),
        "imported": _functions(program.nodes),
    }


def _unused(nodes: Collection[Node], names: Sequence[str]) -> list[str]:
    """Return the arguments of a function that its steps do not read."""
    read = {re.split(r"\[|->", node[1])[0] for node in nodes if node[0] == "input"}
    return [name for name in names if name not in read]


def _functions(nodes: Iterable[Node]) -> list[str]:
    """Return the functions of the mathematics library that steps call."""
    return sorted({node[0] for node in nodes} & set(FUNCTIONS))


def identifier(name: str) -> str:
    """Return a robot's name as an identifier of C and of Python; names come from any file."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)[:NAME_LENGTH]
    return word if re.match(r"[A-Za-z]", word) else f"robot_{word.lstrip('_')}".rstrip("_")


def comment(text: str) -> str:
    """Return a name with nothing in it that could end a comment or a string."""
    return re.sub(r"[^A-Za-z0-9_ .:+-]", "_", text)


def _entries(robot: Robot, positions: Sequence[str]) -> dict[str, list[str]]:
    """Return a line for each entry of q, ν and τ: its name and its unit."""
    slides = {joint.name for joint in robot.description.joints if joint.kind == "prismatic"}
    base = len(robot.drive.base_speeds)  # of ν the first, whatever joints are called
    entries = {
        "q": [(name, name in slides) for name in positions],
        "nu": [
            (name, name in (LINEAR_SPEEDS if k < base else slides))
            for k, name in enumerate(robot.quasi_velocities)
        ],
        "tau": [(name, name in slides) for name in robot.actuators],
    }
    return {
        symbol: [
            f"  {symbol}[{k}]  {comment(name)}  [{UNITS[symbol][linear]}]"
            for k, (name, linear) in enumerate(pairs)
        ]
        for symbol, pairs in entries.items()
    }
