"""How a robot stands: what touches the ground besides its wheels, and how contacts share a load."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint, Link, Shape
from rpctl.drive.leaning import mesh_reaches
from rpctl.drive.wheels import GROUND_TOLERANCE_M
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot

MIN_CONTACTS = 3  # on which a body stands
MIN_SHAPE_SIZE_M = 2e-3  # m: a shape no larger than this marks a frame and bears nothing


@dataclass(frozen=True)
class Support:
    """A part that slides, rolls or swivels over the ground without friction.

    Attributes:
        name: Its link, with the shape's line where the link has several.
        joint: Pinocchio's index of the joint that carries it; 1 is the root.
        point: Its lowest point, or its centre where it rolls, in that joint's frame (3,), m.
        link: Its link.
        line: Line of its shape in the file.
    """

    name: str
    joint: int
    point: tuple[float, float, float]
    link: str = ""
    line: int = 0


@dataclass(frozen=True)
class Supports:
    """What is known of a robot's supports.

    Attributes:
        parts: The supports, in the order of the file.
        unknown: Links drawn by meshes alone that touch the ground at a place that is not known:
            casters, and where less than three contacts are known, whatever reaches down to it.
    """

    parts: tuple[Support, ...]
    unknown: tuple[str, ...]


def find_supports(robot: Robot) -> Supports:
    """Find where a robot touches the ground besides its drive wheels.

    A support is a sphere, cylinder, capsule or small box among a link's collision shapes, or else
    among its visual ones, whose lowest point lies at the height of the ground, and stays there:
    its link is held by the root link through fixed or frozen joints, joints that turn about
    upright axes, and joints that turn it about its own centre, as in a caster.

    Args:
        robot: The robot.
    """
    tree = robot.tree
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    found: list[Support] = []
    meshes: list[str] = []

    def on_wheel(link: Link) -> bool:
        return any(joint.name in wheels for joint in tree.description.chain(link.name))

    for link in tree.description.links:
        if on_wheel(link):
            continue
        chain = tree.description.chain(link.name)
        free = tree.free_joints(link.name)
        touching = _touching(robot, link, link.collisions, free)
        touching = touching or _touching(robot, link, link.visuals, free)
        several = len(touching) > 1
        for shape, support in touching:
            name = f"{link.name} (line {shape.line})" if several else link.name
            found.append(replace(support, name=name))
        if not touching and _mesh_caster(robot, link, chain):
            meshes.append(link.name)
    if not meshes and len(found) + len(wheels) < MIN_CONTACTS:
        others = (each for each in tree.description.links if not on_wheel(each))
        meshes = [link.name for link in others if mesh_reaches(tree, link, robot.drive.ground)]
    return Supports(tuple(found), tuple(meshes))


def _touching(
    robot: Robot, link: Link, shapes: Sequence[Shape], free: list[Joint]
) -> list[tuple[Shape, Support]]:
    """Return the shapes of a link that touch the ground, each place once."""
    found: list[tuple[Shape, Support]] = []
    for shape in shapes:
        pose = robot.tree.pose(link.name) @ shape.origin
        point = _lowest(shape, pose, 2.0 * max(w.radius for w in robot.drive.wheels))
        if point is None or max(shape.size) <= MIN_SHAPE_SIZE_M:
            continue
        steady = all(_keeps_height(robot.tree, joint, shape, pose) for joint in free)
        if not steady or abs(point[2] - robot.drive.ground) > GROUND_TOLERANCE_M:
            continue
        if not all(map(robot.tree.is_upright, free)):
            point = pose[:3, 3]  # it rolls: its lowest point stays below its centre
        carrier = robot.model.getJointId(free[-1].name) if free else ROOT_JOINT
        x, y, z = _in_carrier(robot, free, point)
        support = Support(link.name, carrier, (x, y, z), link.name, shape.line)
        if all(
            math.dist(support.point[:2], known.point[:2]) > GROUND_TOLERANCE_M for _, known in found
        ):
            found.append((shape, support))
    return found


def _lowest(shape: Shape, pose: Array, widest: float) -> Array | None:
    """Return the lowest point (3,) of a shape, the middle of a lowest line or face.

    None for a mesh, and for a flat bottom wider than ``widest`` (m), which is a hull's.
    """
    centre, axis = pose[:3, 3], pose[:3, 2]
    down = np.array([0.0, 0.0, -1.0])
    if shape.kind == "sphere":
        return centre + shape.size[0] * down
    if shape.kind == "box":
        signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        corners = centre + (0.5 * signs * shape.size) @ pose[:3, :3].T
        lowest = corners[corners[:, 2] < corners[:, 2].min() + MIN_SHAPE_SIZE_M]
        return None if max(shape.size) > widest else np.asarray(lowest.mean(axis=0))
    if shape.kind not in ("cylinder", "capsule"):
        return None
    radius, length = shape.size
    tip = centre - math.copysign(0.5 * length, axis[2]) * axis
    end = centre if abs(axis[2]) <= MAX_TILT_SINE else tip
    if shape.kind == "capsule":
        return np.asarray(end + radius * down)
    if math.hypot(axis[0], axis[1]) <= MAX_TILT_SINE:
        return None if 2.0 * radius > widest else np.asarray(tip)
    fall = down - (down @ axis) * axis
    return np.asarray(end + radius * fall / np.linalg.norm(fall))


def _keeps_height(tree: FrozenTree, joint: Joint, shape: Shape, pose: Array) -> bool:
    """Return whether a shape keeps its height above the ground while a joint moves."""
    if joint.kind == "prismatic":
        return False
    if tree.is_upright(joint):
        return True
    origin, axis = tree.frame(joint)[:3, 3], tree.axis(joint)
    centred = float(np.linalg.norm(np.cross(axis, pose[:3, 3] - origin))) <= MIN_SHAPE_SIZE_M
    along = float(np.linalg.norm(np.cross(axis, pose[:3, 2]))) <= MAX_TILT_SINE
    return centred and (shape.kind == "sphere" or (shape.kind in ("cylinder", "capsule") and along))


def _in_carrier(robot: Robot, free: list[Joint], point: Array) -> list[float]:
    """Return a point of the root link's frame in the frame of the last free joint."""
    if not free:
        return [float(x) for x in point]
    pose = robot.tree.pose(free[-1].child)
    return [float(x) for x in pose[:3, :3].T @ (point - pose[:3, 3])]


