"""A closed form as plain text, and what the text and LaTeX formats share."""

from __future__ import annotations

from collections.abc import Iterator

import sympy as sp

from rpctl.derive.closed_form import ClosedForm
from rpctl.derive.subexpressions import readable
from rpctl.errors import printable


def to_text(form: ClosedForm) -> str:
    """Return a closed form as plain text; expressions are valid SymPy and Python."""
    rates = ", ".join(map(str, form.rates))
    lost = " + l" if any(form.losses) else ""
    lines = [f"{printable(form.robot)}: M nu_dot + h = B tau{lost}", ""]
    lines += [f"nu  = ({rates})", f"tau = ({', '.join(map(printable, form.actuators))})"]
    rows = [(str(symbol), what) for symbol, what in legend(form)]
    lines += ["", *columns(rows)]
    numbers = [(f"{p.symbol} = {p.value:g} {p.unit}", printable(p.of)) for p in form.parameters]
    lines += ["", *columns(numbers)] if numbers else []
    named = [f"  {symbol} = {plain(value)}" for symbol, value in form.definitions]
    lines += ["", *named] if named else []
    lines += ["", *(f"  {' = '.join(left)} = {plain(value)}" for left, value in inertia(form))]
    lines += ["", *(f"  h{i + 1} = {plain(value)}" for i, value in enumerate(form.h))]
    widths = [max(len(plain(x)) for x in form.B.col(j)) for j in range(form.B.cols)]
    for i in range(form.B.rows):
        row = "  ".join(plain(x).rjust(w) for x, w in zip(form.B.row(i), widths, strict=True))
        lines.append(f"  B = [ {row} ]" if i == 0 else f"      [ {row} ]")
        if i == 0:
            lines.insert(-1, "")
    if lost:
        lines += ["", *(f"  l{i + 1} = {plain(value)}" for i, value in enumerate(form.losses))]
    return "\n".join(lines) + "\n"


def legend(form: ClosedForm) -> Iterator[tuple[sp.Symbol, str]]:
    """Yield the symbols of speeds and positions and what they are."""
    base = {
        "v": "forward speed of P, midway between the wheels [m/s]",
        "vx": "speed of the root link along its x [m/s]",
        "vy": "speed of the root link along its y [m/s]",
        "omega": "turning rate of the base [rad/s]",
    }
    for rate in form.rates:
        if str(rate) in base:
            yield rate, base[str(rate)]
    for coordinate in form.coordinates:
        yield coordinate.symbol, f"position of {printable(coordinate.joint)} [{coordinate.unit}]"


def inertia(form: ClosedForm) -> Iterator[tuple[list[str], sp.Expr]]:
    """Yield M's upper triangle, entries that are equal together: their names, their value."""
    places: dict[sp.Expr, list[str]] = {}
    for i in range(form.M.rows):
        for j in range(i, form.M.rows):
            places.setdefault(form.M[i, j], []).append(f"M{i + 1}{j + 1}")
    for value, names in places.items():
        yield names, value


def plain(expression: sp.Expr) -> str:
    """Return an expression as SymPy writes it, in one line."""
    return str(sp.sstr(readable(expression), full_prec=False))


def columns(rows: list[tuple[str, str]]) -> list[str]:
    """Return rows of two columns, the second aligned."""
    width = max((len(left) for left, _ in rows), default=0)
    return [f"  {left.ljust(width)}  {right}" for left, right in rows]
