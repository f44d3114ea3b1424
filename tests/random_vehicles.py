"""Random vehicles of every kind: casters, cars, tricycles, bicycles, swerves, omni wheels.

Their numbers are general, their axes carry the rounding of CAD exports, and their root link lies
at any height. What has to be found of them is known from how they are built.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tests import urdf
from tests.random_robots import (
    MAX_HEADING_RAD,
    MIN_MOUNT_HEIGHT_M,
    Array,
    RandomSource,
    RobotBuilder,
    add_arm_joint,
    add_base,
    add_wheel,
    rotation,
)

KINDS = ("casters", "car-like", "free", "tied", "tricycle", "bicycle", "steered", "omni",
         "skid-steer", "wide", "mecanum", "powered")  # fmt: skip
DRIVE_TYPES = {
    "casters": "differential",
    "free": "car-like",
    "tied": "car-like",
    "wide": "skid-steer",
    "powered": "powered-casters",
}
WIDE_DRIVE = (0.9, 0.1, -0.05)  # effective track and centre of rotation that a drive file tells, m
DRIVE_FILES = {  # what their drive files say; the others are found
    "free": 'type = "car-like"\nsteering = "free"\n',
    "skid-steer": 'type = "skid-steer"\n',
    "wide": 'type = "skid-steer"\ntrack = {}\npoint = [{}, {}]\n'.format(*WIDE_DRIVE),
    "mecanum": 'type = "mecanum"\n',
}


@dataclass
class Vehicle:
    """A vehicle under construction, and what detection has to find.

    Attributes:
        tree: Its links and joints.
        heading: Forward direction in the root link's frame, rad.
        point: Where its own frame (forward, left) starts, in the root link's frame (x, y), m.
        ground: Height of the ground in the root link's frame, m.
        place: Origin of the link that holds the wheels, in the root link's frame (3,), m.
        R: Rotation (3, 3) of that link in the root link's frame.
        tilt: Angle by which each axis is off, rad.
        radii: Radius of each wheel, by joint, m.
        roles: Role of each swivel, by joint.
    """

    tree: RobotBuilder
    heading: float
    point: Array
    ground: float
    place: Array
    R: Array
    tilt: float
    radii: dict[str, float] = field(default_factory=dict)
    roles: dict[str, str] = field(default_factory=dict)

    def at(self, ahead: float, left: float) -> Array:
        """Return a place (x, y) in the root link's frame, m."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.point + np.array([cos * ahead - sin * left, sin * ahead + cos * left])

    def leaning(self, axis: Array) -> Array:
        """Return a unit axis (3,) as a CAD program rounds it."""
        leaned = axis + self.tree.vector(self.tilt)
        return np.asarray(leaned / np.linalg.norm(leaned))

    def wheel(
        self,
        name: str,
        place: Array,
        angle: float,
        carrier: tuple[str, Array, Array] | None = None,
        ball: bool = False,
    ) -> None:
        """Add a wheel at a place (2,), heading along an angle of the root link's frame (rad)."""
        radius = self.tree.choose.number(0.03, 0.3)
        link, origin, R = carrier or ("base", self.place, self.R)
        centre = np.array([*place, self.ground + radius])
        left = self.leaning(np.array([-math.sin(angle), math.cos(angle), 0.0]))
        add_wheel(self.tree, name, radius, link, R.T @ (centre - origin), R, left, ball)
        self.radii[f"{name}_joint"] = radius

    def swivel(
        self,
        name: str,
        place: Array,
        angle: float,
        role: str,
        trail: float = 0.0,
        limit: float = math.inf,
        more: str = "",
    ) -> None:
        """Add an upright joint of any frame, with one wheel or two on one axle.

        Args:
            name: Of the joint.
            place: Of its axis (x, y) in the root link's frame, m.
            angle: Rolling direction of its wheels at position 0, rad.
            role: What it has to be found as.
            trail: Distance of its wheels ahead of the axis, m.
            limit: Of its position, rad.
            more: XML within its joint.
        """
        tree = self.tree
        origin = np.array([*place, self.ground + tree.choose.number(0.0, 0.8)])
        local = tree.angles()
        sign = 1.0 if tree.flag() else -1.0
        R = self.R @ rotation(local)
        axis = R.T @ (sign * self.leaning(np.array([0.0, 0.0, 1.0])))
        tree.link(f"{name}_fork", (0.3, 2.0))
        if math.isfinite(limit):
            more += urdf.limit(-limit, limit, 30.0, 5.0)
        kind = "revolute" if math.isfinite(limit) else "continuous"
        xyz = self.R.T @ (origin - self.place)
        tree.joint(name, kind, ("base", f"{name}_fork"), xyz, local, axis, more)
        self.roles[name] = role
        ahead = np.array([math.cos(angle), math.sin(angle)])
        left = np.array([-ahead[1], ahead[0]])
        carrier = f"{name}_fork", origin, R
        contact = place + trail * ahead
        aside = tree.choose.number(-0.02, 0.02)
        if tree.flag():
            self.wheel(f"{name}_wheel", contact + aside * left, angle, carrier)
            return
        gap = tree.choose.number(0.02, 0.06)
        self.wheel(f"{name}_left", contact + (aside + gap) * left, angle, carrier)
        self.wheel(f"{name}_right", contact + (aside - gap) * left, angle, carrier)


