"""A certificate as one HTML page, to keep or to pass on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.contact.record import Gap
from rpctl.equivalence.row import Check, Skipped
from rpctl.files.writing import write_atomically
from rpctl.view.pages.contact_section import contact_section
from rpctl.view.pages.page import asset, badge, escape, policy
from rpctl.view.pages.summary_panel import residual

STYLE = """
main { padding: 0 20px 24px; margin: 0 auto; }
.top, main { max-width: 940px; }
header .badge { float: none; }
table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
th { text-align: left; color: var(--soft); font-weight: 600; }
th, td { padding: 6px 10px; border-bottom: 1px solid var(--line); vertical-align: top; }
td:nth-child(3) { white-space: nowrap; }
@media (min-width: 800px) { td:nth-child(-n + 2) { white-space: nowrap; } }
.remark { margin: 14px 10px; color: var(--soft); overflow-wrap: anywhere; }
.wide { overflow-x: auto; background: var(--card); border: 1px solid var(--line);
  border-radius: 10px; }
"""
PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{robot}: certificate of the dynamics</title>
<style>{style}</style>
</head>
<body>
<header class="top"><h1>{robot}</h1><span class="subtitle">{about}</span>{badge}</header>
<main>{trial}<div class="wide"><table>
<thead><tr><th>Compared</th><th>With</th><th>Residual</th><th>Worst at</th></tr></thead>
<tbody>
{rows}
</tbody></table></div>{remarks}</main>
</body>
</html>
"""


def write_certificate(certificate: Certificate, path: str | Path) -> Path:
    """Write a certificate as one HTML file that needs nothing else.

    Args:
        certificate: The certificate.
        path: The file; there whole or not at all.

    Returns:
        The path.
    """
    style = asset("report.css")
    about = f"M(q) ν̇ + h(q, ν) = B(q) τ at {certificate.samples} random states"
    trial, moves = "", ""
    gaps: tuple[Gap, ...] = ()
    if certificate.contact is not None:
        trial, moves = contact_section(certificate.contact)
        gaps = certificate.contact.checks
    page = PAGE.format(
        policy=policy(),
        robot=escape(certificate.robot),
        style=style + STYLE + moves,
        trial=trial,
        about=f"{about}, seed {certificate.seed}",
        badge=badge(certificate.passed, "verified" if certificate.passed else "not equivalent"),
        remarks=_estimates(certificate.estimated_links)
        + _shared(certificate.shared)
        + _idealised(certificate.idealised),
        rows="\n".join(
            [
                *map(_row, certificate.checks),
                *map(_declared, certificate.declared),
                *map(_gap_row, gaps),
                *map(_left_out, certificate.skipped),
            ]
        ),
    )
    return write_atomically(path, page.encode("utf-8", "backslashreplace"))


def _estimates(links: Sequence[str]) -> str:
    """Return the sentence on links whose inertias are estimates, or nothing."""
    if not links:
        return ""
    text = f"Estimated, at a density, not given by the URDF: mass and inertia of {', '.join(links)}"
    return f'<p class="remark">{escape(text)}.</p>'


def _shared(phrases: Sequence[str]) -> str:
    """Return the sentence on what all derivations take from a common source, or nothing."""
    if not phrases:
        return ""
    return f'<p class="remark">Shared by all derivations: {escape("; ".join(phrases))}.</p>'


def _idealised(sentences: Sequence[str]) -> str:
    """Return the list of what is idealised, or nothing."""
    if not sentences:
        return ""
    items = "".join(f"<li>{escape(sentence)}.</li>" for sentence in sentences)
    return f'<div class="remark">Idealised, the same in all derivations:<ul>{items}</ul></div>'


def _row(check: Check) -> str:
    shown = residual({"passed": check.passed, "residual": check.residual, "limit": check.limit})
    where = f"{check.entry}, sample {check.sample}" if check.residual > 0 else ""
    cells = (check.name, check.against, shown, "; ".join(filter(None, (where, check.note))))
    return _cells(*cells)


def _declared(check: Check) -> str:
    return _cells(
        check.name, check.against, f"{check.residual:.1e}, declared", f"{check.entry}; {check.note}"
    )


def _gap_row(gap: Gap) -> str:
    sign = "≤" if gap.passed else ">"
    mark = "" if gap.passed else " ✗"
    shown = f"{gap.format_value(gap.gap)} {sign} {gap.format_value(gap.band)}{mark}"
    return _cells(gap.name, gap.against, shown, f"{gap.entry} at {gap.time:.2f} s".strip())


def _left_out(skipped: Skipped) -> str:
    return _cells(skipped.name, skipped.against, "not compared", skipped.note)


def _cells(*texts: str) -> str:
    return "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in texts) + "</tr>"
