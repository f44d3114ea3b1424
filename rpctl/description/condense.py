"""Findings in sum: one line for one idiom of a file, however often it stands there."""

from __future__ import annotations

import re
from collections.abc import Iterable

from rpctl.errors import SEVERITIES, Finding

VARYING = re.compile(r'"[^"]*"|[+-]?\d[\d.]*(?:e[+-]?\d+)?')  # names and numbers of a message
NAME = re.compile(r'"([^"]*)"')
MAX_NAMED = 4  # further places that one line names


def condense(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return one finding for those that differ in names and numbers only, the weightiest first.

    Errors come before warnings, and these before remarks; then what stands there most often.

    Args:
        findings: Of one file.
    """
    alike: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        alike.setdefault((finding.severity, VARYING.sub("#", finding.message)), []).append(finding)
    groups = [sorted(group, key=lambda f: f.line or 0) for group in alike.values()]
    groups.sort(key=lambda group: (SEVERITIES.index(group[0].severity), -len(group)))
    return tuple(map(_sum, groups))


def _sum(group: list[Finding]) -> Finding:
    """Return the first finding of a group, with the places of the others."""
    first, *others = group
    if not others:
        return first
    places = list(dict.fromkeys(_place(first, other) for other in others))
    listed = ", ".join(places[:MAX_NAMED])
    if len(others) > MAX_NAMED:
        listed += f" and {len(others) - MAX_NAMED} more"
    return Finding(first.severity, first.line, f"{first.message} (and so {listed})")


def _place(first: Finding, other: Finding) -> str:
    """Return where another finding of a group stands: the name that the first lacks, its line."""
    pairs = zip(NAME.findall(first.message), NAME.findall(other.message), strict=False)
    name = next((f'"{new}"' for known, new in pairs if new != known), "")
    line = "" if other.line is None else f"line {other.line}"
    return f"{name} ({line})" if name and line else name or line or "once more"
