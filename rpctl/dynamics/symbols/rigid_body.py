"""crba and rnea over scalars, in body axes ([F08, Ch. 5, 6]), on a planar root or a free-flyer.

Each joint is along the z axis of the body behind it. Velocities and accelerations are those of
the origins of the bodies' frames, classical ones; a body's inertia is taken about its origin.

[F08] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

from rpctl.dynamics.symbols.basis import SymbolicConfiguration
from rpctl.dynamics.symbols.bodies import MX, MZ, XX, XY, XZ, YY, YZ, ZZ, M, MovingBody
from rpctl.kernels.scalars import (
    Scalar,
    Vector,
    cross,
    exact,
    is_zero,
    plus,
    product,
    times,
    total,
    turned,
)

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The motion across a joint at one position.

    Attributes:
        body: The body behind the joint.
        cos: Of the third of the rotations of the body.
        sin: Likewise.
        p: Origin of the body's frame in its parent's axes.
    """

    body: MovingBody
    cos: Scalar
    sin: Scalar
    p: Vector

    @cached_property
    def turns(self) -> tuple[tuple[int, int, Scalar, Scalar], ...]:
        """The rotations from the body's axes to its parent's: plane, cosine and sine of each."""
        turns = (0, 1, self.cos, self.sin), (1, 2, *self.body.tilt), (0, 1, *self.body.yaw)
        return tuple(turn for turn in turns if not is_zero(turn[3]) or turn[2] != 1.0)

    def outwards(self, vector: Vector) -> list[Scalar]:
        """Return a vector of the parent's axes in the body's."""
        found = list(vector)
        for i, j, cos, sin in reversed(self.turns):
            found[i], found[j] = turned(found[i], found[j], cos, -sin)
        return found

    def inwards(self, vector: Vector) -> list[Scalar]:
        """Return a vector of the body's axes in the parent's."""
        found = list(vector)
        for i, j, cos, sin in self.turns:
            found[i], found[j] = turned(found[i], found[j], cos, sin)
        return found

    def inertia(self, body: ScalarInertia) -> ScalarInertia:
        """Return an inertia about the body's origin about its parent's, in the parent's axes."""
        second = [list(row) for row in body.second]
        for i, j, cos, sin in self.turns:
            _turn_moments(second, i, j, cos, sin)
        mc, p = self.inwards(body.mc), self.p
        moved = [total((a, times(body.m, b))) for a, b in zip(mc, p, strict=True)]
        for i in range(3):  # ∫ (r + p)(r + p)ᵀ = ∫ r rᵀ + mc pᵀ + p (mc + m p)ᵀ
            second[i][i] = total((second[i][i], times(p[i], total((mc[i], moved[i])))))
            for j in range(i):
                beside = times(mc[i], p[j]), times(p[i], moved[j])
                second[i][j] = second[j][i] = total((second[i][j], *beside))
        return ScalarInertia(body.m, moved, second)


def _turn_moments(second: list[list[Scalar]], i: int, j: int, cos: Scalar, sin: Scalar) -> None:
    """Turn second moments (3, 3) by an angle in the plane of two axes, in place."""
    k = 3 - i - j
    beside = turned(second[i][k], second[j][k], cos, sin)
    second[i][k], second[j][k] = second[k][i], second[k][j] = beside
    a, b, mixed = second[i][i], second[j][j], second[i][j]
    if is_zero(cos):  # by a right angle
        a, b, mixed = b, a, -mixed
    elif not is_zero(sin):
        bend = total((times(sin, total((b, -a))), times(-2.0, times(cos, mixed))))
        change = times(sin, bend)
        a, b, mixed = total((a, change)), total((b, -change)), -total((times(cos, bend), mixed))
    second[i][i], second[j][j] = a, b
    second[i][j] = second[j][i] = mixed


@dataclass(frozen=True, eq=False)
class ScalarInertia:
    """Mass, first moment (3,) and second moment ∫ r rᵀ (3, 3) about an origin."""

    m: Scalar
    mc: Vector
    second: Sequence[Vector]

    def plus(self, other: ScalarInertia) -> ScalarInertia:
        """Return that of two bodies together."""
        second = [plus(a, b) for a, b in zip(self.second, other.second, strict=True)]
        return ScalarInertia(total((self.m, other.m)), plus(self.mc, other.mc), second)


