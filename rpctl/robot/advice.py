"""What to tell a user whose robot's drive was not found: the evidence, and what to write."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from rpctl.description.records import Array, Description
from rpctl.robot.drive_file import suggest
from rpctl.robot.swivels import Found
from rpctl.robot.wheels import AXLE_TILT, Candidate, Standing, mostly_left

MANY = 8  # pairs or joints that a message lists
TOUCH = 5e-3  # m; wheels reach the ground together to within this


def why_not(
    description: Description,
    standing: Standing,
    pairs: tuple[tuple[Candidate, ...], ...],
    swivels: tuple[Found, ...],
    kind: str | None,
) -> str:
    """Return why no drive was found, and what to write to have one.

    Args:
        description: The robot.
        standing: The joints that could carry wheels.
        pairs: Those that share an axle.
        swivels: The upright joints that carry wheels.
        kind: Type of the drive that was asked for, or None.
    """
    where = f"{description.path}: no {kind or 'known'} drive"
    start = "a drive file to start from (--drive FILE):\n"
    names = [wheel.joint.name for wheel in standing.wheels[:MANY]]
    roles = {swivel.joint.name: swivel.role for swivel in swivels[:MANY]}
    if pairs or swivels:
        listed = "; ".join(" + ".join(w.joint.name for w in pair) for pair in pairs[:MANY])
        axles = f"{len(pairs)} pair{'s' * (len(pairs) != 1)} of wheels on one axle"
        axles += f" ({listed})" if pairs else ""
        turning = [f"{name} ({role})" for name, role in roles.items()]
        turns = f", wheels on swivels: {', '.join(turning)}" if turning else ""
        guess = "skid-steer" if len(pairs) > 1 else "differential"
        guess = "steered" if not pairs else guess
        advice = suggest(kind or guess, names, roles)
        return f"{where}: {axles}{turns}; say which it is, {start}{advice}"
    aloft = "".join(f"; {reason}" for reason in standing.aloft)
    if standing.wheels:
        listed = ", ".join(
            f'"{c.joint.name}" (line {c.joint.line}, axle {np.round(c.axle, 3).tolist()} '
            f"at {np.round(c.origin, 3).tolist()})"
            for c in standing.wheels[:MANY]
        )
        more = "".join(_turned_axes(standing.wheels)) + aloft
        return f"{where}: no two wheels share one axle; joints on a level axis: {listed}{more}"
    still = still_wheels(description)
    if still:
        return f"{where}: wheels are held by fixed joints; make {'; '.join(still)}"
    return (
        f"{where}: it needs continuous joints about level axles that reach the ground, held by "
        f'the root link "{description.root}"; make the wheels\' joints '
        f'type="continuous" with the axle as <axis>, or say --drive fixed for an arm{aloft}'
    )


def _turned_axes(candidates: tuple[Candidate, ...]) -> list[str]:
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


def still_wheels(description: Description) -> list[str]:
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
