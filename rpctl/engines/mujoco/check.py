"""``check_file``: whether an exported file still describes the robot that it was written from.

It compares two tables, names and rates each difference, and repeats the comparisons of the export.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.engines.mujoco.certificate import MjcfCertificate, find_certificate
from rpctl.engines.mujoco.equations import Witness, compare_with_witness, take_witness
from rpctl.engines.mujoco.mjcf_reader import Fields, StrictMjcf, Table, Value, read_mjcf
from rpctl.engines.mujoco.trial import run_on_ground
from rpctl.equivalence.certificate import Check, Skipped
from rpctl.errors import RpctlError, printable
from rpctl.robot.inspection import model_digest
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

SAME = 1e-12  # of the larger number: error of reading and normalising
ROUNDED = 1e-5  # error of MuJoCo's own writer, which writes six digits
HARMLESS_KINDS = ("camera", "light", "asset", "site")  # kinds that do not affect the motion
HARMLESS_FIELDS = ("rgba", "matid", "group", "castshadow", "user")  # of any element
ORDERED = ("joint", "actuator", "sensor")  # kinds whose order is that of qpos, ctrl, sensordata
DIRECTIONS = ("quat", "axis", "pos", "ipos", "inertia", "qpos")  # compared as wholes
MAX_SHOWN = 60  # characters of a value
EQUATIONS = "equations"  # the row of a model that lacks a part of the robot
FRESH_SEED = 1  # of states other than those that the file holds
ROUNDED_NOTE = (
    "{count} numbers are rounded by at most {largest:.1e} of their size, as MuJoCo saves them"
)


@dataclass(frozen=True)
class Edit:
    """One difference between a file and what was exported.

    Attributes:
        kind: Kind of the element in MJCF: ``"body"``, ``"actuator"``, ``"option"`` …
        name: Name of the element.
        field: The changed field, or ``""`` if the element itself was added or removed.
        before: The exported value, as text.
        after: The value in the file, as text.
        matters: Whether the difference can affect the motion, the sensors or the motors.
    """

    kind: str
    name: str
    field: str
    before: str
    after: str
    matters: bool

    @property
    def sentence(self) -> str:
        """The difference as text: ``body "base_link": mass 1.2 → 1.3``."""
        element = self.kind if self.name == self.kind else f'{self.kind} "{printable(self.name)}"'
        if not self.field:
            return f"{element} {self.after}"
        return f"{element}: {self.field} {self.before} → {self.after}"


@dataclass(frozen=True)
class Comparison:
    """All differences between two tables.

    Attributes:
        edits: The differences that are not due to rounding.
        rounded: Number of values that differ by rounding to six digits, as MuJoCo writes them.
        largest: The largest relative difference among those.
    """

    edits: tuple[Edit, ...]
    rounded: int
    largest: float


def compare_tables(exported: Table, found: Table) -> Comparison:
    """Return the differences between the table of an export and that of a file.

    Fields that only one of them has belong to another version of MuJoCo and are ignored.
    """
    pairs = [*exported.get("pair", {}).values(), *found.get("pair", {}).values()]
    paired = {str(pair[end]) for pair in pairs for end in ("geom1", "geom2")}
    edits: list[Edit] = []
    roundings: list[float] = []
    for kind in sorted({*exported, *found}):
        before, after = exported.get(kind, {}), found.get(kind, {})
        edits += _element_edits(kind, before, after, paired)
        for name in (name for name in before if name in after):
            idle = _is_idle(kind, name, paired, before[name], after[name])
            for entry, old, new in _both(kind, before[name], after[name]):
                gap = _difference(entry, old, new)
                if not gap <= ROUNDED:
                    matters = not idle and entry not in HARMLESS_FIELDS
                    edits.append(Edit(kind, name, entry, _words(old), _words(new), matters))
                elif gap > SAME:
                    roundings.append(gap)
    if any(edit.matters and edit.field != "meaninertia" for edit in edits):  # it follows from these
        edits = [edit for edit in edits if edit.field != "meaninertia"]
    edits.sort(key=lambda edit: not edit.matters)
    return Comparison(tuple(edits), len(roundings), max(roundings, default=0.0))


def _element_edits(
    kind: str, before: Mapping[str, Fields], after: Mapping[str, Fields], paired: Collection[str]
) -> Iterator[Edit]:
    """Yield the elements of a kind that were removed or added, and a changed order."""
    for name in (name for name in before if name not in after):
        matters = not _is_idle(kind, name, paired, before[name])
        yield Edit(kind, name, "", "", "was removed", matters)
    for name in (name for name in after if name not in before):
        matters = kind != "sensor" and not _is_idle(kind, name, paired, after[name])
        yield Edit(kind, name, "", "", "was added", matters)
    both = [name for name in before if name in after]
    now = [name for name in after if name in before]
    if kind in ORDERED and both != now:
        first, other = next(pair for pair in zip(both, now, strict=True) if pair[0] != pair[1])
        yield Edit(kind, kind, "order", f'"{first}" first', f'"{other}" first', True)


def _is_idle(kind: str, name: str, paired: Collection[str], *states: Fields) -> bool:
    """Return whether an element cannot affect the motion, such as a geom without contacts."""
    touching = kind != "geom" or name in paired
    drawn = (each.get("contype") == [0.0] == each.get("conaffinity") for each in states)
    return kind in HARMLESS_KINDS or (not touching and all(drawn))


def _both(kind: str, before: Fields, after: Fields) -> Iterator[tuple[str, Value, Value]]:
    """Yield the common fields of an element with both values; of an asset, all fields."""
    names = before.keys() & after.keys() if kind != "asset" else before.keys() | after.keys()
    for name in sorted(names):
        yield name, before.get(name, ""), after.get(name, "")


def _difference(field: str, before: Value, after: Value) -> float:
    """Return the largest relative difference of two values; infinite if they cannot be compared.

    Directions, positions and inertias are compared as vectors: their small entries are rounding.
    """
    if before == after:
        return 0.0
    words = any(isinstance(each, str) for each in (before, after, *before, *after))
    if words or len(before) != len(after):
        return math.inf
    old, new = np.array(before, dtype=float), np.array(after, dtype=float)
    if field.endswith("quat") and old @ new < 0.0:
        new = -new  # the same rotation
    whole = np.full_like(old, np.abs(old).max())
    scale = whole if field in DIRECTIONS else np.maximum(np.abs(old), np.abs(new))
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.where(old == new, 0.0, np.abs(old - new) / scale).max())


def _words(value: Value) -> str:
    """Return a value as text."""
    if isinstance(value, str):
        text = value or "nothing"
    else:
        text = " ".join(each if isinstance(each, str) else f"{each:.10g}" for each in value)
    text = printable(text)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


@dataclass(frozen=True)
class MjcfCheck:
    """The outcome of a check.

    Attributes:
        path: The file.
        certificate: The certificate in the file.
        edits: What was edited since the file was written.
        checks: The repeated comparisons.
        skipped: Comparisons that could not be repeated, with reasons.
        notes: Further sentences.
    """

    path: Path
    certificate: MjcfCertificate = field(repr=False)
    edits: tuple[Edit, ...]
    checks: tuple[Check, ...]
    skipped: tuple[Skipped, ...]
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the certificate holds: no edit matters, and every comparison passes."""
        sound = all(check.passed for check in self.checks)
        return sound and not any(edit.matters for edit in self.edits)

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome as plain values for JSON."""
        own = self.certificate
        return {
            "path": str(self.path),
            "passed": self.passed,
            "robot": own.robot,
            "source": own.source,
            "urdf": own.urdf,
            "digest": own.digest,
            "made_with": dict(own.made_with),
            "settings": dict(own.settings),
            "edits": [{**asdict(edit), "sentence": edit.sentence} for edit in self.edits],
            "checks": [check.to_dict() for check in self.checks],
            "skipped": [asdict(each) for each in self.skipped],
            "notes": list(self.notes),
        }


def read_certified(path: str | Path) -> tuple[StrictMjcf, MjcfCertificate]:
    """Return an exported file and its certificate.

    Raises:
        RpctlError: rpctl did not export this file.
    """
    file = read_mjcf(path)
    return file, find_certificate(file.texts, path)


def check_file(
    file: StrictMjcf, certificate: MjcfCertificate, robot: Robot | None, given: bool = False
) -> MjcfCheck:
    """Verify an exported file again, and name what was edited.

    Args:
        file: The file.
        certificate: Its certificate.
        robot: The robot to compare with; None: compare only with the numbers in the file.
        given: Whether the user named the robot, which may then be another one.
    """
    compared = compare_tables(certificate.table, file.table)
    notes: tuple[str, ...] = ()
    if compared.rounded:
        notes += (ROUNDED_NOTE.format(count=compared.rounded, largest=compared.largest),)
    checks: list[Check] = []
    skipped: list[Skipped] = []
    rounding = compared.largest
    _collect(checks, file, certificate.witness, rounding, "the numbers in the file")
    if robot is None:
        skipped.append(Skipped("the robot itself", "reduced model", "its URDF is not available"))
    else:
        notes += _identity_notes(robot, certificate, given)
        root = certificate.witness.root
        losses = bool(certificate.settings.get("losses", True))
        fresh = take_witness(robot, root, losses, seed=FRESH_SEED)
        _collect(checks, file, fresh, rounding, f"{robot.name} anew")
        if all(check.name != EQUATIONS for check in checks):  # the file has every name of the robot
            try:
                trial = run_on_ground(robot if losses else without_losses(robot), file.model, root)
                checks += trial.checks
                skipped += trial.skipped
                notes += trial.notes
            except RpctlError as fault:
                checks.append(_failed("motion on the ground", "the file in MuJoCo", fault))
    return MjcfCheck(file.path, certificate, compared.edits, tuple(checks), tuple(skipped), notes)


def same_model(robot: Robot, certificate: MjcfCertificate) -> bool:
    """Return whether a robot's model has the same numbers as the exported robot's."""
    return model_digest(robot) == certificate.model


def _collect(
    checks: list[Check], file: StrictMjcf, witness: Witness, rounding: float, against: str
) -> None:
    """Add the rows of a comparison; a comparison that cannot be made counts as failed."""
    try:
        checks += compare_with_witness(file.model, witness, rounding, against)
    except RpctlError as fault:
        checks.append(_failed(EQUATIONS, against, fault))


def _failed(name: str, against: str, fault: RpctlError) -> Check:
    return Check(name, against, float("inf"), 0.0, entry=str(fault))


def _identity_notes(robot: Robot, certificate: MjcfCertificate, given: bool) -> tuple[str, ...]:
    """Return sentences on how the robot differs from the exported one."""
    if not given:
        return ()
    if robot.description.sha256 != certificate.urdf:
        return (f"the URDF of {robot.name} is not the one that the file was written from",)
    if not same_model(robot, certificate):
        return (f"{robot.name} was loaded with other options than the robot of the file",)
    return ()
