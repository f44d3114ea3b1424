"""A closed form, and a law, as plain text and as LaTeX that needs nothing but amsmath."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import casadi
import sympy as sp

from rpctl.derive.closed_form import ClosedForm
from rpctl.derive.codegen import rendered
from rpctl.derive.equations import rational
from rpctl.derive.law_program import LawSetting, LawSheet
from rpctl.derive.short_form import readable
from rpctl.derive.steps import Steps
from rpctl.errors import printable


def to_text(form: ClosedForm) -> str:
    """Return a closed form as plain text; expressions are valid SymPy and Python."""
    texts = [[plain(x) for x in form.B.row(i)] for i in range(form.B.rows)]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    context = {
        "form": form,
        "lossy": any(form.losses),
        "legend": list(legend(form)),
        "numbers": [
            (f"{p.symbol} = {p.value:g} {p.unit}", printable(p.of)) for p in form.parameters
        ],
        "inertia": list(inertia(form)),
        "rows": [[x.rjust(w) for x, w in zip(row, widths, strict=True)] for row in texts],
    }
    return rendered("form.txt.jinja", context, plain=plain, printable=printable, columns=columns)


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
    """Yield M's upper triangle, entries that are equal together: their places, their value."""
    places: dict[sp.Expr, list[str]] = {}
    for i in range(form.M.rows):
        for j in range(i, form.M.rows):
            places.setdefault(form.M[i, j], []).append(f"{i + 1}{j + 1}")
    for value, names in places.items():
        yield names, value


def plain(expression: sp.Expr) -> str:
    """Return an expression as SymPy writes it, in one line."""
    return str(sp.sstr(readable(expression), full_prec=False))


def columns(rows: Sequence[tuple[Any, str]]) -> str:
    """Return rows of two columns, the second aligned."""
    width = max((len(str(left)) for left, _ in rows), default=0)
    return "\n".join(f"  {str(left).ljust(width)}  {right}" for left, right in rows)


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
    lefts = [(" = ".join(f"M_{{{x}}}" for x in left), value) for left, value in inertia(form)]
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


GREEK = ("alpha", "beta", "eta", "kappa", "omega", "theta")
TOO_LONG = "M, h and B of this robot are too long to read; --format c and python compute them."


def law_text(law: LawSheet, form: ClosedForm | None) -> str:
    """Return a law as plain text; expressions are valid SymPy.

    Args:
        law: The law on a robot.
        form: The robot's equations in closed form, or None if they are too long to read.
    """
    lossy = " - l(nu_d), l the losses in the joints" if law.robot.losses is not None else ""
    results = {"nu_d": law.nu_d, "nu_d_dot": law.nu_d_dot, "nu_dot": law.nu_dot}
    context = {
        "law": law,
        "settings": [(f"{s.symbol} = {s.value:g} {s.unit}", s.of) for s in _settings(law)],
        "inputs": [(name, printable(words)) for name, words in _inputs(law)],
        "shown": [(name, expression(value)) for name, (_, value) in law.shown.items()],
        "results": [(name, [expression(x) for x in values]) for name, values in results.items()],
        "lossy": lossy,
        "rest": f"\n{to_text(form)}" if form else f"{TOO_LONG}\n",
    }
    return rendered("law.txt.jinja", context, plain=plain, printable=printable, columns=columns)


def law_latex(law: LawSheet, form: ClosedForm | None) -> str:
    """Return a law as a complete LaTeX document that needs nothing but amsmath.

    Args:
        law: The law on a robot.
        form: The robot's equations in closed form, or None if they are too long to read.
    """
    names = {sp.Symbol(name, real=True): symbol_latex(name) for name in law.read}
    rows = [
        f"${symbol_latex(str(s.symbol))}$ & {s.value:g} {escaped(s.unit)}, {escaped(s.of)}"
        for s in _settings(law)
    ]
    rows += [f"${symbol_latex(name)}$ & {escaped(words)}" for name, words in _inputs(law)]
    legend = "\\begin{tabular}{lp{13cm}}\n" + " \\\\\n".join(rows) + "\n\\end{tabular}\n"
    body = [f"\\section*{{{escaped(law.robot.name)}: the law}}", legend]
    shown = [(symbol_latex(name), expression(value)) for name, (_, value) in law.shown.items()]
    body.append(aligned(shown, names))
    for name, values in (
        (r"\nu_d", law.nu_d), (r"\dot\nu_d", law.nu_d_dot), (r"\dot\nu^*", law.nu_dot)
    ):  # fmt: skip
        listed = ",\\ ".join(_latex(expression(value), names) for value in values)
        body.append(f"\\[ {name} = \\bigl({listed}\\bigr) \\]")
    lossy = r" - \ell(\nu_d)$, $\ell$ the losses in the joints" if law.robot.losses else "$"
    body.append(
        r"$\tau$ is the effort, least relative to the limits, with $B\tau = M\dot\nu^* + h"
        f"{lossy}."
    )
    body.append(equations_of(form) if form else escaped(TOO_LONG))
    return PREAMBLE % {"columns": max(10, len(law.robot.actuators))} + "\n".join(
        [*body, "\\end{document}", ""]
    )


