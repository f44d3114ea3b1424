"""The reduced equations, and a law, as source code without dependencies: C99 or Python."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from rpctl.derive.law_program import LawProgram
from rpctl.derive.program import ScalarProgram, program
from rpctl.derive.steps import C_FLOAT, FUNCTIONS, PYTHON, C, Language, Node, Written, write_steps
from rpctl.drive.drive import BASE_SPEEDS
from rpctl.robot.model import Robot

LINEAR_SPEEDS = ("v", "vx", "vy")  # speeds of the base in m/s
NAME_LENGTH = 40  # of the identifiers made from a robot's name

C_FORWARD = """
/* nu_dot = M^-1 (B tau - h{plus}), by Cholesky's M = L L'. Returns 0, or 1 where M is not positive
   definite; nu_dot is then left as it was. */
int {name}_forward(const double *q, const double *nu, const double *tau, double *nu_dot)
{{
  double M[{n} * {n}], h[{n}], B[{n} * {m}], x[{n}]{array};
  int i, j, k;
  {name}_dynamics(q, nu, M, h, B);{call}
  for (i = 0; i < {n}; i++) {{
    x[i] = {start};
    for (j = 0; j < {m}; j++) x[i] += B[{m} * i + j] * tau[j];
    for (j = 0; j <= i; j++) {{
      double sum = M[{n} * i + j];
      for (k = 0; k < j; k++) sum -= M[{n} * i + k] * M[{n} * j + k];
      if (i == j && !(sum > 0.0)) return 1;
      M[{n} * i + j] = i == j ? sqrt(sum) : sum / M[{n} * j + j];
    }}
    for (k = 0; k < i; k++) x[i] -= M[{n} * i + k] * x[k];
    x[i] /= M[{n} * i + i];
  }}
  for (i = {n} - 1; i >= 0; i--) {{
    for (k = i + 1; k < {n}; k++) x[i] -= M[{n} * k + i] * x[k];
    x[i] /= M[{n} * i + i];
  }}
  for (i = 0; i < {n}; i++) nu_dot[i] = x[i];
  return 0;
}}
"""

PYTHON_FORWARD = '''

def {name}_forward(q, nu, tau):
    """Return nu_dot = M^-1 (B tau - h{plus}), by Cholesky's M = L L'."""
    M, h, B = {name}_dynamics(q, nu){call}
    n, x = {n}, []
    for i in range(n):
        for j in range(i + 1):
            total = M[i][j] - sum(M[i][k] * M[j][k] for k in range(j))
            M[i][j] = sqrt(total) if i == j else total / M[j][j]
        force = sum(b * effort for b, effort in zip(B[i], tau)) {start}
        x.append((force - sum(M[i][k] * x[k] for k in range(i))) / M[i][i])
    for i in reversed(range(n)):
        x[i] = (x[i] - sum(M[k][i] * x[k] for k in range(i + 1, n))) / M[i][i]
    return x
'''


def c_source(robot: Robot) -> str:
    """Return C99 with no dependency but ``math.h``.

    It has ``NAME_dynamics(q, nu, M, h, B)``, which fills row-major M (dof, dof), h (dof,) and
    B (dof, n_act) of M ν̇ + h = B τ, and ``NAME_forward(q, nu, tau, nu_dot)``. Where joints have
    losses, ``NAME_losses(q, nu, l)`` fills ℓ (dof,), and ``forward`` has it on the right.
    """
    steps, name = program(robot), identifier(robot.name)
    n, m = robot.dof, len(robot.actuators)
    lines = ["/*", *(f" * {line}".rstrip() for line in _header(robot, steps)), " */"]
    lines += ["#include <math.h>", "", f"void {name}_dynamics(const double *q, const double *nu,"]
    lines += [" " * len(f"void {name}_dynamics(") + "double *M, double *h, double *B)", "{"]
    given, values = _written(steps, C)
    lines += [f"  const double {symbol} = {text};" for symbol, text in given]
    kinds = {node[0] for node in steps.nodes}
    lines += [f"  (void){unused};" for unused in ("q", "nu") if unused not in kinds]
    for i in range(n):
        mirrored = [f"M[{n * j + i}]" for j in range(i)]
        entries = mirrored + [values(node) for node in steps.M[i][i:]]
        lines += [f"  M[{n * i + j}] = {text};" for j, text in enumerate(entries)]
    lines += [f"  h[{i}] = {values(node)};" for i, node in enumerate(steps.h)]
    flat = [node for row in steps.B for node in row]
    lines += [f"  B[{k}] = {values(node)};" for k, node in enumerate(flat)]
    lossy = bool(steps.losses)
    forward = C_FORWARD.format(
        name=name, n=n, m=m, plus=" + l" * lossy, array=f", l[{n}]" * lossy,
        call=f"\n  {name}_losses(q, nu, l);" * lossy, start="l[i] - h[i]" if lossy else "-h[i]",
    )  # fmt: skip
    return "\n".join([*lines, "}", "", *_c_losses(name, steps)]) + forward


def _c_losses(name: str, steps: ScalarProgram) -> list[str]:
    """Return the lines of ``NAME_losses``; none where nothing is lost."""
    if not steps.losses:
        return []
    given, values = write_steps(steps.loss_nodes, steps.losses, C)
    kinds = {node[0] for node in steps.loss_nodes}
    return [
        "/* The quasi-force l of damping and friction: M nu_dot + h = B tau + l. */",
        f"void {name}_losses(const double *q, const double *nu, double *l)",
        "{",
        *(f"  const double {symbol} = {text};" for symbol, text in given),
        *(f"  (void){unused};" for unused in ("q", "nu") if unused not in kinds),
        *(f"  l[{i}] = {values(node)};" for i, node in enumerate(steps.losses)),
        "}",
        "",
    ]


def python_source(robot: Robot) -> str:
    """Return Python that imports ``math`` alone.

    It has ``NAME_dynamics(q, nu)``, which returns M (dof, dof), h (dof,) and B (dof, n_act) of
    M ν̇ + h = B τ as lists, and ``NAME_forward(q, nu, tau)``. Where joints have losses,
    ``NAME_losses(q, nu)`` returns ℓ (dof,), and ``forward`` has it on the right.
    """
    steps, name = program(robot), identifier(robot.name)
    imported = _imported((*steps.nodes, *steps.loss_nodes, ("sqrt",)))
    lines = ['"""', *_header(robot, steps), '"""', "", imported, "", ""]
    lines += [f"def {name}_dynamics(q, nu):", '    """Return M, h and B as lists."""']
    given, values = _written(steps, PYTHON)
    lines += [f"    {symbol} = {text}" for symbol, text in given]
    lines += [f"    M = [[0.0] * {robot.dof} for _ in range({robot.dof})]"]
    for i, row in enumerate(steps.M):
        for j in range(i, robot.dof):
            mirror = f"M[{j}][{i}] = " if i != j else ""
            lines.append(f"    M[{i}][{j}] = {mirror}{values(row[j])}")
    lines += ["    h = [", *(f"        {values(node)}," for node in steps.h), "    ]", "    B = ["]
    lines += [f"        [{', '.join(map(values, row))}]," for row in steps.B]
    lines += ["    ]", "    return M, h, B", ""]
    lossy = bool(steps.losses)
    forward = PYTHON_FORWARD.format(
        name=name, n=robot.dof, plus=" + l" * lossy, call=f"\n    l = {name}_losses(q, nu)" * lossy,
        start="+ l[i] - h[i]" if lossy else "- h[i]",
    )  # fmt: skip
    return "\n".join([*lines, *_python_losses(name, steps)]) + forward


def _python_losses(name: str, steps: ScalarProgram) -> list[str]:
    """Return the lines of ``NAME_losses``; none where nothing is lost."""
    if not steps.losses:
        return []
    given, values = write_steps(steps.loss_nodes, steps.losses, PYTHON)
    return [
        "",
        f"def {name}_losses(q, nu):",
        '    """Return the quasi-force l of damping and friction: M nu_dot + h = B tau + l."""',
        *(f"    {symbol} = {text}" for symbol, text in given),
        "    return [",
        *(f"        {values(node)}," for node in steps.losses),
        "    ]",
        "",
    ]


def _imported(nodes: Iterable[Node]) -> str:
    """Return the line that imports the functions of steps."""
    kinds = {node[0] for node in nodes}
    return f"from math import {', '.join(sorted(kinds & set(FUNCTIONS)))}"


def identifier(name: str) -> str:
    """Return a robot's name as an identifier of C and of Python; names come from any file."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)[:NAME_LENGTH]
    return word if re.match(r"[A-Za-z]", word) else f"robot_{word.lstrip('_')}".rstrip("_")


