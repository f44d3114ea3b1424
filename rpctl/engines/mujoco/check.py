"""``check_file``: whether an exported file still is the robot that it was written of."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rpctl.engines.mujoco.edits import Edit, compare_tables
from rpctl.engines.mujoco.mjcf_certificate import MjcfCertificate, find_certificate
from rpctl.engines.mujoco.strict_mjcf import StrictMjcf, read_mjcf
from rpctl.engines.mujoco.trial import run_on_ground
from rpctl.engines.mujoco.witness import Witness, compare_with_witness, take_witness
from rpctl.equivalence.row import Check, Skipped
from rpctl.errors import RpctlError
from rpctl.robot.identity import model_digest
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

EQUATIONS = "equations"  # the row of a model that lacks a part of the robot
FRESH_SEED = 1  # of states other than those that the file holds
ROUNDED_NOTE = (
    "{count} numbers are rounded by at most {largest:.1e} of their size, as MuJoCo's own save does"
)


@dataclass(frozen=True)
class MjcfCheck:
    """The outcome of a check.

    Attributes:
        path: The file.
        certificate: What the file says of itself.
        edits: What was edited since it was written.
        checks: The comparisons that were made anew.
        skipped: Those that could not be, and why.
        notes: What else there is to say.
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
        """Return it as plain values for JSON."""
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
        RpctlError: It is no file that rpctl exported.
    """
    file = read_mjcf(path)
    return file, find_certificate(file.texts, path)


def check_file(
    file: StrictMjcf, certificate: MjcfCertificate, robot: Robot | None, given: bool = False
) -> MjcfCheck:
    """Prove an exported file again, and name what was edited.

    Args:
        file: The file.
        certificate: Its certificate.
        robot: The robot, to compare with anew; None: only with the numbers that the file holds.
        given: Whether the user gave the robot, so that it may be another one.
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
        skipped.append(Skipped("the robot itself", "reduced model", "its URDF is not known here"))
    else:
        notes += _identity_notes(robot, certificate, given)
        root = certificate.witness.root
        losses = bool(certificate.settings.get("losses", True))
        fresh = take_witness(robot, root, losses, seed=FRESH_SEED)
        _collect(checks, file, fresh, rounding, f"{robot.name} anew")
        if all(check.name != EQUATIONS for check in checks):  # every name of the robot is there
            try:
                trial = run_on_ground(robot if losses else without_losses(robot), file.model, root)
                checks += trial.checks
                skipped += trial.skipped
                notes += trial.notes
            except RpctlError as fault:
                checks.append(_failed("motion on the ground", "the file in MuJoCo", fault))
    return MjcfCheck(file.path, certificate, compared.edits, tuple(checks), tuple(skipped), notes)


def same_model(robot: Robot, certificate: MjcfCertificate) -> bool:
    """Return whether a robot has the numbers of the one that was exported."""
    return model_digest(robot) == certificate.model


def _collect(
    checks: list[Check], file: StrictMjcf, witness: Witness, rounding: float, against: str
) -> None:
    """Add the rows of a comparison; one that cannot be made fails."""
    try:
        checks += compare_with_witness(file.model, witness, rounding, against)
    except RpctlError as fault:
        checks.append(_failed(EQUATIONS, against, fault))


def _failed(name: str, against: str, fault: RpctlError) -> Check:
    return Check(name, against, float("inf"), 0.0, entry=str(fault))


def _identity_notes(robot: Robot, certificate: MjcfCertificate, given: bool) -> tuple[str, ...]:
    """Return what tells the robot from the one that was exported."""
    if not given:
        return ()
    if robot.description.sha256 != certificate.urdf:
        return (f"the URDF of {robot.name} is not the one that the file was written of",)
    if not same_model(robot, certificate):
        return (f"{robot.name} was loaded with other options than the robot of the file",)
    return ()
