"""The parts of every page: assets, embedded data, the content policy, badges and sections."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable
from importlib.resources import files
from typing import Any

from rpctl.errors import printable

PAIR = r"\\ud[89ab][0-9a-f]{2}\\ud[c-f][0-9a-f]{2}"  # of surrogates, in JSON
ESCAPED = re.compile(rf"\\\\|({PAIR}|\\u[0-9a-f]{{4}})")  # a backslash, or a sign beyond ASCII


def asset(name: str) -> str:
    """Return a text file of ``rpctl/view/assets``."""
    return files("rpctl.view").joinpath("assets", name).read_text(encoding="utf-8")


def escape(text: str) -> str:
    """Return a text of others as HTML that shows it: no markup, and nothing that is not seen."""
    return html.escape(printable(text, keep="\n"))


def embed(value: Any, *, shown: bool = True) -> str:
    """Return JSON that can stand inside a ``<script>``: no ``<``, so nothing ends it early.

    Args:
        value: What the page is given.
        shown: Whether its texts are only shown; what would not be seen in them is escaped. Names
            that the page sends back stay as they are.
    """
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return ESCAPED.sub(_seen, text) if shown else text


def _seen(found: re.Match[str]) -> str:
    """Return a sign of JSON as it is if it is seen, else the text that stands for it."""
    if found[1] is None:
        return found[0]
    sign = json.loads(f'"{found[1]}"')
    text = printable(sign)
    return found[0] if text == sign else text.replace("\\", r"\\")


def policy(*scripts: str, served: bool = False) -> str:
    """Return a policy under which only these scripts run, and nothing is fetched from anywhere.

    No ``<base>`` turns addresses elsewhere and no form is sent. Styles may stand in the page: with
    no picture or font to fetch they tell nobody anything.

    Args:
        scripts: The scripts, whole.
        served: Whether the page asks its own server for motions.
    """
    digests = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'"
    connected = "'self'" if served else "'none'"
    rules = (
        "default-src 'none'",
        f"script-src {allowed}",
        "style-src 'unsafe-inline'",
        "img-src data: blob:",
        f"connect-src {connected}",
        "base-uri 'none'",
        "form-action 'none'",
    )
    return "; ".join(rules)


def badge(good: bool, text: str) -> str:
    """Return a word on a green or red ground."""
    return f'<span class="badge {"good" if good else "bad"}">{escape(text)}</span>'


def section(title: str, body: str) -> str:
    """Return a section; both strings are HTML already."""
    return f"<section><h2>{title}</h2>{body}</section>"


def definitions(rows: Iterable[tuple[str, str]]) -> str:
    """Return a list of names and values."""
    cells = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows)
    return f'<dl class="rows">{cells}</dl>'