def comment(text: str) -> str:
    """Return a name with nothing in it that could end a comment or a string."""
    return re.sub(r"[^A-Za-z0-9_ .:+-]", "_", text)


def _header(robot: Robot, steps: ScalarProgram) -> Iterator[str]:
    """Yield what the code is of: the robot, the order of its coordinates and their units."""
    slides = {joint.name for joint in robot.description.joints if joint.kind == "prismatic"}
    base = len(BASE_SPEEDS[robot.drive.type])  # of ν the first, whatever joints are called

    def listed(symbol: str, names: Sequence[str], units: tuple[str, str]) -> Iterator[str]:
        for k, name in enumerate(names):
            linear = name in LINEAR_SPEEDS if symbol == "nu" and k < base else name in slides
            yield f"  {symbol}[{k}]  {comment(name)}  [{units[0] if linear else units[1]}]"

    lost = " + l" if steps.losses else ""
    equation = f"M nu_dot + h = B tau{lost}"
    yield f"{comment(robot.name)}: {equation}, with M of composite bodies, h of Newton and Euler."
    yield f"M ({robot.dof} x {robot.dof}) and B ({robot.dof} x {len(robot.actuators)}) row by row."
    yield "SI units; gravity is 9.81 m/s2 along -z. v (forward) or vx, vy, and omega are speeds of"
    yield "the base in its own axes; nothing depends on its place, nor on angles not listed."
    yield ""
    yield from listed("q", steps.positions, ("m", "rad"))
    yield from listed("nu", robot.quasi_velocities, ("m/s", "rad/s"))
    yield from listed("tau", robot.actuators, ("N", "N m"))


