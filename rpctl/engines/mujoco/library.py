"""MuJoCo itself, an extra that is imported where it is needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rpctl.engines.engine import EngineMissing

ABSENT = "MuJoCo is not installed; pip install 'rpctl[mujoco]', with Python 3.11 or later"


def mujoco_library() -> Any:
    """Return the module ``mujoco``.

    Raises:
        EngineMissing: It is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError:
        raise EngineMissing(ABSENT) from None
