"""Robots that were built a little differently: other masses, wheels and losses than drawn.

Each setting of a :class:`Variation` says how it changes :class:`BuiltNumbers`, of any number of
robots at a time: one of them becomes a robot by :func:`vary`, and thousands the parameters of one
compiled model, without a robot each.

A body's pseudo-inertia is ∫ r rᵀ dm with r = (x, y, z, 1) (4, 4): the mass, the first moments and
the second ones in one matrix, which is T J Tᵀ in another frame (P. M. Wensing, S. Kim and J.-J. E.
Slotine, "Linear matrix inequalities for physically consistent inertial parameter identification",
IEEE Robotics and Automation Letters 3, 2018). Those of links that move together add up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array, read_only
from rpctl.description.density import write_inertials
from rpctl.description.records import Link
from rpctl.drive.scaled_wheels import scale_track, with_radii
from rpctl.errors import (
    LARGEST,
    DescriptionError,
    RpctlError,
    UnknownNameError,
    require_within,
)
from rpctl.files.records import NOT_NEGATIVE, POSITIVE, Range, Record, Setting
from rpctl.robot.build import require_dynamics
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.robot.vary import with_losses, with_payload

MAX_OFFSET_M = 1e3  # m: no centre of mass is farther off than this
Offset = tuple[float, float, float]
OFFSET = Range(-MAX_OFFSET_M, MAX_OFFSET_M)
Slope = tuple[float, float]  # rad, by which the ground rises along x and along y
LINK, WHEEL, JOINT, ACTUATOR = "link with a mass", "wheel", "joint", "actuator"


class BuiltNumbers:
    """The numbers of K robots that were built differently from one, a row each.

    Attributes:
        robot: The one that they differ from.
        names: Of its L links that have a mass, in file order, its wheels' joints, its moving
            joints, and those that are driven, by what they are.
        masses: Of the links (K, L), kg.
        centres: Of mass (K, L, 3), m, in the links' frames.
        spreads: Scales of the links' inertias about their centres of mass (K, L).
        radii: Of the wheels (K, n_wheels), m.
        track: Scales of the track (K,).
        damping: Of the joints (K, nv), N·m·s/rad or N·s/m.
        friction: Of the joints (K, nv), N·m or N.
        gravity: Acceleration in the frame of the ground (K, 3), m/s².
        payload: Name of the link that carries one; empty if no robot has any.
        loads: The masses of the payloads (K,), kg.
        places: Their places (K, 3), m, in the link's frame.
    """

    def __init__(self, robot: Robot, variations: Sequence[Any]) -> None:
        """Take the numbers of a robot, and let each setting of K variations change them.

        Raises:
            UnknownNameError: A pattern matches no link with a mass, wheel or joint.
            RpctlError: There is no link to carry a payload.
        """

        def many(values: Any) -> Array:
            return np.array([values] * len(variations), dtype=float)

        self.robot, lost = robot, (np.zeros(robot.nv),) * 2
        if robot.losses is not None:
            lost = robot.losses.damping, robot.losses.friction
        self._links = [link for link in robot.description.links if link.mass]
        self.names = {
            LINK: tuple(link.name for link in self._links),
            WHEEL: tuple(wheel.joint for wheel in robot.drive.wheels),
            JOINT: tuple(robot.entries),
            ACTUATOR: robot.actuators,
        }
        self.masses = many([link.mass for link in self._links])
        self.centres = many([link.com for link in self._links]).reshape(-1, len(self._links), 3)
        self.spreads, self.track = np.ones(self.masses.shape), np.ones(len(variations))
        self.radii = many([wheel.radius for wheel in robot.drive.wheels])
        self.damping, self.friction = map(many, lost)
        self.gravity = many(robot.model.gravity.linear)
        self.payload, self.loads, self.places = "", np.zeros(len(variations)), many(np.zeros(3))
        for name, perturbation in PERTURBATIONS.items():
            self._perturb(perturbation, [getattr(each, name) for each in variations])

    def _perturb(self, perturbation: Perturbation, given: Sequence[Any]) -> None:
        """Let the values of a setting change the numbers; where all have the same, it is a row."""
        if all(each is given[0] or each == given[0] for each in given):
            given = given[:1]
        change, kind, neutral = perturbation
        if not kind:
            change(self, given)
        elif any(given):
            rows = [by_pattern(each, self.names[kind], kind) for each in given]
            columns = [[row.get(name, neutral) for name in self.names[kind]] for row in rows]
            change(self, np.array(columns, dtype=float))

    def index(self, kind: str) -> list[int]:
        """Return the indices in v of the joints that are something."""
        return [self.robot.velocity_index(name) for name in self.names[kind]]

    @cached_property
    def changed(self) -> NDArray[np.bool_]:
        """Which links (K, L) have another mass, centre or inertia than the robot's."""
        heavier = self.masses != np.array([link.mass for link in self._links])
        moved = (self.centres != np.array([link.com for link in self._links])).any(axis=2)
        return np.asarray(heavier | (self.spreads != 1.0) | moved)

    @cached_property
    def body(self) -> list[int]:
        """Index of each link's body: that of its joint in the model, less the root's."""
        return [self.robot.frame(name).parentJoint - ROOT_JOINT for name in self.names[LINK]]

    @cached_property
    def _own(self) -> Array:
        return np.array([pseudo_inertia(x) for x in list(self.robot.model.inertias)[ROOT_JOINT:]])

    @property
    def moved(self) -> NDArray[np.intp]:
        """The bodies with another inertia than the robot's in any row."""
        return np.flatnonzero((self.bodies != self._own).any(axis=(0, 2, 3)))

    @cached_property
    def unloaded(self) -> Array:
        """Pseudo-inertias (K, n_bodies, 4, 4) of the bodies in Pinocchio's axes, no payload."""
        found = np.array([self._own] * len(self.masses))
        for k in np.flatnonzero(self.changed.any(axis=0)).tolist():
            link = self._links[k]
            pose = self.robot.frame(link.name).placement.homogeneous
            spread, com = np.zeros((4, 4)), np.array(link.com)[None]
            spread[:3, :3] = 0.5 * np.trace(link.inertia) * np.eye(3) - link.inertia
            more = (self.spreads[:, k, None, None] - 1.0) * (pose @ spread @ pose.T)
            more += self.masses[:, k, None, None] * _point(pose, self.centres[:, k])
            found[:, self.body[k]] += more - (link.mass or 0.0) * _point(pose, com)
        return found

    @cached_property
    def bodies(self) -> Array:
        """Pseudo-inertias (K, n_bodies, 4, 4) of the bodies with their payloads."""
        if not self.payload:
            return self.unloaded
        frame, found = self.robot.frame(self.payload), self.unloaded.copy()
        point = _point(frame.placement.homogeneous, self.places)
        found[:, frame.parentJoint - ROOT_JOINT] += self.loads[:, None, None] * point
        return found


