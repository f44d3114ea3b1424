"""Idealisations: how the model is simpler than the file, each with a number.

These are the record and those of steering and of losses in the joints;
:mod:`rpctl.robot.idealised_wheels` has those of wheels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rpctl.description.records import Joint
from rpctl.drive.steering import is_regular
from rpctl.robot.model import Robot

STEERING_SAMPLES = 360  # positions of a steered joint's range that are tried; edges are bisected
BISECTIONS = 40  # halvings between two of them: to rounding


@dataclass(frozen=True)
class Idealisation:
    """A simplification of the model, with its size.

    Attributes:
        what: The kind, a word or two.
        value: Its size.
        unit: Its unit.
        sentence: All in words, with the joints that it is of and their lines.
    """

    what: str
    value: float
    unit: str
    sentence: str


def listed(*joints: Joint) -> str:
    """Return joints by name, with their lines of the file."""
    return ", ".join(f'"{joint.name}" (line {joint.line})' for joint in joints)


def joint_idealisations(robot: Robot) -> Iterator[Idealisation]:
    """Yield the steering that no random sample has, and the losses in the joints."""
    yield from _steering(robot)
    yield from _losses(robot)


def _steering(robot: Robot) -> Iterator[Idealisation]:
    """Yield the positions of each steered joint that are too near to a singular steering.

    A joint's range is that of random samples, its limits or ±π; the others are at 0.
    """
    for swivel in robot.drive.steered:
        joint = robot.description.joint[swivel.joint]
        low, high = max(joint.lower, -math.pi), min(joint.upper, math.pi)
        gaps = _singular_ranges(robot, joint.name, low, high)
        if not gaps:
            continue
        share = 100.0 * sum(end - begin for begin, end in gaps) / (high - low)
        spans = " and ".join(
            f"{math.degrees(begin):.1f}° to {math.degrees(end):.1f}°" for begin, end in gaps
        )
        others = ", the others at 0" if len(robot.drive.steered) > 1 else ""
        yield Idealisation(
            "singular steering",
            share,
            "%",
            f"random samples leave out steering near a singular one: {listed(joint)} from {spans}"
            f"{others}: {share:.2g} % of its range",
        )


def _singular_ranges(robot: Robot, name: str, low: float, high: float) -> list[tuple[float, float]]:
    """Return the ranges (rad) of a steered joint within which steering is near a singular one."""

    def inside(position: float) -> bool:
        return not is_regular(robot.drive, {name: position})

    def edge(out: float, within: float) -> float:
        for _ in range(BISECTIONS):
            middle = 0.5 * (out + within)
            out, within = (out, middle) if inside(middle) else (middle, within)
        return within

    grid = np.linspace(low, high, STEERING_SAMPLES + 1).tolist()
    gaps: list[tuple[float, float]] = []
    begin = low if inside(low) else None
    for before, after in pairwise(grid):
        if inside(after) and begin is None:
            begin = edge(before, after)
        elif begin is not None and not inside(after):
            gaps.append((begin, edge(after, before)))
            begin = None
    return gaps if begin is None else [*gaps, (begin, high)]


def _losses(robot: Robot) -> Iterator[Idealisation]:
    """Yield where friction is smooth, or what is left out, for turning joints and sliding ones."""
    joints = [robot.description.joint[name] for name in robot.moving_joint_names]
    for slides in (False, True):
        group = [joint for joint in joints if (joint.kind == "prismatic") is slides]
        if robot.losses is not None:
            yield from _creep(robot, [joint for joint in group if joint.friction])
            continue
        damping = "N·s/m" if slides else "N·m·s/rad"
        friction = "N" if slides else "N·m"
        yield from _loss("damping", [(joint.damping, joint) for joint in group], damping)
        yield from _loss("friction", [(joint.friction, joint) for joint in group], friction)


def _creep(robot: Robot, joints: list[Joint]) -> Iterator[Idealisation]:
    """Yield the rate below which friction is less than the file's, of joints that have any."""
    if robot.losses is not None and joints:
        rate = float(robot.losses.rate[robot.velocity_index(joints[0].name)])
        unit = "m/s" if joints[0].kind == "prismatic" else "rad/s"
        which = listed(*joints) if len(joints) == 1 else f"{len(joints)} joints"
        text = f"friction of {which} is smooth below {rate:g} {unit}: under a load of 70 % of it"
        yield Idealisation("creep", rate, unit, f"{text}, a joint creeps at this rate")


def _loss(what: str, values: list[tuple[float, Joint]], unit: str) -> Iterator[Idealisation]:
    lossy = [(value, joint) for value, joint in values if value]
    if lossy:
        largest, joint = max(lossy, key=lambda item: item[0])
        many = f"of {len(lossy)} joints is left out, at most" if len(lossy) > 1 else "is left out:"
        text = f"<dynamics> {what} {many} {largest:.3g} {unit} of {listed(joint)}"
        yield Idealisation(what, largest, unit, text)
