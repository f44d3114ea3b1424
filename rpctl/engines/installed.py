"""The engines that are installed, and the commands that install the others."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import cast

from rpctl.engines.engine import Engine, EngineMissing
from rpctl.errors import UnknownNameError

ENGINES = {  # by the name that users give
    "mujoco": "rpctl.engines.mujoco.engine:MujocoSimulator",
    "drake": "rpctl.engines.drake.engine:DrakeEngine",
    "pybullet": "rpctl.engines.bullet.engine:BulletEngine",
}


def installed_engines(names: Sequence[str] = ()) -> tuple[list[Engine], list[str]]:
    """Return the engines that are installed, and a sentence on each that is not.

    Args:
        names: Those that are wanted; empty: all.

    Raises:
        UnknownNameError: There is no engine of such a name.
    """
    found: list[Engine] = []
    missing: list[str] = []
    for name in names or tuple(ENGINES):
        if name not in ENGINES:
            raise UnknownNameError("engine", name, ENGINES)
        module, _, kind = ENGINES[name].partition(":")
        _start(module, kind, found, missing)
    return found, missing


def _start(module: str, kind: str, found: list[Engine], missing: list[str]) -> None:
    """Add an engine to those found, or the sentence on how to install it to those missing."""
    try:
        engine = cast("Engine", getattr(import_module(module), kind)())
        found.extend([engine] if engine.version else [])  # its library is asked, and so imported
    except EngineMissing as error:
        missing.append(str(error))
