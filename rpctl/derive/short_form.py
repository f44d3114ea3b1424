"""Polynomials written as short expressions: common factors out, recurring sums named."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, count

import sympy as sp

from rpctl.derive.polynomial import Poly, primitive, without_common_term
from rpctl.derive.substitution import EquationForm

MAX_WRITING_COST = 200_000  # sum of squared numbers of terms, with which the time to write grows

Definition = tuple[sp.Symbol, sp.Expr]


@dataclass(frozen=True)
class ShortForm:
    """Expressions, and the definitions of the names in them, each in terms of those before."""

    entries: tuple[sp.Expr, ...]
    definitions: tuple[Definition, ...]


def shortest_form(forms: Iterable[EquationForm]) -> ShortForm:
    """Return M's upper triangle and h in the fewest operations that forms and layouts give.

    Of long forms only the first few are tried, few terms first.
    """
    choices = [
        (form, order)
        for form in sorted(forms, key=lambda form: form.size)
        for order in (
            (form.rates, form.angles, form.lengths),
            (form.rates, form.lengths, form.angles),
            (form.angles, form.rates, form.lengths),
        )
    ]
    spent = accumulate(form.size**2 for form, _ in choices)
    tried = [
        choice for choice, cost in zip(choices, spent, strict=True) if cost <= MAX_WRITING_COST
    ]
    results = (_Writer(form, order).all() for form, order in tried or choices[:1])
    return min(results, key=lambda x: operations((*x.entries, *(v for _, v in x.definitions))))


class _Writer:
    """Writes with one order of variables, outermost first.

    Every sum of terms without a common factor stands as a symbol at first; at the end those that
    occur once are put in place, and the others get a name.
    """

    def __init__(self, form: EquationForm, order: Sequence[Sequence[sp.Symbol]]) -> None:
        self._form = form
        self._ring = form.space.ring
        self._levels = [frozenset(form.space.index[symbol] for symbol in x) for x in order]
        self._sums: dict[Poly, sp.Symbol] = {}
        self._bodies: dict[sp.Symbol, sp.Expr] = {}

    def all(self) -> ShortForm:
        """Write the whole form."""
        inertia = self._inertia(self._form.M)
        entries, named = self._named([*inertia, *(self._write(poly) for poly in self._form.h)])
        used = set().union(*(x.free_symbols for x in (*entries, *(v for _, v in named))))
        kept = []
        for symbol, value in reversed(self._form.definitions):
            if symbol in used:
                kept.append((symbol, value))
                used |= value.free_symbols
        return ShortForm(tuple(entries), (*reversed(kept), *named))

    def _inertia(self, polys: Sequence[Poly]) -> list[sp.Expr]:
        """Write entries of M, each as another plus the rest where that is shorter.

        A composite inertia recurs so: M33 in M23 and M22 of a serial arm.
        """
        expressions: dict[Poly, sp.Expr] = {}
        for poly in sorted(dict.fromkeys(polys), key=len):
            best = direct = self._write(poly)
            cost = self._cost(direct)
            for base in [base for base in expressions if len(base) > 1]:
                rest = self._write(poly - base)
                if 1 + self._cost(rest) < cost:
                    best, cost = expressions[base] + rest, 1 + self._cost(rest)
            if best is not direct:  # wherever the sum occurs, it is written so
                (stand_in,) = direct.free_symbols & self._bodies.keys()
                self._bodies[stand_in] = best / (direct / stand_in)
                best = direct
            expressions[poly] = best
        return [expressions[poly] for poly in polys]

    def _cost(self, expression: sp.Expr) -> int:
        return operations([self._expanded(expression)])

    def _expanded(self, expression: sp.Expr) -> sp.Expr:
        inner = expression.free_symbols & self._bodies.keys()
        if not inner:
            return expression
        return expression.xreplace({s: self._expanded(self._bodies[s]) for s in inner})

    def _primitive(self, poly: Poly) -> tuple[sp.Expr, Poly]:
        """Return a polynomial's one-term factor, as an expression, and the rest of it."""
        if not poly:
            return sp.S.Zero, self._ring.one
        content, rest = primitive(poly)
        powers, rest = without_common_term(rest)
        term = self._ring.term_new(powers, content)
        return self._form.space.expression(term, self._form.shown), rest

    def _write(self, poly: Poly) -> sp.Expr:
        head, rest = self._primitive(poly)
        if rest == 1 or not poly:
            return head
        if rest not in self._sums:
            body = self._sum(rest)
            self._sums[rest] = sp.Dummy(f"s{len(self._sums)}")
            self._bodies[self._sums[rest]] = body
        return head * self._sums[rest]

    def _sum(self, poly: Poly) -> sp.Expr:
        """Write a sum by the outermost variables in it, like coefficients together."""
        for level in self._levels:
            outer = {tuple(p if i in level else 0 for i, p in enumerate(m)) for m in poly}
            if len(outer) > 1:
                break
        else:
            return self._form.space.expression(poly, self._form.shown)
        coefficients: dict[tuple[int, ...], Poly] = defaultdict(lambda: self._ring.zero)
        for powers, coefficient in poly.items():
            out = tuple(p if i in level else 0 for i, p in enumerate(powers))
            rest = tuple(0 if i in level else p for i, p in enumerate(powers))
            coefficients[out] = coefficients[out] + self._ring.term_new(rest, coefficient)
        alike: dict[Poly, Poly] = defaultdict(lambda: self._ring.zero)
        for out, inner in coefficients.items():
            content, rest = primitive(inner)
            alike[rest] = alike[rest] + self._ring.term_new(out, content)
        return sp.Add(*(self._product(outer, inner) for inner, outer in alike.items()))

    def _product(self, outer: Poly, inner: Poly) -> sp.Expr:
        if inner == 1:  # a plain sum: nothing to share
            return self._form.space.expression(outer, self._form.shown)
        return self._write(outer) * self._write(inner)

    def _named(self, entries: list[sp.Expr]) -> tuple[list[sp.Expr], list[Definition]]:
        """Name the sums that occur more than once."""
        entries, bodies = settle(entries, self._bodies)
        polys = {symbol: poly for poly, symbol in self._sums.items()}
        counters = {letter: count(1) for letter in "Jpku"}
        letters = {symbol: self._letter(polys[symbol]) for symbol in bodies}
        names = {
            symbol: sp.Symbol(f"{letter}{next(counters[letter])}", real=True)
            for symbol, letter in letters.items()
        }
        named = [(names[symbol], body.xreplace(names)) for symbol, body in bodies.items()]
        return [entry.xreplace(names) for entry in entries], named

    def _letter(self, poly: Poly) -> str:
        """Return J for an inertia, p for another function of positions, k for a constant."""
        index = self._form.space.index
        degree = {s: max(m[index[s]] for m in poly) for s in (*self._form.lengths,)}
        if any(m[index[rate]] for m in poly for rate in self._form.rates):
            return "u"
        if any(power > 1 for power in degree.values()):
            return "J"
        used = any(m[index[s]] for m in poly for s in self._form.angles)
        return "p" if used or any(degree.values()) else "k"


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
    texts = (f"{x.p}{x.q}" if x.is_Rational else f"{float(x):.{DECIMALS}g}" for x in numbers)
    return operations([shown]) + DIGIT_COST * sum(map(len, texts))


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
