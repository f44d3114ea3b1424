"""Runs that differ from one that was simulated."""

from __future__ import annotations

import dataclasses
from typing import Any

from rpctl import Run
from rpctl.simulation.run import ENTRIES


def vary(run: Run, **entries: Any) -> Run:
    """Return a run with some entries of its records changed; they are called as in its file."""
    for entry, value in entries.items():
        record, name = ENTRIES[entry]
        if record is not None:
            name, value = record, dataclasses.replace(getattr(run, record), **{name: value})
        run = dataclasses.replace(run, **{name: value})
    return run
