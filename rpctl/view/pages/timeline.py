"""Marks on the timeline of a report: when links ran into something."""

from __future__ import annotations

from collections.abc import Iterable

from rpctl.simulation.collision_facts import Collision
from rpctl.view.pages.page import escape

THUMB_PX = 16  # width of the slider's thumb, whose middle stands at the time


def timeline_marks(collisions: Iterable[Collision], start: float, duration: float) -> str:
    """Return the marks as HTML, each as wide as its collision lasted.

    Args:
        collisions: Of the run.
        start: Its first time, s.
        duration: Of the timeline, s.
    """
    return "".join(_mark(each, start, duration) for each in collisions) if duration > 0.0 else ""


def _mark(collision: Collision, start: float, duration: float) -> str:
    left = min(max((collision.first_time - start) / duration, 0.0), 1.0)
    width = min(max(collision.duration / duration, 0.0), 1.0 - left)
    style = (
        f"left:calc({0.5 * THUMB_PX:g}px + {left:.4f}*(100% - {THUMB_PX}px));"
        f"width:max(3px, {width:.4f}*(100% - {THUMB_PX}px))"
    )
    return f'<i class="collision" style="{style}" title="{escape(collision.sentence)}"></i>'
