"""Roles of the swivels in a drive: steered, follower, mimic or caster."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel
from rpctl.drive.evidence import Evidence
from rpctl.drive.swivels import SHARED_TRAIL_ROUNDING_M, SwivelCandidate
from rpctl.errors import DriveError


def assign_roles(
    kind: str, evidence: Evidence, forward: Array, driven: frozenset[str]
) -> tuple[Swivel, ...]:
    """Return the records of the swivels, each with its role in a drive.

    Args:
        kind: Type of the drive.
        evidence: The swivels, and what the user says of them.
        forward: Its forward direction (2,) in the root link's frame.
        driven: Joints that are driven.

    Raises:
        DriveError: A swivel cannot have the role that the drive has for it.
    """
    steered = _leading(kind, evidence, forward)
    lead = 2 if kind == "steered" else 1
    leaders = {swivel.joint.name for swivel in steered[:lead]}
    records = []
    for swivel in (*steered, *(s for s in evidence.swivels if s.role == "caster")):
        name, shares, role = swivel.joint.name, None, swivel.role
        if swivel.joint.mimic is not None:
            role, shares = "mimic", _leader(evidence, swivel)
        elif role == "steered" and name not in leaders:
            free = evidence.spec.steering == "free"
            role = "steered" if free else "follower"
            shares = steered[0].joint.name if free else None
        records.append(swivel.record(role, name in driven, shares))
    _require_leaders(kind, evidence, records)
    _require_trails(evidence, records)
    if kind == "steered" or any(record.role == "follower" for record in records):
        records = [_without_rounded_trail(record) for record in records]
        _require_contacts(kind, evidence, records)
    return tuple(records)


def _without_rounded_trail(swivel: Swivel) -> Swivel:
    """Return a swivel of several that share a centre, without the trail that rounding makes."""
    rounding = swivel.role != "caster" and abs(swivel.trail) < SHARED_TRAIL_ROUNDING_M
    return replace(swivel, trail=0.0) if rounding else swivel


def _leader(evidence: Evidence, swivel: SwivelCandidate) -> str:
    """Return the joint that a swivel mimics in the end."""
    joint = swivel.joint
    while joint.mimic is not None:
        joint = evidence.description.joint[joint.mimic.joint]
    return joint.name


def _require_leaders(kind: str, evidence: Evidence, swivels: list[Swivel]) -> None:
    """Refuse swivels that mimic what does not steer, or that would share more than one centre."""
    steered = {swivel.joint for swivel in swivels if swivel.role == "steered"}
    for swivel in swivels:
        if swivel.role != "mimic" or (swivel.shares in steered and kind != "steered"):
            continue
        joint = evidence.description.joint[swivel.joint]
        why = "which steers no wheel; let it mimic another swivel, or take its <mimic> out"
        if kind == "steered":
            why = "but no multiple keeps all wheels on one centre of rotation; take its <mimic> out"
            why += ", and it follows the others exactly"
        raise DriveError(
            f'{evidence.description.path}:{joint.line}: the swivel "{swivel.joint}" mimics '
            f'"{swivel.shares}", {why}'
        )


def _require_trails(evidence: Evidence, swivels: list[Swivel]) -> None:
    """Refuse casters whose wheels stand under their axis: no motion would turn them."""
    for swivel in swivels:
        if swivel.role == "caster" and not swivel.trail:
            joint = evidence.description.joint[swivel.joint]
            raise DriveError(
                f'{evidence.description.path}:{joint.line}: the wheels of "{swivel.joint}" stand '
                "under its axis, so it trails nothing and is no caster; move their contact off the "
                'axis, or say role = "steered" of its [[swivel]] in a drive file'
            )


def _leading(kind: str, evidence: Evidence, forward: Array) -> list[SwivelCandidate]:
    """Return the steered swivels, those first whose rates are quasi-velocities.

    Of several axles two wheels one behind the other lead: their axles fix one centre of rotation
    but where both point at each other, and straight ahead, in bends and on the spot they do not.
    """
    left = np.array([-forward[1], forward[0]])
    steered = sorted(
        evidence.steered,
        key=lambda s: (-round(float(s.pivot @ forward), 3), -float(s.pivot @ left)),
    )
    steered.sort(key=lambda swivel: swivel.joint.mimic is not None)
    if kind != "steered":
        return steered
    pairs = [(a, b) for i, a in enumerate(steered) for b in steered[i + 1 :]]
    first, second = max(pairs, key=lambda pair: _spacing(pair[0], pair[1], forward))
    return [first, second, *(s for s in steered if s not in (first, second))]


def _spacing(a: SwivelCandidate, b: SwivelCandidate, forward: Array) -> float:
    """Return how much further one swivel is ahead of another than beside it, m."""
    between = a.pivot - b.pivot
    ahead = abs(float(between @ forward))
    return ahead - math.sqrt(max(0.0, float(between @ between) - ahead**2))


def _require_contacts(kind: str, evidence: Evidence, swivels: list[Swivel]) -> None:
    """Refuse wheels off the axes that share a centre: they have none to keep to."""
    for swivel in swivels:
        shared = swivel.role == "follower" or (kind == "steered" and swivel.role != "caster")
        if shared and swivel.trail:
            joint = evidence.description.joint[swivel.joint]
            raise DriveError(
                f'{evidence.description.path}:{joint.line}: the wheels of "{swivel.joint}" stand '
                f"{1e3 * abs(swivel.trail):.3g} mm off its axis, where several steered wheels are "
                "to share one centre of rotation; put them under the axis, or say role = "
                '"caster" of its [[swivel]] in a drive file'
            )
