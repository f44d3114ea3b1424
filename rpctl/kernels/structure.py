"""What of a record is compiled in: all but its numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any


def structure(setting: Any) -> object:
    """Return what is compiled in of a law: its numbers are inputs, all but whether one is 0.

    None in the place of a number stands for one that is found elsewhere.
    """
    if isinstance(setting, tuple):
        return [structure(each) for each in setting]
    if dataclasses.is_dataclass(setting):
        return type(setting).__name__, {k: structure(x) for k, x in vars(setting).items()}
    if setting is None or isinstance(setting, float | int):
        return setting is None or bool(setting)
    return () if isinstance(setting, Mapping) else setting
