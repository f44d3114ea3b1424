"""Which shapes of a robot must not touch each other, and their distances by coal.

Two shapes of a pair are on joints that move against each other. A pair may touch if it does so by
construction: the shapes are on neighbouring joints, touch at home, or touch in every posture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array, read_only
from rpctl.description.density import primitive
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import Surface, convex_hull, read_shape
from rpctl.description.records import Shape
from rpctl.errors import listed
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.link_boxes import mass_box
from rpctl.robot.model import Robot

TOUCH_M = 1e-3  # m: shapes nearer than this touch; deeper than this in each other they collide
POSTURES = 30  # random ones; a pair that touches in all of them is built so
SEED = 0
GROUND = "ground"
KEPT_MODELS = 2  # reference and run look at the same robot
Pairs = NDArray[np.intp]
WORLD = 0  # Pinocchio's index of what stands still
THINNEST_M = 1e-3  # m: edge of a box that stands in for a mesh
MOST_NEIGHBOURS = 250  # of a corner: coal takes 255
MOST_CORNERS = 250  # of a hull with a corner of more neighbours
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))  # rad: it spreads directions evenly over a sphere
NAMED = 4  # links in a note; more are counted


class AllowedPair(NamedTuple):
    """Two links that may touch, and why: ``"at home"`` or ``"in every posture"``."""

    first: str
    second: str
    why: str


class Nearest(NamedTuple):
    """The nearest points of a pair, in the world."""

    distance: float  # m; negative: how deep the shapes are in each other
    first: Array  # (3,) m
    second: Array  # (3,) m
    normal: Array  # (3,) unit vector from the first shape to the second


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """The shapes of a robot, of the ground and of obstacles, and the pairs that must not touch.

    Attributes:
        robot: The robot.
        shapes: The robot's, and then what stands in the world.
        pairs: Indices of two shapes each (n, 2), read-only.
        allowed: Links that touch by construction, but for neighbours.
        notes: What stands in for what, in sentences.
        geometry: The shapes and pairs as Pinocchio has them.
    """

    robot: Robot = field(repr=False)
    shapes: tuple[CollisionShape, ...] = field(repr=False)
    pairs: Pairs = field(repr=False)
    allowed: tuple[AllowedPair, ...]
    notes: tuple[str, ...]
    geometry: pin.GeometryModel = field(repr=False)

    def distances(self) -> Distances:
        """Return a workspace that computes distances; one for each thread."""
        return Distances(self)

    def with_obstacles(
        self, obstacles: Sequence[CollisionShape], against: Sequence[Sequence[int]]
    ) -> CollisionModel:
        """Return the model with more shapes that stand in the world.

        Args:
            against: Indices of the robot's shapes that each of them must not touch.
        """
        if not obstacles:
            return self
        first = len(self.shapes)
        pairs = [(shape, first + k) for k, row in enumerate(against) for shape in row]
        return _model(
            self.robot,
            (*self.shapes, *obstacles),
            np.vstack([self.pairs, np.array(pairs, dtype=np.intp).reshape(-1, 2)]),
            self.allowed,
            self.notes,
        )


class Distances:
    """Distances of the pairs of a model at one configuration at a time.

    Args:
        model: The model.
    """

    def __init__(self, model: CollisionModel) -> None:
        self._model, self._geometry = model.robot.model, model.geometry
        self._data, self._placed = self._model.createData(), pin.GeometryData(model.geometry)

    @property
    def data(self) -> pin.Data:
        """Pinocchio's workspace, with the placements of the joints."""
        return self._data

    def place(self, q: Array) -> None:
        """Place all shapes as at a configuration (nq,)."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, q)

    def distance(self, pair: int) -> float:
        """Return the distance of a pair at the last configuration, m; negative: the depth."""
        return float(pin.computeDistance(self._geometry, self._placed, pair).min_distance)

    def nearest(self, pair: int) -> Nearest:
        """Return the nearest points of a pair at the last configuration."""
        found = pin.computeDistance(self._geometry, self._placed, pair)
        return Nearest(
            float(found.min_distance),
            np.array(found.getNearestPoint1()),
            np.array(found.getNearestPoint2()),
            np.array(found.normal),
        )


@lru_cache(maxsize=KEPT_MODELS)
def collision_model(robot: Robot) -> CollisionModel:
    """Return the shapes of a robot, with the ground, and the pairs that must not touch.

    Meshes are read now; whoever needs no collisions does not call this. The last models are kept.
    """
    shapes, notes = read_collision_shapes(robot)
    floor = np.eye(4)
    floor[2, 3] = robot.drive.floor
    half_space = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    everything = (*shapes, standing(GROUND, floor, half_space))
    # Wheels and base stand on the ground; of a fixed base the file does not say how high it is.
    moved = arm_joints(robot) if robot.drive.base_speeds else set()
    touching = [(k, len(shapes)) for k, shape in enumerate(shapes) if shape.joint in moved]
    pairs = np.array([*_self_pairs(robot, shapes), *touching], dtype=np.intp)
    whole = _model(robot, everything, pairs.reshape(-1, 2), (), notes)
    return _without_built(whole)


def arm_joints(robot: Robot) -> set[int]:
    """Return the model's joints that the arm moves: its own, and all above which one of them is."""
    model, moved = robot.model, set(robot.joint_names)
    return {
        joint
        for joint in range(ROOT_JOINT + 1, model.njoints)
        if any(model.names[above] in moved for above in model.supports[joint])
    }


