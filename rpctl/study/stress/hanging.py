"""Wheels that hang in the air from the start, where rigid supports carry the robot: in words."""

from __future__ import annotations

from collections.abc import Iterable

from rpctl.study.stress.battery import StressCell
from rpctl.study.stress.ladders import RADIUS, Stress
from rpctl.study.stress.verdict import StressFigures

RIGID = "the supports are rigid and as high as the file has them, so they carry the robot"
OTHERS = "the other contacts carry the robot"
Ran = tuple[StressCell, StressFigures]


def hanging_told(runs: Iterable[Ran], stresses: Iterable[Stress]) -> list[str]:
    """Return a sentence for each ladder along which wheels hang; none for one that has no such.

    Args:
        runs: The cells of one plant, and what became of them.
        stresses: The ladders.
    """
    hanging = {
        cell.levels: figures.hanging_wheels for cell, figures in runs if figures.hanging_wheels
    }
    always = hanging.get((), ())
    found = [f"nothing stressed: {', '.join(always)} bear nothing: {OTHERS}"] if always else []
    for stress in stresses:
        wheels = {
            level: [name for name in hanging.get(((stress.name, level),), ()) if name not in always]
            for level in stress.levels
        }
        levels = [stress.text(level) for level, names in wheels.items() if names]
        if levels:
            named = dict.fromkeys(name for names in wheels.values() for name in names)
            where = f"{stress.name} {', '.join(levels)} {stress.unit}".rstrip()
            why = RIGID if stress.name == RADIUS else OTHERS
            found.append(f"{where}: {', '.join(named)} bear nothing from the start: {why}")
    return found
