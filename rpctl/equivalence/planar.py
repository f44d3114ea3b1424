"""The planar motion of a base on its wheels, for any scalar: what the wheels make of ν.

A twist T = (x, y, turn) is the root link's velocity in its own axes. A wheel at p that heads along
d has the rows k = (d, d·(ẑ × p)) and l = (n, n·(ẑ × p)) with n = ẑ × d, the speeds of its place
along and across its heading; as it turns, k̇ = φ̇ l and l̇ = −φ̇ k. Three rows fix T; the rates of
all other swivels, and of the wheels on swivels, follow one by one, each with its drift: the part
of its derivative that ν̇ does not make. What a swivel carries has a twist, too: that of the base,
seen from axes that turn with the swivel, and the swivel's own rate. A trailer behind it is to it
what a caster is to the base. Axes of states, if any, come first in all arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Drive, Swivel
from rpctl.equivalence.tree import SwivelPart, Tree, components, dot, in_rows, lifted, vector


class JointRate(NamedTuple):
    """A joint's rate as a row of u (n,), and its drift."""

    row: Array
    drift: Any


class Twist(NamedTuple):
    """The twist J ν of the root link, or of what a swivel carries, and the components' drift."""

    J: Array  # (3, n)
    drift: Array  # (3,)


def base_motion(
    tree: Tree, drive: Drive, positions: Mapping[str, Any], nu: Array
) -> tuple[Twist, dict[str, JointRate]]:
    """Return how a base moves when its wheels roll, and the rates of joints.

    Args:
        tree: The robot's tree, whose scalars are used.
        nu: Quasi-velocities (dof,); the base's own speeds, then the steered joints' rates, first.
    """
    scalars, n = tree.scalars, nu.shape[-1]
    identity = scalars.identity(n)
    own = len(drive.base_speeds) - len(drive.steered)
    rates = {
        swivel.joint: JointRate(identity[own + i], 0 * nu[..., 0])
        for i, swivel in enumerate(drive.steered)
    }
    for swivel in drive.swivels:
        if swivel.role == "mimic":
            leader, factor = tree.leader(swivel.joint)
            rates[swivel.joint] = JointRate(factor * rates[leader].row, 0 * nu[..., 0])
    J, drift = scalars.zeros((3, n)), scalars.zeros(3)
    if drive.steered:
        J, drift = _steered_twist(tree, drive, positions, nu, rates)
    elif drive.has_axle:
        J[:2, 0] = tree.forward[:2]
        J[:, 1] = tree.point[1], -tree.point[0], identity[0, 0]
    elif drive.wheels:
        J[:, :3] = identity[:3, :3]
    carriers: dict[str | None, Twist] = {None: Twist(J, drift)}
    for swivel in drive.swivels:
        part = tree.swivels[swivel.joint]
        carrier = carriers[part.parent]
        if swivel.trails:
            rates[swivel.joint] = _caster_rate(tree, part, positions, nu, carrier)
        elif swivel.role == "follower":
            rates[swivel.joint] = follower_rate(tree, drive, swivel, positions, nu, rates)
        if any(each.parent == swivel.joint for each in tree.swivels.values()):
            carriers[swivel.joint] = _carried(
                tree, part, positions, nu, carrier, rates[swivel.joint]
            )
    for wheel in drive.wheels:
        if wheel.swivel is not None:
            part = tree.swivels[wheel.swivel]
            rates[wheel.joint] = _wheel_rate(
                tree, wheel.joint, positions, nu, carriers[part.parent], rates[part.joint]
            )
    return Twist(J, drift), rates


