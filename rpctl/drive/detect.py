"""Detection of the drive from the wheels of a description, with the evidence for it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description
from rpctl.drive.assemble import assemble
from rpctl.drive.drive import FIXED_BASE, POWERED_CASTERS, Drive
from rpctl.drive.drive_file import DriveSpec
from rpctl.drive.evidence import Evidence, gather_evidence
from rpctl.drive.leftovers import explain_leftovers, lock_option
from rpctl.drive.near_misses import misaligned_axes, wheels_on_fixed_joints
from rpctl.drive.no_drive_message import explain_no_drive
from rpctl.drive.parallel_wheels import (
    mecanum_evidence,
    parallel_kind,
    swivels_of_mecanum_wheels,
)
from rpctl.drive.plugins import SimulatorTags, read_simulator_tags
from rpctl.drive.wheels import WheelCandidate, find_candidates, parallel
from rpctl.errors import DriveError, UnknownNameError

MAX_RADIUS_RATIO = 1.1  # of the wheels of a skid-steer drive, if nothing tells that it is one


def detect(
    tree: FrozenTree,
    spec: DriveSpec | None = None,
    tags: SimulatorTags | None = None,
    free: Collection[str] = (),
) -> Drive:
    """Find the drive of a robot.

    A wheel turns without limits about a level axle, is held by the root link, rigidly or through
    one upright joint, and reaches the ground. The type follows from the number of wheels, the
    lines that their axles lie on, and the upright joints that steer. Rollers, names and plugins
    distinguish mecanum from skid-steer wheels, and without any they are skid-steer. What looks
    like a wheel and is none of the drive's is refused.

    Args:
        tree: The robot, with its locked joints.
        spec: What the user says of the drive.
        tags: What the file tells simulators and controllers; read from it if None.
        free: Names of joints that are no wheels.

    Returns:
        The drive, with its evidence and its doubts.

    Raises:
        DriveError: No wheels fit, or nothing tells which drive they are; every candidate is named.
        UnknownNameError: A joint that the specification names is not known.
    """
    spec = spec or DriveSpec()
    if spec.type == "fixed":
        return FIXED_BASE
    candidates = find_candidates(tree, spec.wheels)
    if spec.wheels:
        candidates = _named(tree.description, candidates, spec)
    tags = read_simulator_tags(tree.description) if tags is None else tags
    evidence = gather_evidence(tree, candidates, spec, tags, free)
    if spec.type is None and _is_arm(evidence):
        return _fixed(evidence)
    crossed = [] if spec.wheels else misaligned_axes(tree, evidence.grounded.wheels)
    if crossed:
        raise DriveError(
            f"{tree.description.path}: the joints of wheels turn across their cylinders' axles; "
            f"give {', '.join(crossed)}, or name the wheels in a drive file"
        )
    if spec.type is None:
        _refuse_swivels_of_mecanum_wheels(evidence)
    kind = spec.type or _kind(evidence)
    if kind is None or not _fits(kind, evidence):
        raise DriveError(explain_no_drive(evidence, spec.type))
    if evidence.leftovers and not spec.wheels:
        raise DriveError(explain_leftovers(tree, kind, evidence.leftovers))
    return _explained(assemble(kind, evidence), evidence)


def _explained(drive: Drive, evidence: Evidence) -> Drive:
    """Return a drive with the evidence for its type, and its doubts, where geometry has neither."""
    if evidence.leftovers:
        names = ", ".join(each.joint.name for each in evidence.leftovers)
        doubt = f"{names}: not among the wheels that the drive file names, so taken for an arm's"
        drive = replace(drive, doubts=(*drive.doubts, doubt))
    if evidence.spec.type is not None or evidence.steered or len(evidence.pairs) < 2:
        return drive
    found = parallel_kind(evidence)
    if found.kind != drive.type:
        return drive
    why = (f"{drive.type}: {found.why}",) if found.why else ()
    doubts = (found.doubt,) if found.doubt else ()
    return replace(drive, evidence=(*why, *drive.evidence), doubts=(*doubts, *drive.doubts))


def _refuse_swivels_of_mecanum_wheels(evidence: Evidence) -> None:
    """Refuse swivels under wheels that are called mecanum wheels: one of the two is wrong.

    Raises:
        DriveError: Naming what holds the swivels, and what takes them for what they are.
    """
    swivels = swivels_of_mecanum_wheels(evidence)
    if swivels:
        names = [swivel.joint.name for swivel in swivels]
        kind = POWERED_CASTERS if evidence.trailing else "steered"
        raise DriveError(
            f"{evidence.description.path}:{swivels[0].joint.line}: each wheel turns on a swivel "
            f"({', '.join(names)}), yet {mecanum_evidence(evidence)}, mecanum wheels, which need "
            f"none; say which it is:\n  {lock_option(evidence.tree, names)} --drive mecanum\n"
            f"  --drive {kind}"
        )


def _kind(evidence: Evidence) -> str | None:
    """Return the type of drive that the wheels make, or None."""
    fixed, pairs, steered = evidence.fixed, evidence.pairs, evidence.steered
    if evidence.trailing and evidence.powered:
        return POWERED_CASTERS
    aligned = all(parallel(fixed[0], wheel) for wheel in fixed)
    if steered and not fixed:
        return "steered" if len(steered) > 1 else None
    if steered:
        several = "tricycle" if pairs else "bicycle"
        return (several if len(steered) == 1 else "car-like") if aligned else None
    if len(fixed) > 2 and not aligned and not _passive(evidence):
        return "omni"
    if len(pairs) > 1:
        found = parallel_kind(evidence)
        certain = found.why or _are_alike(evidence)
        return found.kind if certain and _fits(found.kind, evidence) else None
    return "differential" if pairs else None


def _are_alike(evidence: Evidence) -> bool:
    """Return whether the wheels are of one size, and either all driven or none said to be."""
    radii = [wheel.radius or 0.0 for wheel in evidence.fixed]
    driven = {wheel.joint.name in evidence.actuated for wheel in evidence.fixed}
    return len(driven) == 1 and max(radii) <= MAX_RADIUS_RATIO * min(radii)


def _passive(evidence: Evidence) -> bool:
    """Return whether the wheels off the one pair's axle are left without a drive, as casters."""
    driven = [w for w in evidence.fixed if w.joint.name in evidence.actuated]
    return len(evidence.pairs) == 1 and 0 < len(driven) < 3