def _self_pairs(robot: Robot, shapes: Sequence[CollisionShape]) -> list[tuple[int, int]]:
    """Return the pairs of shapes on joints that are neither the same nor neighbours."""
    model = robot.model
    bearing = {shape.joint for shape in shapes}
    parent = {}
    for joint in bearing:  # joints that bear no shape do not keep others apart
        above = int(model.parents[joint])
        while above not in bearing and above != WORLD:
            above = int(model.parents[above])
        parent[joint] = above
    return [
        (a, b)
        for b, second in enumerate(shapes)
        for a, first in enumerate(shapes[:b])
        if first.joint != second.joint
        and parent[first.joint] != second.joint
        and parent[second.joint] != first.joint
    ]


def _model(
    robot: Robot,
    shapes: tuple[CollisionShape, ...],
    pairs: Pairs,
    allowed: tuple[AllowedPair, ...],
    notes: tuple[str, ...],
) -> CollisionModel:
    geometry = pin.GeometryModel()
    for number, shape in enumerate(shapes):
        geometry.addGeometryObject(
            pin.GeometryObject(
                f"{number} {shape.link}", shape.joint, pin.SE3(shape.pose), shape.geometry
            )
        )
    for first, second in pairs.tolist():
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    pairs.setflags(write=False)
    return CollisionModel(robot, shapes, pairs, allowed, notes, geometry)


def _without_built(model: CollisionModel) -> CollisionModel:
    """Return the model without the pairs that touch by construction; they are told."""
    robot, distances = model.robot, model.distances()
    distances.place(robot.configuration_at(np.zeros(3), robot.home))
    left = range(len(model.pairs))
    home = [pair for pair in left if distances.distance(pair) < TOUCH_M]
    always = sorted(set(left) - set(home))
    rng = np.random.default_rng(SEED)
    for _ in range(POSTURES):
        if not always:
            break
        distances.place(robot.random_configuration(rng))
        always = [pair for pair in always if distances.distance(pair) < TOUCH_M]
    why = {"at home": home, "in every posture": always}
    allowed = dict.fromkeys(
        AllowedPair(model.shapes[first].link, model.shapes[second].link, reason)
        for reason, pairs in why.items()
        for first, second in model.pairs[pairs].tolist()
    )
    kept = np.setdiff1d(left, [*home, *always]).astype(np.intp)
    return _model(robot, model.shapes, model.pairs[kept], tuple(allowed), model.notes)


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """A convex body that a joint moves, or that stands in the world.

    Attributes:
        link: The link's name; of what stands in the world what it is.
        joint: Index of the joint in the Pinocchio model; ``WORLD`` for what stands still.
        pose: Its pose (4, 4) in the joint's frame.
        geometry: The body as coal has it.
        centre: Centre (3,) of a ball about it, in the joint's frame, m.
        radius: Of that ball, m; inf for a half-space.
    """

    link: str
    joint: int
    pose: Array = field(repr=False)
    geometry: Any = field(repr=False)
    centre: Array = field(repr=False)
    radius: float


