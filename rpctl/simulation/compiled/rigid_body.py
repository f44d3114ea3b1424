"""crba and rnea over scalars, in body axes ([F08, Ch. 5, 6]), on a planar root.

Each joint is along the z axis of the body behind it. Velocities and accelerations are those of
the origins of the bodies' frames, classical ones; a body's inertia is taken about its origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rpctl.simulation.compiled.bodies import MovingBody
from rpctl.simulation.compiled.scalars import (
    Scalar,
    Vector,
    cross,
    plus,
    product,
    times,
    total,
    transposed,
)

GRAVITY = 9.81  # m/s², Pinocchio's
Pair = tuple[int, int]
Motion = tuple[Vector, Vector, Vector, Sequence[Vector]]  # ω, α, acceleration, U


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The motion across a joint at one position.

    Attributes:
        body: The body behind the joint.
        cos: Of its angle; 1 where it slides.
        sin: Likewise, or 0.
        p: Origin of the body's frame in its parent's axes.
    """

    body: MovingBody
    cos: Scalar
    sin: Scalar
    p: Vector

    def outwards(self, vector: Vector) -> list[Scalar]:
        """Return a vector of the parent's axes in the body's."""
        x, y, z = product(transposed(self.body.R.tolist()), vector)
        return self._turned((x, y, z), self.sin)

    def inwards(self, vector: Vector) -> list[Scalar]:
        """Return a vector of the body's axes in the parent's."""
        return product(self.body.R.tolist(), self._turned(vector, -self.sin))

    def _turned(self, vector: Vector, sin: Scalar) -> list[Scalar]:
        x, y, z = vector
        return [
            total((times(self.cos, x), times(sin, y))),
            total((times(self.cos, y), times(-sin, x))),
            z,
        ]


@dataclass(frozen=True, eq=False)
class ScalarInertia:
    """Mass, first moment (3,) and second moment ∫ r rᵀ (xx, yy, zz, xy, xz, yz) about an origin."""

    m: Scalar
    mc: Vector
    second: Vector

    def plus(self, other: ScalarInertia) -> ScalarInertia:
        """Return that of two bodies together."""
        return ScalarInertia(
            total((self.m, other.m)), plus(self.mc, other.mc), plus(self.second, other.second)
        )


def second_moments(numbers: Vector) -> list[Scalar]:
    """Return xx, yy, zz, xy, xz, yz of ∫ r rᵀ of a body's ten numbers."""
    xx, yy, zz, xy, xz, yz = numbers[4:]
    half = times(0.5, total((xx, yy, zz)))
    return [*(total((half, -each)) for each in (xx, yy, zz)), -xy, -xz, -yz]


def moved_inwards(joint: JointMotion, body: ScalarInertia) -> ScalarInertia:
    """Return a body's inertia about its parent's origin, in the parent's axes."""
    columns = [joint.inwards(row) for row in _square(body.second)]
    turned = [joint.inwards(row) for row in transposed(columns)]
    mc, p = joint.inwards(body.mc), joint.p
    moved = [total((a, times(body.m, b))) for a, b in zip(mc, p, strict=True)]
    # ∫ (r + p)(r + p)ᵀ = ∫ r rᵀ + mc pᵀ + p (mc + m p)ᵀ
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    second = [total((turned[i][j], times(mc[i], p[j]), times(p[i], moved[j]))) for i, j in pairs]
    return ScalarInertia(body.m, moved, second)


def _square(second: Vector) -> list[list[Scalar]]:
    xx, yy, zz, xy, xz, yz = second
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def crba(joints: Sequence[JointMotion | None], numbers: Sequence[Vector]) -> dict[Pair, Scalar]:
    """Return the entries of the inertia matrix by their indices in v, each pair in both orders.

    Args:
        joints: Motion across the joint of each body; None of the root.
        numbers: Ten numbers of each body.
    """
    whole = [ScalarInertia(n[0], n[1:4], second_moments(n)) for n in numbers]
    M: dict[Pair, Scalar] = {}
    for i in reversed(range(1, len(joints))):
        joint = joints[i]
        assert joint is not None
        body, part = joint.body, whole[i]
        whole[body.parent] = whole[body.parent].plus(moved_inwards(joint, part))
        xx, yy, _, _, xz, yz = part.second
        (x, y, _), m = part.mc, part.m
        if body.slides:
            force, moment, own = [0.0, 0.0, m], [y, -x, 0.0], m
        else:
            own = total((xx, yy))
            force, moment = [-y, x, 0.0], [-xz, -yz, own]
        M[body.index, body.index] = total((own, body.armature))
        _spread(M, joints, i, force, moment)
    xx, yy, *_ = whole[0].second
    (x, y, _), m = whole[0].mc, whole[0].m
    M |= {(0, 0): m, (1, 1): m, (2, 2): total((xx, yy)), (0, 2): -y, (1, 2): x}
    M |= {(2, 0): -y, (2, 1): x}
    return M


