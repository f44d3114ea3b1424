"""What to tell a user whose robot's drive was not found: the evidence, and what to write."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from rpctl.description.records import Array, Description
from rpctl.robot.drive_file import suggest
from rpctl.robot.wheels import AXLE_TILT, Candidate, mostly_left

MANY = 8  # pairs or joints that a message lists
TOUCH = 5e-3  # m; wheels reach the ground together to within this


def why_not(
    description: Description,
    candidates: list[Candidate],
    pairs: list[tuple[Candidate, Candidate]],
    kind: str | None,
) -> str:
    """Return why no drive was found, and what to write to have one.

    Args:
        description: The robot.
        candidates: The joints that could carry wheels.
        pairs: Those that share an axle.
        kind: Type of the drive that was asked for, or None.
    """
    where = f"{description.path}: no {kind or 'differential'} drive"
    start = "a drive file to start from (--drive FILE):\n"
    if pairs:
        listed = "; ".join(f"{a.joint.name} + {b.joint.name}" for a, b in pairs[:MANY])
        two = kind in ("skid-steer", "mecanum")
        wanted = "it has two such axles" if two else "it has one such axle"
        axles = f"{len(pairs)} pair{'s' * (len(pairs) > 1)} of wheels on one axle ({listed})"
        names = dict.fromkeys(c.joint.name for pair in pairs[:MANY] for c in pair)
        guess = "mecanum" if "mecanum" in description.xml else "skid-steer"
        advice = suggest(guess if len(pairs) == 2 else "differential", names)
        return f"{where}: {axles}, where {wanted}; say which it is, {start}{advice}"
    if candidates:
        listed = ", ".join(
            f'"{c.joint.name}" (line {c.joint.line}, axle {np.round(c.axle, 3).tolist()} '
            f"at {np.round(c.origin, 3).tolist()})"
            for c in candidates[:MANY]
        )
        turned = "".join(_turned_axes(candidates))
        return f"{where}: no two wheels share one axle; joints on a level axis: {listed}{turned}"
    still = _still_wheels(description)
    if still:
        return f"{where}: wheels are held by fixed joints; make {'; '.join(still)}"
    return (
        f"{where}: it needs two continuous joints, held rigidly by the root link "
        f'"{description.root}", about one level axle; make the wheels\' joints '
        'type="continuous" with the axle as <axis>, or say --drive fixed for an arm'
    )


def _turned_axes(candidates: list[Candidate]) -> list[str]:
    """Return what to write where the axles of two wheels lie across the line that joins them."""
    advice = []
    for a, b in combinations(candidates, 2):
        line = a.origin - b.origin
        line = line / (np.linalg.norm(line) or 1.0)
        parallel = abs(float(a.axle @ b.axle)) > 1.0 - AXLE_TILT**2
        if parallel and abs(float(a.axle @ line)) < AXLE_TILT and abs(line[2]) < AXLE_TILT:
            left = line if mostly_left(line) > 0 else -line
            axes = (f'"{c.joint.name}" <axis xyz="{_triple(c.frame.T @ left)}"/>' for c in (a, b))
            advice.append(
                f"; their axles lie across the line that joins them: give {', '.join(axes)}"
            )
    return advice


def _still_wheels(description: Description) -> list[str]:
    """Return what to write for round links on fixed joints that reach as low as any link does."""
    found = []
    for joint in description.joints:
        shapes = [s for s in description.link[joint.child].collisions if s.kind == "cylinder"]
        if joint.kind != "fixed" or not shapes:
            continue
        pose = description.pose(joint.child)
        axle = pose[:3, :3] @ shapes[0].origin[:3, 2]
        if abs(axle[2]) > AXLE_TILT or len(description.child_joints[joint.child]):
            continue
        left = axle if mostly_left(axle) > 0 else -axle
        axis = _triple(pose[:3, :3].T @ left)
        found.append((float(pose[2, 3]) - shapes[0].size[0], joint, axis))
    lowest = min((bottom for bottom, _, _ in found), default=0.0)
    return [
        f'"{joint.name}" (line {joint.line}) type="continuous" with <axis xyz="{axis}"/>'
        for bottom, joint, axis in found
        if bottom - lowest < TOUCH
    ]


def _triple(vector: Array) -> str:
    return " ".join(f"{value:.6g}" for value in np.round(vector, 6) + 0.0)