def _mesh_caster(robot: Robot, link: Link, chain: tuple[Joint, ...]) -> bool:
    """Tell whether a link is a caster's roller that only meshes describe.

    It turns without end about a level axle no higher above the ground than a wheel's radius.
    """
    shapes = link.shapes
    if not shapes or any(shape.kind != "mesh" for shape in shapes) or not chain:
        return False
    joint = chain[-1]
    limited = any(free.kind != "continuous" for free in robot.tree.free_joints(link.name))
    if joint.kind != "continuous" or limited:
        return False
    height = robot.tree.frame(joint)[2, 3] - robot.drive.ground
    reach = max(wheel.radius for wheel in robot.drive.wheels) + GROUND_TOLERANCE_M
    return robot.tree.is_level(joint) and bool(0.0 < height <= reach)


MIN_STANCE_WIDTH_M = 5e-3  # m: contacts this near to one line do not hold a balance
ON_EDGE_M = 1e-12  # m: a contact so near to a line is on it
BLOCK_NUMBERS = 300_000  # that are held at once: they stay in the cache
LOAD_RESOLUTION = 1e-9  # of the load: a smaller share is rounding


@dataclass(frozen=True)
class LoadSplit:
    """How contacts at given places share any load.

    Attributes:
        statics: Map (k, n) from the contacts' loads to their sum and those moments that they
            determine.
        split: Map (n, 3) from the sum and both moments, Σ N (1, x, y), to the loads of least norm.
        free: Changes of the loads that statics do not see (n - k, n), orthonormal.
        directions: The moments (k, 3) of the sum and the moments about x and y of ``statics``.
    """

    statics: Array
    split: Array
    free: Array
    directions: Array