def _written(steps: ScalarProgram, language: Language) -> Written:
    """Return the assignments of named steps, and the text of any node after them."""
    wanted = [node for row in (*steps.M, *steps.B) for node in row]
    return write_steps(steps.nodes, [*wanted, *steps.h], language)


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
    lines = ["/*", *(f" * {line}".rstrip() for line in _law_header(program)), " */"]
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
    given, value = _law_written(program, language)
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
    lines = ['"""', *_law_header(program), '"""', "", _imported(program.nodes), "", ""]
    lines += [f"def {name}_law(pose, q, nu, r):", '    """Return tau, nu_d and nu_d_dot."""']
    if any(node[0] == "input" and "direction" in node[1] for node in program.nodes):
        lines.append("    direction = ((0.0,) * 3,) * 3 if r.direction is None else r.direction")
    lines += [f"    {symbol} = {value}" for symbol, value, _ in _settings(program)]
    given, value = _law_written(program, PYTHON)
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


def _law_written(program: LawProgram, language: Language) -> Written:
    wanted = [*program.tau, *program.nu_d, *program.nu_d_dot]
    return write_steps(program.nodes, wanted, language, program.named, "t")


def _settings(program: LawProgram) -> Iterator[tuple[str, str, str]]:
    """Yield the constants that the steps read: name, value, and a comment of C."""
    read = {node[1] for node in program.nodes if node[0] == "input"}
    for setting in program.law.settings:
        if str(setting.symbol) in read:
            what = comment(setting.of) + (f" [{setting.unit}]" if setting.unit else "")
            yield str(setting.symbol), repr(setting.value), f" /* {what} */"


def _unused(program: LawProgram) -> list[str]:
    texts = {node[1].partition("[")[0].partition("-")[0] for node in program.nodes
             if node[0] == "input"}  # fmt: skip
    texts |= {node[0] for node in program.nodes}
    return [name for name in ("pose", "q", "nu", "r") if name not in texts]


def _law_header(program: LawProgram) -> Iterator[str]:
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
    for k, name in enumerate(robot.quasi_velocities):
        yield f"  nu[{k}]  {comment(name)}  [{law.inputs[k].unit}]"
    yield "  r  the reference at this time; SI units, in the order of nu where it is the arm's"
    for k, name in enumerate(robot.actuators):
        yield f"  tau[{k}]  {comment(name)}  [{'N' if name in slides else 'N m'}]"
