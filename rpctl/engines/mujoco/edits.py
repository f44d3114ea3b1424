"""What was edited in an MJCF file: two tables compared, each difference named and weighed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from rpctl.engines.mujoco.table import Fields, Table, Value
from rpctl.errors import printable

SAME = 1e-12  # of the larger number: what reading and normalising leave
ROUNDED = 1e-5  # and of MuJoCo's own save, which writes six digits
ROUNDED_FLOOR = 2e-6  # of entries of a unit vector or quaternion, six digits each
HARMLESS_KINDS = ("camera", "light", "asset", "site", "key")  # nothing of them moves a robot
HARMLESS_FIELDS = ("rgba", "matid", "group", "castshadow", "user")  # of any element
ORDERED = ("joint", "actuator", "sensor")  # kinds whose order is that of qpos, ctrl, sensordata
DIRECTIONS = ("quat", "axis", "pos", "ipos", "inertia")  # compared as wholes, not number by number
MAX_SHOWN = 60  # characters of a value


@dataclass(frozen=True)
class Edit:
    """One difference between a file and what was exported.

    Attributes:
        kind: Of the element, as MJCF calls it: ``"body"``, ``"actuator"``, ``"option"`` …
        name: Of the element.
        field: What of it, or ``""`` where the element itself was added or removed.
        before: As it was exported, in words.
        after: As the file has it, in words.
        matters: Whether it can change the motion, or what the controller reads and sends.
    """

    kind: str
    name: str
    field: str
    before: str
    after: str
    matters: bool

    @property
    def sentence(self) -> str:
        """The difference in words: ``body "base_link": mass 1.2 → 1.3``."""
        element = self.kind if self.name == self.kind else f'{self.kind} "{printable(self.name)}"'
        if not self.field:
            return f"{element} {self.after}"
        return f"{element}: {self.field} {self.before} → {self.after}"


@dataclass(frozen=True)
class Comparison:
    """All differences between two tables.

    Attributes:
        edits: Those that are no rounding.
        rounded: Number of values that differ as six digits do, as MuJoCo's own save writes.
        largest: The largest of those differences, relative.
    """

    edits: tuple[Edit, ...]
    rounded: int
    largest: float


def compare_tables(exported: Table, found: Table) -> Comparison:
    """Return what differs between the table of an export and that of a file.

    Fields that only one of them has are of another version of MuJoCo, and left out.

    Args:
        exported: What was written.
        found: What the file means now.
    """
    pairs = [*exported.get("pair", {}).values(), *found.get("pair", {}).values()]
    walker = _Walker({str(pair[end]) for pair in pairs for end in ("geom1", "geom2")})
    edits = [edit for kind in sorted({*exported, *found}) for edit in walker.kind(
        kind, exported.get(kind, {}), found.get(kind, {}), found
    )]  # fmt: skip
    if any(edit.matters and edit.field != "meaninertia" for edit in edits):  # it follows from these
        edits = [edit for edit in edits if edit.field != "meaninertia"]
    edits.sort(key=lambda edit: not edit.matters)
    return Comparison(tuple(edits), walker.rounded, walker.largest)


class _Walker:
    """Compares elements, and counts what was only rounded."""

    def __init__(self, paired: Collection[str]) -> None:
        self._paired = paired
        self.rounded = 0
        self.largest = 0.0

    def kind(
        self,
        kind: str,
        before: Mapping[str, Fields],
        after: Mapping[str, Fields],
        found: Table,
    ) -> Iterator[Edit]:
        """Yield the edits of all elements of a kind."""
        for name in (name for name in before if name not in after):
            matters = kind not in HARMLESS_KINDS and not self.drawn_only(kind, name, before[name])
            yield Edit(kind, name, "", "", "was removed", matters)
        for name in (name for name in after if name not in before):
            matters = kind not in HARMLESS_KINDS and not self.drawn_only(kind, name, after[name])
            yield Edit(kind, name, "", "", "was added", matters and kind != "sensor")
        both = [name for name in before if name in after]
        now = [name for name in after if name in before]
        if kind in ORDERED and both != now:
            at = next(i for i, pair in enumerate(zip(both, now, strict=True)) if pair[0] != pair[1])
            yield Edit(kind, kind, "order", f'"{both[at]}" first', f'"{now[at]}" first', True)
        for name in both:
            yield from self.fields(kind, name, before[name], after[name])

    def fields(self, kind: str, name: str, before: Fields, after: Fields) -> Iterator[Edit]:
        """Yield the edits of one element."""
        drawn = self.drawn_only(kind, name, before) and self.drawn_only(kind, name, after)
        shared = before.keys() & after.keys() if kind != "asset" else before.keys() | after.keys()
        for field in sorted(shared):
            if self.same(field, before.get(field, ""), after.get(field, "")):
                continue
            matters = not (drawn or field in HARMLESS_FIELDS or kind in HARMLESS_KINDS)
            words = _words(before.get(field, "")), _words(after.get(field, ""))
            yield Edit(kind, name, field, *words, matters)

    def drawn_only(self, kind: str, name: str, fields: Fields) -> bool:
        """Return whether an element is a geom that touches nothing."""
        if kind != "geom" or name in self._paired:
            return False
        return fields.get("contype") == [0.0] == fields.get("conaffinity")

    def same(self, field: str, before: Value, after: Value) -> bool:
        """Return whether two values are one, up to rounding; rounding is counted."""
        if before == after:
            return True
        if isinstance(before, str) or isinstance(after, str) or len(before) != len(after):
            return False
        words = [(a, b) for a, b in zip(before, after, strict=True) if isinstance(a, str | bytes)]
        if words or any(isinstance(b, str) for b in after):
            return before == after
        gap, size = _gap(field, [float(a) for a in before], [float(b) for b in after])
        if not gap <= ROUNDED:
            return False
        if gap > SAME:
            self.rounded += 1
            self.largest = max(self.largest, gap)
        return size >= 0.0


def _gap(field: str, before: list[float], after: list[float]) -> tuple[float, float]:
    """Return the largest relative difference of two lists of numbers, and the largest number.

    Directions, places and inertias are compared as wholes: their small entries are rounding.
    """
    if field.endswith("quat") and sum(a * b for a, b in zip(before, after, strict=True)) < 0.0:
        after = [-number for number in after]  # the same turn
    size = max(map(abs, before), default=0.0)
    gaps = []
    for a, b in zip(before, after, strict=True):
        if a == b:
            continue
        scale = size if field in DIRECTIONS else max(abs(a), abs(b))
        gaps.append(abs(a - b) / scale if scale > 0.0 else math.inf)
    return max(gaps, default=0.0), size


def _words(value: Value) -> str:
    """Return a value in words."""
    if isinstance(value, str):
        text = value or "nothing"
    else:
        text = " ".join(each if isinstance(each, str) else f"{each:.10g}" for each in value)
    text = printable(text)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."
