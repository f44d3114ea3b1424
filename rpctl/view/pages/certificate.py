"""A certificate as one HTML page, to keep or to pass on; no script may run on it and none does."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rpctl.equivalence.contact.trial import ContactTrial
from rpctl.equivalence.scope import Condition
from rpctl.equivalence.verify import Certificate
from rpctl.files.writing import write_atomically
from rpctl.view.pages.page import Badge, render_page
from rpctl.view.pages.panel import residual
from rpctl.view.plots.contact import contact_figure
from rpctl.view.plots.figures import svg_address

STYLES = ("report.css", "certificate.css")


def write_certificate(certificate: Certificate, path: str | Path) -> Path:
    """Write a certificate as one HTML file that needs nothing else.

    Args:
        certificate: The certificate.
        path: The file; there whole or not at all.

    Returns:
        The path.
    """
    page = certificate_page(certificate).encode("utf-8", "backslashreplace")
    return write_atomically(path, page)


def certificate_page(certificate: Certificate) -> str:
    """Return a certificate as a page."""
    return render_page(
        "certificate.html",
        title=f"{certificate.robot}: certificate of the dynamics",
        styles=STYLES,
        robot=certificate.robot,
        about=f"M(q) ν̇ + h(q, ν) = B(q) τ at {certificate.samples} random states, "
        f"seed {certificate.seed}",
        badge=Badge(certificate.passed, "verified" if certificate.passed else "not verified"),
        rows=list(_rows(certificate)),
        remarks=[f"Scope: {certificate.scope.line}"],
        idealised=certificate.idealised,
        **_trial(certificate.contact),
    )


def _trial(trial: ContactTrial | None) -> dict[str, Any]:
    """Return what the page shows of a contact trial."""
    if trial is None:
        return {"trial": None}
    broken = sum(not check.passed for check in trial.checks)
    text = f"{broken} of {len(trial.checks)} gaps too wide" if broken else "both agree"
    return {
        "trial": trial,
        "trial_badge": Badge(not broken, text),
        "picture": svg_address(contact_figure(trial)),
    }


def _rows(certificate: Certificate) -> Iterator[tuple[str, str, str, str]]:
    """Yield what is compared, with what, the residual, and where it is worst."""
    for check in certificate.checks:
        shown = residual(check.passed, check.residual, check.limit)
        if isinstance(check, Condition):
            yield check.name, check.against, f"{check.value}, limit {check.bound}", check.entry
            continue
        where = f"{check.entry}, sample {check.sample}" if check.residual > 0 else ""
        yield check.name, check.against, shown, "; ".join(filter(None, (where, check.note)))
    for check in certificate.declared:
        told = f"{check.residual:.1e}, declared"
        yield check.name, check.against, told, f"{check.entry}; {check.note}"
    for gap in certificate.contact.checks if certificate.contact is not None else ():
        sign, mark = ("≤", "") if gap.passed else (">", " ✗")
        shown = f"{gap.format_value(gap.gap)} {sign} {gap.format_value(gap.band)}{mark}"
        yield gap.name, gap.against, shown, f"{gap.entry} at {gap.time:.2f} s".strip()
    for skipped in certificate.skipped:
        yield skipped.name, skipped.against, "not compared", skipped.note