def pair(built: Vehicle, name: str, ahead: float) -> None:
    """Add two wheels on one axle, P in their middle where ``ahead`` is 0."""
    half = built.tree.choose.number(0.15, 0.5)
    for side, left in (("left", half), ("right", -half)):
        built.wheel(f"{name}_{side}", built.at(ahead, left), built.heading)


def car(built: Vehicle, kind: str) -> None:
    number = built.tree.choose.number
    if built.tree.flag():
        pair(built, "rear", 0.0)
    else:  # a lorry
        reach = number(0.1, 0.3)
        pair(built, "rear_1", reach)
        pair(built, "rear_2", -reach)
    ahead, limit = number(0.4, 1.5), number(0.4, 1.2)
    ahead *= 1.0 if built.tree.flag() else -1.0  # some steer at the back
    trail = 0.0 if kind == "car-like" else number(-0.03, 0.03)
    second = {"car-like": "follower", "free": "steered", "tied": "mimic"}[kind]
    mimic = f'<mimic joint="steer_left" multiplier="{number(0.8, 1.2)!r}"/>'
    for side, sign in (("left", 1.0), ("right", -1.0)):
        where = built.at(ahead, sign * number(0.15, 0.5))
        role = "steered" if side == "left" else second
        tied = mimic if role == "mimic" else ""
        angle = built.heading + number(-0.2, 0.2)
        built.swivel(f"steer_{side}", where, angle, role, trail, limit, tied)


def one_steered(built: Vehicle, kind: str) -> None:
    number = built.tree.choose.number
    if kind == "tricycle":
        pair(built, "rear", 0.0)
    else:
        built.wheel("rear", built.at(0.0, 0.0), built.heading)
    ahead = number(0.4, 1.5) * (1.0 if built.tree.flag() else -1.0)
    where, angle = built.at(ahead, number(-0.1, 0.1)), built.heading + number(-0.3, 0.3)
    built.swivel("steer", where, angle, "steered", number(-0.05, 0.05), number(0.4, 1.4))


def steered(built: Vehicle, _: str) -> None:
    number = built.tree.choose.number
    count = built.tree.choose.integer(2, 4)
    start = number(-math.pi, math.pi)
    for k in range(count):
        turn, reach = start + 2.0 * math.pi * (k + number(-0.2, 0.2)) / count, number(0.3, 0.7)
        where = np.array([reach * math.cos(turn), reach * math.sin(turn)])
        built.swivel(f"steer_{k}", where, built.heading + number(-1.0, 1.0), "")