def _point(pose: Array, places: Array) -> Array:
    """Return pseudo-inertias (K, 4, 4) of masses of 1 kg at places (K, 3) in a frame (4, 4).

    No matrix product: each is what it is alone, to the bit.
    """
    r = pose[:3, 3] + sum(places[:, k, None] * pose[:3, k] for k in range(3))
    r = np.column_stack([r, np.ones(len(r))])
    return np.asarray(r[:, :, None] * r[:, None])


class Perturbation(NamedTuple):
    """How a setting changes the numbers of robots.

    Attributes:
        change: Changes them, given the setting's values: of patterns (K, names), or one a robot;
            one row where all robots have the same.
        kind: What its patterns are the names of; empty: it has none.
        neutral: What a name has that no pattern matches.
    """

    change: Callable[[BuiltNumbers, Any], None]
    kind: str = ""
    neutral: Any = 0.0


def _scale(*names: str) -> Callable[[BuiltNumbers, Any], None]:
    """Return what scales some of the numbers of robots, all alike."""

    def change(numbers: BuiltNumbers, scales: Any) -> None:
        for name in names:
            getattr(numbers, name)[...] *= scales

    return change


def _move_centres(numbers: BuiltNumbers, offsets: Array) -> None:
    numbers.centres += offsets


def _add_damping(numbers: BuiltNumbers, added: Array) -> None:
    numbers.damping[:, numbers.index(JOINT)] += added


def _add_friction(numbers: BuiltNumbers, added: Array) -> None:
    numbers.friction[:, numbers.index(ACTUATOR)] += added


def _scale_losses(numbers: BuiltNumbers, scales: Sequence[float]) -> None:
    """Scale the robot's own losses, not those that are added."""
    own, more = numbers.robot.losses, np.array(scales)[:, None] - 1.0
    if own is not None:
        numbers.damping += more * own.damping
        numbers.friction += more * own.friction


