"""The parts of every page: assets, embedded data, the content policy, badges and sections."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterable
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError

MESHCAT_SCRIPT = "viewer/dist/main.min.js"


def asset(name: str) -> str:
    """Return a text file of ``rpctl/view/assets``."""
    return files("rpctl.view").joinpath("assets", name).read_text(encoding="utf-8")


def meshcat_script() -> str:
    """Return meshcat's viewer; the package is found, not imported (it would load IPython).

    Raises:
        RpctlError: It is not there.
    """
    found = find_spec("meshcat")
    folders = found.submodule_search_locations if found else None
    for folder in folders or ():
        file = Path(folder) / MESHCAT_SCRIPT
        if file.is_file():
            return file.read_text(encoding="utf-8").replace("</script", "<\\/script")
    raise RpctlError(f"meshcat or its {MESHCAT_SCRIPT} is not there; run: pip install meshcat")


def uplot_script() -> str:
    """Return uPlot's script with its licence."""
    return f"/*\n{asset('uplot/LICENSE')}*/\n{asset('uplot/uPlot.iife.min.js')}"


def embed(value: Any) -> str:
    """Return JSON that can stand inside a ``<script>``: no ``<``, so nothing ends it early."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def policy(*scripts: str) -> str:
    """Return a policy under which only these scripts run, and nothing is fetched from anywhere."""
    digests = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"
    )


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