def read_collision_shapes(robot: Robot) -> tuple[tuple[CollisionShape, ...], tuple[str, ...]]:
    """Return the shapes of a robot and what there is to say of them.

    Boxes, cylinders, capsules and spheres are exact; of a mesh the convex hull is taken. For a
    mesh that is missing the box of its link's inertia stands in. A robot without any <collision>
    has its <visual> shapes taken.

    Args:
        robot: The robot; its meshes are read confined, as for the viewer.
    """
    links = robot.description.links
    drawn = not any(link.collisions for link in links)
    shapes_of = {link.name: link.visuals if drawn else link.collisions for link in links}
    found: list[CollisionShape] = []
    faults: dict[str, list[str]] = {}
    for link in links:
        for shape in shapes_of[link.name]:
            try:
                found.append(_placed(robot, link.name, shape.origin, _geometry(robot, shape)))
            except MeshError as fault:  # noqa: PERF203 - one bad mesh must not cost the others
                faults.setdefault(str(fault), []).append(link.name)
        if any(link.name in names for names in faults.values()) and link.mass:
            pose, half = mass_box(robot.description, link.name)
            edges = np.maximum(2.0 * half, THINNEST_M)
            found.append(_placed(robot, link.name, pose, coal.Box(*edges.tolist())))
    notes = [
        f"the collision mesh of {listed(dict.fromkeys(names), NAMED)} is missing ({fault}); rpctl "
        "uses a box of the link's inertia instead"
        for fault, names in faults.items()
    ]
    if drawn and found:
        notes.append(
            "the robot has no <collision>; rpctl checks its <visual> shapes for collisions"
        )
    return tuple(found), tuple(notes)


def standing(what: str, pose: Array, geometry: Any) -> CollisionShape:
    """Return a shape that stands in the world.

    Args:
        pose: In the world (4, 4), m.
    """
    return _shape(what, WORLD, pose, geometry)


def _placed(robot: Robot, link: str, origin: Array, geometry: Any) -> CollisionShape:
    """Return a shape that stands at ``origin`` (4, 4) in a link's frame."""
    frame = robot.frame(link)
    return _shape(link, int(frame.parentJoint), frame.placement.homogeneous @ origin, geometry)


def _shape(name: str, joint: int, pose: Array, geometry: Any) -> CollisionShape:
    geometry.computeLocalAABB()
    centre = pose[:3, :3] @ geometry.aabb_center + pose[:3, 3]
    radius = float(geometry.aabb_radius)
    if isinstance(geometry, coal.Halfspace):
        centre, radius = np.zeros(3), np.inf
    return CollisionShape(name, joint, read_only(pose), geometry, read_only(centre), radius)


def _geometry(robot: Robot, shape: Shape) -> Any:
    """Return a shape as coal has it.

    Raises:
        MeshError: Its mesh is missing, refused, flat, or of no sensible size.
    """
    if shape.mesh is not None:
        mesh = read_shape(shape.mesh, shape.size, robot.description.mesh_paths)
        return _convex(_hull(mesh.surfaces, shape.size))
    return primitive(shape)


def _hull(surfaces: Sequence[Surface], scale: Sequence[float]) -> Surface:
    """Return the convex hull of the surfaces of a mesh, with as many corners as coal can take.

    coal counts the neighbours of a corner in eight bits, and a disc may have one corner that all
    triangles share. Then the corners farthest out along ``MOST_CORNERS`` directions stay: of a disc
    of radius r, all but 0.1 % of r.

    Args:
        scale: By which each axis is multiplied (3,).

    Raises:
        MeshError: It is flat, or there is no process to compute it.
    """
    hull = convex_hull(surfaces, scale)
    if np.bincount(hull.faces.ravel()).max() <= MOST_NEIGHBOURS:
        return hull
    heights = 1.0 - (2.0 * np.arange(MOST_CORNERS) + 1.0) / MOST_CORNERS
    turns, wide = GOLDEN_ANGLE * np.arange(MOST_CORNERS), np.sqrt(1.0 - heights**2)
    outward = np.array([wide * np.cos(turns), wide * np.sin(turns), heights])
    far = np.unique((hull.vertices @ outward).argmax(axis=0))
    return convex_hull([Surface(hull.vertices[far], hull.faces[:0], None)], (1.0, 1.0, 1.0))


def _convex(hull: Surface) -> Any:
    """Return a convex body as coal has it."""
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend([*hull.vertices])
    triangles.extend([coal.Triangle(*corners) for corners in hull.faces.tolist()])
    return coal.Convex(points, triangles)
