"""Detection of the drive from the wheels of a description, with the evidence for it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

from rpctl.description.frozen_tree import FrozenTree
from rpctl.drive.assemble import assemble
from rpctl.drive.controls import PLANAR, BaseControl, plugin_controls
from rpctl.drive.drive import (
    FIXED_BASE,
    LEANING,
    POWERED_CASTERS,
    SELF_BALANCING,
    Drive,
    DriveSpec,
)
from rpctl.drive.evidence import Evidence, gather_evidence
from rpctl.drive.leaning import find_leaning
from rpctl.drive.leftovers import explain_leftovers, lock_option
from rpctl.drive.no_drive import (
    drive_file_draft,
    explain_no_drive,
    explain_unknown_radius,
    fits,
    fixed_swivels,
    misaligned_axes,
    upright_spinners,
    wheels_on_fixed_joints,
)
from rpctl.drive.wheels import has_mecanum_rollers, parallel
from rpctl.errors import DriveError

MAX_RADIUS_RATIO = 1.1  # of the wheels of a skid-steer drive, if nothing tells that it is one
MECANUM, SKID_STEER = "mecanum", "skid-steer"
MADE_FOR = {  # type of the drive that a control is made for: that of parallel wheels
    "mecanum": MECANUM,
    "omni": MECANUM,
    "skid-steer": SKID_STEER,
    "differential": SKID_STEER,
}
MECANUM_ROBOTS = ("youbot",)  # whose files give neither rollers nor a word of them
ONE_AXLE = "differential", "bicycle"  # drives that two wheels make
FREE = "free"  # the root of one that leans
NO_LEANING = (
    "not a robot that leans: on a free root only two wheels may touch the ground, on one axle, "
    "at the ends of legs, or one behind the other with a joint that steers"
)
CHOICE = "give --drive skid-steer or --drive mecanum"


def detect(
    tree: FrozenTree,
    spec: DriveSpec | None = None,
    controls: tuple[BaseControl, ...] | None = None,
    free: Collection[str] = (),
    root: str | None = None,
) -> Drive:
    """Find the drive of a robot.

    The type follows from the number of wheels, the lines that their axles lie on, and the upright
    joints that steer. Rollers, names and plugins distinguish mecanum from skid-steer wheels. What
    looks like a wheel and is none of the drive's is refused.

    Args:
        tree: The robot, with its locked joints.
        controls: Plugins and controllers of the base; the file's plugins if None.
        root: ``"planar"`` keeps the root link level, ``"free"`` lets it lean; None: as it stands.

    Raises:
        DriveError: No wheels fit, or nothing tells which drive they are; every candidate is named.
        UnknownNameError: A joint that the specification names is not known.
    """
    spec = spec or DriveSpec()
    if spec.type == "fixed":
        return FIXED_BASE
    if spec.type in LEANING or root == FREE:
        drive = find_leaning(tree, spec, asked=True)
        if drive is None or spec.type not in (None, drive.type):
            found = f"it is a {drive.type} robot" if drive else NO_LEANING
            raise DriveError(f"{tree.description.path}: {found}; leave out --root and --drive")
        return drive
    controls = plugin_controls(tree.description) if controls is None else controls
    try:
        level = _level(tree, spec, controls, free)
    except DriveError:
        drive = None if spec.type or root else find_leaning(tree, spec)
        if drive is None or drive.type == SELF_BALANCING:
            raise
        return drive
    if spec.type or root or controls or level.type not in ONE_AXLE or len(level.wheels) != 2:
        return level
    return find_leaning(tree, spec) or level


def _level(
    tree: FrozenTree,
    spec: DriveSpec,
    controls: tuple[BaseControl, ...],
    free: Collection[str],
) -> Drive:
    """Return the drive of a robot whose root link stays level; see :func:`detect`."""
    evidence = gather_evidence(tree, spec, controls, free)
    if spec.type is None and _is_arm(evidence):
        return _fixed(evidence)
    crossed = [] if spec.wheels else misaligned_axes(tree, evidence.grounded.wheels)
    if crossed:
        raise DriveError(
            f"{tree.description.path}: the joints of wheels turn across their cylinders' axles; "
            f"give {', '.join(crossed)}, or name the wheels in a drive file"
            f"{drive_file_draft(evidence, None)}"
        )
    if spec.type is None:
        _refuse_swivels_of_mecanum_wheels(evidence)
    kind, why, doubt = (spec.type, "", "") if spec.type else _kind(evidence)
    if any(wheel.radius is None for wheel in evidence.grounded.wheels):
        raise DriveError(explain_unknown_radius(evidence, kind))
    if kind is None or not fits(kind, evidence):
        raise DriveError(explain_no_drive(evidence, spec.type))
    if evidence.leftovers and not spec.wheels:
        raise DriveError(explain_leftovers(tree, kind, evidence.leftovers))
    drive = assemble(kind, evidence)
    return replace(
        drive,
        evidence=(*filter(None, [why]), *drive.evidence),
        doubts=(*filter(None, [doubt]), *drive.doubts, *_unused(evidence)),
    )


def _unused(evidence: Evidence) -> Iterator[str]:
    """Yield the doubts about what is no wheel of the drive, or is kept from rolling or steering."""
    tree, wheels = evidence.tree, evidence.grounded.wheels
    if evidence.leftovers:
        names = ", ".join(each.joint.name for each in evidence.leftovers)
        yield (
            f"{names}: the drive file does not name them as wheels, so rpctl treats them as "
            "joints of an arm"
        )
    still = wheels_on_fixed_joints(tree, wheels)
    if still:
        yield (
            "further bodies that look like wheels on the ground are held by fixed joints, so they "
            f"slide; make {'; '.join(still)}, or name it a caster"
        )
    straight = fixed_swivels(tree, [wheel.joint for wheel in wheels])
    if straight and MECANUM not in _told(evidence):
        yield (
            "wheels hang on fixed joints that are called steering or casters, or have an upright "
            f"<axis>; make {'; '.join(straight)}"
        )


def _refuse_swivels_of_mecanum_wheels(evidence: Evidence) -> None:
    """Refuse swivels under all wheels that are called mecanum wheels: one of the two is wrong.

    Raises:
        DriveError: Naming what holds the swivels, and what takes them for what they are.
    """
    carried = sum(len(swivel.wheels) for swivel in evidence.swivels)
    told = _told(evidence).get(MECANUM)
    if told and carried == len(evidence.grounded.wheels) == 4:
        names = [swivel.joint.name for swivel in evidence.swivels]
        kind = POWERED_CASTERS if evidence.trailing else "steered"
        raise DriveError(
            f"{evidence.description.path}:{evidence.swivels[0].joint.line}: each wheel turns on a "
            f"swivel ({', '.join(names)}), yet {told}, mecanum wheels, which need none; choose "
            f"one:\n  {lock_option(evidence.tree, names)} --drive mecanum\n  --drive {kind}"
        )


def _kind(evidence: Evidence) -> tuple[str | None, str, str]:
    """Return the type of drive that the wheels make, or None.

    With it comes what tells it, in words, and what was assumed, where geometry does not settle it.

    Raises:
        DriveError: One part of the file says mecanum and another skid-steer.
    """
    fixed, steered = evidence.fixed, evidence.steered
    aligned = all(parallel(fixed[0], wheel) for wheel in fixed)
    driven = [wheel for wheel in fixed if wheel.joint.name in evidence.actuated]
    casters = len(evidence.pairs) == 1 and 0 < len(driven) < 3  # what is off the axle of a pair
    likely = {  # the first of them that the wheels are enough for
        POWERED_CASTERS: evidence.powered,
        "steered": True,
        "articulated": aligned and any(swivel.body for swivel in steered),
        "tricycle": aligned,
        "bicycle": aligned,
        "car-like": aligned,
        "omni": not aligned and not casters,
        "differential": True,
    }
    found = [kind for kind in likely if likely[kind] and fits(kind, evidence)]
    if found or not fits(SKID_STEER, evidence):
        return found[0] if found else None, "", ""
    kind, why, doubt = _parallel_kind(evidence)
    radii = [wheel.radius or 0.0 for wheel in fixed]
    alike = max(radii) <= MAX_RADIUS_RATIO * min(radii) and len(driven) in (0, len(fixed))
    return kind if why or alike else None, why, doubt


def _parallel_kind(evidence: Evidence) -> tuple[str, str, str]:
    """Return what two or more pairs of parallel wheels are, why, and what was assumed.

    Rollers, names of wheels and their meshes, and plugins and controllers tell. A plugin that
    moves the base any way is weak evidence for mecanum wheels; without any the wheels are taken
    for ordinary ones.

    Raises:
        DriveError: One part of the file says mecanum and another skid-steer.
    """
    told = _told(evidence)
    if len(told) > 1:
        path = evidence.description.path
        raise DriveError(
            f"{path}: the file contradicts itself about its wheels: {told[MECANUM]}, but "
            f"{told[SKID_STEER]}; {CHOICE}"
        )
    for kind, why in told.items():
        return kind, f"{kind}: {why}", ""
    count = len(evidence.fixed)
    planar = next((c for c in evidence.controls if c.kind == PLANAR), None)
    if planar is not None and count == 4:
        doubt = f"rpctl assumes mecanum wheels, because {_control_name(planar)} moves the "
        return MECANUM, "", f"{doubt}base any way; {CHOICE}"
    doubt = (
        f"{count} parallel wheels: rpctl assumes ordinary ones, skid-steer, as nothing in the file "
    )
    return SKID_STEER, "", f"{doubt}mentions rollers; {CHOICE}"


def _told(evidence: Evidence) -> dict[str, str]:
    """Return the types that something in the file tells, and what does so first."""
    return dict(reversed([*_hints(evidence)]))


def _hints(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Yield what tells a type of drive, the type first: rollers, names, plugins and controllers.

    Omni wheels with parallel axles are mecanum wheels, as makers call them; and what rolls on a
    wheel is one's.
    """
    tree, description, wheels = evidence.tree, evidence.description, evidence.grounded.wheels
    for wheel in wheels:
        if has_mecanum_rollers(tree, wheel):
            yield MECANUM, f'the rollers of "{wheel.joint.name}" are at an angle to its axle'
    links = [description.link[wheel.joint.child] for wheel in wheels]
    names = [*(wheel.joint.name for wheel in wheels), *(link.name for link in links)]
    meshes = [s.mesh or "" for link in links for s in link.visuals + link.collisions]
    files = [mesh.rpartition("/")[2] for mesh in meshes]
    for word, places in ((MECANUM, (*names, *meshes, description.name)), ("omni", names + files)):
        for name in places:
            if word in name.lower():
                yield MECANUM, f'the name "{name}" mentions them'
    for wheel in wheels:
        for name, _ in tree.rigid_links(wheel.joint.child):
            if "roller" in name.lower() and name != wheel.joint.child:
                yield MECANUM, f'"{wheel.joint.name}" has rollers, such as "{name}"'
    if any(known in description.name.lower() for known in MECANUM_ROBOTS):
        yield MECANUM, f'the robot "{description.name}" is known for them'
    for control in evidence.controls:
        if control.kind in MADE_FOR:
            label = _control_name(control)
            yield MADE_FOR[control.kind], f"{label} is made for {control.kind} drives"


def _control_name(control: BaseControl) -> str:
    return control.label + (f" (line {control.line})" if control.line is not None else "")


def _is_arm(evidence: Evidence) -> bool:
    """Return whether joints move, and nothing is, or looks like, a wheel."""
    tree, moving = evidence.tree, any(joint.moving for joint in evidence.description.joints)
    wheels = evidence.grounded.wheels or evidence.leftovers
    return moving and not (wheels or wheels_on_fixed_joints(tree) or upright_spinners(tree))


def _fixed(evidence: Evidence) -> Drive:
    rejected = "".join(f"{reason}; " for reason in evidence.grounded.rejected)
    doubt = (
        "no joint can carry a wheel, so rpctl assumes a fixed base: give --drive fixed if it is; "
        f'{rejected}a wheel\'s joint is type="continuous", about a level axis, held by the '
        f'root link "{evidence.description.root}" or by an upright joint of it'
    )
    return Drive("fixed", doubts=(doubt,))
