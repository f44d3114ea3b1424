"""The reduced equations, and a law, as source code without dependencies: C99 or Python."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from importlib.resources import files
from typing import Any

import jinja2
import numpy as np

from rpctl.derive.law_program import LawProgram
from rpctl.derive.program import C_FLOAT, FUNCTIONS, PYTHON, C, Language, Node, program, write_steps
from rpctl.robot.model import Robot

LINEAR_SPEEDS = ("v", "vx", "vy")  # speeds of the base in m/s
UNITS = {"q": ("rad", "m"), "nu": ("rad/s", "m/s"), "tau": ("N m", "N")}
TEX: dict[str, Any] = {  # how templates of LaTeX mark what is put in: braces are LaTeX's
    "variable_start_string": "<<", "variable_end_string": ">>",
    "block_start_string": "<%", "block_end_string": "%>", "comment_start_string": "<#",
}  # fmt: skip
NAME_LENGTH = 40  # of the identifiers made from a robot's name


def c_source(robot: Robot) -> str:
    """Return C99 with no dependency but ``math.h``.

    It has ``NAME_dynamics(q, nu, M, h, B)``, which fills row-major M (dof, dof), h (dof,) and
    B (dof, n_act) of M ν̇ + h = B τ, and ``NAME_forward(q, nu, tau, nu_dot)``. Where joints have
    losses, ``NAME_losses(q, nu, l)`` fills ℓ (dof,), and ``forward`` has it on the right.
    """
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


def python_law(program: LawProgram) -> str:
    """Return Python that imports ``math`` alone.

    It has ``NAME_law(pose, q, nu, r)``, which returns τ (n_act,), ν_d (dof,) and ν̇_d (dof,) as
    lists; ``r`` has the attributes of ``rpctl.ReferenceState``.
    """
    text = rendered("law.py.jinja", _law(program, PYTHON))
    return text.replace("r->direction", "direction").replace("r->", "r.")


def rendered(name: str, context: dict[str, Any], **filters: Callable[..., Any]) -> str:
    """Return a template of this room with values, and filters of the caller's, put in."""
    folder = files("rpctl.derive") / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: folder.joinpath(name).read_text("utf-8")),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        **(TEX if ".tex" in name else {}),
    )
    environment.filters.update(filters)
    return environment.get_template(name).render(context)


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
