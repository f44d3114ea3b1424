"""Scalar steps read from CasADi's graphs, each once: a robot's of any size, as C or Python."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import casadi

from rpctl.derive.equations import position_symbols
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot


@dataclass(frozen=True)
class ScalarProgram:
    """Steps that compute M, h and B; every step is a node, no two are the same.

    Attributes:
        positions: Joints whose positions the results depend on, and every joint of the arm.
        nodes: See :class:`Steps`; operands before what needs them.
        terms: Nodes of M (dof, dof), h (dof,) and B (dof, n_act), row by row, one after the other.
        loss_nodes: Steps of the losses ℓ alone, as ``nodes``.
        losses: Of these, the node of each entry (dof,); none where nothing is lost.
    """

    positions: tuple[str, ...]
    nodes: tuple[Node, ...]
    terms: tuple[int, ...]
    loss_nodes: tuple[Node, ...] = ()
    losses: tuple[int, ...] = ()


def program(robot: Robot) -> ScalarProgram:
    """List the steps of M ν̇ + h = B τ + ℓ; the angle of a round wheel is in none of them."""
    dynamics, places = SymbolicDynamics(robot), joint_symbols(robot)
    q, nu = symbolic_configuration(robot, places), casadi.SX.sym("nu", robot.dof)
    parts = dynamics.inertia(q), dynamics.bias(q, nu), dynamics.at(q).B.T
    terms = casadi.cse(casadi.vertcat(*(casadi.vec(casadi.densify(part)) for part in parts)))
    losses = casadi.cse(casadi.densify(dynamics.losses(q, nu)))
    read = {symbol.name() for symbol in casadi.symvar(casadi.vertcat(terms, losses))}
    positions = joints_of_code(robot, {name for name in places if places[name].name() in read})
    read_q = casadi.vertcat(*(places[name] for name in positions), casadi.SX(0, 1))
    inputs = {"q": read_q, "nu": nu}
    lost = steps_of(inputs, losses) if dynamics.lossy else ((), ())
    return ScalarProgram(positions, *steps_of(inputs, terms), *lost)


def steps_of(inputs: Mapping[str, Any], outputs: Any) -> tuple[tuple[Node, ...], tuple[int, ...]]:
    """Return steps from columns of symbols, by what code calls them, to a column, and its nodes."""
    steps, given = Steps(), [*inputs.values()]
    leaves = [lambda i, x=x: steps.add("input", f"{x}[{i}]") for x in inputs]
    found = steps.evaluate(casadi.Function("terms", given, [outputs]), leaves)
    return tuple(steps.nodes), tuple(found)


def joint_symbols(robot: Robot) -> dict[str, Any]:
    """Return a symbol for the position of each joint that is neither locked nor a mimic."""
    return {name: casadi.SX.sym(str(symbol)) for name, symbol in position_symbols(robot).items()}


def symbolic_configuration(robot: Robot, places: Mapping[str, Any]) -> Any:
    """Return q (nq, 1) at positions; the base, on whose place nothing depends, is at the origin."""
    q = casadi.SX.zeros(robot.nq, 1)
    q[2] = 1.0
    known = {**robot.locked, **places}
    mimics = {joint.name: joint.mimic for joint in robot.mimics}
    for name, entry in robot.entries.items():
        mimic = mimics.get(name)
        position = casadi.SX(
            known[name] if mimic is None else mimic.multiplier * known[mimic.joint] + mimic.offset
        )
        if entry.is_pair:
            q[entry.index], q[entry.index + 1] = casadi.cos(position), casadi.sin(position)
        else:
            q[entry.index] = position
    return q


def joints_of_code(robot: Robot, read: set[str]) -> tuple[str, ...]:
    """Return the joints whose positions code takes: those it reads and all of the arm.

    The actuated ones come first.
    """
    order = dict.fromkeys((*robot.actuators, *robot.moving_joint_names))
    return tuple(name for name in order if name in read or name in robot.joint_names)


Node = tuple[Any, ...]  # (operation, operands): indices of nodes, a number, or an input's place

FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log", "pow",
    "sinh", "cosh", "tanh", "floor", "ceil", "fabs",
)  # fmt: skip
OPERATIONS = {  # of CasADi, that have a node of their own
    casadi.OP_ADD: "+", casadi.OP_SUB: "-", casadi.OP_MUL: "*", casadi.OP_DIV: "/",
    casadi.OP_NEG: "-", casadi.OP_LT: "<", casadi.OP_LE: "<=", casadi.OP_EQ: "==",
    casadi.OP_NE: "!=", casadi.OP_AND: "&&", casadi.OP_OR: "||", casadi.OP_NOT: "!",
    casadi.OP_CONSTPOW: "pow", **{getattr(casadi, f"OP_{x.upper()}"): x for x in FUNCTIONS},
}  # fmt: skip
LEAVES = ("number", "input")  # nodes without operands
MAX_INLINE = 60  # characters; a longer expression gets a line of its own
# How firmly an expression holds together: choices, and, or, comparisons, sums, products, the rest.
CHOICE_PRECEDENCE, LOGIC_PRECEDENCE, COMPARISON_PRECEDENCE = range(3)
SUM_PRECEDENCE, PRODUCT_PRECEDENCE, ATOM_PRECEDENCE = range(3, 6)


PRECEDENCES = dict.fromkeys(("&&", "||"), LOGIC_PRECEDENCE)
PRECEDENCES |= dict.fromkeys(("<", "<=", "==", "!=", "!"), COMPARISON_PRECEDENCE)
PRECEDENCES |= {"+": SUM_PRECEDENCE, "-": SUM_PRECEDENCE}
PRECEDENCES |= {"*": PRODUCT_PRECEDENCE, "/": PRODUCT_PRECEDENCE}


@dataclass(frozen=True)
class Language:
    """How a language writes what the languages write differently.

    Attributes:
        choice: A choice between two values by a condition, of ``{test}``, ``{yes}``, ``{no}``.
        words: How it writes an operator, where that is another than its node's.
        suffix: What ends a number with a point, and the name of a function.
    """

    choice: str
    words: Mapping[str, str]
    suffix: str = ""


C = Language("{test} ? {yes} : {no}", {})
C_FLOAT = Language(C.choice, {}, "f")
PYTHON = Language("{yes} if {test} else {no}", {"&&": "and", "||": "or", "!": "not "})


@dataclass
class Steps:
    """Steps of a computation, of which no two are the same.

    Attributes:
        nodes: ``("input", text)``, ``("number", value)``; then
            ``(operation, operands…)`` with ``"+" "-" "*" "/"`` of two or ``"-"`` of one, a function
            of :data:`FUNCTIONS`, a comparison, ``"&&" "||" "!"``, or ``"?"`` with a condition and
            the two to choose from.
    """

    nodes: list[Node] = field(default_factory=list)
    _known: dict[Node, int] = field(default_factory=dict)

    def add(self, *key: Any) -> int:
        """Return the index of a node, a new one where there is none."""
        if key[0] in ("+", "*"):
            key = (key[0], *sorted(key[1:]))
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append(key)
        return self._known[key]

    def evaluate(self, function: Any, inputs: Sequence[Callable[[int], int]]) -> list[int]:
        """Add the steps of a CasADi function and return the nodes of its dense output.

        Args:
            function: A function of vectors with one vector as its output.
            inputs: For each of its inputs, the node of an entry; asked for those that are read.
        """
        slots: dict[int, int] = {}
        outputs = [self.add("number", 0.0)] * function.numel_out(0)
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            read, (out, *_) = function.instruction_input(k), function.instruction_output(k) or [0]
            if operation == casadi.OP_OUTPUT:
                outputs[function.instruction_output(k)[1]] = slots[read[0]]
            elif operation == casadi.OP_INPUT:
                slots[out] = inputs[read[0]](read[1])
            elif operation == casadi.OP_CONST:
                slots[out] = self.add("number", float(function.instruction_constant(k)) + 0.0)
            else:
                slots[out] = self._operation(operation, [slots[i] for i in read])
        return outputs

    def _operation(self, operation: int, operands: list[int]) -> int:
        """Return the node of one of CasADi's operations, in the few that code is written with."""
        a, b = operands[0], operands[-1]
        zero, one = self.add("number", 0.0), self.add("number", 1.0)
        if operation == casadi.OP_ADD and (whole := self._choice(a, b)) is not None:
            return whole
        if operation in OPERATIONS:
            return self.add(OPERATIONS[operation], *operands)
        if operation not in OTHERS:
            names = {getattr(casadi, name): name[3:] for name in dir(casadi) if name[:3] == "OP_"}
            raise RpctlError(
                f"a formula has the operation {names[operation]}, which code is not written with"
            )
        return OTHERS[operation](self, a, b, zero, one)

    def _choice(self, a: int, b: int) -> int | None:
        """Return the choice that two sums of a choice and 0 are together; None if they are none."""
        (kind, *first), (other, *second), zero = self.nodes[a], self.nodes[b], ("number", 0.0)
        if kind != "?" or other != "?" or first[0] != second[0]:
            return None
        for (test, yes, no), (_, yes_too, no_too) in ((first, second), (second, first)):
            if self.nodes[no] == zero and self.nodes[yes_too] == zero:
                return self.add("?", test, yes, no_too)
        return None


