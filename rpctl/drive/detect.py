"""Detection of the drive from the wheels of a description, with the evidence for it."""

from __future__ import annotations

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description
from rpctl.drive.assemble import assemble
from rpctl.drive.drive import FIXED_BASE, POWERED_CASTERS, Drive
from rpctl.drive.drive_file import DriveSpec
from rpctl.drive.evidence import Evidence, gather_evidence
from rpctl.drive.near_misses import misaligned_axes, wheels_on_fixed_joints
from rpctl.drive.no_drive_message import explain_no_drive
from rpctl.drive.wheels import WheelCandidate, find_candidates, parallel
from rpctl.errors import DriveError, UnknownNameError

MECANUM = "mecanum"  # only this word distinguishes four such wheels from four ordinary ones


def detect(tree: FrozenTree, spec: DriveSpec | None = None) -> Drive:
    """Find the drive of a robot.

    A wheel turns without limits about a level axle, is held by the root link, rigidly or through
    one upright joint, and reaches the ground. The type follows from the number of wheels, the
    lines that their axles lie on, and the upright joints that steer. Only a name distinguishes
    mecanum from skid-steer wheels in a URDF; without one the specification has to.

    Args:
        tree: The robot, with its locked joints.
        spec: What the user says of the drive.

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
    evidence = gather_evidence(tree, candidates, spec)
    if spec.type is None and _is_arm(evidence):
        return _fixed(evidence)
    crossed = [] if spec.wheels else misaligned_axes(tree, evidence.grounded.wheels)
    if crossed:
        raise DriveError(
            f"{tree.description.path}: the joints of wheels turn across their cylinders' axles; "
            f"give {', '.join(crossed)}, or name the wheels in a drive file"
        )
    kind = spec.type or _kind(evidence)
    if kind is None or not _fits(kind, evidence):
        raise DriveError(explain_no_drive(evidence, spec.type))
    return assemble(kind, evidence)


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
        return MECANUM if _mentions(evidence, MECANUM) else None
    return "differential" if pairs else None


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


def _mentions(evidence: Evidence, word: str) -> bool:
    """Return whether a wheel's names or meshes mention a word."""
    links = [evidence.description.link[wheel.joint.child] for wheel in evidence.fixed]
    names = [wheel.joint.name for wheel in evidence.fixed] + [link.name for link in links]
    names += [shape.mesh or "" for link in links for shape in link.visuals + link.collisions]
    return any(word in name.lower() for name in (*names, evidence.description.name))


def _is_arm(evidence: Evidence) -> bool:
    """Return whether joints move, and nothing is, or looks like, a wheel."""
    if evidence.grounded.wheels or evidence.near_miss_notes:
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
