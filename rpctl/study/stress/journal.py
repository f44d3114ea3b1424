"""The runs of a battery on disk while it runs: one line of JSON each, written when a run has ended.

A line that a crash or a full disk cut off is no JSON, and its run is done again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError
from rpctl.files.opening import read_text
from rpctl.files.strict_json import read_json
from rpctl.files.writing import make_folder, write_atomically
from rpctl.study.identity import plain_differences
from rpctl.study.stress.verdict import StressFigures, figures_from

JOURNAL_FILE = "cells.jsonl"


@dataclass(frozen=True)
class Journal:
    """The runs that have ended, in a folder.

    Attributes:
        folder: The folder.
        identity: What the runs follow from, besides their cells; a journal of another is refused.
    """

    folder: Path
    identity: Mapping[str, Any]

    @property
    def path(self) -> Path:
        """The file."""
        return self.folder / JOURNAL_FILE

    def begin(self, resume: bool) -> dict[str, StressFigures]:
        """Make the file, or go on with it.

        Args:
            resume: Whether to go on with runs that are there; False refuses them.

        Returns:
            The runs that have ended, by the keys of their cells.

        Raises:
            RpctlError: The folder holds runs and is not to be resumed, or runs of something else:
                the difference is named.
        """
        known = json.loads(json.dumps(self.identity))
        make_folder(self.folder)
        if not self.path.exists():
            self._write(known, {})
            return {}
        if not resume:
            raise RpctlError(
                f"{self.folder}: holds a battery's runs; add --resume to go on with them, or give "
                "another --out"
            )
        there, *rows = self._records() or [None]
        if found := plain_differences(there, known):
            raise RpctlError(
                f"{self.folder}: holds runs of something else: {'; '.join(found[:5])}; give "
                "another --out"
            )
        done = dict(filter(None, map(_row, rows)))
        self._write(known, done)  # without what was torn
        return done

    def add(self, key: str, figures: StressFigures) -> None:
        """Keep a run.

        Args:
            key: Of its cell.
            figures: What became of it.
        """
        with self.path.open("a", encoding="utf-8") as file:
            file.write(_line(key, figures))

    def close(self, rows: Mapping[str, StressFigures]) -> None:
        """Write the runs in their order, whatever the order in which they ended."""
        self._write(json.loads(json.dumps(self.identity)), rows)

    def _write(self, identity: Any, rows: Mapping[str, StressFigures]) -> None:
        lines = [json.dumps(identity) + "\n", *(_line(*row) for row in rows.items())]
        write_atomically(self.path, "".join(lines).encode(), follow_links=False)

    def _records(self) -> list[Any]:
        """Return what the lines say, up to the first that says nothing."""
        text = read_text(self.path, "MAX_SHOWN_BYTES", "a battery's runs")
        found: list[Any] = []
        with suppress(ValueError):
            found.extend(map(read_json, text.splitlines()))
        return found


def _line(key: str, figures: StressFigures) -> str:
    return json.dumps({"cell": key, "figures": figures.to_dict()}) + "\n"


def _row(record: Any) -> tuple[str, StressFigures] | None:
    """Return the cell's key and the figures that a line says; None if it says none."""
    try:
        return str(record["cell"]), figures_from(record["figures"])
    except (KeyError, TypeError):
        return None