def _steered_twist(
    tree: Tree,
    drive: Drive,
    positions: Mapping[str, Any],
    nu: Array,
    rates: Mapping[str, JointRate],
) -> tuple[Array, Array]:
    """Return J (3, n) and the drift of T from K T = U ν.

    K holds two lateral rows and that of the base's speed; rates of swivels are on the right.
    """
    zeros, speed = tree.scalars.zeros, tree.scalars.identity(nu.shape[-1])[0]
    rows: list[tuple[Array, ...]] = []  # of K, U and K̇
    if drive.has_axle:
        rows.append((lateral(tree.forward, tree.point), zeros(nu.shape[-1]), zeros(3)))
    for swivel in drive.swivels:
        if swivel.role in ("steered", "mimic"):
            part = tree.swivels[swivel.joint]
            d, angle_row = tree.heading(part, positions), part.sign * rates[swivel.joint].row
            row: tuple[Array, ...] = (
                lateral(d, part.pivot) + part.trail * _turn(tree),
                -part.trail * angle_row,
                -lifted(dot(angle_row, nu)) * rolling(d, part.pivot),
            )
            if swivel.shares is not None:
                row = tuple(one + other for one, other in zip(rows.pop(), row, strict=True))
            rows.append(row)
    if drive.has_axle:
        rows.append((rolling(tree.forward, tree.point), speed, zeros(3)))
    else:
        first = tree.swivels[drive.steered[0].joint]
        d, angle_row = tree.heading(first, positions), first.sign * rates[first.joint].row
        forward = rolling(d, first.pivot) - first.left * _turn(tree)
        change = lifted(dot(angle_row, nu)) * lateral(d, first.pivot)
        rows.append((forward, speed + first.left * angle_row, change))
    K, U, K_dot = zip(*rows, strict=True)
    inverse = _inverse(K)
    J = inverse @ in_rows(U)
    changes = [-dot(row_rate, np.matvec(J, nu)) for row_rate in K_dot]
    return J, np.matvec(inverse, vector(changes))


def _carried(
    tree: Tree,
    part: SwivelPart,
    positions: Mapping[str, Any],
    nu: Array,
    carrier: Twist,
    turned: JointRate,
) -> Twist:
    """Return the twist of what a swivel carries, in the axes that it has at position 0.

    The pivot belongs to both: its velocity is turned back, and the components' rates with it.
    """
    (x, y), position = part.pivot, positions[part.joint]
    cos, sin = tree.scalars.cos(position), part.sign * tree.scalars.sin(position)
    row = part.sign * turned.row
    turning = carrier.J[..., 2, :] + row
    ahead, left = (
        carrier.J[..., 0, :] - y * carrier.J[..., 2, :],
        (carrier.J[..., 1, :] + x * carrier.J[..., 2, :]),
    )
    rows = (lifted(cos) * ahead + lifted(sin) * left, lifted(cos) * left - lifted(sin) * ahead)
    a, b, change = components(carrier.drift)
    a, b, rate = a - y * change, b + x * change, dot(row, nu)
    drifts = (
        cos * a + sin * b + rate * dot(rows[1], nu),
        cos * b - sin * a - rate * dot(rows[0], nu),
    )
    change = change + part.sign * turned.drift
    J = in_rows([rows[0] + y * turning, rows[1] - x * turning, turning])
    return Twist(J, vector([drifts[0] + y * change, drifts[1] - x * change, change]))


def _caster_rate(
    tree: Tree, part: SwivelPart, positions: Mapping[str, Any], nu: Array, carrier: Twist
) -> JointRate:
    """Return the rate of a caster: l·T + trail (ω + φ̇) = 0 at its contact."""
    J, drift = carrier
    d = tree.heading(part, positions)
    row, trail = lateral(d, part.pivot), part.sign * part.trail
    turned = -(np.matvec(J.mT, row) + part.trail * J[..., 2, :]) / trail
    row_rate = -part.sign * lifted(dot(turned, nu)) * rolling(d, part.pivot)
    change = dot(row, drift) + part.trail * drift[..., 2] + dot(row_rate, np.matvec(J, nu))
    return JointRate(turned, -change / trail)


