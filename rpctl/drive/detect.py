"""Detection of the drive from the wheels of a description, with the evidence for it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description
from rpctl.drive.assemble import assemble
from rpctl.drive.controls import PLANAR, BaseControl, plugin_controls
from rpctl.drive.drive import FIXED_BASE, POWERED_CASTERS, Drive, DriveSpec
from rpctl.drive.evidence import Evidence, gather_evidence
from rpctl.drive.leftovers import explain_leftovers, lock_option
from rpctl.drive.no_drive import (
    drive_file_draft,
    explain_no_drive,
    explain_unknown_radius,
    fixed_swivels,
    misaligned_axes,
    upright_spinners,
    wheels_on_fixed_joints,
)
from rpctl.drive.wheels import (
    SwivelCandidate,
    WheelCandidate,
    find_candidates,
    has_mecanum_rollers,
    parallel,
)
from rpctl.errors import DriveError, require_known

MAX_RADIUS_RATIO = 1.1  # of the wheels of a skid-steer drive, if nothing tells that it is one
MECANUM, SKID_STEER = "mecanum", "skid-steer"
MADE_FOR = {  # type of the drive that a control is made for: that of parallel wheels
    "mecanum": MECANUM,
    "omni": MECANUM,
    "skid-steer": SKID_STEER,
    "differential": SKID_STEER,
}
MECANUM_ROBOTS = ("youbot",)  # whose files give neither rollers nor a word of them
CHOICE = "say --drive skid-steer or --drive mecanum"


def detect(
    tree: FrozenTree,
    spec: DriveSpec | None = None,
    controls: tuple[BaseControl, ...] | None = None,
    free: Collection[str] = (),
) -> Drive:
    """Find the drive of a robot.

    The type follows from the number of wheels, the lines that their axles lie on, and the upright
    joints that steer. Rollers, names and plugins distinguish mecanum from skid-steer wheels. What
    looks like a wheel and is none of the drive's is refused.

    Args:
        tree: The robot, with its locked joints.
        controls: Plugins and controllers of the base; the file's plugins if None.

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
    controls = plugin_controls(tree.description) if controls is None else controls
    evidence = gather_evidence(tree, candidates, spec, controls, free)
    if spec.type is None and _is_arm(evidence):
        return _fixed(evidence)
    if not spec.wheels:
        _refuse_crossed_axes(evidence)
    if spec.type is None:
        _refuse_swivels_of_mecanum_wheels(evidence)
    kind = spec.type or _kind(evidence)
    if evidence.grounded.sizeless:
        raise DriveError(explain_unknown_radius(evidence, kind))
    if kind is None or not _fits(kind, evidence):
        raise DriveError(explain_no_drive(evidence, spec.type))
    if evidence.leftovers and not spec.wheels:
        raise DriveError(explain_leftovers(tree, kind, evidence.leftovers))
    return _explained(assemble(kind, evidence), evidence)


def _refuse_crossed_axes(evidence: Evidence) -> None:
    path = evidence.description.path
    crossed = misaligned_axes(evidence.tree, evidence.grounded.wheels)
    if crossed:
        raise DriveError(
            f"{path}: the joints of wheels turn across their cylinders' axles; "
            f"give {', '.join(crossed)}, or name the wheels in a drive file"
            f"{drive_file_draft(evidence, None)}"
        )


def _explained(drive: Drive, evidence: Evidence) -> Drive:
    """Return a drive with the evidence for its type, and its doubts, where geometry has neither."""
    if evidence.leftovers:
        names = ", ".join(each.joint.name for each in evidence.leftovers)
        doubt = f"{names}: not among the wheels that the drive file names, so taken for an arm's"
        drive = replace(drive, doubts=(*drive.doubts, doubt))
    drive = replace(drive, doubts=(*drive.doubts, *_held_by_fixed_joints(evidence)))
    if evidence.spec.type is not None or evidence.steered or len(evidence.pairs) < 2:
        return drive
    found = parallel_kind(evidence)
    if found.kind != drive.type:
        return drive
    why = (f"{drive.type}: {found.why}",) if found.why else ()
    doubts = (found.doubt,) if found.doubt else ()
    return replace(drive, evidence=(*why, *drive.evidence), doubts=(*doubts, *drive.doubts))


def _held_by_fixed_joints(evidence: Evidence) -> Iterator[str]:
    """Yield the doubts about wheels that fixed joints keep from rolling, or from steering."""
    tree, wheels = evidence.tree, evidence.grounded.wheels
    still = wheels_on_fixed_joints(tree, wheels)
    if still:
        yield (
            "what looks like further wheels on the ground is held by fixed joints, so it slides; "
            f"make {'; '.join(still)}, or call it a caster"
        )
    straight = fixed_swivels(tree, [wheel.joint for wheel in wheels])
    if straight and not mecanum_evidence(evidence):
        yield (
            "wheels hang on fixed joints that are called steering or casters, or have an upright "
            "<axis>; make "
            f"{'; '.join(straight)}"
        )


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
        several = "bicycle" if not pairs else "articulated" if steered[0].body else "tricycle"
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
        "articulated": len(pairs) > 0 and len(steered) == 1 and steered[0].trails,
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
    tree = evidence.tree
    return moving and not (wheels_on_fixed_joints(tree) or upright_spinners(tree))


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
    require_known("wheel joint", spec.wheels, description.joint)
    fit = {candidate.joint.name: candidate for candidate in candidates}
    for name in spec.wheels.keys() - fit.keys():
        joint = description.joint[name]
        raise DriveError(
            f'{description.path}:{joint.line}: joint "{name}" cannot carry a wheel: it has to be '
            "continuous, about a level axis, and held by the root link, rigidly or by one upright "
            "joint"
        )
    return [candidate for candidate in candidates if candidate.joint.name in spec.wheels]


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
        doubt = (
            f"the wheels are taken for mecanum wheels, for {_control_name(planar)} moves the base "
        )
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
            yield kind, f"{_control_name(control)} is made for {control.kind} drives"


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


def _control_name(control: BaseControl) -> str:
    return control.label + (f" (line {control.line})" if control.line is not None else "")


def swivels_of_mecanum_wheels(evidence: Evidence) -> tuple[SwivelCandidate, ...]:
    """Return the swivels, if they carry all wheels, and something tells of mecanum wheels."""
    carried = {wheel.joint.name for swivel in evidence.swivels for wheel in swivel.wheels}
    whole = len(carried) == len(evidence.grounded.wheels) == 4
    return evidence.swivels if whole and mecanum_evidence(evidence) else ()
