"""Which drive parallel wheels make, that a URDF's geometry does not tell: skid-steer or mecanum."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rpctl.drive.evidence import Evidence
from rpctl.drive.plugins import PLANAR, BaseControl
from rpctl.drive.rollers import has_mecanum_rollers
from rpctl.drive.swivels import SwivelCandidate
from rpctl.errors import DriveError

MECANUM, SKID_STEER = "mecanum", "skid-steer"
MADE_FOR = {  # type of the drive that a control is made for: that of parallel wheels
    "mecanum": MECANUM,
    "omni": MECANUM,
    "skid-steer": SKID_STEER,
    "differential": SKID_STEER,
}
MECANUM_ROBOTS = ("youbot",)  # whose files give neither rollers nor a word of them
CHOICE = "say --drive skid-steer or --drive mecanum"


@dataclass(frozen=True)
class ParallelKind:
    """What parallel wheels are.

    Attributes:
        kind: ``"skid-steer"`` or ``"mecanum"``.
        why: The evidence, in words; empty if there is none.
        doubt: What was assumed, and how to say otherwise; empty if nothing was.
    """

    kind: str
    why: str = ""
    doubt: str = ""


def parallel_kind(evidence: Evidence) -> ParallelKind:
    """Return what two or more pairs of parallel wheels are, and why.

    Rollers, names of wheels and their meshes, and plugins and controllers tell. A plugin that
    moves the base any way is weak evidence for mecanum wheels; without any the wheels are taken
    for ordinary ones.

    Args:
        evidence: The wheels.

    Raises:
        DriveError: One part of the file says mecanum and another skid-steer.
    """
    told: dict[str, str] = {}
    for kind, why in _told(evidence):
        told.setdefault(kind, why)
    if len(told) > 1:
        path = evidence.description.path
        raise DriveError(
            f"{path}: the file says two things of its wheels: {told[MECANUM]}, but "
            f"{told[SKID_STEER]}; {CHOICE}"
        )
    for kind, why in told.items():
        return ParallelKind(kind, why)
    planar = next((c for c in evidence.controls if c.kind == PLANAR), None)
    if planar is not None and len(evidence.fixed) == 4:
        doubt = f"the wheels are taken for mecanum wheels, for {_named(planar)} moves the base "
        return ParallelKind(MECANUM, doubt=f"{doubt}any way; {CHOICE}")
    return ParallelKind(
        SKID_STEER,
        doubt=f"{len(evidence.fixed)} parallel wheels are taken for ordinary ones, skid-steer: "
        f"nothing in the file tells of rollers; {CHOICE}",
    )


def mecanum_evidence(evidence: Evidence) -> str:
    """Return what tells of mecanum wheels, in words, or nothing."""
    return next((why for kind, why in _told(evidence) if kind == MECANUM), "")


def _told(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Yield each kind that something in the file tells, and what."""
    for wheel in evidence.grounded.wheels:
        if has_mecanum_rollers(evidence.tree, wheel):
            yield MECANUM, f'the rollers of "{wheel.joint.name}" lie askew to its axle'
    word = _mention(evidence)
    if word:
        yield MECANUM, word
    for control in evidence.controls:
        if control.kind in MADE_FOR:
            kind = MADE_FOR[control.kind]
            yield kind, f"{_named(control)} is made for {control.kind} drives"


def _mention(evidence: Evidence) -> str:
    """Return the name that mentions mecanum wheels, in words, or nothing.

    Omni wheels with parallel axles are such, as makers call them; and what rolls on a wheel is.
    """
    links = [evidence.description.link[w.joint.child] for w in evidence.grounded.wheels]
    meshes = [s.mesh or "" for link in links for s in link.visuals + link.collisions]
    names = [wheel.joint.name for wheel in evidence.grounded.wheels]
    names += [link.name for link in links]
    for name in (*names, *meshes, evidence.description.name):
        if MECANUM in name.lower():
            return f'the name "{name}" mentions them'
    for name in (*names, *(mesh.rpartition("/")[2] for mesh in meshes)):
        if "omni" in name.lower():
            return f'the name "{name}" mentions them'
    for wheel in evidence.grounded.wheels:
        for name, _ in evidence.tree.rigid_links(wheel.joint.child):
            if "roller" in name.lower() and name != wheel.joint.child:
                return f'"{wheel.joint.name}" has rollers, such as "{name}"'
    robot = evidence.description.name.lower()
    if any(known in robot for known in MECANUM_ROBOTS):
        return f'the robot "{evidence.description.name}" is known for them'
    return ""


def _named(control: BaseControl) -> str:
    return control.label + (f" (line {control.line})" if control.line is not None else "")


def swivels_of_mecanum_wheels(evidence: Evidence) -> tuple[SwivelCandidate, ...]:
    """Return the swivels, if they carry all wheels, and something tells of mecanum wheels."""
    carried = {wheel.joint.name for swivel in evidence.swivels for wheel in swivel.wheels}
    whole = len(carried) == len(evidence.grounded.wheels) == 4
    return evidence.swivels if whole and mecanum_evidence(evidence) else ()
