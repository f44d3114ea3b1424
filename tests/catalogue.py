"""Robots of the catalogue, each loaded once: what is built for a robot is kept for it."""

from __future__ import annotations

from functools import cache

import rpctl
from rpctl import Robot


@cache
def robot_of(name: str) -> Robot:
    """Return a robot by its name; the linear model of one that leans takes half a second."""
    return rpctl.load(name)
