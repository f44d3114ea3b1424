"""What the ground does to a moving robot: wheel forces, loads, and margins to slipping and tipping.

The dynamics assume that the wheels neither slip nor lift; this says whether they would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.reduced import OutsideForce, Reactions, ReducedDynamics
from rpctl.dynamics.rolling import contact_point
from rpctl.dynamics.stance import (
    MIN_STANCE_WIDTH_M,
    Stance,
    Supports,
    even_loads,
    find_supports,
    loads,
    make_stance,
    margins,
    width,
)
from rpctl.errors import require_positive
from rpctl.robot.coordinates import ROOT_JOINT

ON_ONE_LINE = "on one line"  # of contacts: two such wheels hold nothing upright
FRICTION = 0.7  # of rubber on a dry indoor floor
MIN_LOAD = 1e-3  # of the weight: below it a contact bears nothing to speak of
MIN_LATERAL_SINE = (
    1e-9  # sine of the angle to forward from which a wheel's own force has a lateral part
)


@dataclass(frozen=True)
class Contacts:
    """Contacts of a robot with the ground, wheels first, and which forces are determinate.

    Attributes:
        names: Names of the contacts: the wheels' joints, then the supports' links.
        axles: Wheels (indices) that share one lateral force: only its sum is determinate.
        friction: Coefficient between wheels and ground.
        balanced: Whether loads and margins are defined: three contacts or more, all known, not on
            one line.
        determinate: Whether the loads follow from statics alone: three contacts exactly. With
            more, they are those of equal springs under a rigid robot, one split of many; the
            ranges over all splits come from :func:`rpctl.dynamics.grip.find_ranges`.
        notes: What keeps loads and margins from being defined or unique, in sentences.
        points: Contacts (n, 2) with all joints at 0 or frozen, in the root link's frame, m.
        supports: Those of the contacts that are not wheels.
        along: Map (n_wheels, rows) from λ to the wheels' forces forward.
        across: Map (n_axles, rows) from λ to the axles' forces to the left.
        incidence: Incidence of wheels and axles (n_wheels, n_axles), 0 or 1.
        floor: Load below which a contact bears nothing to speak of, N.
        stance: Polygon and split of the loads; None where contacts move, or nothing is balanced.
    """

    names: tuple[str, ...]
    axles: tuple[tuple[int, ...], ...]
    friction: float
    balanced: bool
    determinate: bool
    notes: tuple[str, ...]
    points: Array
    supports: Supports = field(repr=False)
    along: Array = field(repr=False)
    across: Array = field(repr=False)
    incidence: Array = field(repr=False)
    floor: float = field(repr=False)
    stance: Stance | None = field(repr=False)


@dataclass(frozen=True, eq=False)
class GroundReaction:
    """Forces of the ground on a robot at one instant; at K instants all have K rows.

    They are empty or None where they are not defined.

    Attributes:
        force: Total force (3,), world axes, N; the third is the load.
        longitudinal: Force of each wheel along the robot's forward direction (n_wheels,), N; of a
            wheel that swivels along its own.
        lateral: Force of each axle to its left (n_axles,), N: the sum over its wheels.
        load: Vertical force of each contact (n,), wheels first, N; negative where it would pull.
        zmp: Zero-moment point (2,) on the ground, world axes, m.
        arms: Contacts (n, 2) as seen from the zero-moment point, root link's axes, m.
        tip_margin: Distance of the zero-moment point to the nearest edge of the support polygon,
            m; negative outside, where the robot tips.
        slip_ratio: Horizontal force of each wheel over friction times load (n_wheels,); above 1
            it slips. An axle's lateral force is shared in proportion to its wheels' loads.
    """

    force: Array
    longitudinal: Array
    lateral: Array
    load: Array
    zmp: Array
    arms: Array
    tip_margin: Any
    slip_ratio: Array


def find_contacts(dynamics: ReducedDynamics, friction: float = FRICTION) -> Contacts | None:
    """Return how a robot stands on the ground, or None for one that leans or has a fixed base.

    Args:
        dynamics: Its dynamics.
        friction: Coefficient between wheels and ground.

    Raises:
        RpctlError: The friction is not a positive number.
    """
    require_positive("friction", friction)
    robot = dynamics.robot
    if not robot.drive.wheels or robot.drive.leans:
        return None
    q = pin.neutral(robot.model)
    supports = find_supports(robot)
    wheels = tuple(wheel.joint for wheel in robot.drive.wheels)
    names = wheels + tuple(part.name for part in supports.parts)
    points = contact_points(dynamics, supports, q)
    points.setflags(write=False)
    axles, along, across = _force_maps(dynamics)
    moves = any(part.joint != ROOT_JOINT for part in supports.parts) or not dynamics.constant
    balanced = not supports.unknown and width(points) > MIN_STANCE_WIDTH_M
    return Contacts(
        names=names,
        axles=axles,
        friction=friction,
        balanced=balanced,
        determinate=balanced and len(names) == 3,
        notes=contact_notes(names, supports, balanced, free_rotation(points, robot.drive.heading)),
        points=points,
        supports=supports,
        along=along,
        across=across,
        incidence=np.array([[float(w in axle) for axle in axles] for w in range(len(wheels))]),
        floor=MIN_LOAD * robot.mass * float(np.linalg.norm(robot.model.gravity.linear)),
        stance=make_stance(points) if balanced and not moves else None,
    )


def ground_reaction(
    dynamics: ReducedDynamics,
    contacts: Contacts,
    q: Array,
    nu: Array,
    tau: Array,
    outside: OutsideForce | None = None,
) -> GroundReaction:
    """Return the forces of the ground on a robot that moves under τ.

    Args:
        dynamics: The robot's dynamics.
        contacts: Its contacts, from :func:`find_contacts`.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.
        outside: What pushes the robot besides; None: nothing.
    """
    pushed = None if outside is None else OutsideForce(*(each[None] for each in outside))
    reactions = dynamics.reactions(q[None], nu[None], tau[None], outside=pushed)
    rows = vars(ground_reactions(dynamics, contacts, q[None], reactions))
    first: dict[str, Any] = {k: None if row is None else row[0] for k, row in rows.items()}
    margin = first.pop("tip_margin")
    return GroundReaction(**first, tip_margin=None if margin is None else float(margin))


def ground_reactions(
    dynamics: ReducedDynamics,
    contacts: Contacts,
    q: Array,
    reactions: Reactions,
    points: Array | None = None,
) -> GroundReaction:
    """Return the forces of the ground on a robot at K states.

    The horizontal ones are the multipliers of M v̇ + h = B τ + Aᵀ λ, of least norm where rows of A
    are redundant. The vertical force and the moments that the planar root hides come from the
    wrench (f, n) through it: all of it is the ground's, so its horizontal moments vanish at the
    zero-moment point ([SB04]) p at the height z of the ground,
    p_x = (z f_x − n_y)/f_z, p_y = (z f_y + n_x)/f_z, and Σ N_i (1, p_i) = f_z (1, p).

    Args:
        dynamics: The robot's dynamics.
        contacts: Its contacts, from :func:`find_contacts`.
        q: Configurations (K, nq).
        reactions: Of these states.
        points: Places of the contacts (K, n, 2) in the root link's frame, m, where they move; None
            finds them.
    """
    multipliers, wrench = reactions.multipliers, reactions.wrench
    along, lateral = multipliers @ contacts.along.T, multipliers @ contacts.across.T
    fx, fy, fz, nx, ny, _ = wrench.T
    z, floor = dynamics.robot.drive.ground, contacts.floor
    moments = np.column_stack([fz, z * fx - ny, z * fy + nx])
    local = moments[:, 1:] / np.maximum(fz, floor)[:, None]
    zmp, force = q[:, :2] + _turned(q, local), np.column_stack([_turned(q, wrench[:, :2]), fz])
    if not contacts.balanced:
        none = np.empty((len(q), 0))
        return GroundReaction(force, along, lateral, none, zmp, none, None, none)
    if contacts.stance is not None:
        points = contacts.stance.statics[1:].T
    elif points is None:
        points = np.array([contact_points(dynamics, contacts.supports, each) for each in q])
    arms, (margin, load) = points - local[:, None], _split(contacts, points, moments, local)
    slip = _slip_ratio(contacts, along, lateral, np.maximum(load[:, : along.shape[1]], floor))
    return GroundReaction(force, along, lateral, load, zmp, arms, margin, slip)


def _turned(q: Array, vectors: Array) -> Array:
    """Return vectors (K, 2) in the root link's axes along the world's, at q (K, nq)."""
    (cos, sin), (x, y) = q[:, 2:4].T, vectors.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


def _split(contacts: Contacts, points: Array, moments: Array, local: Array) -> tuple[Array, Array]:
    """Return margins (K,) and loads (K, n) of a robot that is balanced.

    Args:
        contacts: Its contacts.
        points: Their places (K, n, 2) in the root link's frame, m; (n, 2) where they keep them.
        moments: The load and its moments (K, 3) about the root link's axes, N, N·m.
        local: Zero-moment points (K, 2) in the root link's frame, m.
    """
    stance = contacts.stance
    if stance is None:
        margin, load = margins(points, local), even_loads(points, moments)
    else:
        margin = (local @ stance.inward.T + stance.offset).min(axis=1)
        load = moments @ stance.split.T
    pulls = moments[:, 0] < contacts.floor  # the ground would have to
    margin = np.where(pulls, -np.abs(margin), margin)
    for k in np.flatnonzero((margin > 0.0) & (load.min(axis=1) < 0.0)):
        load[k] = loads(stance or make_stance(points[k]), moments[k], margin[k])
    return margin, load


def stance_at(dynamics: ReducedDynamics, contacts: Contacts, q: Array) -> Stance:
    """Return the stance at q (nq,) of a robot that is balanced.

    Args:
        dynamics: The reduced dynamics.
        contacts: The contacts of a robot that is balanced.
        q: Configuration (nq,).
    """
    return contacts.stance or make_stance(contact_points(dynamics, contacts.supports, q))


def _slip_ratio(contacts: Contacts, along: Array, lateral: Array, load: Array) -> Array:
    """Return √(F² + L²)/(μ N) of each wheel (K, n_wheels); L/N is that of its axle."""
    incidence = contacts.incidence
    sideways = (lateral / (load @ incidence)) @ incidence.T
    return np.asarray(np.hypot(along / load, sideways) / contacts.friction)


def contact_points(dynamics: ReducedDynamics, supports: Supports, q: Array) -> Array:
    """Return the places (n, 2) of a robot's contacts in the root link's frame, m.

    Args:
        dynamics: The reduced dynamics.
        supports: Those of its contacts that are not wheels.
        q: Configuration (nq,).
    """
    robot, data = dynamics.robot, dynamics.placements(q)
    root = data.oMi[ROOT_JOINT]
    wheels = [root.actInv(contact_point(robot, data, w))[:2] for w in robot.drive.wheels]
    others = [
        root.actInv(data.oMi[part.joint].act(np.array(part.point)))[:2] for part in supports.parts
    ]
    return np.array(wheels + others)


def _force_maps(
    dynamics: ReducedDynamics,
) -> tuple[tuple[tuple[int, ...], ...], Array, Array]:
    """Return the axles and the maps (n_wheels, rows), (n_axles, rows) from λ to the forces.

    Wheels on the root link share their lateral force, for only P is kept from moving sideways; so
    do those of a swivel and of the swivels that follow it. A roller's one force has both parts.
    """
    drive, rolling = dynamics.robot.drive, dynamics.rolling
    identity = np.eye(len(rolling.matrix.constant))
    along = np.zeros((len(drive.wheels), len(identity)))
    axles: list[tuple[int, ...]] = []
    across = []
    for index, (wheel, row) in enumerate(zip(drive.wheels, rolling.along, strict=True)):
        forward, left = 1.0, 0.0  # a wheel that swivels: along its own rolling direction
        if wheel.swivel is None:
            turn = math.atan2(wheel.direction[1], wheel.direction[0]) - drive.heading
            forward, left = math.cos(turn), math.sin(turn)
        along[index, row] = forward
        if abs(left) > MIN_LATERAL_SINE:
            axles.append((index,))
            across.append(left * identity[row])
    for row, shared in rolling.across:
        axles.append(shared)
        across.append(identity[row])
    return tuple(axles), along, np.array(across)


def free_rotation(points: Array, heading: float) -> str:
    """Return the freedom that contacts (n, 2) on one line leave, in words."""
    along = points[-1] - points[0]
    ahead = abs(along @ [math.cos(heading), math.sin(heading)])
    aside = abs(along @ [-math.sin(heading), math.cos(heading)])
    if max(ahead, aside) <= MIN_STANCE_WIDTH_M:
        return "pitch and roll"
    return "pitch" if aside > ahead else "roll"


def contact_notes(
    names: tuple[str, ...], supports: Supports, balanced: bool, free: str
) -> tuple[str, ...]:
    """Return what keeps a robot's loads and margins from being defined or unique, in sentences.

    Args:
        names: Names of its contacts.
        supports: Those that are not wheels.
        balanced: Whether they hold a balance.
        free: The freedom that they leave, from :func:`free_rotation`, if they do not.
    """
    fix = "give each caster a <collision> with a <sphere> or <cylinder> that reaches the ground"
    if supports.unknown:
        listed = ", ".join(supports.unknown)
        return (
            f"the support polygon is incomplete: {listed} touch the ground but are drawn as "
            f"meshes only, so loads and margins are not defined; {fix}",
        )
    if not balanced:
        return (
            f"only {', '.join(names)} are known to touch the ground, {ON_ONE_LINE}: the planar "
            f"model assumes balance and ignores {free}, so loads and margins are not defined; if "
            f"the robot does not balance, {fix}",
        )
    if len(names) > 3:
        return (
            f"{len(names)} contacts share the load, which statics cannot determine: wheel loads "
            "and grip are intervals over all load distributions; plots show those of equally "
            "stiff contacts",
        )
    return ()