def _carry(numbers: BuiltNumbers, payloads: Sequence[CarriedLoad]) -> None:
    """Let the robots carry payloads, all of them on the same link."""
    numbers.loads[:] = [each.mass for each in payloads]
    numbers.places[:] = [each.com for each in payloads]
    for link in {each.link_of(numbers.robot) for each in payloads if each.mass}:
        numbers.payload = link


def _tilt(numbers: BuiltNumbers, slopes: Sequence[Slope]) -> None:
    """Tilt the ground under the robots.

    A way of a metre along its x axis leads sin(along x) m upwards, one along y likewise: the
    upward direction is (sin along x, sin along y, √(1 − ...)) in the frame of the ground.
    """
    if np.any(slopes):
        along = np.sin(slopes)
        up = np.column_stack([along, np.sqrt(1.0 - np.square(along).sum(axis=1))])
        numbers.gravity[:] = -np.linalg.norm(numbers.robot.model.gravity.linear) * up


@dataclass(frozen=True)
class CarriedLoad(Record):
    """A point mass fixed to a link of the simulated robot, unknown to its controller."""

    of = "the payload's "
    link: Annotated[str, Setting("", "", "Name of the link; empty: that of the end effector.")] = ""
    mass: Annotated[
        float, Range(0.0, LARGEST, "0 or more, in kg"), Setting("kg", "mass", "Mass; 0: no load.")
    ] = 0.0
    com: Annotated[
        Offset, OFFSET, Setting("m", "place", "Its centre of mass (x, y, z) in the link's frame.")
    ] = (
        0.0,
        0.0,
        0.0,
    )

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        super().__post_init__()
        if len(self.com) != 3:
            raise RpctlError(f"the payload's com is {self.com}; give x, y, z in m")

    def link_of(self, robot: Robot) -> str:
        """Return the name of the link that carries the load.

        Raises:
            UnknownNameError: The link is not known.
            RpctlError: No link is named, and the robot has no end effector.
        """
        link = self.link or robot.end_effector
        if link is None:
            raise RpctlError(
                f"{robot.name} has no end effector to carry the payload; name a link in "
                "[plant.payload]"
            )
        if not robot.model.existBodyName(link):
            raise UnknownNameError("link", link, robot.description.link)
        return link


