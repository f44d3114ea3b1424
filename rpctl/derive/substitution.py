"""Changes of variables that make equations shorter: sums of rates, shifted lengths, angle sums."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy as sp

from rpctl.derive.equations import Angle, Equations
from rpctl.derive.polynomial import Poly, Space, primitive, without_common_term

MAX_FORMS = 6  # forms that are worth writing out to see which is shortest

Key = tuple[tuple[int, ...], bool]  # multiples of the angles, and whether of the sine


@dataclass(frozen=True)
class EquationForm:
    """Polynomials whose generators have got new meanings.

    Attributes:
        space: Where they live.
        M: Upper triangle, row by row.
        h: Entries (n,).
        shown: Symbol to write for a generator, where it is another.
        definitions: What those symbols are, each in terms of those before it.
        rates: Generators that are rates.
        angles: Generators that are cosines and sines.
        lengths: Generators that are positions of sliding joints.
    """

    space: Space
    M: tuple[Poly, ...]
    h: tuple[Poly, ...]
    shown: dict[sp.Symbol, sp.Symbol]
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...]
    rates: tuple[sp.Symbol, ...]
    angles: tuple[sp.Symbol, ...]
    lengths: tuple[sp.Symbol, ...]

    @property
    def size(self) -> int:
        """Number of terms."""
        return _size((*self.M, *self.h))


def candidate_forms(equations: Equations) -> list[EquationForm]:
    """Return the equations in rates and lengths that may make them short, few terms first."""
    n = len(equations.h)
    angles = equations.angles
    start = EquationForm(
        space=equations.space,
        M=tuple(equations.M[i][j] for i in range(n) for j in range(i, n)),
        h=equations.h,
        shown={},
        definitions=tuple(
            pair
            for angle in angles
            for pair in ((angle.cos, sp.cos(angle.value)), (angle.sin, sp.sin(angle.value)))
        ),
        rates=equations.rates,
        angles=tuple(symbol for angle in angles for symbol in (angle.cos, angle.sin)),
        lengths=equations.lengths,
    )
    forms = [_summed_rates(start, equations.angular_velocities)]
    for number, length in enumerate(equations.lengths, start=1):
        forms += [shifted for form in forms for shifted in _shifted(form, length, number)]
    return sorted(forms, key=lambda form: form.size)[:MAX_FORMS]


def _summed_rates(form: EquationForm, angular_velocities: Sequence[Poly]) -> EquationForm:
    """Write Ω for a sum of rates in an angular velocity, where that makes h shorter."""
    space, number = form.space, 0
    places = {space.index[rate]: rate for rate in form.rates}
    found = (s for turn in angular_velocities if (s := _plain_sum(turn, places)) is not None)
    sums = sorted(dict.fromkeys(found), key=len)  # in the same order in every process
    while sums:
        total = sums.pop(0)
        powers = max(total, key=lambda powers: powers.index(1))
        last, sign = powers.index(1), total[powers]
        if len(total) < 2 or places[last] in form.shown:
            continue
        x = space.ring.gens[last]
        instead = (x - (total - x * sign)) * sign
        h = tuple(poly.compose(x, instead) for poly in form.h)
        if _size(h) >= _size(form.h):
            continue
        number += 1
        symbol = sp.Symbol(f"Omega{number}", real=True)
        meaning = (symbol, space.expression(total, form.shown))
        shown = form.shown | {places[last]: symbol}
        form = replace(form, h=h, shown=shown, definitions=(*form.definitions, meaning))
        sums = [other.compose(x, instead) for other in sums]
    return form


def _plain_sum(turn: Poly, rates: Iterable[int]) -> Poly | None:
    """Return the sum of rates, each ±1 times, that an angular velocity is a multiple of."""
    if not turn:
        return None
    _, rest = without_common_term(primitive(turn)[1])
    rates = set(rates)
    plain = all(
        sum(powers) == 1 and powers.index(1) in rates and abs(coefficient) == 1
        for powers, coefficient in rest.items()
    )
    return rest if plain and len(rest) > 1 else None


def _shifted(form: EquationForm, length: sp.Symbol, number: int) -> Iterator[EquationForm]:
    """Yield the form in ρ = η + c, the distance of a centre of mass, for every c that fits."""
    space, symbol = form.space, sp.Symbol(f"rho{number}", real=True)
    x = space.generator(length)
    for shift in _shifts(form, length):
        yield replace(
            form,
            M=tuple(space.reduced(poly.compose(x, x - shift)) for poly in form.M),
            h=tuple(space.reduced(poly.compose(x, x - shift)) for poly in form.h),
            shown=form.shown | {length: symbol},
            definitions=(*form.definitions, (symbol, length + space.expression(shift, {}))),
        )


def _shifts(form: EquationForm, length: sp.Symbol) -> list[Poly]:
    """Return c of every a (η + c)² + … and a (η + c) among the coefficients of other variables."""
    space, i = form.space, form.space.index[length]
    variables = [space.index[s] for s in (*form.rates, *form.angles, *form.lengths) if s != length]
    found: dict[Poly, None] = {}
    for poly in (*form.M, *form.h):
        groups: dict[tuple[int, ...], dict[int, Poly]] = defaultdict(dict)
        for powers, coefficient in poly.items():
            rest = [0 if k == i or k in variables else power for k, power in enumerate(powers)]
            by_power = groups[tuple(powers[k] for k in variables)]
            term = space.ring.term_new(tuple(rest), coefficient)
            by_power[powers[i]] = by_power.get(powers[i], space.ring.zero) + term
        for by_power in groups.values():
            top = max(by_power)
            if top > 0 and top - 1 in by_power:
                shift, remainder = by_power[top - 1].div(by_power[top] * top)
                found |= {} if remainder else {shift: None}
    return list(found)


def with_angle_sums(form: EquationForm, equations: Equations) -> EquationForm:
    """Return the polynomials with products of cosines and sines turned into those of sums."""
    angles = equations.angles
    pairs = [(form.space.index[a.cos], form.space.index[a.sin]) for a in angles]
    taken = {k for pair in pairs for k in pair}
    kept = [s for k, s in enumerate(form.space.symbols) if k not in taken]
    expanded = [_expanded(poly, pairs, taken) for poly in (*form.M, *form.h)]
    multiples = sorted({key[0] for terms in expanded for key, _ in terms if any(key[0])})
    symbols, definitions = {}, []
    for multiple in reversed(multiples):
        total = sum((k * angle.value for k, angle in zip(multiple, angles, strict=True)), sp.S.Zero)
        for odd, function in ((False, sp.cos), (True, sp.sin)):
            symbol = sp.Symbol(("S" if odd else "C") + _digits(multiple, angles), real=True)
            symbols[multiple, odd] = symbol
            definitions.append((symbol, function(total)))
    old = form.space
    order = (*kept[: kept.index(form.rates[-1]) + 1], *symbols.values())
    order += tuple(s for s in kept if s not in order)
    space = Space(order, {}, {}, old.constants, old.max_terms, old.deadline)

    def monomial(key: Key, rest: tuple[int, ...]) -> tuple[int, ...]:
        powers = {symbols.get(key): 1} | dict(zip(kept, rest, strict=True))
        return tuple(powers.get(symbol, 0) for symbol in order)

    polys = [space.ring.from_dict({monomial(*m): c for m, c in x.items()}) for x in expanded]
    others = form.definitions[2 * len(angles) :]
    return replace(
        form, space=space, M=tuple(polys[: len(form.M)]), h=tuple(polys[len(form.M) :]),
        definitions=(*definitions, *others), angles=tuple(symbols.values()),
    )  # fmt: skip


def _expanded(
    poly: Poly, pairs: Sequence[tuple[int, int]], taken: set[int]
) -> dict[tuple[Key, tuple[int, ...]], Any]:
    """Return coefficients by the cosine or sine of a sum and the powers of all else."""
    result: dict[tuple[Key, tuple[int, ...]], Any] = defaultdict(int)
    for powers, coefficient in poly.items():
        waves = {((0,) * len(pairs), False): coefficient}
        for angle, (c, s) in enumerate(pairs):
            for odd in [False] * powers[c] + [True] * powers[s]:
                waves = _times(waves, angle, odd)
        rest = tuple(power for k, power in enumerate(powers) if k not in taken)
        for key, value in waves.items():
            result[key, rest] += value
    return {key: value for key, value in result.items() if value}


def _times(waves: dict[Key, Any], angle: int, odd: bool) -> dict[Key, Any]:
    """Multiply by the cosine (or, odd, the sine) of an angle: product-to-sum formulas."""
    product: dict[Key, Any] = defaultdict(int)
    for (multiple, sine), coefficient in waves.items():
        for step in (1, -1):
            moved = tuple(k + step * (i == angle) for i, k in enumerate(multiple))
            sign = 1 if not odd or (step > 0) != sine else -1
            out = sine != odd
            if next((k for k in moved if k), 0) < 0:
                moved, sign = tuple(-k for k in moved), -sign if out else sign
            if any(moved) or not out:
                product[moved, out] += coefficient * sign / 2
    return product


def _digits(multiple: tuple[int, ...], angles: Sequence[Angle]) -> str:
    """Return what names an angle sum: 12 for θ1 + θ2, 1m2 for θ1 − θ2, 11 for 2 θ1."""
    marks = [str(angle.cos).removeprefix("C") for angle in angles]
    return "".join(
        ("m" if k < 0 else "") + mark * abs(k) for k, mark in zip(multiple, marks, strict=True) if k
    )


def _size(polys: Iterable[Poly]) -> int:
    return sum(len(poly) for poly in polys)
