"""A law as source code that needs nothing of this package: one file of C99, or Python."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rpctl.derive.codegen import comment, identifier
from rpctl.derive.law_program import LawProgram
from rpctl.derive.steps import C_FLOAT, FUNCTIONS, PYTHON, C, Language, Written, write_steps

ARM_FIELDS = ("joints", "joint_rates", "joint_accelerations")
BASE_FIELDS = {
    "pose": "of P: x, y [m], heading [rad]",
    "twist": "forward, left [m/s], turning [rad/s]",
    "twist_dot": "derivatives of these three",
}
DIRECTION = "along the twist, not zero at standstill, and two derivatives; zeros: none"


def c_law(program: LawProgram, single: bool = False) -> str:
    """Return C99 with no dependency but ``math.h``.

    It has ``NAME_law(pose, q, nu, r, tau, nu_d, nu_d_dot)`` and ``NAME_reference``, the type of
    ``*r``; no loop, no memory but the stack.

    Args:
        program: The law.
        single: Whether its numbers are ``float`` rather than ``double``.
    """
    real, language = ("float", C_FLOAT) if single else ("double", C)
    robot, name = program.law.robot, identifier(program.law.robot.name)
    lines = ["/*", *(f" * {line}".rstrip() for line in _header(program)), " */"]
    lines += ["#include <math.h>", "", "typedef struct {"]
    lines += [f"  {real} {field}[3]; /* {what} */" for field, what in BASE_FIELDS.items()]
    lines += [f"  {real} direction[3][3]; /* {DIRECTION} */"]
    lines += [f"  {real} {field}[{len(robot.joints)}];" for field in ARM_FIELDS if robot.joints]
    lines += [f"}} {name}_reference;", ""]
    head = f"void {name}_law("
    indent = " " * len(head)
    lines += [f"{head}const {real} *pose, const {real} *q, const {real} *nu,"]
    lines += [f"{indent}const {name}_reference *r,"]
    lines += [f"{indent}{real} *tau, {real} *nu_d, {real} *nu_d_dot)", "{"]
    for setting in _settings(program):
        lines.append(f"  const {real} {setting[0]} = {setting[1]}{language.suffix};{setting[2]}")
    given, value = _written(program, language)
    lines += [f"  const {real} {symbol} = {text};" for symbol, text in given]
    for output, nodes in _outputs(program):
        lines += [f"  {output}[{i}] = {value(node)};" for i, node in enumerate(nodes)]
    lines += [f"  (void){unused};" for unused in _unused(program)]
    return "\n".join([*lines, "}", ""])


def python_law(program: LawProgram) -> str:
    """Return Python that imports ``math`` alone.

    It has ``NAME_law(pose, q, nu, r)``, which returns τ (n_act,), ν_d (dof,) and ν̇_d (dof,) as
    lists; ``r`` has the attributes of ``rpctl.ReferenceState``.
    """
    name = identifier(program.law.robot.name)
    kinds = {node[0] for node in program.nodes}
    imported = ", ".join(sorted(kinds & set(FUNCTIONS)))
    lines = ['"""', *_header(program), '"""', ""]
    lines += [f"from math import {imported}", "", ""] if imported else [""]
    lines += [f"def {name}_law(pose, q, nu, r):", '    """Return tau, nu_d and nu_d_dot."""']
    if any(node[0] == "input" and "direction" in node[1] for node in program.nodes):
        lines.append("    direction = ((0.0,) * 3,) * 3 if r.direction is None else r.direction")
    lines += [f"    {symbol} = {value}" for symbol, value, _ in _settings(program)]
    given, value = _written(program, PYTHON)
    lines += [f"    {symbol} = {_dotted(text)}" for symbol, text in given]
    for output, nodes in _outputs(program):
        lines += [f"    {output} = ["]
        lines += [f"        {_dotted(value(node))}," for node in nodes]
        lines += ["    ]"]
    return "\n".join([*lines, "    return tau, nu_d, nu_d_dot", ""])


def _dotted(text: str) -> str:
    return text.replace("r->direction", "direction").replace("r->", "r.")


def _outputs(program: LawProgram) -> list[tuple[str, Sequence[int]]]:
    return [("tau", program.tau), ("nu_d", program.nu_d), ("nu_d_dot", program.nu_d_dot)]


def _written(program: LawProgram, language: Language) -> Written:
    wanted = [*program.tau, *program.nu_d, *program.nu_d_dot]
    return write_steps(program.nodes, wanted, language, program.named, "t")


def _settings(program: LawProgram) -> Iterator[tuple[str, str, str]]:
    """Yield the constants that the steps read: name, value, and a comment of C."""
    read = {node[1] for node in program.nodes if node[0] == "input"}
    for setting in program.law.sheet.settings:
        if str(setting.symbol) in read:
            what = comment(setting.of) + (f" [{setting.unit}]" if setting.unit else "")
            yield str(setting.symbol), repr(setting.value), f" /* {what} */"


def _unused(program: LawProgram) -> list[str]:
    texts = {node[1].partition("[")[0].partition("-")[0] for node in program.nodes
             if node[0] == "input"}  # fmt: skip
    texts |= {node[0] for node in program.nodes}
    return [name for name in ("pose", "q", "nu", "r") if name not in texts]


def _header(program: LawProgram) -> Iterator[str]:
    """Yield what the code is of: the robot, its inputs and outputs, and what it costs."""
    law = program.law
    robot = law.robot
    slides = {joint.name for joint in robot.description.joints if joint.kind == "prismatic"}
    yield f"{comment(robot.name)}: a tracking law, from the measured state to actuator efforts."
    yield "Predictive laws of Mirzaeinejad and Shafei, Amirkabir J. Mech. Eng. 53(SI 2), 2021, and"
    yield "what rpctl makes of them; nu_d_dot is the analytic derivative of nu_d along the motion."
    yield f"At most {program.operations}."
    yield f"For a control period of {law.period:g} s."
    yield ""
    yield "  pose  of the root link: x, y [m], heading [rad]"
    for k, name in enumerate(program.positions):
        yield f"  q[{k}]  {comment(name)}  [{'m' if name in slides else 'rad'}]"
    for k, (name, given) in enumerate(zip(robot.quasi_velocities, law.nu, strict=True)):
        unit = next(each.unit for each in law.sheet.inputs if each.symbol == given)
        yield f"  nu[{k}]  {comment(name)}  [{unit}]"
    yield "  r  the reference at this time; SI units, in the order of nu where it is the arm's"
    for k, name in enumerate(robot.actuators):
        yield f"  tau[{k}]  {comment(name)}  [{'N' if name in slides else 'N m'}]"
