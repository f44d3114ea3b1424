"""Drake's own modules, imported where they are needed, and what it says."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from rpctl.engines.engine import EngineMissing
from rpctl.libraries import library


class DrakeModules(NamedTuple):
    """The modules of Drake that an engine needs."""

    common: Any
    framework: Any
    analysis: Any
    geometry: Any
    math: Any
    plant: Any
    parsing: Any


def load_drake() -> DrakeModules:
    """Return Drake's modules.

    Raises:
        EngineMissing: Drake is not installed.
    """
    names = (
        "common",
        "systems.framework",
        "systems.analysis",
        "geometry",
        "math",
        "multibody.plant",
        "multibody.parsing",
    )
    try:
        return DrakeModules(*(library(f"pydrake.{name}") for name in names))
    except ImportError as error:
        raise EngineMissing(f"Drake: {error}; pip install 'rpctl[drake]'") from error


class _Heard(logging.Handler):
    """Keeps the first line of each warning."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a warning's first line, without the file's place."""
        line = record.getMessage().partition("\n")[0]
        line = line.rpartition("warning: ")[2]
        if line not in self.lines:
            self.lines.append(line)


@contextmanager
def heard() -> Iterator[list[str]]:
    """Keep what Drake warns of from the terminal; the first lines are in the list."""
    logger, handler = logging.getLogger("drake"), _Heard()
    handlers, passes = list(logger.handlers), logger.propagate
    logger.handlers, logger.propagate = [handler], False
    try:
        yield handler.lines
    finally:
        logger.handlers, logger.propagate = handlers, passes