@dataclass(frozen=True, kw_only=True)
class Variation(Record):
    """How a robot differs from its file. Of several patterns that match a name the last counts."""

    masses: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "Scale of the mass",
            "Scales of the masses by pattern of link names, and with them of the "
            "inertias, as of another density.",
        ),
        Perturbation(_scale("masses", "spreads"), LINK, 1.0),
    ] = field(default_factory=dict)
    centres: Annotated[
        Mapping[str, Offset],
        OFFSET,
        Setting(
            "m",
            "Offset of the centre of mass",
            "Offsets of the centres of mass (x, y, z) in the links' own frames, by "
            "pattern of link names.",
        ),
        Perturbation(_move_centres, LINK, (0.0, 0.0, 0.0)),
    ] = field(default_factory=dict)
    inertias: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "Scale of the inertia",
            "Further scales of the inertias about the centres of mass, by pattern of link names.",
        ),
        Perturbation(_scale("spreads"), LINK, 1.0),
    ] = field(default_factory=dict)
    radii: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "Scale of the radius",
            "Scales of the wheels' radii, by pattern of wheel joints. The ground moves to the "
            "lowest points of the wheels.",
        ),
        Perturbation(_scale("radii"), WHEEL, 1.0),
    ] = field(default_factory=dict)
    track: Annotated[
        float,
        POSITIVE,
        Setting(
            "",
            "Scale of the track",
            "Scale of the distances of the wheels' contacts from the middle line; the wheels' "
            "masses stay where they are.",
        ),
        Perturbation(_scale("track")),
    ] = 1.0
    damping: Annotated[
        Mapping[str, float],
        NOT_NEGATIVE,
        Setting(
            "N·m·s/rad or N·s/m",
            "Damping",
            "Added damping by pattern of the names of moving joints.",
        ),
        Perturbation(_add_damping, JOINT),
    ] = field(default_factory=dict)

    joint_friction: Annotated[
        Mapping[str, float],
        Range(0.0, LARGEST, "an effort of 0 or more"),
        Setting(
            "N·m or N",
            "Friction",
            "Dry friction of the simulated robot that the controller does not know, by pattern "
            "of actuator names; the last match counts.",
        ),
        Perturbation(_add_friction, ACTUATOR),
    ] = field(default_factory=dict)
    losses: Annotated[
        float,
        NOT_NEGATIVE,
        Setting(
            "",
            "Scale of the losses",
            "Scale of the damping and dry friction of the simulated robot's own joints, "
            "without those that the plant adds.",
        ),
        Perturbation(_scale_losses),
    ] = 1.0
    payload: Annotated[
        CarriedLoad,
        Setting("", "Payload", "A load that the simulated robot carries."),
        Perturbation(_carry),
    ] = field(default_factory=CarriedLoad)
    slope: Annotated[
        Slope,
        Setting(
            "rad",
            "Slope",
            "Angles by which the ground rises along the x and the y axis of the world; "
            "the world's frame stays that of the ground.",
        ),
        Perturbation(_tilt),
    ] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse what no robot can have."""
        super().__post_init__()
        for pattern, offset in self.centres.items():
            if len(offset) != 3:
                raise RpctlError(f"centres of {pattern} is {offset}; give x, y, z in m")
        if len(self.slope) != 2:
            raise RpctlError(f"slope is {self.slope}; give the angles along x and along y, in rad")
        require_within("slope", self.slope, 0.5 * math.pi)
        if not sum(math.sin(angle) ** 2 for angle in self.slope) < 1.0:
            raise RpctlError(f"slope is {self.slope}; no plane rises by both angles")


PERTURBATIONS: Mapping[str, Perturbation] = {
    name: said
    for name, hint in get_type_hints(Variation, include_extras=True).items()
    for said in getattr(hint, "__metadata__", ())
    if isinstance(said, Perturbation)
}


def vary(robot: Robot, variation: Variation) -> Robot:
    """Return a robot that differs from another, which is itself where nothing does.

    Its description differs, too. What no file can say is among the drive's declared numbers:
    radii, which are those of shapes, and the track of the contacts. So ``verify`` proves the robot
    like any other, unless the ground slopes: its derivations have the ground level.

    Raises:
        UnknownNameError: A pattern matches no link with a mass, wheel or moving joint.
        RpctlError: A wheel would not reach the ground, or forces would determine no motion.
    """
    built = BuiltNumbers(robot, [variation])
    varied, tree = _with_inertias(robot, built), robot.tree
    drive = scale_track(with_radii(robot.drive, tree, built.radii[0]), tree, variation.track)
    if drive is not robot.drive:
        varied = replace(varied, drive=drive)
    varied = with_losses(varied, built.damping[0], built.friction[0])
    if built.payload:
        varied = with_payload(varied, built.payload, float(built.loads[0]), com=built.places[0])
    if not np.array_equal(built.gravity[0], robot.model.gravity.linear):
        varied = replace(varied, model=varied.model.copy())
        varied.model.gravity.linear = built.gravity[0]
    return varied


def _with_inertias(robot: Robot, built: BuiltNumbers) -> Robot:
    """Return a robot with the masses, centres and inertias of the first of some."""
    changed = np.flatnonzero(built.changed[0]).tolist()
    if not changed:
        return robot
    model, links = robot.model.copy(), dict[str, Link]()
    for k in changed:
        name, body = built.names[LINK][k], built.body[k]
        pseudo = pin.PseudoInertia.FromMatrix(built.unloaded[0, body])
        # It need not be that of a body alone: a robot is sound if its inertia matrix is.
        model.inertias[body + ROOT_JOINT] = pin.Inertia.FromPseudoInertia(pseudo)
        link = robot.description.link[name]
        links[name] = replace(
            link,
            mass=float(built.masses[0, k]),
            com=read_only(built.centres[0, k]),
            inertia=read_only(built.spreads[0, k] * link.inertia),
        )
    # What was estimated stays an estimate, which the user's text does not have.
    written = {name: link for name, link in links.items() if not link.estimated}
    description = robot.description.edited(
        lambda root: write_inertials(root, links),
        lambda root: write_inertials(root, written),
        links=tuple(links.get(link.name, link) for link in robot.description.links),
    )
    try:
        require_dynamics(description, model)
    except DescriptionError as error:
        raise RpctlError(
            f"masses, centres and inertias of the plant leave {robot.name} with an inertia that "
            f"is not positive definite ({error.findings[0].message}); vary them by less"
        ) from None
    return replace(robot, description=description, model=model)


def pseudo_inertia(inertia: pin.Inertia) -> Array:
    """Return the pseudo-inertia (4, 4) of Pinocchio's inertia, about its frame's origin."""
    return np.asarray(inertia.toPseudoInertia().toMatrix())
