"""A closed form, and a law, as plain text and as LaTeX that needs nothing but amsmath."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any

import casadi
import jinja2
import sympy as sp

from rpctl.derive.closed_form import ClosedForm
from rpctl.derive.equations import rational
from rpctl.derive.law_program import LawSheet, LawSymbol
from rpctl.derive.program import FUNCTIONS, Steps
from rpctl.derive.short_form import readable
from rpctl.errors import printable

TEX: dict[str, Any] = {  # how templates of LaTeX mark what is put in: braces are LaTeX's
    "variable_start_string": "<<", "variable_end_string": ">>",
    "block_start_string": "<%", "block_end_string": "%>", "comment_start_string": "<#",
}  # fmt: skip


def rendered(name: str, context: dict[str, Any], **filters: Callable[..., Any]) -> str:
    """Return a template of this room with values, and filters of the caller's, put in."""
    folder = files("rpctl.derive") / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: folder.joinpath(name).read_text("utf-8")),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        **(TEX if ".tex" in name else {}),
    )
    environment.filters.update(filters)
    return environment.get_template(name).render(context)


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
        "inertia": inertia(form),
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
    yield from ((rate, base[str(rate)]) for rate in form.rates if str(rate) in base)
    for coordinate in form.coordinates:
        yield coordinate.symbol, f"position of {printable(coordinate.joint)} [{coordinate.unit}]"


def inertia(form: ClosedForm) -> list[tuple[list[str], sp.Expr]]:
    """Return M's upper triangle, entries that are equal together: their places, their value."""
    places: dict[sp.Expr, list[str]] = {}
    for i in range(form.M.rows):
        for j in range(i, form.M.rows):
            places.setdefault(form.M[i, j], []).append(f"{i + 1}{j + 1}")
    return [(names, value) for value, names in places.items()]


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


def to_latex(form: ClosedForm) -> str:
    """Return a closed form as a complete LaTeX document that needs nothing but amsmath."""
    return rendered("document.tex.jinja", {"columns": form.B.cols, "body": _equations(form)})


def _equations(form: ClosedForm) -> str:
    """Return the section of a closed form."""
    names = {symbol: symbol_latex(str(symbol)) for symbol in _all_symbols(form)}
    numbers = [(p.symbol, f"{p.value:g} {p.unit}, {p.of}") for p in form.parameters]
    inertias = [(" = ".join(f"M_{{{x}}}" for x in left), value) for left, value in inertia(form)]
    h, losses = (
        aligned([(f"{letter}_{{{i}}}", x) for i, x in enumerate(column, start=1)], names)
        for letter, column in (("h", form.h), (r"\ell", form.losses))
    )
    context = {
        "form": form,
        "lossy": r" + \ell" if any(form.losses) else "",
        "rates": [names[rate] for rate in form.rates],
        "rows": [(names[symbol], words) for symbol, words in (*legend(form), *numbers)],
        "definitions": aligned([(names[s], x) for s, x in form.definitions], names)
        if form.definitions
        else "",
        "inertia": aligned(inertias, names),
        "h": h,
        "losses": losses,
        "B": _latex(form.B, names),
    }
    return rendered("equations.tex.jinja", context, escaped=escaped, tabular=_tabular)


def _tabular(rows: Sequence[tuple[str, str]]) -> str:
    lines = " \\\\\n".join(f"${symbol}$ & {escaped(words)}" for symbol, words in rows)
    return f"\\begin{{tabular}}{{lp{{13cm}}}}\n{lines}\n\\end{{tabular}}\n"


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
    for place, term in enumerate(expression.as_ordered_terms()):
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


def _all_symbols(form: ClosedForm) -> set[sp.Symbol]:
    parts = (form.M, form.h, form.B, form.losses, *form.rates, *form.definitions)
    symbols = (coordinate.symbol for coordinate in form.coordinates)
    return set(sp.Tuple(*parts, *symbols).free_symbols)


def escaped(text: str) -> str:
    """Return any text as LaTeX of plain ASCII; names come from any file, units have powers."""
    plain = "".join(SPECIAL.get(c, c) if " " <= c <= "~" else "?" for c in text)
    return re.sub(r"\\textasciicircum\{\}(\d)", r"$^\1$", plain)


GREEK = (
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu",
    "rho", "sigma", "tau", "phi", "omega", "Omega",
)  # fmt: skip
TOO_LONG = "M, h and B of this robot are too long to read; --format c and python compute them."


