"""What keeps loads and margins of a robot's contacts from being defined or unique, in words."""

from __future__ import annotations

import math

from rpctl.arrays import Array
from rpctl.dynamics.stance import MIN_STANCE_WIDTH_M
from rpctl.dynamics.supports import Supports


def free_rotation(points: Array, heading: float) -> str:
    """Return the freedom that contacts (n, 2) on one line leave, in words."""
    along = points[-1] - points[0]
    ahead = abs(along @ [math.cos(heading), math.sin(heading)])
    aside = abs(along @ [-math.sin(heading), math.cos(heading)])
    if max(ahead, aside) <= MIN_STANCE_WIDTH_M:
        return "pitch and roll"
    return "pitch" if aside > ahead else "roll"


def contact_notes(
    names: tuple[str, ...], supports: Supports, balanced: bool, free: str
) -> tuple[str, ...]:
    """Return what keeps a robot's loads and margins from being defined or unique, in sentences.

    Args:
        names: Names of its contacts.
        supports: Those that are not wheels.
        balanced: Whether they hold a balance.
        free: The freedom that they leave, from :func:`free_rotation`, if they do not.
    """
    fix = "give each caster a <collision> with a <sphere> or <cylinder> that reaches the ground"
    if supports.unknown:
        listed = ", ".join(supports.unknown)
        return (
            f"the support polygon is incomplete: {listed} touch the ground but are drawn as "
            f"meshes only, so loads and margins are not defined; {fix}",
        )
    if not balanced:
        return (
            f"only {', '.join(names)} are known to touch the ground, on one line: the planar model "
            f"assumes balance and leaves {free} out, so loads and margins are "
            "not defined; if "
            f"the robot does not balance, {fix}",
        )
    if len(names) > 3:
        return (
            f"{len(names)} contacts share the load, more than statics can tell apart: wheel loads "
            "and grip are intervals over all splits, and where one of them is drawn it is that of "
            "equally stiff contacts",
        )
    return ()