def powered(built: Vehicle, _: str) -> None:
    """Add two to four casters with motors at swivels and wheels, or at twin wheels alone."""
    number = built.tree.choose.number
    count = built.tree.choose.integer(2, 4)
    start = number(-math.pi, math.pi)
    for k in range(count):
        turn, reach = start + 2.0 * math.pi * (k + number(-0.2, 0.2)) / count, number(0.3, 0.7)
        where = np.array([reach * math.cos(turn), reach * math.sin(turn)])
        trail = number(0.04, 0.12) * (1.0 if built.tree.flag() else -1.0)
        built.swivel(f"powered_{k}", where, number(-3.0, 3.0), "caster", trail)
        twin = f"powered_{k}_left_joint" in built.radii
        names = [name for name in built.radii if name.startswith(f"powered_{k}_")]
        if not twin or built.tree.flag():
            names.append(f"powered_{k}")
        built.tree.parts.append(urdf.actuated(*names))


def omni(built: Vehicle, _: str) -> None:
    number = built.tree.choose.number
    count = built.tree.choose.integer(3, 4)
    for k in range(count):
        turn, reach = 2.0 * math.pi * (k + number(-0.1, 0.1)) / count, number(0.2, 0.6)
        where = np.array([reach * math.cos(turn), reach * math.sin(turn)])
        built.wheel(f"omni_{k}", where, turn + 0.5 * math.pi + number(-0.1, 0.1))


def axles(built: Vehicle, kind: str) -> None:
    reach = built.tree.choose.number(0.3, 0.6)
    places = [reach, -reach]
    if kind != "mecanum" and built.tree.flag():
        places.append(0.0)
    for k, ahead in enumerate(places):
        pair(built, f"axle_{k}", ahead)
    if kind == "wide":
        built.point = np.array(WIDE_DRIVE[1:])


BUILDERS = {"casters": lambda built, _: pair(built, "drive", 0.0), "car-like": car, "free": car,
            "tied": car, "tricycle": one_steered, "bicycle": one_steered, "steered": steered,
            "omni": omni, "powered": powered, "skid-steer": axles, "wide": axles,
            "mecanum": axles}  # fmt: skip


def vehicle(kind: str, seed: int) -> tuple[str, Vehicle]:
    """Return the URDF of a random vehicle of a kind (see ``KINDS``), and what it is."""
    tree = RobotBuilder(RandomSource(np.random.default_rng([seed, KINDS.index(kind)])))
    number = tree.choose.number
    place, turn = add_base(tree)
    point = np.array([number(-0.4, 0.4), number(-0.4, 0.4)])
    heading, ground = number(-MAX_HEADING_RAD, MAX_HEADING_RAD), number(-2.0, 1.0)
    tilt = 10.0 ** number(-6.0, -4.0) if tree.flag() else 0.0
    built = Vehicle(tree, heading, point, ground, place, rotation(turn), tilt)
    BUILDERS[kind](built, kind)
    for index in range(tree.choose.integer(kind == "casters", 2)):
        where = built.at(number(-1.5, -0.8), number(-0.5, 0.5))
        trail = -number(0.04, 0.12)
        built.swivel(f"caster_{index}", where, number(-3.0, 3.0), "caster", trail)
    if kind not in ("bicycle", "steered", "omni", "powered") and tree.flag():
        where = built.at(number(0.8, 1.5), number(-0.5, 0.5))
        built.wheel("ball", where, number(-3.0, 3.0), ball=True)
    mount = built.R.T @ (np.array([0.0, 0.0, ground + 0.3 + MIN_MOUNT_HEIGHT_M]) - place)
    for index in range(tree.choose.integer(0, 3)):
        add_arm_joint(tree, index, mount)
    return urdf.robot(kind, *tree.parts), built
