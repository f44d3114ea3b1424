"""What long work has done so far, in a folder: one line of JSON each, written when it has ended.

The first line says what the others follow from. A line that a crash or a full disk cut off, or that
has changed since, is not what its digest says: what it stood for is done again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from rpctl.errors import RpctlError
from rpctl.files.opening import open_input
from rpctl.files.strict_json import read_json
from rpctl.files.writing import make_folder, write_atomically

DIGEST = "sha256"  # of the rest of a line
MOST_SHOWN = 5  # differences that a message names

Record = dict[str, Any]


class Journal(NamedTuple):
    """The journal of some work.

    Attributes:
        path: The file.
        identity: What the records follow from; a journal of another identity is refused.
        work: What it is of, in words: ``"a study"``.
    """

    path: Path
    identity: Mapping[str, Any]
    work: str
    pronoun: str = "it"

    def begin(self, resume: bool) -> list[Record]:
        """Make the file, or go on with it; return the records that it holds.

        Raises:
            RpctlError: There are records and they are not to be resumed, or they are of something
                else: the difference is named.
        """
        make_folder(self.path.parent)
        if not self.path.exists():
            self.rewrite([])
            return []
        there, *records = [*self._records()] or [{}]
        self.require_same(there, resume)
        self.rewrite(records)  # without what was torn
        return records

    def require_same(self, there: Mapping[str, Any], resume: bool) -> None:
        """Refuse to go on with records of another identity, or if nobody has asked for it.

        Raises:
            RpctlError: The difference is named.
        """
        folder = self.path.parent
        if not resume:
            raise RpctlError(
                f"{folder}: holds {self.work}; add --resume to go on with {self.pronoun}, or give "
                "another --out"
            )
        differences = [*plain_differences(there, json.loads(json.dumps(self.identity)))]
        if differences:
            raise RpctlError(
                f"{folder}: holds runs of something else: {'; '.join(differences[:MOST_SHOWN])}; "
                "give another --out"
            )

    def add(self, record: Mapping[str, Any]) -> None:
        """Keep a record."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(_line(record))

    def rewrite(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Write other records in the place of those that are there."""
        lines = map(_line, (self.identity, *records))
        write_atomically(self.path, "".join(lines).encode(), follow_links=False)

    def _records(self) -> Iterator[Record]:
        """Yield what the lines say that are whole."""
        with open_input(self.path, "MAX_SHOWN_BYTES", "a journal of runs") as file:
            for line in file:
                try:
                    record = read_json(line.decode())
                    whole = record.pop(DIGEST) == _digest(json.dumps(record))
                except (ValueError, KeyError, AttributeError, TypeError):
                    continue
                if whole:
                    yield record


def _line(record: Mapping[str, Any]) -> str:
    return json.dumps({**record, DIGEST: _digest(json.dumps(record))}) + "\n"


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:16]


def plain_differences(there: Any, here: Any, label: str = "") -> Iterator[str]:
    """Yield where two records of JSON differ: ``seed: 1 there, 2 here``."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for key in sorted({*there, *here}):
            inner = f"{label}.{key}" if label else key
            yield from plain_differences(there.get(key), here.get(key), inner)
    elif there != here:
        yield f"{label}: {_short(there)} there, {_short(here)} here"


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
