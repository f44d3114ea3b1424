"""Equations as MathML, which browsers draw by themselves: no script, no network."""

import re
from typing import Any

from docutils import nodes
from latex2mathml import converter

NAMED = re.compile(r"<mi>([a-z]{2,})</mi>")  # cos, sin, ...: browsers set no space before them


def convert(text: str, display: str = "inline") -> str:
    """Return MathML of LaTeX, with space around the names of functions as TeX sets it."""
    space = '<mspace width="0.17em"/>'
    return NAMED.sub(rf"{space}<mi>\1</mi>{space}", converter.convert(text, display=display))


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True}
