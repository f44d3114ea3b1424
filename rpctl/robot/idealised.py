"""Idealisations: how the model is simpler than the file, each with a number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.drive.drive import Swivel
from rpctl.drive.evidence import lines_of
from rpctl.drive.steering import is_regular
from rpctl.drive.wheel_size import (
    MAX_ECCENTRICITY,
    SHAPE_ROLES,
    WheelSize,
    is_round,
    shape_sizes,
    wheel_parts,
)
from rpctl.drive.wheels import WheelCandidate
from rpctl.robot.model import Robot

STEERING_SAMPLES = 360  # positions of a steered joint's range that are tried; edges are bisected
BISECTIONS = 40  # halvings between two of them: to rounding
ANGLE_ROUNDING = 1e-4  # rad; smaller ones are the rounding of a file's angles
LENGTH_ROUNDING_M = 1e-5  # m; shorter ones are the rounding of a file's places
MESH_RADIUS_TOLERANCE = 5e-3  # of the radius; a circle of 32 corners is drawn as near to it


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


def idealisations(robot: Robot) -> tuple[Idealisation, ...]:
    """Return the simplifications of the model against the file, each with its size.

    Only those that apply to the robot: places, directions and sizes of wheels that the drive
    rounds, steering that no random sample has, and losses in the joints.
    """
    return (*_of_wheels(robot), *_steering(robot), *_losses(robot))


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
        many = f"of {len(lossy)} joints is ignored, at most" if len(lossy) > 1 else "is ignored:"
        yield Idealisation(
            what, largest, unit, f"<dynamics> {what} {many} {largest:.3g} {unit} of {listed(joint)}"
        )


def _of_wheels(robot: Robot) -> Iterator[Idealisation]:
    """Yield the idealisations of a robot's wheels and swivels."""
    wheels = [_placed(robot, index) for index in range(len(robot.drive.wheels))]
    rolling = [
        wheel
        for wheel, record in zip(wheels, robot.drive.wheels, strict=True)
        if wheel.swivel is None and not record.slides
    ]
    if robot.drive.type != "omni":
        yield from _heading(robot, rolling)
    if robot.drive.has_axle:
        yield from _axle_scatter(robot, rolling)
    yield from _standing(robot, wheels)
    for swivel in robot.drive.swivels:
        carried = [wheels[index] for index in robot.drive.carried(swivel)]
        yield from _swivel(robot, swivel, carried)
    yield from _sizes(robot, wheels)
    yield from _sliding(robot, wheels)


def _placed(robot: Robot, index: int) -> WheelCandidate:
    """Return a wheel of the drive where the file has it, in the root link's frame."""
    record, description = robot.drive.wheels[index], robot.description
    joint = description.joint[record.joint]
    swivel = None if record.swivel is None else description.joint[record.swivel]
    place = (robot.tree.frame(joint)[:3, 3], robot.tree.axis(joint), swivel)
    return WheelCandidate(joint, *place, record.radius, record.source, record.offset, False, "")


def _axle_angle(axle: Array, heading: float) -> float:
    """Return the angle, seen from above, between an axle and the one across a heading, rad."""
    along = axle[0] * math.cos(heading) + axle[1] * math.sin(heading)
    across = axle[1] * math.cos(heading) - axle[0] * math.sin(heading)
    return math.atan2(abs(along), abs(across))


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


def _heading(robot: Robot, wheels: list[WheelCandidate]) -> Iterator[Idealisation]:
    """Yield the largest angle between an axle that the root link holds and their mean."""
    if not wheels:
        return
    angle, worst = max(
        ((_axle_angle(wheel.axle, robot.drive.heading), wheel) for wheel in wheels),
        key=lambda item: item[0],
    )
    if angle > ANGLE_ROUNDING:
        yield Idealisation(
            "heading",
            math.degrees(angle),
            "°",
            f"the heading is across the mean of {len(wheels)} axles that are not parallel: "
            f"{listed(worst.joint)} is {_degrees(angle)} ({1e3 * angle:.3g} mrad) off it",
        )


def _axle_scatter(robot: Robot, wheels: list[WheelCandidate]) -> Iterator[Idealisation]:
    """Yield how far wheels taken for one axle are apart across it, and axles from P."""
    drive, lines = robot.drive, lines_of(wheels)
    ahead = np.array([math.cos(drive.heading), math.sin(drive.heading)])
    for line in lines:
        apart = float(np.ptp([float(wheel.centre[:2] @ ahead) for wheel in line]))
        if apart > LENGTH_ROUNDING_M:
            yield Idealisation(
                "axle scatter",
                1e3 * apart,
                "mm",
                f"{listed(*(wheel.joint for wheel in line))} are treated as wheels on one axle; "
                f"their centres are {1e3 * apart:.3g} mm apart along the heading",
            )
    yield from _axles_apart(wheels, np.array(drive.point), ahead, "fixed axles", "P")


