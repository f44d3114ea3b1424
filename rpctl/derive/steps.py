"""Scalar steps, each once, and how C and Python write them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi

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