def law_text(law: LawSheet, form: ClosedForm | None) -> str:
    """Return a law as plain text; expressions are valid SymPy.

    Args:
        law: The law on a robot.
        form: The robot's equations in closed form, or None if they are too long to read.
    """
    results = {"nu_d": law.nu_d, "nu_d_dot": law.nu_d_dot, "nu_dot": law.nu_dot}
    context = {
        "law": law,
        "settings": [(f"{s.symbol} = {s.place:g} {s.unit}", s.of) for s in _settings(law)],
        "inputs": [(name, printable(words)) for name, words in _inputs(law)],
        "shown": [(name, expression(value)) for name, value in law.shown.items()],
        "results": [(name, [expression(x) for x in values]) for name, values in results.items()],
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
    numbers = [(str(s.symbol), f"{s.place:g} {s.unit}, {s.of}") for s in _settings(law)]
    parts = {r"\nu_d": law.nu_d, r"\dot\nu_d": law.nu_d_dot, r"\dot\nu^*": law.nu_dot}
    context = {
        "law": law,
        "rows": [(symbol_latex(name), words) for name, words in (*numbers, *_inputs(law))],
        "shown": aligned([(symbol_latex(k), expression(x)) for k, x in law.shown.items()], names),
        "results": [(k, [_latex(expression(x), names) for x in v]) for k, v in parts.items()],
        "rest": _equations(form) if form else escaped(TOO_LONG),
    }
    body = rendered("law.tex.jinja", context, escaped=escaped, tabular=_tabular)
    return rendered("document.tex.jinja", {"columns": len(law.robot.actuators), "body": body})


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


ROLLING = "what rolling makes of nu at the present steering"
TURNS = (0.5, 1.0, 2.0)  # times pi: numbers that are written so
LOGIC = {"&&": sp.And, "||": sp.Or, "!": sp.Not}
OPERATIONS: dict[str, Callable[..., Any]] = {
    "+": sp.Add, "-": lambda a, *b: a - b[0] if b else -a, "*": sp.Mul, "/": lambda a, b: a / b,
    "<": sp.Lt, "<=": sp.Le, "==": sp.Eq, "!=": sp.Ne,
    **{name: getattr(sp, name, sp.Abs) for name in FUNCTIONS}, "pow": sp.Pow, "ceil": sp.ceiling,
}  # fmt: skip


def _is_condition(value: Any) -> bool:
    return isinstance(value, sp.logic.boolalg.Boolean) and not value.is_Symbol


def _condition(value: Any) -> Any:
    return value if _is_condition(value) else sp.Ne(value, 0)


def _number(value: Any) -> Any:
    return sp.Piecewise((1, value), (0, True)) if _is_condition(value) else value


def symbol_latex(name: str) -> str:
    """Return x1_dot as a dotted x with index 1, C1m2 as a C with index 1-2, vx as v with x."""
    stem, *ends = re.split("_(?=d?dot$)", name)
    head, *indices = stem.split("_")
    letters, number = re.fullmatch(r"([A-Za-z]+)(\w*)", head).groups()  # type: ignore[union-attr]
    if len(letters) == 2 and not number and letters not in GREEK:
        letters, number = letters[0], letters[1]
    stem = _word(letters) if letters in GREEK or len(letters) == 1 else f"\\mathit{{{letters}}}"
    stem = f"\\{ends[0]}{{{stem}}}" if ends else stem
    words = [number.replace("m", "-"), *map(_word, indices)]
    return f"{stem}_{{{','.join(filter(None, words))}}}" if any(words) else stem


def _word(word: str) -> str:
    """Return a letter, a number, a Greek letter's name, or a word that is written upright."""
    if len(word) == 1 or word.isdigit():
        return word
    return f"\\{word}" if word in GREEK else f"\\mathrm{{{word}}}"


def _settings(law: LawSheet) -> list[LawSymbol]:
    """Return the settings that a law reads."""
    return [each for each in law.settings if each.symbol.name() in law.read]


def _inputs(law: LawSheet) -> list[tuple[str, str]]:
    """Return the names of the inputs that a law reads, and what they are."""
    found = [
        (str(each.symbol), f"{each.of} [{each.unit}]".removesuffix(" []"))
        for each in law.inputs
        if each.symbol.name() in law.read
    ]
    return found + [(name, ROLLING) for name in sorted(law.rolling & law.read)]
