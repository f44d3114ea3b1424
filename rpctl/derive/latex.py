"""A closed form as a LaTeX document that needs nothing but amsmath."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import sympy as sp

from rpctl.derive.closed_form import ClosedForm
from rpctl.derive.subexpressions import readable
from rpctl.derive.text import inertia, legend

LINE_WIDTH = 76  # of a line of a formula, in letters, about
SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
SPECIAL |= {character: f"\\{character}" for character in "#$%&_{}"}

PREAMBLE = r"""\documentclass[a4paper,fleqn]{article}
\usepackage{amsmath}
\setlength{\textwidth}{17cm}
\setlength{\oddsidemargin}{-0.5cm}
\setlength{\topmargin}{-1.5cm}
\setlength{\textheight}{25cm}
\setlength{\parindent}{0pt}
\setcounter{MaxMatrixCols}{%(columns)d}
\renewcommand{\arraystretch}{1.2}
\allowdisplaybreaks
\sloppy
\begin{document}
"""

BODY = r"""\section*{%(robot)s}
The reduced equations of motion $M \dot\nu + h = B \tau%(lost)s$ with $\nu = (%(rates)s)$ and
$\tau$ the efforts of %(actuators)s.

\medskip
%(legend)s
%(parts)s
"""


def to_latex(form: ClosedForm) -> str:
    """Return a closed form as a complete LaTeX document."""
    return PREAMBLE % {"columns": max(10, form.B.cols)} + equations_of(form) + "\\end{document}\n"


def equations_of(form: ClosedForm) -> str:
    """Return the section of a closed form."""
    names = {symbol: _symbol(str(symbol)) for symbol in _all_symbols(form)}
    rows = [f"${names[symbol]}$ & {escaped(what)}" for symbol, what in legend(form)]
    rows += [
        f"${names[p.symbol]}$ & {p.value:g} {_unit(p.unit)}, {escaped(p.of)}"
        for p in form.parameters
    ]
    parts = []
    if form.definitions:
        parts.append(aligned([(names[s], value) for s, value in form.definitions], names))
    lefts = [(" = ".join(f"M_{{{x[1:]}}}" for x in left), value) for left, value in inertia(form)]
    parts += ["$M$ is symmetric:", aligned(lefts, names)]
    parts.append(aligned([(f"h_{{{i + 1}}}", x) for i, x in enumerate(form.h)], names))
    parts.append(f"\\[ B = {_latex(form.B, names)} \\]")
    if any(form.losses):
        parts.append(aligned([(f"\\ell_{{{i + 1}}}", x) for i, x in enumerate(form.losses)], names))
    return BODY % {
        "lost": r" + \ell" if any(form.losses) else "",
        "robot": escaped(form.robot),
        "rates": ", ".join(names[rate] for rate in form.rates),
        "actuators": ", ".join(map(escaped, form.actuators)),
        "legend": "\\begin{tabular}{lp{13cm}}\n" + " \\\\\n".join(rows) + "\n\\end{tabular}\n",
        "parts": "\n".join(parts),
    }


def aligned(rows: Sequence[tuple[str, sp.Expr]], names: Mapping[sp.Symbol, str]) -> str:
    """Return equations one below the other, each in as many lines as it needs."""
    written = []
    for left, value in rows:
        lines, width = [""], 0
        for piece in _pieces(readable(value), names):
            width += _width(piece)
            if width > LINE_WIDTH and lines[-1]:
                lines.append("")
                width = _width(piece)
            lines[-1] += f" {piece}"
        written.append(f"{left} &= " + " \\\\\n&\\quad ".join(line.strip() for line in lines))
    return "\\begin{align*}\n" + " \\\\\n".join(written) + "\n\\end{align*}"


def _pieces(expression: sp.Expr, names: Mapping[sp.Symbol, str]) -> Iterator[str]:
    """Yield parts of an expression between which a line may end: terms, also inside of factors."""
    terms = expression.as_ordered_terms()
    for place, term in enumerate(terms):
        whole = _latex(term, names)
        sign = "" if place == 0 or whole.startswith("-") else "+ "
        sums = [factor for factor in sp.Mul.make_args(term) if factor.is_Add]
        if not sums or _width(whole) <= LINE_WIDTH or term.is_Add:
            yield sign + whole
            continue
        longest = max(sums, key=sp.count_ops)
        head = term / longest
        factor = {1: "", -1: "-"}.get(head, _latex(head, names))
        *inner, last = _pieces(longest, names)
        first = inner.pop(0) if inner else ""
        yield f"{sign}{factor} \\bigl( {first}"
        yield from inner
        yield f"{last} \\bigr)"


def _width(latex: str) -> int:
    """Return about how many letters wide a formula is; a sign takes three."""
    plain = re.sub(r"\\(left|right|frac|dot|bigl|bigr)|[{}^_\s]", "", latex)
    return len(re.sub(r"\\[a-zA-Z]+", "x", plain)) + 2 * len(re.findall("[+-]", plain))


def _latex(expression: sp.Expr, names: Mapping[sp.Symbol, str]) -> str:
    return str(sp.latex(readable(expression), symbol_names=dict(names)))


def _symbol(name: str) -> str:
    """Return theta1_dot as a dotted theta with index 1, C1m2 as a C with index 1-2."""
    plain = name.removesuffix("_dot")
    letters = ("theta", "eta", "phi", "rho", "Omega", "omega")
    stem = next((letter for letter in letters if plain.startswith(letter)), plain[:1])
    index = plain[len(stem) :].replace("m", "-")
    head = f"\\{stem}" if stem in letters else stem
    head = f"\\dot{{{head}}}" if plain != name else head
    return f"{head}_{{{index}}}" if index else head


def _all_symbols(form: ClosedForm) -> set[sp.Symbol]:
    parts = [form.M, form.h, form.B, form.losses, sp.Tuple(*form.rates)]
    parts += [sp.Tuple(symbol, value) for symbol, value in form.definitions]
    parts += [coordinate.symbol for coordinate in form.coordinates]
    return set().union(*(part.free_symbols for part in parts))


def _unit(unit: str) -> str:
    return re.sub(r"\^(\d)", r"$^\1$", unit)


def escaped(text: str) -> str:
    """Return any text as LaTeX of plain ASCII; names come from any file."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in text)
    return "".join(SPECIAL.get(c, c) for c in plain)