def _inertia(numbers: Vector) -> ScalarInertia:
    """Return the inertia of a body's ten numbers."""
    half = times(0.5, total((numbers[XX], numbers[YY], numbers[ZZ])))
    xx, yy, zz = (total((half, -numbers[k])) for k in (XX, YY, ZZ))
    xy, xz, yz = (-numbers[k] for k in (XY, XZ, YZ))
    second = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return ScalarInertia(numbers[M], numbers[MX : MZ + 1], second)


@dataclass(frozen=True, eq=False)
class MovingTree:
    """Bodies at one configuration.

    Attributes:
        joints: BodyMotion across the joint of each body but the first.
        numbers: The ten numbers of each body.
        lift: What gravity takes of the first body's acceleration (3,), in its axes, m/s².
        root: How the first body moves.
    """

    joints: tuple[JointMotion, ...]
    numbers: Sequence[Vector]
    lift: Vector
    root: Root

    def before(self, joint: JointMotion) -> Iterator[JointMotion]:
        """Yield a joint and those that carry it, inwards."""
        while True:
            yield joint
            if not joint.body.parent:
                return
            joint = self.joints[joint.body.parent - 1]


def moving_tree(
    bodies: Sequence[MovingBody],
    numbers: Sequence[Vector],
    lift: Vector,
    at: SymbolicConfiguration,
    root: Root,
) -> MovingTree:
    """Return bodies at a configuration.

    Args:
        bodies: The bodies.
        numbers: The ten numbers of each, those that are felt.
        lift: Acceleration (3,) against gravity along the axes of the ground, m/s².
        at: The configuration.
        root: How the first body moves.
    """
    carriers = {body.parent for body in bodies}
    joints = list(joint_motions(bodies, at))
    for k, body in enumerate(bodies[1:], start=1):
        if k not in carriers and not body.slides and _is_round(numbers[k]):
            joints[k - 1] = JointMotion(body, 1.0, 0.0, body.p.tolist())  # any angle will do
    return MovingTree(tuple(joints), numbers, root.inwards(at, lift), root)


def joint_motions(
    bodies: Sequence[MovingBody], at: SymbolicConfiguration
) -> tuple[JointMotion, ...]:
    """Return the motion across the joint of each body but the first."""
    return tuple(_joint_motion(body, at) for body in bodies[1:])


def _is_round(numbers: Vector) -> bool:
    """Return whether a body looks the same at all angles of the joint that turns it."""
    return all(is_zero(number) for k, number in enumerate(numbers) if k != ZZ)


def _joint_motion(body: MovingBody, at: SymbolicConfiguration) -> JointMotion:
    assert body.entry is not None
    p = body.p.tolist()
    if not body.slides:
        return JointMotion(body, *at.pair(body.entry, body.offset), p)
    still = JointMotion(body, *exact(body.offset), p)
    way = plus(p, still.inwards([0.0, 0.0, at.position(body.entry)]))
    return JointMotion(body, still.cos, still.sin, way)


def crba(tree: MovingTree) -> dict[Pair, Scalar]:
    """Return the entries of the inertia matrix by their indices in v, each pair in both orders."""
    whole = [_inertia(numbers) for numbers in tree.numbers]
    found: dict[Pair, Scalar] = {}
    for i, joint in reversed(list(enumerate(tree.joints, start=1))):
        body, part = joint.body, whole[i]
        whole[body.parent] = whole[body.parent].plus(joint.inertia(part))
        x, y, _ = part.mc
        if body.slides:
            force, moment, own = [0.0, 0.0, part.m], [y, -x, 0.0], part.m
        else:
            own = total((part.second[0][0], part.second[1][1]))
            force, moment = [-y, x, 0.0], [-part.second[0][2], -part.second[1][2], own]
        found[body.index, body.index] = total((own, body.armature))
        for other, value in _asked(tree, joint, force, moment):
            found[body.index, other] = found[other, body.index] = value
    for (i, j), value in tree.root.inertia(whole[0]).items():
        found[i, j] = found[j, i] = value
    return found


def _asked(
    tree: MovingTree, joint: JointMotion, force: Vector, moment: Vector
) -> Iterator[tuple[int, Scalar]]:
    """Yield what a wrench on the body behind a joint asks of the joints before it.

    Args:
        tree: The bodies.
        joint: The joint.
        force: In the body's axes.
        moment: About the body's origin.

    Yields:
        Index in v, force or moment.
    """
    for each in tree.before(joint):
        force = each.inwards(force)
        moment = plus(each.inwards(moment), cross(each.p, force))
        if each.body.parent:
            carrier = tree.joints[each.body.parent - 1].body
            yield carrier.index, force[2] if carrier.slides else moment[2]
    yield from enumerate(tree.root.felt(force, moment))


