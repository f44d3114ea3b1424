"""A law as text and as LaTeX: settings, inputs, ν_d, ν̇_d, ν̇*, and the equations of motion."""

from __future__ import annotations

import re
from collections.abc import Mapping

import sympy as sp

from rpctl.derive.closed_form import ClosedForm
from rpctl.derive.latex import PREAMBLE, aligned, equations_of, escaped
from rpctl.derive.law_program import LawSheet
from rpctl.derive.law_sheet import as_piecewise
from rpctl.derive.text import columns, plain, to_text
from rpctl.errors import printable

GREEK = ("alpha", "beta", "eta", "kappa", "omega", "theta")
TOO_LONG = "M, h and B of this robot are too long to read; --format c and python compute them."


def law_text(law: LawSheet, form: ClosedForm | None) -> str:
    """Return a law as plain text; expressions are valid SymPy.

    Args:
        law: The law on a robot.
        form: The robot's equations in closed form, or None if they are too long to read.
    """
    sheet = law.sheet
    lines = [f"{printable(law.robot.name)}: from the measured state to actuator efforts", ""]
    settings = [(f"{s.symbol} = {s.value:g} {s.unit}", s.of) for s in sheet.settings]
    lines += ["settings", *columns(settings), ""]
    read = _read(law)
    inputs = [(str(g.symbol), f"{printable(g.of)} {_unit(g.unit)}".strip()) for g in sheet.inputs
              if g.symbol in read]  # fmt: skip
    lines += ["inputs: pose of the root link, positions and rates, the reference (_r)"]
    lines += [*columns(inputs), "", "in this order"]
    lines += [f"  {symbol} = {_plain(value)}" for symbol, value in sheet.definitions]
    for name, values in (("nu_d", law.nu_d), ("nu_d_dot", law.nu_d_dot), ("nu_dot", law.nu_dot)):
        lines.append(f"  {name} = ({', '.join(map(_plain, values))})")
    lossy = " - l(nu_d), l the losses in the joints" if law.robot.losses is not None else ""
    lines += ["", f"tau of least effort, relative to the limits, with B tau = M nu_dot + h{lossy}"]
    lines.append("")
    return "\n".join(lines) + (f"\n{to_text(form)}" if form else f"{TOO_LONG}\n")


def law_latex(law: LawSheet, form: ClosedForm | None) -> str:
    """Return a law as a complete LaTeX document that needs nothing but amsmath.

    Args:
        law: The law on a robot.
        form: The robot's equations in closed form, or None if they are too long to read.
    """
    sheet, read = law.sheet, _read(law)
    symbols = [*(s.symbol for s in sheet.settings), *(g.symbol for g in sheet.inputs)]
    symbols += [symbol for symbol, _ in sheet.definitions]
    names = {symbol: symbol_latex(str(symbol)) for symbol in symbols}
    rows = [
        f"${names[s.symbol]}$ & {s.value:g} {escaped(s.unit)}, {escaped(s.of)}"
        for s in sheet.settings
    ]
    rows += [
        f"${names[g.symbol]}$ & {escaped(f'{g.of} {_unit(g.unit)}')}" for g in sheet.inputs
        if g.symbol in read
    ]  # fmt: skip
    legend = "\\begin{tabular}{lp{13cm}}\n" + " \\\\\n".join(rows) + "\n\\end{tabular}\n"
    definitions = [(names[symbol], as_piecewise(value)) for symbol, value in sheet.definitions]
    body = [f"\\section*{{{escaped(law.robot.name)}: the law}}", legend]
    body.append(aligned(definitions, names))
    for name, values in (
        (r"\nu_d", law.nu_d), (r"\dot\nu_d", law.nu_d_dot), (r"\dot\nu^*", law.nu_dot)
    ):  # fmt: skip
        body.append(f"\\[ {name} = \\bigl({_listed(values, names)}\\bigr) \\]")
    lossy = r" - \ell(\nu_d)$, $\ell$ the losses in the joints" if law.robot.losses else "$"
    body.append(
        r"$\tau$ is the effort, least relative to the limits, with $B\tau = M\dot\nu^* + h"
        f"{lossy}."
    )
    body.append(equations_of(form) if form else escaped(TOO_LONG))
    return PREAMBLE % {"columns": max(10, len(law.robot.actuators))} + "\n".join(
        [*body, "\\end{document}", ""]
    )


def symbol_latex(name: str) -> str:
    """Return x1_dot as a dotted x with index 1, theta1_r_ddot as a twice dotted theta."""
    stem, dots = name, ""
    for ending, mark in (("_ddot", "\\ddot"), ("_dot", "\\dot")):
        if name.endswith(ending):
            stem, dots = name.removesuffix(ending), mark
    head, *indices = stem.split("_")
    letters, number = re.fullmatch(r"([A-Za-z]+)(\d*)", head).groups()  # type: ignore[union-attr]
    stem = f"\\{letters}" if letters in GREEK else letters
    stem = stem if len(letters) == 1 or letters in GREEK else f"\\mathit{{{letters}}}"
    stem = f"{dots}{{{stem}}}" if dots else stem
    words = [w if len(w) == 1 or w.isdigit() else _word(w) for w in [number, *indices] if w]
    return f"{stem}_{{{','.join(words)}}}" if words else stem


def _word(word: str) -> str:
    return f"\\{word}" if word in GREEK else f"\\mathrm{{{word}}}"


def _listed(values: tuple[sp.Expr, ...], names: Mapping[sp.Symbol, str]) -> str:
    return ",\\ ".join(
        str(sp.latex(as_piecewise(value), symbol_names=dict(names))) for value in values
    )


def _read(law: LawSheet) -> set[sp.Symbol]:
    """Return the symbols that the law depends on."""
    parts = [value for _, value in law.sheet.definitions]
    parts += [*law.nu_d, *law.nu_d_dot, *law.nu_dot]
    return set().union(*(part.free_symbols for part in parts))


def _plain(value: sp.Expr) -> str:
    return plain(as_piecewise(value))


def _unit(unit: str) -> str:
    return f"[{unit}]" if unit else ""
