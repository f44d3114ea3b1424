"""Robots that were built a little differently: other masses, wheels and losses than drawn.

A body's pseudo-inertia is ∫ r rᵀ dm with r = (x, y, z, 1) (4, 4): the mass, the first moments and
the second ones in one matrix, which is T J Tᵀ in another frame (P. M. Wensing, S. Kim and J.-J. E.
Slotine, "Linear matrix inequalities for physically consistent inertial parameter identification",
IEEE Robotics and Automation Letters 3, 2018). Those of links that move together add up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.description.records import Link
from rpctl.drive.scaled_wheels import scale_radii, scale_track
from rpctl.errors import DescriptionError, RpctlError, require_within
from rpctl.files.records import NOT_NEGATIVE, POSITIVE, Range, Record, Setting
from rpctl.robot.build import require_dynamics
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.robot.vary import add_losses, with_links

MAX_OFFSET_M = 1e3  # m: no centre of mass is farther off than this
Offset = tuple[float, float, float]
OFFSET = Range(-MAX_OFFSET_M, MAX_OFFSET_M)
Slope = tuple[float, float]  # rad, by which the ground rises along x and along y


@dataclass(frozen=True)
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
    ] = field(default_factory=dict)
    inertias: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "Scale of the inertia",
            "Further scales of the inertias about the centres of mass, by pattern of link names.",
        ),
    ] = field(default_factory=dict)
    radii: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "Scale of the radius",
            "Scales of the wheels' radii, by pattern of wheel joints. The ground is where "
            "the wheels end then.",
        ),
    ] = field(default_factory=dict)
    track: Annotated[
        float,
        POSITIVE,
        Setting(
            "",
            "Scale of the track",
            "Scale of the distances of the wheels' contacts from the middle line; the "
            "wheels themselves stay.",
        ),
    ] = 1.0
    damping: Annotated[
        Mapping[str, float],
        NOT_NEGATIVE,
        Setting(
            "N·m·s/rad or N·s/m",
            "Damping",
            "Added damping by pattern of the names of moving joints.",
        ),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what no robot can have."""
        super().__post_init__()
        for pattern, offset in self.centres.items():
            if len(offset) != 3:
                raise RpctlError(f"centres of {pattern} is {offset}; give x, y, z in m")


def vary(robot: Robot, variation: Variation) -> Robot:
    """Return a robot that differs from another; its description does, too.

    What no file can say is among the drive's declared numbers: radii, which are those of shapes,
    and the track of the contacts. So ``verify`` proves the robot like any other.

    Raises:
        UnknownNameError: A pattern matches no link with a mass, wheel or moving joint.
        RpctlError: A wheel would not reach the ground, or forces would determine no motion.
    """
    varied = _with_inertias(robot, variation)
    wheels = [wheel.joint for wheel in robot.drive.wheels]
    radii = by_pattern(variation.radii, wheels, "wheel")
    drive = scale_track(scale_radii(robot.drive, robot.tree, radii), robot.tree, variation.track)
    if drive is not robot.drive:
        varied = replace(varied, drive=drive)
    return add_losses(varied, by_pattern(variation.damping, list(robot.entries), "joint"), {})


def _with_inertias(robot: Robot, variation: Variation) -> Robot:
    """Return a robot with other masses, centres and inertias of some links."""
    if not (variation.masses or variation.centres or variation.inertias):
        return robot
    found = LinkInertias(robot)
    names = found.names
    masses, inertias = (
        scales_of(given, names, "link with a mass")
        for given in (variation.masses, variation.inertias)
    )
    offsets = by_pattern(variation.centres, names, "link with a mass")
    centres = np.array([offsets.get(name, (0.0, 0.0, 0.0)) for name in names])
    pseudo = found.bodies(masses[None], centres[None], inertias[None])[0]
    model = robot.model.copy()
    changed = (masses != 1.0) | (inertias != 1.0) | centres.any(axis=1)
    for body in sorted(set(found.body[changed].tolist())):
        model.inertias[body + ROOT_JOINT] = inertia_of(pseudo[body])
    links = {
        name: _varied_link(robot.description.link[name], masses[k], centres[k], inertias[k])
        for k, name in enumerate(names)
        if changed[k]
    }
    description = with_links(robot.description, links)
    try:
        require_dynamics(description, model)
    except DescriptionError as error:
        raise RpctlError(
            f"masses, centres and inertias of the plant leave {robot.name} without dynamics "
            f"({error.findings[0].message}); vary them by less"
        ) from None
    return replace(robot, description=description, model=model)


def scales_of(given: Mapping[str, float], names: Sequence[str], kind: str) -> Array:
    """Return a scale for each name (n,), 1 where no pattern matches.

    Args:
        given: Scales by pattern.
        kind: What they are the names of, for messages.

    Raises:
        UnknownNameError: A pattern matches none of them.
    """
    found = by_pattern(given, names, kind)
    return np.array([found.get(name, 1.0) for name in names])


def _varied_link(link: Link, mass: float, offset: Array, inertia: float) -> Link:
    com, about = link.com + offset, mass * inertia * link.inertia
    for array in (com, about):
        array.setflags(write=False)
    return replace(link, mass=float(mass * (link.mass or 0.0)), com=com, inertia=about)