class BodyMotion(NamedTuple):
    """How a body moves, in its own axes.

    Attributes:
        spin: Angular velocity ω.
        turn: Angular acceleration α.
        lift: Acceleration of the origin, gravity's reaction included.
        U: [α]× + [ω]×², which gives a point at r the acceleration ``lift`` + U r.
        squares: xx, yy, zz, xy, xz, yz of ω ωᵀ.
    """

    spin: Vector
    turn: Vector
    lift: Vector
    U: Sequence[Vector]
    squares: Vector


def _motion(spin: Vector, turn: Vector, lift: Vector) -> BodyMotion:
    (x, y, z), (ax, ay, az) = spin, turn
    squares = [times(a, b) for a, b in ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z))]
    xx, yy, zz, xy, xz, yz = squares
    U = [
        [-total((yy, zz)), total((xy, -az)), total((xz, ay))],
        [total((xy, az)), -total((xx, zz)), total((yz, -ax))],
        [total((xz, -ay)), total((yz, ax)), -total((xx, yy))],
    ]
    return BodyMotion(spin, turn, lift, U, squares)


def first_moment(tree: MovingTree) -> tuple[Scalar, Vector]:
    """Return the mass of all bodies, and its first moment (3,) about the first one's origin."""
    parts = [(numbers[M], numbers[MX : MZ + 1]) for numbers in tree.numbers]
    for i, joint in reversed(list(enumerate(tree.joints, start=1))):
        (m, mc), (mass, moment) = parts[i], parts[joint.body.parent]
        moved = plus(moment, joint.inwards(mc), [times(m, p) for p in joint.p])
        parts[joint.body.parent] = total((mass, m)), moved
    return parts[0]


def rnea(tree: MovingTree, v: Vector, a: Vector) -> tuple[list[Scalar], Vector]:
    """Return the generalised forces (nv,) of a motion, and the wrench (6,) on the first body.

    Gravity is included; the wrench is force and moment about the body's origin, in its axes.

    Args:
        tree: The bodies.
        v: Velocities (nv,).
        a: Accelerations (nv,), Pinocchio's v̇.
    """
    motions = [tree.root.motion(v, a, tree.lift)]
    for joint in tree.joints:
        rate, change = v[joint.body.index], a[joint.body.index]
        motions.append(_next(joint, motions[joint.body.parent], rate, change))
    wrenches = [_wrench(*each) for each in zip(tree.numbers, motions, strict=True)]
    forces: list[Scalar] = [0.0] * len(v)
    for i, joint in reversed(list(enumerate(tree.joints, start=1))):
        body, (force, moment) = joint.body, wrenches[i]
        own = force[2] if body.slides else moment[2]
        forces[body.index] = total((own, times(body.armature, a[body.index])))
        force = joint.inwards(force)
        moment = plus(joint.inwards(moment), cross(joint.p, force))
        before = wrenches[body.parent]
        wrenches[body.parent] = plus(before[0], force), plus(before[1], moment)
    force, moment = wrenches[0]
    own = tree.root.felt(force, moment)
    forces[: len(own)] = own
    return forces, [*force, *moment]


class Root(Protocol):
    """How the first body moves: what of v, forces and inertia is its own."""

    def inwards(self, at: SymbolicConfiguration, vector: Vector) -> Vector:
        """Return a vector (3,) of the world's axes in the body's."""

    def motion(self, v: Vector, a: Vector, lift: Vector) -> BodyMotion:
        """Return the body's motion at v and v̇ (nv,), ``lift`` (3,) against gravity, its axes."""

    def felt(self, force: Vector, moment: Vector) -> Vector:
        """Return what of a wrench on the body is in the generalised force."""

    def inertia(self, whole: ScalarInertia) -> dict[Pair, Scalar]:
        """Return the entries of the inertia matrix that are its alone, each pair once."""