def expression(value: Any) -> sp.Expr:
    """Return a scalar of CasADi's as an expression of SymPy."""
    steps, symbols = Steps(), casadi.symvar(casadi.SX(value))
    function = casadi.Function("value", [casadi.vertcat(*symbols)], [casadi.SX(value)])
    (last,) = steps.evaluate(function, [lambda i: steps.add("input", symbols[i].name())])
    found: list[Any] = []
    for kind, *held in steps.nodes:
        if kind == "input":
            found.append(sp.Symbol(held[0], real=True))
        elif kind == "number":
            turns = held[0] / math.pi
            found.append(rational(turns) * sp.pi if turns in TURNS else rational(held[0]))
        elif kind in LOGIC:
            found.append(LOGIC[kind](*(_condition(found[a]) for a in held)))
        elif kind == "?":
            test, yes, no = _condition(found[held[0]]), *(_number(found[a]) for a in held[1:])
            found.append(sp.Piecewise((yes, test), (no, True)))
        else:
            found.append(OPERATIONS[kind](*(_number(found[a]) for a in held)))
    return _number(found[last])


def _difference(a: sp.Expr, *b: sp.Expr) -> sp.Expr:
    return a - b[0] if b else -a


ROLLING = "what rolling makes of nu at the present steering"
TURNS = (0.5, 1.0, 2.0)  # times pi: numbers that are written so
LOGIC = {"&&": sp.And, "||": sp.Or, "!": sp.Not}
OPERATIONS: dict[str, Callable[..., Any]] = {
    "+": sp.Add, "-": _difference, "*": sp.Mul, "/": lambda a, b: a / b, "<": sp.Lt, "<=": sp.Le,
    "==": sp.Eq, "!=": sp.Ne, "sin": sp.sin, "cos": sp.cos, "sqrt": sp.sqrt, "tanh": sp.tanh,
    "asin": sp.asin, "atan2": sp.atan2, "floor": sp.floor, "fabs": sp.Abs,
}  # fmt: skip


def _is_condition(value: Any) -> bool:
    return isinstance(value, sp.logic.boolalg.Boolean) and not value.is_Symbol


def _condition(value: Any) -> Any:
    return value if _is_condition(value) else sp.Ne(value, 0)


def _number(value: Any) -> Any:
    return sp.Piecewise((1, value), (0, True)) if _is_condition(value) else value


def symbol_latex(name: str) -> str:
    """Return x1_dot as a dotted x with index 1, theta1_r_ddot as a twice dotted theta."""
    stem, dots = name, ""
    for ending, mark in (("_ddot", "\\ddot"), ("_dot", "\\dot")):
        if name.endswith(ending):
            stem, dots = name.removesuffix(ending), mark
    head, *indices = stem.split("_")
    letters, number = re.fullmatch(r"([A-Za-z]+)(\w*)", head).groups()  # type: ignore[union-attr]
    stem = f"\\{letters}" if letters in GREEK else letters
    stem = stem if len(letters) == 1 or letters in GREEK else f"\\mathit{{{letters}}}"
    stem = f"{dots}{{{stem}}}" if dots else stem
    words = [w if len(w) == 1 or w.isdigit() else _word(w) for w in [number, *indices] if w]
    return f"{stem}_{{{','.join(words)}}}" if words else stem


def _word(word: str) -> str:
    return f"\\{word}" if word in GREEK else f"\\mathrm{{{word}}}"


def _settings(law: LawSheet) -> list[LawSetting]:
    """Return the settings that a law reads."""
    return [each for each in law.settings if each.symbol.name() in law.read]


def _inputs(law: LawSheet) -> list[tuple[str, str]]:
    """Return the names of the inputs that a law reads, and what they are."""
    given = [each for each in law.inputs if each.symbol.name() in law.read]
    found = [(str(each.symbol), f"{each.of} {_bracketed(each.unit)}".strip()) for each in given]
    return found + [(name, ROLLING) for name in sorted(law.rolling & law.read)]


def _bracketed(unit: str) -> str:
    return f"[{unit}]" if unit else ""