class LinkInertias:
    """The links of a robot that have a mass, and the bodies that they are parts of.

    Attributes:
        names: Names of the links, in file order; L of them.
        body: Index of each link's body (L,): that of its joint in the model, less the root's.
    """

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        links = [link for link in robot.description.links if link.mass]
        self.names = tuple(link.name for link in links)
        frames = [model.frames[model.getFrameId(name, pin.FrameType.BODY)] for name in self.names]
        self.body: NDArray[np.intp] = np.array([f.parentJoint - ROOT_JOINT for f in frames], int)
        poses = np.array([f.placement.homogeneous for f in frames]).reshape(-1, 4, 4)
        self._poses = poses
        self._masses = np.array([link.mass for link in links])
        self._centres = np.array([link.com for link in links]).reshape(-1, 3)
        spread = np.array([_about_centre(link) for link in links]).reshape(-1, 4, 4)
        self._spread = poses @ spread @ np.swapaxes(poses, 1, 2)
        local = np.hstack([self._centres, np.ones((len(links), 1))])
        self._places = np.einsum("lij,lj->li", poses, local)
        self._points = (self._places[:, :, None] * self._places[:, None]).reshape(-1, 16)
        self.nominal = np.array([pseudo_inertia(i) for i in list(model.inertias)[ROOT_JOINT:]])
        self._own = self._sums(np.ones((1, len(links))), None, None)

    def bodies(
        self, masses: Array, centres: Array | None = None, inertias: Array | None = None
    ) -> Array:
        """Return the pseudo-inertias (K, n_bodies, 4, 4) of K robots like this one.

        Args:
            masses: Scales of the links' masses (K, L), and with them of their inertias.
            centres: Offsets of their centres of mass in their own frames (K, L, 3), m; None: none.
            inertias: Further scales of their inertias about these centres (K, L); None: ones.
        """
        return np.asarray(self.nominal + (self._sums(masses, centres, inertias) - self._own))

    def _sums(self, masses: Array, offsets: Array | None, inertias: Array | None) -> Array:
        """Return what the links alone make of the bodies; :meth:`bodies` has the arguments."""
        weights = masses * self._masses
        scales = masses if inertias is None else masses * inertias
        found = np.zeros((len(masses), len(self.nominal), 16))
        for link, body in enumerate(self.body.tolist()):  # no matrix product: robots are alone
            point: Array = self._points[link]
            if offsets is not None and (own := offsets[:, link]).any():
                R = self._poses[link, :, :3]
                place = self._places[link] + sum(own[:, k, None] * R[:, k] for k in range(3))
                point = (place[:, :, None] * place[:, None]).reshape(-1, 16)
            found[:, body] += scales[:, link, None] * self._spread[link].ravel()
            found[:, body] += weights[:, link, None] * point
        return found.reshape(*found.shape[:2], 4, 4)


def pseudo_inertia(inertia: pin.Inertia) -> Array:
    """Return the pseudo-inertia (4, 4) of Pinocchio's inertia, about its frame's origin."""
    return np.asarray(inertia.toPseudoInertia().toMatrix())


def inertia_of(pseudo: Array) -> pin.Inertia:
    """Return Pinocchio's inertia of a pseudo-inertia (4, 4) with a mass.

    It need not be that of a body alone: a robot is sound if its inertia matrix is.
    """
    return pin.Inertia.FromPseudoInertia(pin.PseudoInertia.FromMatrix(pseudo))


def _about_centre(link: Link) -> Array:
    """Return the pseudo-inertia (4, 4) of a link's spread about its centre of mass alone."""
    spread = np.zeros((4, 4))
    spread[:3, :3] = 0.5 * np.trace(link.inertia) * np.eye(3) - link.inertia
    return spread


def require_slope(slope: Slope) -> None:
    """Refuse what is no slope of a ground.

    Raises:
        RpctlError: There are not two angles, or no plane rises so.
    """
    if len(slope) != 2:
        raise RpctlError(f"slope is {slope}; give the angles along x and along y, in rad")
    require_within("slope", slope, 0.5 * math.pi)
    if not sum(math.sin(angle) ** 2 for angle in slope) < 1.0:
        raise RpctlError(f"slope is {slope}; no ground rises so along x and y at once")


def on_slope(robot: Robot, slope: Slope) -> Robot:
    """Return a robot whose ground rises by given angles.

    A way of a metre along the ground's x axis leads sin(along x) m upwards, one along y likewise:
    the upward direction is (sin along x, sin along y, √(1 − ...)) in the frame of the ground.

    Args:
        slope: Angles (2,), rad, along x and along y.

    Raises:
        RpctlError: They are none of a ground.
    """
    require_slope(slope)
    if not any(slope):
        return robot
    along = [math.sin(angle) for angle in slope]
    up = np.array([*along, math.sqrt(1.0 - sum(x * x for x in along))])
    model = robot.model.copy()
    model.gravity.linear = -float(np.linalg.norm(robot.model.gravity.linear)) * up
    return replace(robot, model=model)