class PlanarRoot:
    """A root that stays level: v begins with its velocity (x, y) and its turning rate."""

    def inwards(self, at: SymbolicConfiguration, vector: Vector) -> Vector:
        """Return a vector (3,) of the world's axes in the body's."""
        (x, y, z), (cos, sin) = vector, at.values[2:4]
        return [total((times(cos, x), times(sin, y))), total((times(cos, y), times(-sin, x))), z]

    def motion(self, v: Vector, a: Vector, lift: Vector) -> BodyMotion:
        """Return the body's motion."""
        ahead, left, up = lift
        lifted = [
            total((a[0], times(-v[2], v[1]), ahead)), total((a[1], times(v[2], v[0]), left)), up,
        ]  # fmt: skip
        return _motion([0.0, 0.0, v[2]], [0.0, 0.0, a[2]], lifted)

    def felt(self, force: Vector, moment: Vector) -> Vector:
        """Return force ahead and to the left, and the moment about the vertical."""
        return [force[0], force[1], moment[2]]

    def inertia(self, whole: ScalarInertia) -> dict[Pair, Scalar]:
        """Return its entries of the inertia matrix."""
        (x, y, _), turning = whole.mc, total((whole.second[0][0], whole.second[1][1]))
        mass = {(0, 0): whole.m, (1, 1): whole.m, (2, 2): turning}
        return mass | {(0, 2): -y, (1, 2): x}


class FreeRoot:
    """A free-flyer: v begins with its linear and its angular velocity, in its own axes."""

    def inwards(self, at: SymbolicConfiguration, vector: Vector) -> Vector:
        """Return a vector (3,) of the world's axes in the body's."""
        x, y, z, w = at.values[3:7]
        axis, twice = [-x, -y, -z], cross([-x, -y, -z], vector)  # v + 2 w a × v + 2 a × (a × v)
        twice = [2.0 * each for each in twice]
        return plus(vector, [times(w, each) for each in twice], cross(axis, twice))

    def motion(self, v: Vector, a: Vector, lift: Vector) -> BodyMotion:
        """Return the body's motion."""
        speed, spin = v[:3], v[3:6]
        return _motion(spin, a[3:6], plus(a[:3], cross(spin, speed), lift))

    def felt(self, force: Vector, moment: Vector) -> Vector:
        """Return the whole wrench."""
        return [*force, *moment]

    def inertia(self, whole: ScalarInertia) -> dict[Pair, Scalar]:
        """Return its entries of the inertia matrix."""
        (x, y, z), second = whole.mc, whole.second
        found: dict[Pair, Scalar] = {(i, i): whole.m for i in range(3)}
        found |= {(0, 4): z, (0, 5): -y, (1, 3): -z, (1, 5): x, (2, 3): y, (2, 4): -x}
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            found[3 + i, 3 + i] = total((second[j][j], second[k][k]))
            found[3 + i, 3 + j] = -second[i][j]
        return found


PLANAR_ROOT, FREE_ROOT = PlanarRoot(), FreeRoot()


def _next(joint: JointMotion, before: BodyMotion, rate: Scalar, change: Scalar) -> BodyMotion:
    """Return the motion of the body behind a joint.

    Args:
        joint: The joint.
        before: BodyMotion of the body before it.
        rate: Of the joint.
        change: Its derivative.
    """
    x, y, z = spin = joint.outwards(before.spin)
    turn = joint.outwards(before.turn)
    lift = joint.outwards(plus(before.lift, product(before.U, joint.p)))
    beside = [times(y, rate), times(-x, rate), 0.0]
    if joint.body.slides:
        return _motion(spin, turn, plus(lift, beside, beside, [0.0, 0.0, change]))
    return _motion([x, y, total((z, rate))], plus(turn, beside, [0.0, 0.0, change]), lift)


def _wrench(numbers: Vector, motion: BodyMotion) -> tuple[Vector, Vector]:
    """Return the force on a body and its moment about the body's origin."""
    mc, U = numbers[MX : MZ + 1], motion.U
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz = numbers[XX:]
    ax, ay, az = motion.turn
    xx, yy, zz, xy, xz, yz = motion.squares
    force = plus([times(numbers[M], each) for each in motion.lift], product(U, mc))
    spread = [  # I α + ω × I ω
        (times(Ixx, ax), times(total((Izz, -Iyy)), yz), times(-Ixy, U[2][0])),
        (times(Iyy, ay), times(total((Ixx, -Izz)), xz), times(-Iyz, U[0][1])),
        (times(Izz, az), times(total((Iyy, -Ixx)), xy), times(-Ixz, U[1][2])),
    ]
    more = [
        (times(Ixz, U[1][0]), times(Iyz, total((yy, -zz)))),
        (times(Ixy, U[2][1]), times(Ixz, total((zz, -xx)))),
        (times(Iyz, U[0][2]), times(Ixy, total((xx, -yy)))),
    ]
    moment = [total((*a, *b)) for a, b in zip(spread, more, strict=True)]
    return force, plus(moment, cross(mc, motion.lift))