def _selected(steps: Steps, test: int, value: int, zero: int, _: int) -> int:
    """Return the choice of a value where a test holds, else 0."""
    if steps.nodes[test][0] == "!":
        return steps.add("?", steps.nodes[test][1], zero, value)
    return steps.add("?", test, value, zero)


def _sign(steps: Steps, a: int, b: int, zero: int, one: int) -> int:
    below = steps.add("?", steps.add("<", a, zero), steps.add("number", -1.0), zero)
    return steps.add("?", steps.add("<", zero, a), one, below)


OTHERS: dict[int, Callable[[Steps, int, int, int, int], int]] = {
    casadi.OP_IF_ELSE_ZERO: _selected,
    casadi.OP_SIGN: _sign,
    casadi.OP_SQ: lambda steps, a, *_: steps.add("*", a, a),
    casadi.OP_TWICE: lambda steps, a, *_: steps.add("*", steps.add("number", 2.0), a),
    casadi.OP_INV: lambda steps, a, b, zero, one: steps.add("/", one, a),
    casadi.OP_FMIN: lambda steps, a, b, *_: steps.add("?", steps.add("<", a, b), a, b),
    casadi.OP_FMAX: lambda steps, a, b, *_: steps.add("?", steps.add("<", a, b), b, a),
}


