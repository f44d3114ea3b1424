"""Robots that were built a little differently: other masses, wheels and losses than drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Link
from rpctl.drive.scaled_wheels import scale_radii, scale_track
from rpctl.errors import DescriptionError, RpctlError, require_positive, require_within
from rpctl.robot.build import require_dynamics
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.described import with_links
from rpctl.robot.link_inertias import LinkInertias, inertia_of
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern
from rpctl.robot.vary import add_losses

MAX_OFFSET_M = 1e3  # m: no centre of mass is farther off than this
Offset = tuple[float, float, float]


@dataclass(frozen=True)
class Variation:
    """How a robot differs from its file. Of several patterns that match a name the last counts.

    Attributes:
        masses: Scales of the masses by pattern of link names, and with them of the inertias, as of
            another density.
        centres: Offsets of the centres of mass (x, y, z) in the links' own frames, m, by pattern of
            link names.
        inertias: Further scales of the inertias about the centres of mass, by pattern of link
            names.
        radii: Scales of the wheels' radii, by pattern of wheel joints. The ground is where the
            wheels end then.
        track: Scale of the distances of the wheels' contacts from the middle line; the wheels
            themselves stay.
        damping: Added damping, N·m·s/rad or N·s/m, by pattern of the names of moving joints.
    """

    masses: Mapping[str, float] = field(default_factory=dict)
    centres: Mapping[str, Offset] = field(default_factory=dict)
    inertias: Mapping[str, float] = field(default_factory=dict)
    radii: Mapping[str, float] = field(default_factory=dict)
    track: float = 1.0
    damping: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what no robot can have."""
        for kind in ("masses", "inertias", "radii"):
            for pattern, scale in getattr(self, kind).items():
                require_positive(f"{kind} of {pattern}", scale)
        require_positive("track", self.track)
        for pattern, offset in self.centres.items():
            if len(offset) != 3:
                raise RpctlError(f"centres of {pattern} is {offset}; give x, y, z in m")
            require_within(f"centres of {pattern}", offset, MAX_OFFSET_M)
        for pattern, damping in self.damping.items():
            if not damping >= 0.0:
                raise RpctlError(f"damping of {pattern} is {damping:g}; give 0 or more")
            require_within(f"damping of {pattern}", [damping])


def vary(robot: Robot, variation: Variation) -> Robot:
    """Return a robot that differs from another; its description does, too.

    What no file can say is among the drive's declared numbers: radii, which are those of shapes,
    and the track of the contacts. So ``verify`` proves the robot like any other.

    Args:
        robot: The other one.
        variation: The differences.

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
        names: The names.
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
