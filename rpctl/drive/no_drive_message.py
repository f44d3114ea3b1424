"""The error message for a robot without a detectable drive: evidence found, and a fix."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from rpctl.description.frozen_tree import MAX_TILT_SINE
from rpctl.drive.drive import POWERED_CASTERS
from rpctl.drive.drive_file import suggest
from rpctl.drive.evidence import Evidence
from rpctl.drive.leftovers import lock_option
from rpctl.drive.near_misses import format_vector, wheels_on_fixed_joints
from rpctl.drive.wheels import WheelCandidate, mostly_left, parallel

MAX_LISTED = 8  # pairs or joints that a message lists
NEEDS = {
    "differential": "one pair of wheels on one axle, held by the root link, and none steered",
    "skid-steer": "two or more pairs of wheels, held by the root link, and none steered",
    "mecanum": "two pairs of wheels, held by the root link, and none steered",
    "omni": "three or more wheels, held by the root link, and none steered",
    "bicycle": "a wheel that the root link holds, and a steered one",
    "tricycle": "a pair of wheels that the root link holds, and a steered wheel",
    "car-like": "wheels that the root link holds, and two or more steered ones",
    "steered": "two or more steered wheels, and none that the root link holds",
    POWERED_CASTERS: "wheels that all trail upright joints, and none that the root link holds",
}
UNSTEERED = ("differential", "skid-steer", "mecanum", "omni")


def explain_no_drive(evidence: Evidence, kind: str | None) -> str:
    """Return why no drive was found, and what to write to have one.

    Args:
        evidence: The wheels.
        kind: Type of the drive that was asked for, or None.
    """
    grounded = evidence.grounded
    message = f"{evidence.description.path}: no {kind or 'known'} drive: "
    if kind is not None:
        message += f"it takes {NEEDS[kind]}; "
    if evidence.pairs or evidence.swivels:
        message += _counts(evidence)
    elif grounded.wheels:
        message += (
            f"no two wheels share one axle; joints on a level axis: {_wheel_places(evidence)}"
        )
    else:
        message += "no joint could carry a wheel"
    message += "".join(f"; {reason}" for reason in grounded.rejected)
    fix = _fixes(evidence)
    if fix:
        arm = "" if grounded.wheels else "; or say --drive fixed for an arm"
        return f"{message}; {fix}{arm}"
    if not grounded.wheels:
        return (
            f"{message}; it needs continuous joints about level axles that reach the ground, held "
            f'by the root link "{evidence.description.root}"; make the wheels\' joints '
            'type="continuous" with the axle as <axis>, or say --drive fixed for an arm'
        )
    if kind in UNSTEERED and evidence.steered:
        names = [swivel.joint.name for swivel in evidence.steered]
        message += f"; {lock_option(evidence.tree, names)} holds what steers"
    if kind is None and evidence.trailing:
        message += (
            "; all of them trail, and nothing tells that motors drive them: say --drive "
            f"{POWERED_CASTERS} if motors do"
        )
    if kind is None and len(evidence.pairs) > 1 and not evidence.steered:
        message += "; nothing in a URDF tells skid-steer from mecanum wheels"
    return (
        f"{message}; say which it is, a drive file to start from (--drive FILE):\n"
        + _drive_file_draft(evidence, kind)
    )


def _counts(evidence: Evidence) -> str:
    """Return the pairs and the swivels, in words."""
    pairs = evidence.pairs
    listed = "; ".join(" + ".join(w.joint.name for w in pair) for pair in pairs[:MAX_LISTED])
    axles = f"{len(pairs)} pair{'s' * (len(pairs) != 1)} of wheels on one axle"
    axles += f" ({listed})" if pairs else ""
    lone = [line[0].joint.name for line in evidence.lines if len(line) == 1]
    axles += f", on their own: {', '.join(lone[:MAX_LISTED])}" if lone else ""
    turning = [f"{s.joint.name} ({s.role})" for s in evidence.swivels[:MAX_LISTED]]
    return axles + (f", wheels on swivels: {', '.join(turning)}" if turning else "")


def _wheel_places(evidence: Evidence) -> str:
    return ", ".join(
        f'"{c.joint.name}" (line {c.joint.line}, axle {(np.round(c.axle, 3) + 0.0).tolist()} '
        f"at {(np.round(c.origin, 3) + 0.0).tolist()})"
        for c in evidence.grounded.wheels[:MAX_LISTED]
    )


def _fixes(evidence: Evidence) -> str:
    """Return changes to the URDF or the options that would let a drive be detected, or nothing."""
    ways = _turned_axes(evidence.fixed) if not evidence.pairs else []
    still = [] if evidence.pairs else wheels_on_fixed_joints(evidence.tree)
    if still:
        ways.append(f"wheels are held by fixed joints; make {'; '.join(still)}")
    left = evidence.leftovers
    ways += [f'"{each.joint.name}" {each.why}; {each.edit}' for each in left if each.edit]
    holding = dict.fromkeys(name for each in left for name in each.hold)
    if holding:
        hanging = ", ".join(each.joint.name for each in left if each.hold)
        ways.append(
            f"{hanging} hang on joints that can move; hold these: "
            f"{lock_option(evidence.tree, list(holding))}"
        )
    return "; ".join(ways)


def _turned_axes(candidates: tuple[WheelCandidate, ...]) -> list[str]:
    """Return what to write where the axles of two wheels lie across the line that joins them."""
    advice = []
    for a, b in combinations(candidates, 2):
        line = a.origin - b.origin
        line = line / (np.linalg.norm(line) or 1.0)
        if parallel(a, b) and max(abs(float(a.axle @ line)), abs(line[2])) < MAX_TILT_SINE:
            left = line if mostly_left(line) > 0 else -line
            axes = (
                f'"{c.joint.name}" <axis xyz="{format_vector(c.frame.T @ left)}"/>' for c in (a, b)
            )
            advice.append(
                f"their axles lie across the line that joins them: give {', '.join(axes)}"
            )
    return advice


def _drive_file_draft(evidence: Evidence, kind: str | None) -> str:
    """Return a drive file of what was found."""
    roles = {swivel.joint.name: swivel.role for swivel in evidence.swivels}
    guess = "skid-steer" if len(evidence.pairs) > 1 else "differential"
    swivelling = POWERED_CASTERS if evidence.trailing else "steered"
    guess = guess if evidence.pairs else swivelling
    wheels = {wheel.joint.name: wheel.radius for wheel in evidence.grounded.wheels}
    return suggest(kind or guess, wheels, roles)