def _axles_apart(
    wheels: list[WheelCandidate], middle: Array, ahead: Array, axles: str, place: str
) -> Iterator[Idealisation]:
    """Yield how far along a heading axles are from the point (2,) that alone is held sideways."""
    count = len(lines_of(wheels))
    places = [abs(float((wheel.centre[:2] - middle) @ ahead)) for wheel in wheels]
    if count > 1 and max(places) > LENGTH_ROUNDING_M:
        furthest = wheels[int(np.argmax(places))]
        yield Idealisation(
            "axles apart",
            max(places),
            "m",
            f"{count} {axles} share one lateral constraint, at {place}: "
            f"{listed(furthest.joint)} is {max(places):.3g} m from it along the heading, and in a "
            f"bend slides sideways, without friction, at {max(places):.3g} m/s for each rad/s",
        )


def _standing(robot: Robot, wheels: list[WheelCandidate]) -> Iterator[Idealisation]:
    """Yield how far contacts are off the plane of the ground, and axles off the level."""
    if not wheels:
        return
    gap, worst = max(
        ((abs(wheel.bottom - robot.drive.ground), wheel) for wheel in wheels),
        key=lambda item: item[0],
    )
    if gap > LENGTH_ROUNDING_M:
        side = "above" if worst.bottom > robot.drive.ground else "below"
        yield Idealisation(
            "contact height",
            1e3 * gap,
            "mm",
            f"all wheels touch the ground, at the mean of their heights: {listed(worst.joint)} "
            f"ends {1e3 * gap:.3g} mm {side} it",
        )
    lean, worst = max(
        ((math.asin(min(1.0, abs(float(wheel.axle[2])))), wheel) for wheel in wheels),
        key=lambda item: item[0],
    )
    if lean > ANGLE_ROUNDING:
        yield Idealisation(
            "axle lean",
            math.degrees(lean),
            "°",
            f"wheels touch the ground straight below their centres, as if their axles were level: "
            f"that of {listed(worst.joint)} leans {_degrees(lean)}",
        )


def _swivel(robot: Robot, swivel: Swivel, wheels: list[WheelCandidate]) -> Iterator[Idealisation]:
    """Yield the idealisations of a swivel: its axis, its trail, and its wheels' directions."""
    joint = robot.description.joint[swivel.joint]
    origin, axis = robot.tree.frame(joint)[:3, 3], robot.tree.axis(joint)
    lean = math.atan2(math.hypot(axis[0], axis[1]), abs(float(axis[2])))
    if lean > ANGLE_ROUNDING and not robot.drive.leans:
        shift = abs(float(origin[2]) - robot.drive.ground) * math.tan(lean)
        yield Idealisation(
            "swivel lean",
            math.degrees(lean),
            "°",
            f"the axis of {listed(joint)} leans {_degrees(lean)} and is treated as upright: it "
            f"{'meets' if robot.tree.is_leaning(joint) else 'would meet'} the ground "
            f"{1e3 * shift:.3g} mm from below its origin",
        )
    ahead = np.array([math.cos(swivel.heading), math.sin(swivel.heading)])
    contact = np.mean([wheel.centre[:2] for wheel in wheels], axis=0)
    trail = float(ahead @ (contact - origin[:2]))
    if abs(trail - swivel.trail) > LENGTH_ROUNDING_M:
        yield Idealisation(
            "trail",
            1e3 * trail,
            "mm",
            f"{listed(joint)} steers together with others, so its trail is set to 0: its contact "
            f"is {1e3 * abs(trail):.3g} mm {'ahead of' if trail > 0.0 else 'behind'} its axis",
        )
    yield from _axles_apart(wheels, contact, ahead, f"axles on {listed(joint)}", "their middle")
    angle, worst = max(
        ((_axle_angle(wheel.axle, swivel.heading), wheel) for wheel in wheels),
        key=lambda item: item[0],
    )
    if angle > ANGLE_ROUNDING:
        yield Idealisation(
            "swivel heading",
            math.degrees(angle),
            "°",
            f"all wheels of {listed(joint)} roll as its first one: the axle of "
            f"{listed(worst.joint)} is {_degrees(angle)} off",
        )


