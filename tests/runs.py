"""Runs that differ from one that was simulated."""

from __future__ import annotations

import dataclasses
from typing import Any

from rpctl import Run
from rpctl.simulation.run.facts import GroundFacts, RobotFacts
from rpctl.simulation.run.log import COLUMNS

RECORDS: dict[str, type[RobotFacts | GroundFacts]] = {"robot": RobotFacts, "ground": GroundFacts}


def vary(run: Run, **entries: Any) -> Run:
    """Return a run with other arrays, facts of its robot or ground, or fields of its own."""
    renamed = {"ground_notes": "notes", "contact_points": "points"}
    for name in entries.keys() & renamed.keys():
        facts = dataclasses.replace(run.ground, **{renamed[name]: entries.pop(name)})
        run = dataclasses.replace(run, ground=facts)
    arrays = {name: value for name, value in entries.items() if name in COLUMNS}
    own = {name: value for name, value in entries.items() if name not in arrays}
    bound = own.get("bound_limits", run.bound_limits)
    run = dataclasses.replace(run, log=run.log.changed(arrays, bound_limits=bound))
    for name, value in own.items():
        if name in {item.name for item in dataclasses.fields(Run)}:
            run = dataclasses.replace(run, **{name: value})
            continue
        kinds = RECORDS.items()
        record = next(r for r, kind in kinds if name in {f.name for f in dataclasses.fields(kind)})
        facts = dataclasses.replace(getattr(run, record), **{name: value})
        run = dataclasses.replace(run, **{record: facts})
    return run