@dataclass(frozen=True)
class Stance(LoadSplit):
    """Contacts of one posture that hold a balance, in the root link's frame; they determine all.

    Attributes:
        inward: Inward unit normals of the support polygon's edges (n_edges, 2).
        offset: Signed distance of the root link's origin to each edge (n_edges,), m.
    """

    inward: Array
    offset: Array


def make_stance(points: Array) -> Stance:
    """Return the polygon and the loads' split of contacts (n, 2) that hold a balance."""
    statics = np.vstack([np.ones(len(points)), points.T])  # Σ N, Σ N x, Σ N y
    U, singular, Vt = np.linalg.svd(statics)
    corners = points[_hull(points)]
    edge = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.linalg.norm(edge, axis=1)[:, None]
    return Stance(
        statics=statics,
        split=(Vt[:3].T / singular) @ U.T,
        free=Vt[3:],
        directions=np.eye(3),
        inward=inward,
        offset=-(inward * corners).sum(axis=1),
    )


def _hull(points: Array) -> list[int]:
    """Return the corners of the convex hull (indices), counterclockwise, by monotone chains."""
    order = np.lexsort(points.T[::-1]).tolist()

    def half(indices: list[int]) -> list[int]:
        chain: list[int] = []
        for i in indices:
            while len(chain) > 1 and _turn(points[chain[-2]], points[chain[-1]], points[i]) <= 0.0:
                chain.pop()
            chain.append(i)
        return chain[:-1]

    return half(order) + half(order[::-1])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def margins(points: Array, at: Array) -> Array:
    """Return how far inside their contacts' support polygons places are (K,), m; negative outside.

    A line through two contacts is an edge if all others are to its left.

    Args:
        points: Contacts (K, n, 2), m.
        at: Places (K, 2), m.
    """
    found = np.empty(len(points))
    size = max(1, BLOCK_NUMBERS // points.shape[1] ** 3)
    for first in range(0, len(points), size):
        rows = slice(first, first + size)
        start, places = points[rows, :, None], points[rows, None]
        edge = places - start  # from contact to contact (K, n, n, 2)
        length = np.hypot(edge[..., 0], edge[..., 1])
        left = np.stack([-edge[..., 1], edge[..., 0]], axis=-1)
        left /= np.where(length > ON_EDGE_M, length, np.inf)[..., None]
        aside = np.einsum("kijx,klx->kijl", left, points[rows])
        aside -= np.einsum("kijx,kix->kij", left, points[rows])[..., None]
        edges = (aside.min(axis=-1) >= -ON_EDGE_M) & (length > ON_EDGE_M)
        inside = np.einsum("kijx,kijx->kij", left, at[rows, None, None] - start)
        found[rows] = np.where(edges, inside, np.inf).min(axis=(1, 2))
    return found


def even_loads(points: Array, moments: Array) -> Array:
    """Return the loads (K, n) of least norm with given sums and moments, as a stance's ``split``.

    They are those of a plane over the ground, N_i = W/n + (p_i − c)·g: with c the contacts' centre
    g solves Σ (p_i − c)(p_i − c)ᵀ g = Σ N_i p_i − W c.

    Args:
        points: Contacts (K, n, 2), m.
        moments: Σ N_i (1, x_i, y_i) (K, 3); N, N·m.
    """
    centre, weight = points.mean(axis=1), moments[:, :1]
    arms = points - centre[:, None]
    spread = np.swapaxes(arms, 1, 2) @ arms
    slope = np.linalg.solve(spread, (moments[:, 1:] - weight * centre)[..., None])
    return np.asarray(weight / points.shape[1] + (arms @ slope)[..., 0])


def width(points: Array) -> float:
    """Return how far points (n, 2) lie off their best line, m: 0 for fewer than three."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1])


def loads(stance: Stance, moments: Array, margin: float) -> Array:
    """Return the contacts' loads (n,), N, with Σ N_i (1, x_i, y_i) = ``moments``.

    Those of least norm lie in one plane over the ground, N = a + b x + c y: the loads of a rigid
    robot on equal springs. Where the plane dips below the ground although the robot does not tip,
    the springs there let go, and N = max(0, a + b x + c y): the least ones that only push, a least
    distance problem ([LH74, Ch. 23]).

    Args:
        stance: The contacts' polygon and how they share a load.
        moments: Σ N_i (1, x_i, y_i) (3,) of the ground's force; N, N·m.
        margin: Distance of the zero-moment point to the polygon's edge, m; negative outside.
    """
    load = stance.split @ moments
    if margin <= 0.0 or len(load) == 3 or load.min() >= 0.0:
        return np.asarray(load)
    found = pressed_loads(stance, moments, load)
    return np.asarray(load) if found is None else found.load


class ContactLoads(NamedTuple):
    """Loads of n contacts.

    Attributes:
        load: (n,) N, none negative.
        slope: Derivatives (n, 3) by the sum and the moments.
        tips: Whether no loads that only push have these moments.
    """

    load: Array
    slope: Array
    tips: bool


def make_split(points: Array) -> LoadSplit:
    """Return how contacts share loads, whatever their places.

    Contacts on one line determine the moment along it only; the other is left out.

    Args:
        points: Their places (n, 2), root link's axes, m.
    """
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0))
    known = np.flatnonzero(spread > MIN_STANCE_WIDTH_M)
    directions = np.zeros((1 + len(known), 3))
    directions[0, 0] = 1.0
    directions[1:, 1:] = axes[known]
    statics = directions @ np.vstack([np.ones(len(points)), points.T])
    U, singular, Vt = np.linalg.svd(statics)
    count = len(directions)
    split = (Vt[:count].T / singular) @ U.T @ directions
    return LoadSplit(statics, split, Vt[count:], directions)


def share_load(split: LoadSplit, moments: Array) -> ContactLoads:
    """Return the loads that contacts share.

    Where a + b x + c y dips below the ground, contacts let go until those that are left only push.
    Where none can have such moments, the robot tips: then each contact that would push has its part
    of the whole load.

    Args:
        split: How they share loads.
        moments: Their sum, N, and Σ N_i (x_i, y_i), N·m (3,).
    """
    load = split.split @ moments
    if load.min(initial=0.0) >= 0.0:
        return ContactLoads(load, split.split, False)
    if moments[0] <= 0.0:
        return ContactLoads(np.zeros(len(load)), np.zeros((len(load), 3)), True)
    return pressed_loads(split, moments, load) or _tipping(split, moments, load)


def pressed_loads(split: LoadSplit, moments: Array, load: Array) -> ContactLoads | None:
    """Return the least loads that only push, or None where there are none: [LH74, Ch. 23].

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
        load: Loads of least norm (n,), not all pushing.
    """
    share = load / moments[0]
    left, target = np.vstack([split.free, -share]), np.zeros(len(split.free) + 1)
    target[-1] = 1.0
    residual = left @ scipy.optimize.nnls(left, target)[0] - target
    if residual[-1] > -LOAD_RESOLUTION:
        return None
    share = share - split.free.T @ residual[:-1] / residual[-1]
    pressed, slope = share > LOAD_RESOLUTION, np.zeros_like(split.split)
    slope[pressed] = np.linalg.pinv(split.statics[:, pressed]) @ split.directions
    return ContactLoads(np.maximum(slope @ moments, 0.0), slope, False)


def _tipping(split: LoadSplit, moments: Array, load: Array) -> ContactLoads:
    """Return each pushing contact's part of the whole load, of a robot that tips.

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
        load: Loads of least norm (n,), pushing or not.
    """
    pushing = np.maximum(load, 0.0)
    total = pushing.sum()
    change = split.split * (load > 0.0)[:, None] / total
    part = pushing / total
    slope = moments[0] * (change - part[:, None] * change.sum(axis=0))
    slope[:, 0] += part
    return ContactLoads(moments[0] * part, slope, True)