def _spread(
    M: dict[Pair, Scalar],
    joints: Sequence[JointMotion | None],
    start: int,
    force: Vector,
    moment: Vector,
) -> None:
    """Write what a joint's unit acceleration asks of the joints before it."""
    index, i = joints[start].body.index, start  # type: ignore[union-attr]
    while (joint := joints[i]) is not None:
        force = joint.inwards(force)
        moment = plus(joint.inwards(moment), cross(joint.p, force))
        i = joint.body.parent
        before = joints[i]
        if before is None:
            found = {0: force[0], 1: force[1], 2: moment[2]}
        else:
            found = {before.body.index: force[2] if before.body.slides else moment[2]}
        for other, value in found.items():
            M[index, other] = M[other, index] = value


def rnea(
    joints: Sequence[JointMotion | None],
    numbers: Sequence[Vector],
    v: Vector,
    a: Vector,
) -> list[Scalar]:
    """Return the generalised forces (nv,) of a motion, gravity included.

    Args:
        joints: Motion across the joint of each body; None of the root.
        numbers: Ten numbers of each body.
        v: Velocities (nv,).
        a: Accelerations (nv,), Pinocchio's v̇.
    """
    spin, turn = [0.0, 0.0, v[2]], [0.0, 0.0, a[2]]
    lift = [total((a[0], times(-v[2], v[1]))), total((a[1], times(v[2], v[0]))), GRAVITY]
    motions: list[Motion] = [(spin, turn, lift, _rates(spin, turn))]
    for joint in joints[1:]:
        assert joint is not None
        motions.append(_next(joint, *motions[joint.body.parent], v, a))
    wrenches = [_wrench(n, *motion) for n, motion in zip(numbers, motions, strict=True)]
    forces: list[Scalar] = [0.0] * len(v)
    for i in reversed(range(1, len(joints))):
        joint = joints[i]
        assert joint is not None
        force, moment = wrenches[i]
        body = joint.body
        own = force[2] if body.slides else moment[2]
        forces[body.index] = total((own, times(body.armature, a[body.index])))
        force = joint.inwards(force)
        moment = plus(joint.inwards(moment), cross(joint.p, force))
        before = wrenches[body.parent]
        wrenches[body.parent] = plus(before[0], force), plus(before[1], moment)
    force, moment = wrenches[0]
    forces[:3] = force[0], force[1], moment[2]
    return forces


def _rates(spin: Vector, turn: Vector) -> list[list[Scalar]]:
    """Return U = [α]× + [ω]×², which gives a point at r of a body the acceleration a + U r."""
    (x, y, z), (ax, ay, az) = spin, turn
    xx, yy, zz = times(x, x), times(y, y), times(z, z)
    xy, xz, yz = times(x, y), times(x, z), times(y, z)
    return [
        [-total((yy, zz)), total((xy, -az)), total((xz, ay))],
        [total((xy, az)), -total((xx, zz)), total((yz, -ax))],
        [total((xz, -ay)), total((yz, ax)), -total((xx, yy))],
    ]


def _next(
    joint: JointMotion,
    spin: Vector,
    turn: Vector,
    lift: Vector,
    U: Sequence[Vector],
    v: Vector,
    a: Vector,
) -> Motion:
    """Return ω, α, acceleration and U of the body behind a joint; arguments as of its parent's."""
    rate, change = v[joint.body.index], a[joint.body.index]
    spin, turn = joint.outwards(spin), joint.outwards(turn)
    lift = joint.outwards(plus(lift, product(U, joint.p)))
    x, y, z = spin
    beside = [times(y, rate), times(-x, rate), change]
    if joint.body.slides:
        double = [times(2.0, beside[0]), times(2.0, beside[1]), change]
        lift = plus(lift, double)
    else:
        spin, turn = [x, y, total((z, rate))], plus(turn, beside)
    return spin, turn, lift, _rates(spin, turn)


def _wrench(
    numbers: Vector, spin: Vector, turn: Vector, lift: Vector, U: Sequence[Vector]
) -> tuple[Vector, Vector]:
    """Return the force on a body and its moment about the body's origin."""
    m, mc = numbers[0], numbers[1:4]
    force = plus([times(m, each) for each in lift], product(U, mc))
    second = _square(second_moments(numbers))
    # ∫ r × (a + U r) = mc × a + what is not symmetric of ∫ (U r) rᵀ
    spread = [product(second, row) for row in U]
    moment = [
        total((spread[2][1], -spread[1][2])),
        total((spread[0][2], -spread[2][0])),
        total((spread[1][0], -spread[0][1])),
    ]
    return force, plus(moment, cross(mc, lift))
