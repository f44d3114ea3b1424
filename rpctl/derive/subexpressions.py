"""Expressions that stand for sums by symbols: which sums are put in place, which get a name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

import sympy as sp

MAX_FRACTION_TERM = 10**5  # a fraction of larger numbers is written as a decimal
DECIMALS = 13
DIGIT_COST = 0.05  # of an operation; 2 rho**2 + 21/50 is easier to read than (100 rho**2 + 21)/50
CACHE_SIZE = 10_000  # expressions; most stay the same while one name is tried after another
MIN_GAIN = (
    1.5  # operations that taking a factor out must save; terms in their own right read better
)

Bodies = dict[sp.Symbol, sp.Expr]  # what each stand-in stands for, in terms of others


def operations(expressions: Iterable[sp.Expr]) -> int:
    """Return the number of operations in expressions."""
    return sum(int(sp.count_ops(expression)) for expression in expressions)


def readable(expression: sp.Expr) -> sp.Expr:
    """Return an expression with fractions of large numbers as decimals."""
    large = (x for x in expression.atoms(sp.Rational) if max(abs(x.p), x.q) >= MAX_FRACTION_TERM)
    return expression.xreplace({x: sp.Float(x, DECIMALS) for x in large})


def _effort(expressions: Iterable[sp.Expr]) -> float:
    """Return the number of operations, and a little for every digit, as they will be written."""
    return sum(_effort_of(expression) for expression in expressions)


@lru_cache(maxsize=CACHE_SIZE)
def _effort_of(expression: sp.Expr) -> float:
    shown = readable(expression)
    numbers = (x for x in sp.preorder_traversal(shown) if x.is_Number)
    return operations([shown]) + DIGIT_COST * sum(len(_written(x)) for x in numbers)


def _written(number: sp.Expr) -> str:
    return f"{number.p}{number.q}" if number.is_Rational else f"{float(number):.{DECIMALS}g}"


def settle(entries: Sequence[sp.Expr], bodies: Bodies) -> tuple[list[sp.Expr], Bodies]:
    """Put sums that occur once in their place, and scale the others so that little is to write.

    Returns:
        The expressions, and what the stand-ins left in them mean, each after those in it.
    """
    entries, bodies = _in_place(list(entries), bodies)
    entries = [spread(entry) for entry in entries]
    bodies = {symbol: spread(body) for symbol, body in bodies.items()}
    for symbol in reversed(bodies):  # outer sums first: their scale decides that of the inner
        entries, bodies = _scaled(symbol, entries, bodies)
    return [gathered(x) for x in entries], {s: gathered(x) for s, x in bodies.items()}


def _in_place(entries: list[sp.Expr], bodies: Bodies) -> tuple[list[sp.Expr], Bodies]:
    while True:
        reached = _reachable(entries, bodies)
        bodies = {symbol: bodies[symbol] for symbol in reached}
        written = (*dict.fromkeys(entries), *bodies.values())  # equal entries are written once
        uses = Counter(s for x in written for s in sp.preorder_traversal(x) if s.is_Symbol)
        single = next((symbol for symbol in reached if uses[symbol] == 1), None)
        if single is None:
            return entries, bodies
        entries, bodies = _put(single, bodies.pop(single), entries, bodies)


def _scaled(
    symbol: sp.Symbol, entries: list[sp.Expr], bodies: Bodies
) -> tuple[list[sp.Expr], Bodies]:
    """Let a stand-in mean the multiple of its sum that makes everything shortest."""
    factors = {sp.S.One}
    for expression in (*entries, *bodies.values()):
        products = (x for x in sp.preorder_traversal(expression) if x.is_Mul and x.has(symbol))
        factors |= {abs(product.as_coeff_Mul()[0]) for product in products}
    best, least = (entries, bodies), _effort((*entries, *bodies.values()))
    for factor in sorted(factors):
        new, others = _put(symbol, symbol / factor, entries, bodies)
        others[symbol] = spread(sp.expand_mul(factor * bodies[symbol], deep=False))
        new, others = [spread(x) for x in new], {s: spread(x) for s, x in others.items()}
        cost = _effort((*new, *others.values()))
        if cost < least:
            best, least = (new, others), cost
    return best


def _put(
    symbol: sp.Symbol, value: sp.Expr, entries: list[sp.Expr], bodies: Bodies
) -> tuple[list[sp.Expr], Bodies]:
    put = {symbol: value}
    return [x.xreplace(put) for x in entries], {s: x.xreplace(put) for s, x in bodies.items()}


def _reachable(entries: Sequence[sp.Expr], bodies: Mapping[sp.Symbol, sp.Expr]) -> list[sp.Symbol]:
    """Return the stand-ins that expressions need, each after those that it needs itself."""
    order: dict[sp.Symbol, None] = {}

    def visit(expression: sp.Expr) -> None:
        for symbol in sorted(expression.free_symbols & bodies.keys(), key=str):
            if symbol not in order:
                visit(bodies[symbol])
                order[symbol] = None

    for entry in entries:
        visit(entry)
    return list(order)


@lru_cache(maxsize=CACHE_SIZE)
def spread(expression: sp.Expr) -> sp.Expr:
    """Return an expression with numbers moved into sums where that takes fewer operations."""
    return expression.replace(lambda x: x.is_Mul, _spread_product)


def _spread_product(product: sp.Expr) -> sp.Expr:
    number, rest = product.as_coeff_Mul()
    if number in (1, -1):
        return product
    choices = [product]
    for total in (factor for factor in sp.Mul.make_args(rest) if factor.is_Add):
        for share in {number, abs(number), sp.Rational(1, number.q)} if number.is_Rational else ():
            spread_out = sp.Add(*(share * term for term in total.args))
            choices.append(number / share * (rest / total) * spread_out)
    return min(choices, key=lambda choice: _effort([choice]))


def gathered(expression: sp.Expr) -> sp.Expr:
    """Return an expression with factors that some terms of a sum share taken out of them."""
    return expression.replace(lambda x: x.is_Add, _gathered_sum)


def _gathered_sum(total: sp.Expr) -> sp.Expr:
    """Take out one factor after another, always the one that saves most."""
    while total.is_Add:
        powers = {term: term.as_powers_dict() for term in total.args}
        choices = [total]
        for symbol in sorted({s for held in powers.values() for s in held if s.is_Symbol}, key=str):
            group = [term for term in total.args if powers[term][symbol] > 0]
            if len(group) < 2:
                continue
            shared = [s for s in powers[group[0]] if s.is_Symbol]
            common = sp.Mul(*(s ** min(powers[t][s] for t in group if t) for s in shared))
            rest = sp.Add(*(term for term in total.args if term not in group))
            choices.append(common * sp.Add(*(term / common for term in group)) + rest)
        best = min(choices, key=lambda choice: _effort([choice]))
        if _effort([best]) + MIN_GAIN > _effort([total]):
            break
        total = best
    return total
