"""MuJoCo without its warnings, which go to stderr and into a file of the current folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rpctl.engines.mujoco.library import mujoco_library


@contextmanager
def muted() -> Iterator[None]:
    """Let MuJoCo warn nobody; what matters of it is counted in the ``MjData``."""
    mujoco = mujoco_library()
    known = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_nobody)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(known)


def _nobody(message: str) -> None:
    """Take a warning."""
