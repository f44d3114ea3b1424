"""Scalar steps, each once: how C and Python write them, and how SymPy's expressions become them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import casadi
import sympy as sp

from rpctl.derive.law_sheet import Choice

Node = tuple[Any, ...]  # (operation, operands): indices of nodes, a number, or an input's place
Written = tuple[list[tuple[str, str]], Callable[[int], str]]

INFIX = {casadi.OP_ADD: "+", casadi.OP_SUB: "-", casadi.OP_MUL: "*", casadi.OP_DIV: "/"}
CALLS = {casadi.OP_SIN: "sin", casadi.OP_COS: "cos", casadi.OP_SQRT: "sqrt"}
FUNCTIONS = ("sin", "cos", "sqrt", "tanh", "asin", "atan2", "ceil", "floor", "fabs")
LEAVES = ("q", "nu", "number", "input")  # nodes without operands
MAX_INLINE = 60  # characters; a longer expression gets a line of its own
# How firmly an expression holds together: choices, sums, products, the rest.
CHOICE_PRECEDENCE, SUM_PRECEDENCE, PRODUCT_PRECEDENCE, ATOM_PRECEDENCE = range(4)


@dataclass(frozen=True)
class Language:
    """How a language writes what the languages write differently.

    Attributes:
        choice: A choice between two values by a condition, of ``{test}``, ``{yes}``, ``{no}``.
        suffix: What ends a number with a point, and the name of a function.
    """

    choice: str
    suffix: str = ""


C = Language("{test} ? {yes} : {no}")
C_FLOAT = Language(C.choice, "f")
PYTHON = Language("{yes} if {test} else {no}")


@dataclass
class Steps:
    """Steps of a computation, of which no two are the same.

    Attributes:
        nodes: ``("q", i)``, ``("nu", i)``, ``("input", text)``, ``("number", value)``; then
            ``(operation, operands…)`` with ``"+" "-" "*" "/"`` of two or ``"-"`` of one, a function
            of :data:`FUNCTIONS`, or ``"<"`` with two to compare and the two to choose from.
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
        a = operands[0]
        if operation in INFIX:
            return self.add(INFIX[operation], *operands)
        if operation in CALLS:
            return self.add(CALLS[operation], a)
        if operation == casadi.OP_NEG:
            return self.add("-", a)
        if operation == casadi.OP_SQ:
            return self.add("*", a, a)
        if operation == casadi.OP_TWICE:
            return self.add("*", self.add("number", 2.0), a)
        if operation == casadi.OP_INV:
            return self.add("/", self.add("number", 1.0), a)
        raise AssertionError(f"the recursion has no CasADi operation {operation}")


def write_steps(
    nodes: Sequence[Node],
    wanted: Iterable[int],
    language: Language,
    named: Mapping[int, str] | None = None,
    letter: str = "x",
) -> Written:
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
    if kind in ("q", "nu"):
        return f"{kind}[{held[0]}]", ATOM_PRECEDENCE
    if kind == "input":
        return held[0], ATOM_PRECEDENCE
    if kind == "number":
        return (
            f"{held[0]!r}{language.suffix}",
            ATOM_PRECEDENCE if held[0] >= 0.0 else SUM_PRECEDENCE,
        )
    if kind in FUNCTIONS:
        arguments = ", ".join(texts[a][0] for a in held)
        return f"{kind}{language.suffix}({arguments})", ATOM_PRECEDENCE
    if kind == "<":
        parts = [_parenthesised(texts[a], SUM_PRECEDENCE) for a in held]
        test = f"{parts[0]} < {parts[1]}"
        return language.choice.format(test=test, yes=parts[2], no=parts[3]), CHOICE_PRECEDENCE
    if len(held) == 1:
        return f"-{_parenthesised(texts[held[0]], ATOM_PRECEDENCE)}", SUM_PRECEDENCE
    precedence = SUM_PRECEDENCE if kind in "+-" else PRODUCT_PRECEDENCE
    left, right = (texts[a] for a in held)
    return (
        f"{_parenthesised(left, precedence)} {kind} {_parenthesised(right, precedence + 1)}",
        precedence,
    )


