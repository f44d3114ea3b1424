"""SymPy's expressions as scalar steps, and how many operations steps take."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import sympy as sp

from rpctl.derive.law_sheet import Choice
from rpctl.derive.steps import FUNCTIONS, LEAVES, Node, Steps, operands

CALLS = {sp.sin: "sin", sp.cos: "cos", sp.tanh: "tanh", sp.ceiling: "ceil", sp.asin: "asin",
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
        return self.steps.add(CALLS[x.func], *map(self.node, x.args))

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