def _fits(kind: str, evidence: Evidence) -> bool:
    """Return whether there are the wheels that a drive of a type needs."""
    fixed, pairs, steered = evidence.fixed, evidence.pairs, evidence.steered
    needs = {
        "differential": len(pairs) == 1 and not steered,
        "skid-steer": len(pairs) > 1 and not steered,
        "mecanum": len(pairs) == 2 and len(fixed) == 4 and not steered,
        "omni": len(fixed) > 2 and not steered,
        "bicycle": len(fixed) > 0 and len(steered) == 1,
        "tricycle": len(pairs) > 0 and len(steered) == 1,
        "car-like": len(fixed) > 0 and len(steered) > 1,
        "steered": not fixed and len(steered) > 1,
        POWERED_CASTERS: evidence.trailing,
    }
    return needs[kind]


def _is_arm(evidence: Evidence) -> bool:
    """Return whether joints move, and nothing is, or looks like, a wheel."""
    if evidence.grounded.wheels or evidence.leftovers:
        return False
    moving = any(joint.moving for joint in evidence.description.joints)
    return moving and not wheels_on_fixed_joints(evidence.tree)


def _fixed(evidence: Evidence) -> Drive:
    rejected = "".join(f"{reason}; " for reason in evidence.grounded.rejected)
    doubt = (
        "no joint could carry a wheel, so the base is taken for fixed: say --drive fixed if it is; "
        f'{rejected}a wheel\'s joint is type="continuous", about a level axis, held by the root '
        f'link "{evidence.description.root}" or by an upright joint of it'
    )
    return Drive("fixed", doubts=(doubt,))


def _named(
    description: Description, candidates: list[WheelCandidate], spec: DriveSpec
) -> list[WheelCandidate]:
    """Return the candidates that a specification names.

    Raises:
        UnknownNameError: A joint is not known.
        DriveError: A joint cannot carry a wheel.
    """
    for name in spec.wheels:
        if name not in description.joint:
            raise UnknownNameError("wheel joint", name, description.joint)
    fit = {candidate.joint.name: candidate for candidate in candidates}
    for name in spec.wheels.keys() - fit.keys():
        joint = description.joint[name]
        raise DriveError(
            f'{description.path}:{joint.line}: joint "{name}" cannot carry a wheel: it has to be '
            "continuous, about a level axis, and held by the root link, rigidly or by one upright "
            "joint"
        )
    return [candidate for candidate in candidates if candidate.joint.name in spec.wheels]