def _parenthesised(expression: tuple[str, int], needed: int) -> str:
    text, precedence = expression
    return text if precedence >= needed else f"({text})"


SYMPY_CALLS = {sp.sin: "sin", sp.cos: "cos", sp.tanh: "tanh", sp.ceiling: "ceil", sp.asin: "asin",
         sp.atan2: "atan2", sp.Abs: "fabs"}  # fmt: skip


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
        choices=kinds["<"],
    )


class Translator:
    """Adds SymPy's expressions to steps.

    Args:
        steps: Where to add.
    """

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        self.known: dict[sp.Expr, int] = {}

    def node(self, expression: sp.Expr) -> int:
        """Return the node of an expression whose symbols are known."""
        if expression not in self.known:
            self.known[expression] = self._node(expression)
        return self.known[expression]

    def number(self, value: float) -> int:
        """Return the node of a number."""
        return self.steps.add("number", float(value) + 0.0)

    def _node(self, x: sp.Expr) -> int:
        if x.is_number and not x.is_Function:
            return self.number(float(x))
        if x.is_Add:
            return self._sum(x)
        if x.is_Mul:
            return self._product(x)
        if x.is_Pow:
            return self._power(x.base, x.exp)
        if isinstance(x, Choice):
            return self.steps.add("<", *map(self.node, x.args))
        return self.steps.add(SYMPY_CALLS[x.func], *map(self.node, x.args))

    def _sum(self, x: sp.Expr) -> int:
        terms = [(term, bool(term.as_coeff_Mul()[0].is_negative)) for term in x.args]
        terms.sort(key=lambda pair: pair[1])  # those that are added come first
        first, negative = terms[0]
        total = self.node(first)
        for term, negative in terms[1:]:
            if negative:
                total = self.steps.add("-", total, self.node(-term))
            else:
                total = self.steps.add("+", total, self.node(term))
        return total

    def _product(self, x: sp.Expr) -> int:
        coefficient, rest = x.as_coeff_Mul()
        above, below = [], []
        for factor in sp.Mul.make_args(rest):
            if factor.is_Pow and factor.exp.could_extract_minus_sign():
                below.append(self._power(factor.base, -factor.exp))
            elif factor != 1:
                above.append(self.node(factor))
        size = abs(coefficient)
        if size != 1 or not above:
            above.insert(0, self.number(float(size)))
        product = self._multiplied(above)
        if below:
            product = self.steps.add("/", product, self._multiplied(below))
        return self.steps.add("-", product) if coefficient.is_negative else product

    def _multiplied(self, factors: Sequence[int]) -> int:
        product = factors[0]
        for factor in factors[1:]:
            product = self.steps.add("*", product, factor)
        return product

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> int:
        if exponent.could_extract_minus_sign():
            return self.steps.add("/", self.number(1.0), self._power(base, -exponent))
        whole, half = divmod(exponent, 1)
        assert half in (0, sp.Rational(1, 2)), f"no steps for the power {exponent}"
        factors = [self.node(base)] * int(whole)
        if half:
            factors.append(self.steps.add("sqrt", self.node(base)))
        return self._multiplied(factors)


def without_idle(nodes: Sequence[Node], wanted: Sequence[int]) -> tuple[list[Node], dict[int, int]]:
    """Return the nodes that results depend on, and where each of them is now."""
    needed, stack = set(wanted), list(wanted)
    while stack:
        for operand in operands(nodes[stack.pop()]):
            if operand not in needed:
                needed.add(operand)
                stack.append(operand)
    place = {old: new for new, old in enumerate(sorted(needed))}
    kept = []
    for old in place:
        node = nodes[old]
        leaf = node[0] in LEAVES
        kept.append(node if leaf else (node[0], *(place[a] for a in node[1:])))
    return kept, place