def _sizes(robot: Robot, wheels: list[WheelCandidate]) -> Iterator[Idealisation]:
    """Yield other radii than the one used, shapes off the axle, and the width that is left out."""
    widest, others = 0.0, dict[tuple[object, ...], list[tuple[WheelCandidate, float, str]]]()
    for wheel in wheels:
        sizes = [*shape_sizes(robot.tree, wheel.joint)]
        drawn = _unambiguous_roles(robot, wheel)
        for alike, radius, text in _others(wheel, [each for each in sizes if each[0] in drawn]):
            others.setdefault(alike, []).append((wheel, radius, text))
        for _, size in sizes:
            if size.source == wheel.source:
                if size.aside > LENGTH_ROUNDING_M:
                    yield Idealisation(
                        "eccentric wheel",
                        1e3 * size.aside,
                        "mm",
                        f"the shape that {listed(wheel.joint)} rolls on ({size.source}) is "
                        f"centred {1e3 * size.aside:.3g} mm off its axle, and treated as on it",
                    )
                yield from _drawn_beside(wheel, size, [each for _, each in sizes])
                widest = max(widest, size.width)
    for group in others.values():  # wheels with the same values are told of together
        _, radius, text = group[0]
        names = listed(*(wheel.joint for wheel, *_ in group))
        yield Idealisation("radius", radius, "m", f"the radius of {names} is {text}")
    if widest > 0.0:
        yield Idealisation(
            "thin wheels",
            1e3 * widest,
            "mm",
            "wheels are thin discs that touch the ground at one point, though up to "
            f"{1e3 * widest:.3g} mm wide: nothing resists turning on the spot",
        )


def _unambiguous_roles(robot: Robot, wheel: WheelCandidate) -> set[str]:
    """Return the roles (collision, visual) whose shapes are all round or meshes.

    Rollers and lugs make the outer radius ambiguous.
    """
    parts = wheel_parts(robot.tree, wheel.joint)
    hidden = {p.role for p in parts if p.shape.kind != "mesh" and not is_round(p, wheel.joint.axis)}
    return set(SHAPE_ROLES) - hidden


def _others(
    wheel: WheelCandidate, sizes: list[tuple[str, WheelSize]]
) -> Iterator[tuple[tuple[object, ...], float, str]]:
    """Yield the widest radius of each role, where it is not the one used.

    Each with what it has in common with those of like wheels, and in words.
    """
    used, source = wheel.radius or 0.0, wheel.source.split(", line")[0]
    by_collision = any(role == "collision" for role, _ in sizes)
    rolls = "simulators roll on the collision" if by_collision else "there is no round collision"
    for role in SHAPE_ROLES:
        radii = [(size.radius or 0.0, size.source) for its, size in sizes if its == role]
        radius, other = max(radii, key=itemgetter(0), default=(used, ""))
        by_mesh = "mesh" in other + wheel.source
        if abs(radius - used) > (MESH_RADIUS_TOLERANCE * used if by_mesh else LENGTH_ROUNDING_M):
            text = f"that of the {role} shape {radius:.4g} m ({other}); {rolls}"
            alike = (role, radius, used, source, rolls)
            yield alike, radius, f"{used:.4g} m ({source}), {text}"


def _drawn_beside(
    wheel: WheelCandidate, used: WheelSize, sizes: Iterable[WheelSize]
) -> Iterator[Idealisation]:
    """Yield how far from where it rolls a wheel is drawn, where the two shapes are apart."""
    for size in sizes:
        along, across = abs(size.offset - used.offset), abs(size.aside - used.aside)
        eccentric = across > MAX_ECCENTRICITY * (used.radius or 0.0)
        if eccentric or along > max(used.radius or 0.0, 0.5 * (size.width + used.width)):
            yield Idealisation(
                "drawn beside",
                1e3 * math.hypot(along, across),
                "mm",
                f"{listed(wheel.joint)} rolls on its {used.source}, and its {size.source} is "
                f"{1e3 * math.hypot(along, across):.3g} mm beside it; one of the two is wrong",
            )


def _sliding(robot: Robot, wheels: Iterable[WheelCandidate]) -> Iterator[Idealisation]:
    """Yield which wheels slide sideways without friction."""
    sliding = [
        wheel.joint
        for wheel, record in zip(wheels, robot.drive.wheels, strict=True)
        if record.slides
    ]
    if sliding:
        verb = "slides" if len(sliding) == 1 else "slide"
        yield Idealisation(
            "sliding wheels",
            float(len(sliding)),
            "wheels",
            f"{listed(*sliding)} {verb} sideways without friction",
        )