def _wheel_rate(
    tree: Tree,
    joint: str,
    positions: Mapping[str, Any],
    nu: Array,
    carrier: Twist,
    turned: JointRate,
) -> JointRate:
    """Return the rate of a wheel on a swivel: its place's speed along its heading, over r."""
    wheel, (J, drift) = tree.wheels[joint], carrier
    part = tree.swivels[str(wheel.swivel)]
    d = tree.heading(part, positions)
    row, angle_row = rolling(d, part.pivot), part.sign * turned.row
    row_rate = lifted(dot(angle_row, nu)) * lateral(d, part.pivot)
    spin = np.matvec(J.mT, row) - wheel.left * (J[..., 2, :] + angle_row)
    change = dot(row, drift) + dot(row_rate, np.matvec(J, nu))
    change = change - wheel.left * (drift[..., 2] + part.sign * turned.drift)
    return JointRate(spin / wheel.lever, change / wheel.lever)


def follower_rate(
    tree: Tree,
    drive: Drive,
    swivel: Swivel,
    positions: Mapping[str, Any],
    nu: Array,
    rates: Mapping[str, JointRate],
) -> JointRate:
    """Return the rate of a swivel that heads along the velocity V which N = l₁ × l₂ gives it.

    φ = atan2(V_y, V_x), so φ̇ = V × V̇/|V|²; V̇ and the drift of V̈ come from those of N.

    Args:
        tree: The tree of the independent derivation.
        swivel: The swivel that follows the others.
        rates: Rates of the swivels that are steered, by joint.
    """
    rows, derivatives = [], []  # l, and k with the row of φ̇
    if drive.has_axle:
        rows.append(lateral(tree.forward, tree.point))
        derivatives.append((rolling(tree.forward, tree.point), tree.scalars.zeros(nu.shape[-1])))
    for one in drive.steered:
        part = tree.swivels[one.joint]
        d = tree.heading(part, positions)
        rows.append(lateral(d, part.pivot))
        derivatives.append((rolling(d, part.pivot), part.sign * rates[one.joint].row))
    (l1, l2), ((k1, row1), (k2, row2)) = rows, derivatives
    rate1, rate2 = lifted(dot(row1, nu)), lifted(dot(row2, nu))
    N = np.cross(l1, l2)
    first, second = -np.cross(k1, l2), -np.cross(l1, k2)  # of Ṅ, by φ̇₁ and by φ̇₂
    N_drift = 2 * rate1 * rate2 * np.cross(k1, k2) - (rate1 * rate1 + rate2 * rate2) * N
    part = tree.swivels[swivel.joint]
    V, A, B, D = (_velocity(part, twist) for twist in (N, first, second, N_drift))
    square = dot(V, V)
    row = (lifted(_cross(V, A)) * row1 + lifted(_cross(V, B)) * row2) / lifted(square)
    V_dot = rate1 * A + rate2 * B
    drift = (_cross(V, D) - 2 * dot(V, V_dot) * dot(row, nu)) / square
    return JointRate(row / part.sign, drift / part.sign)


def rolling(d: Array, place: Array) -> Array:
    """Return k (..., 3) of headings d (..., 2) at a place (2,)."""
    x, y = components(d)[:2]
    return vector([x, y, y * place[0] - x * place[1]])


def lateral(d: Array, place: Array) -> Array:
    """Return l (..., 3) of headings d (..., 2) at a place (2,)."""
    x, y = components(d)[:2]
    return vector([-y, x, x * place[0] + y * place[1]])


def _turn(tree: Tree) -> Array:
    """Return the row (3,) of the turning rate."""
    return tree.scalars.identity(3)[2]


def _velocity(part: SwivelPart, T: Array) -> Array:
    """Return the velocity (..., 2) of a swivel's pivot under a twist."""
    (vx, vy, turn), (x, y) = components(T), part.pivot
    return vector([vx - turn * y, vy + turn * x])


def _cross(a: Array, b: Array) -> Any:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _inverse(rows: Sequence[Array]) -> Array:
    """Return the inverse (..., 3, 3) of a matrix of three rows, by their cross products."""
    a, b, c = rows
    columns = in_rows([np.cross(b, c), np.cross(c, a), np.cross(a, b)]).mT
    return columns / lifted(lifted(dot(a, np.cross(b, c))))