def write_steps(
    nodes: Sequence[Node],
    wanted: Iterable[int],
    language: Language,
    named: Mapping[int, str] | None = None,
    letter: str = "x",
) -> tuple[list[tuple[str, str]], Callable[[int], str]]:
    """Return the assignments of named steps, and the text of any node after them.

    What is used once and short is written where it is used.

    Args:
        nodes: The steps.
        wanted: Nodes of the results.
        language: What to write.
        named: Names of some nodes, which are assigned in any case.
        letter: Of the names of the others, numbered.
    """
    uses = Counter(a for node in nodes for a in operands(node))
    uses.update(wanted)
    names = named or {}
    texts: list[tuple[str, int]] = []
    given: list[tuple[str, str]] = []
    numbered = 0
    for k, node in enumerate(nodes):
        text, precedence = _text(node, texts, language)
        leaf = node[0] in LEAVES
        if k in names or (not leaf and (uses[k] > 1 or len(text) > MAX_INLINE)):
            given.append((names.get(k, f"{letter}{numbered}"), text))
            numbered += k not in names
            text, precedence = given[-1][0], ATOM_PRECEDENCE
        texts.append((text, precedence))
    return given, lambda node: texts[node][0]


def operands(node: Node) -> tuple[int, ...]:
    """Return the nodes that a node needs."""
    return () if node[0] in LEAVES else tuple(node[1:])


def _text(node: Node, texts: Sequence[tuple[str, int]], language: Language) -> tuple[str, int]:
    """Return a node's expression and how firmly it holds together.

    A sum or product on the right keeps its parentheses, so that rounding is the same everywhere.
    """
    kind, held = node[0], node[1:]
    if kind == "number":
        precedence = ATOM_PRECEDENCE if held[0] >= 0.0 else SUM_PRECEDENCE
        return f"{held[0]!r}{language.suffix}", precedence
    if kind == "input":
        return held[0], ATOM_PRECEDENCE
    if kind in FUNCTIONS:
        arguments = ", ".join(texts[a][0] for a in held)
        return f"{kind}{language.suffix}({arguments})", ATOM_PRECEDENCE
    if kind == "?":
        parts = [_parenthesised(texts[a], LOGIC_PRECEDENCE) for a in held]
        return language.choice.format(test=parts[0], yes=parts[1], no=parts[2]), CHOICE_PRECEDENCE
    word, precedence = language.words.get(kind, kind), PRECEDENCES[kind]
    if len(held) == 1:
        return f"{word}{_parenthesised(texts[held[0]], ATOM_PRECEDENCE)}", precedence
    first = _parenthesised(texts[held[0]], precedence + (precedence < SUM_PRECEDENCE))
    return f"{first} {word} {_parenthesised(texts[held[1]], precedence + 1)}", precedence


def _parenthesised(expression: tuple[str, int], needed: int) -> str:
    text, precedence = expression
    return text if precedence >= needed else f"({text})"


@dataclass(frozen=True)
class Operations:
    """Worst-case operation counts of a straight piece of code: each step is taken once."""

    additions: int  # and subtractions, changes of sign
    multiplications: int
    divisions: int
    roots: int
    functions: int  # sines, cosines, and what else the mathematics library computes
    choices: int  # a comparison, then one of two values

    @property
    def total(self) -> int:
        """All of them."""
        return sum(asdict(self).values())

    def __str__(self) -> str:
        """Return the counts in words."""
        parts = (f"{count} {name}" for name, count in asdict(self).items())
        return f"{self.total} operations: {', '.join(parts)}"


def count_operations(nodes: Iterable[Node]) -> Operations:
    """Return how many operations steps take."""
    kinds = Counter(node[0] for node in nodes if node[0] not in LEAVES)
    return Operations(
        additions=kinds["+"] + kinds["-"],
        multiplications=kinds["*"],
        divisions=kinds["/"],
        roots=kinds["sqrt"],
        functions=sum(kinds[name] for name in FUNCTIONS if name != "sqrt"),
        choices=kinds["?"],
    )


def without_idle(nodes: Sequence[Node], wanted: Sequence[int]) -> tuple[list[Node], dict[int, int]]:
    """Return the nodes that results depend on, and where each of them is now."""
    needed = set(wanted)
    for k in reversed(range(len(nodes))):
        if k in needed:
            needed.update(operands(nodes[k]))
    place = {old: new for new, old in enumerate(sorted(needed))}
    inner = {old: tuple(place[a] for a in operands(nodes[old])) for old in place}
    return [(nodes[old][0], *inner[old]) if inner[old] else nodes[old] for old in place], place
