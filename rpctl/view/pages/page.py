"""What makes every page: templates, assets, embedded data, the content policy."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup

from rpctl.errors import printable
from rpctl.view import palette
from rpctl.view.scene.stand_ins import StandIn, label, note

PAIR = r"\\ud[89ab][0-9a-f]{2}\\ud[c-f][0-9a-f]{2}"  # of surrogates, in JSON
ESCAPED = re.compile(rf"\\\\|({PAIR}|\\u[0-9a-f]{{4}})")  # a backslash, or a sign beyond ASCII


@dataclass(frozen=True)
class Badge:
    """A word on a green or red ground."""

    good: bool
    text: str


Cell = str | Badge | tuple[str, str]  # of a table, or a note; of a pair, the first is bold


@dataclass(frozen=True)
class Table:
    """Rows of cells below their heads; ``coloured``: the columns are runs, in their colours."""

    heads: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Cell]]]
    coloured: bool = False


@dataclass(frozen=True)
class Curve:
    """A small curve over its foot: its points, 0 to 1 along each axis, upwards."""

    label: str
    points: Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Section:
    """A section of a panel; it shows what it has, in this order."""

    title: str
    badges: Sequence[Badge] = ()
    rows: Sequence[tuple[str, str]] = ()
    curve: Curve | None = None
    notes: Sequence[Cell] = ()
    paragraphs: Sequence[str] = ()
    quiet: str = ""
    table: Table | None = None
    details: tuple[str, str] | None = None  # what is always seen, and what can be unfolded


@dataclass(frozen=True)
class LegendEntry:
    """An entry of a scene's legend.

    Attributes:
        layer: What it shows and hides; a CSS class too.
        text: Its name.
        colour: Of its swatch, as a chart's line; None: the class says it.
        shown: Whether it is shown at first.
        title: What more is to be said of it.
        scale: The end of its scale of colours, and what that is.
    """

    layer: str
    text: str
    colour: int | None = None
    shown: bool = True
    title: str = ""
    scale: tuple[str, str] | None = None


def stand_in_entry(stand_ins: Sequence[StandIn]) -> LegendEntry | None:
    """Return the entry that names what stands in for missing meshes; None where nothing does."""
    if not stand_ins:
        return None
    return LegendEntry("stand-in", label(stand_ins), title=note(stand_ins, most=len(stand_ins)))


def asset(name: str) -> str:
    """Return a text file of ``rpctl/view/assets``."""
    return files("rpctl.view").joinpath("assets", name).read_text(encoding="utf-8")


def render_page(
    template: str,
    *,
    styles: Sequence[str],
    scripts: Sequence[str] = (),
    served: bool = False,
    dark: bool = True,
    **content: Any,
) -> str:
    """Return a page under a policy that lets its scripts run, and no others.

    Args:
        template: A file of ``rpctl/view/templates`` that extends ``page.html``.
        styles: Names of its style sheets; the colours come first.
        scripts: Its scripts, whole.
        served: Whether it asks its own server for motions.
        dark: Whether it is dark where its reader's other pages are.
        content: What the template shows; texts are escaped, ``Markup`` and numbers are not.
    """
    return render(
        template,
        css=Markup(palette.style_sheet(dark) + "".join(map(asset, styles))),  # our own
        **{"policy": policy(*scripts, served=served), **content},
        scripts=[Markup(script) for script in scripts],  # known by their hashes
    )


def render(template: str, **content: Any) -> Markup:
    """Return a template of ``rpctl/view/templates`` with its content, see :func:`render_page`."""
    return Markup(_environment().get_template(template).render(content))


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("rpctl.view"),
        autoescape=True,
        finalize=_shown,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _shown(value: Any) -> Any:
    """Return a text with what would not be seen escaped, before its markup is."""
    return printable(value, keep="\n") if type(value) is str else value


def embed(value: Any, *, shown: bool = True) -> Markup:
    """Return JSON that can stand inside a ``<script>``: no ``<``, so nothing ends it early.

    Args:
        value: What the page is given.
        shown: Whether its texts are only shown; what would not be seen in them is escaped. Names
            that the page sends back stay as they are.
    """
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(ESCAPED.sub(_seen, text) if shown else text)


def _seen(found: re.Match[str]) -> str:
    """Return a sign of JSON as it is if it is seen, else the text that stands for it."""
    if found[1] is None:
        return found[0]
    sign = json.loads(f'"{found[1]}"')
    text = printable(sign)
    return found[0] if text == sign else text.replace("\\", r"\\")


def policy(*scripts: str, served: bool = False) -> Markup:
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
    return Markup("; ".join(rules))  # our own
