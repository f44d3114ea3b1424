"""Records of wheels, swivels and drives, and the TOML file in which a user declares them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from rpctl.files import toml
from rpctl.files.records import (
    POSITIVE,
    OneOf,
    OutOfRangeError,
    Range,
    Record,
    Setting,
    read_record,
)

POWERED_CASTERS = "powered-casters"  # all wheels trail upright joints; motors drive them
SELF_BALANCING, WHEEL_LEGS, LEANING_BICYCLE = "self-balancing", "wheel-legs", "leaning-bicycle"
LEANING = SELF_BALANCING, WHEEL_LEGS, LEANING_BICYCLE  # they pitch or roll on two wheels
# The base's own speeds by the drive's type; each independently steered joint's rate follows them.
BASE_SPEEDS = {
    "differential": ("v", "omega"),
    "skid-steer": ("v", "omega"),
    "car-like": ("v",),
    "tricycle": ("v",),
    "articulated": ("v",),
    "bicycle": ("v",),
    "steered": ("v",),
    "omni": ("vx", "vy", "omega"),
    "mecanum": ("vx", "vy", "omega"),
    POWERED_CASTERS: ("vx", "vy", "omega"),
    SELF_BALANCING: ("v", "omega", "pitch_rate"),
    WHEEL_LEGS: ("v", "omega", "pitch_rate"),
    LEANING_BICYCLE: ("v", "roll_rate"),
    "fixed": (),
}
TYPES_WITH_AXLE = (
    "differential", "skid-steer", "car-like", "tricycle", "articulated", "bicycle", *LEANING,
)  # fmt: skip

TRAILING = ("caster", "trailer")  # roles of swivels whose rates follow from the base's motion


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel on the ground.

    Attributes:
        joint: Name of its joint.
        radius: Radius of the shape that touches the ground, m; see
            :func:`rpctl.drive.wheel_size.wheel_size`.
        source: Source of the radius, in words.
        axis: Unit axle (3,) in the wheel joint's frame.
        offset: Distance of the wheel's centre from the joint's origin along the axle, m; from the
            same shape as the radius.
        direction: Direction (x, y) in the root link's frame, with all joints at 0, along which the
            contact point has no velocity: forward for an ordinary wheel, along the roller for a
            mecanum wheel, perpendicular to the axle for an omni wheel.
        driven: Whether its joint has an actuator.
        swivel: Joint of the swivel that carries it; None if the root link carries it.
        lateral: Distance of its contact point to the left of its swivel's axis, m.
        shift: Distance of its contact point to the left of its centre, m: half the difference
            between the effective track of a skid-steer drive and the distance of its wheels.
        slides: Whether it may slide sideways: a ball, or a wheel off the axle of a differential.
        tyre: Radius of the tyre's circular section, m, for a wheel that leans; 0: a thin disc.
        why: The reason why it counts as a wheel, in words.
    """

    joint: str
    radius: float
    source: str
    axis: tuple[float, float, float]
    offset: float = 0.0
    direction: tuple[float, float] = (1.0, 0.0)
    driven: bool = True
    swivel: str | None = None
    lateral: float = 0.0
    shift: float = 0.0
    slides: bool = False
    tyre: float = 0.0
    why: str = ""


@dataclass(frozen=True)
class Swivel:
    """An upright joint that carries wheels: of the root link, or of another swivel's link.

    Places and directions are in the root link's frame with all joints at 0.

    Attributes:
        joint: Name of the joint.
        role: ``"steered"``: its rate is a quasi-velocity; ``"follower"``: it keeps its wheels'
            axle on the centre of rotation that the others fix; ``"mimic"``: the URDF ties it to
            another one; ``"caster"``: its wheels trail its axis, so that the base's motion fixes
            its rate, whether a motor turns it or nothing does; ``"trailer"``: so they do, and are
            those of a body that is pulled.
        pivot: Where its axis meets the ground (x, y), m.
        heading: Rolling direction of its wheels, rad.
        sign: 1 where its axis points up, −1 where it points down.
        trail: Distance of its wheels' contact ahead of its axis along the rolling direction, m;
            negative where it lies behind.
        driven: Whether it has an actuator.
        shares: Swivel with which it shares one lateral constraint: on average the two do not slip.
        ratio: Of one that mimics: its position is ``ratio`` times the other's, plus ``offset``.
        offset: rad.
        parent: Joint of the swivel whose link carries it; None where the root link does.
        why: The reason for the role, in words.
    """

    joint: str
    role: str
    pivot: tuple[float, float]
    heading: float = 0.0
    sign: float = 1.0
    trail: float = 0.0
    driven: bool = True
    shares: str | None = None
    ratio: float = 1.0
    offset: float = 0.0
    parent: str | None = None
    why: str = ""

    @property
    def trails(self) -> bool:
        """Whether the motion of what carries it fixes its rate."""
        return self.role in TRAILING

    def reversed(self) -> Swivel:
        """Return it with wheels that roll the other way."""
        heading = math.remainder(self.heading + math.pi, 2.0 * math.pi)
        return replace(self, heading=heading, trail=0.0 - self.trail)

    def behind(self) -> Swivel:
        """Return it with a contact behind its axis."""
        return self.reversed() if self.trail > 0.0 else self


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The wheels of a robot, its kind of drive, and the geometry of both.

    Attributes:
        type: One of ``DRIVE_TYPES``.
        wheels: The wheels, front before rear and left before right; those of casters last.
        point: P (x, y) in the root link's frame, m: the midpoint of the axle of the fixed wheels,
            or the centre of rotation of a skid-steer drive.
        heading: Angle of the forward direction in the root link's frame, rad: perpendicular to the
            mean of the leftward unit axles of the fixed wheels that do not slide.
        track: Distance between the left and the right wheels' contact points, m; for a skid-steer
            drive the effective track.
        ground: Height of the ground in the root link's frame, m.
        swivels: The upright joints that carry wheels.
        evidence: Sentences on how the drive was detected.
        doubts: Sentences on assumptions, and on how to declare something else.
        declared: Names of numbers that come from the user and not from shapes: ``"radius of
            JOINT"``, ``"direction of JOINT"`` (a roller's angle), ``"track"``, ``"point"``; or
            ``"drive"`` for all.
    """

    type: str = field(kw_only=False)
    wheels: tuple[Wheel, ...] = field(default=(), kw_only=False)
    point: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    track: float = 0.0
    ground: float = 0.0
    swivels: tuple[Swivel, ...] = ()
    evidence: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    declared: tuple[str, ...] = ()

    @property
    def base_speeds(self) -> tuple[str, ...]:
        """Names of the quasi-velocities of the base."""
        return BASE_SPEEDS[self.type] + tuple(swivel.joint for swivel in self.steered)

    @property
    def steered(self) -> tuple[Swivel, ...]:
        """The swivels whose rates are quasi-velocities."""
        return tuple(swivel for swivel in self.swivels if swivel.role == "steered")

    @property
    def followers(self) -> tuple[Swivel, ...]:
        """The swivels that follow the centre of rotation which the other swivels determine."""
        return tuple(swivel for swivel in self.swivels if swivel.role == "follower")

    @property
    def trailers(self) -> tuple[Swivel, ...]:
        """The hitches of trailers, each after the hitch that pulls it."""
        return tuple(swivel for swivel in self.swivels if swivel.role == "trailer")

    def chain(self, swivel: Swivel) -> tuple[Swivel, ...]:
        """Return the chain of swivels from the root link to a swivel, itself included."""
        joints = {each.joint: each for each in self.swivels}
        above = () if swivel.parent is None else self.chain(joints[swivel.parent])
        return (*above, swivel)

    @property
    def idle_casters(self) -> tuple[Swivel, ...]:
        """The trailers, and the casters of which neither the swivel nor a wheel is driven."""
        powered = {wheel.swivel for wheel in self.wheels if wheel.driven}
        return tuple(
            swivel
            for swivel in self.swivels
            if swivel.role == "trailer"
            or (swivel.role == "caster" and not swivel.driven and swivel.joint not in powered)
        )

    @property
    def powered_casters(self) -> tuple[Swivel, ...]:
        """The casters whose swivel or wheels have actuators."""
        idle = self.idle_casters
        return tuple(s for s in self.swivels if s.trails and s not in idle)

    @property
    def floor(self) -> float:
        """Height of the ground in the world, m; a root link that stays level has height 0."""
        return 0.0 if self.leans else self.ground

    @property
    def leans(self) -> bool:
        """Whether the root link can pitch, roll and rise: its joint is a free-flyer."""
        return self.type in LEANING

    @property
    def has_axle(self) -> bool:
        """Whether P can move only along the heading."""
        return self.type in TYPES_WITH_AXLE

    @property
    def omnidirectional(self) -> bool:
        """Whether the base can move in any direction.

        An omni or mecanum drive and a base on powered casters can do so at once, a swerve drive
        once its wheels have turned.
        """
        return bool(self.wheels) and not self.has_axle

    def carried(self, swivel: Swivel) -> tuple[int, ...]:
        """Return the indices in ``wheels`` of the wheels that a swivel carries."""
        return tuple(i for i, wheel in enumerate(self.wheels) if wheel.swivel == swivel.joint)


FIXED_BASE = Drive("fixed")


DRIVE_TYPES = tuple(BASE_SPEEDS)
SWIVEL_ROLES = ("steered", *TRAILING)
STEERING_MODES = ("ackermann", "free")
ROLLER_RANGE = Range(math.nextafter(-90.0, 0.0), 90.0, "degrees between -90 and 90", below=True)
ONLY_OF = {
    "track": "skid-steer",
    "point": "skid-steer",
    "steering": "car-like",
}  # types that have it


@dataclass(frozen=True)
class WheelSpec(Record):
    """A declared wheel; None where it is to be detected."""

    joint: Annotated[str, Setting("", "joint", "The wheel's joint.")]
    radius: Annotated[float | None, POSITIVE, Setting("m", "radius", "Its radius.")] = None
    roller_deg: Annotated[
        float | None,
        ROLLER_RANGE,
        Setting("deg", "roller", "Angle from the heading to the roller on the ground (mecanum)."),
    ] = None
    driven: Annotated[bool | None, Setting("", "driven", "Whether a motor turns it.")] = None
    tyre: Annotated[
        float | None, POSITIVE, Setting("m", "tyre", "Radius of its section, of one that leans.")
    ] = None

    @property
    def roller(self) -> float | None:
        """Its roller's angle, rad."""
        return None if self.roller_deg is None else math.radians(self.roller_deg)


@dataclass(frozen=True)
class SwivelSpec(Record):
    """A declared swivel; None where it is to be detected."""

    joint: Annotated[str, Setting("", "joint", "The swivel's joint.")]
    role: Annotated[str | None, OneOf(SWIVEL_ROLES), Setting("", "role", "What it does.")] = None
    driven: Annotated[bool | None, Setting("", "driven", "Whether a motor turns it.")] = None


@dataclass(frozen=True)
class DriveSpec(Record):
    """A declared drive; None or empty where it is to be detected.

    Where any wheels are named, these are all of them.
    """

    type: Annotated[str | None, OneOf(DRIVE_TYPES), Setting("", "type", "Of the drive.")] = None
    wheel: Annotated[tuple[WheelSpec, ...], Setting("", "wheels", "The wheels.")] = ()
    swivel: Annotated[tuple[SwivelSpec, ...], Setting("", "swivels", "Swivels.")] = ()
    track: Annotated[
        float | None, POSITIVE, Setting("m", "track", "Effective track of a skid-steer drive.")
    ] = None
    point: Annotated[
        tuple[float, float] | None,
        Setting("m", "point", "Centre of rotation of a skid-steer drive in the root link's frame."),
    ] = None
    steering: Annotated[
        str,
        OneOf(STEERING_MODES),
        Setting("", "steering", "Whether the wheels' axles meet in one centre (ackermann), or each "
                "turns on its own and on average they do not slip (free)."),
    ] = STEERING_MODES[0]  # fmt: skip

    def __post_init__(self) -> None:
        """Refuse what the type of the drive does not have, and what is named twice."""
        super().__post_init__()
        faults = []
        for name, kind in ONLY_OF.items():
            if getattr(self, name) not in (None, STEERING_MODES[0]) and self.type != kind:
                faults.append(f"{name} applies to {kind} drives only; leave it out")
        for name, tables in (("wheel", self.wheel), ("swivel", self.swivel)):
            joints = [each.joint for each in tables]
            twice = dict.fromkeys(joint for joint in joints if joints.count(joint) > 1)
            faults += [f'{name}: joint "{joint}" is named twice' for joint in twice]
            if tables and self.type == "fixed":
                faults.append(f"a fixed base has no {name}; leave out [[{name}]]")
        if self.type != "mecanum" and any(each.roller_deg is not None for each in self.wheel):
            faults.append("wheel: roller_deg applies to mecanum drives only; leave it out")
        if faults:
            raise OutOfRangeError(faults)

    @cached_property
    def wheels(self) -> dict[str, WheelSpec]:
        """The wheels by joint."""
        return {each.joint: each for each in self.wheel}

    @cached_property
    def swivels(self) -> dict[str, SwivelSpec]:
        """The swivels by joint."""
        return {each.joint: each for each in self.swivel}


def read_drive(path: str | Path) -> DriveSpec:
    """Read a drive file.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    return toml.read(path, _drive_in, "a drive file")


def _drive_in(data: dict[str, Any], faults: list[str]) -> Any:
    if "type" not in data:
        faults.append(f"type is missing; give one of {', '.join(DRIVE_TYPES)}")
    return read_record(DriveSpec, data, "", faults)


def draft(drive: Drive) -> str:
    """Return a drive file that says what a drive is, to be changed where it is doubted."""
    turns = {s.joint: s.role if s.role in SWIVEL_ROLES else "steered" for s in drive.swivels}
    return suggest(drive.type, {w.joint: w.radius for w in drive.wheels}, turns)


def suggest(
    kind: str, wheels: Mapping[str, float | None], swivels: Mapping[str, str] | None = None
) -> str:
    """Return a drive file to start from.

    Args:
        wheels: Radius (m) of each joint that could carry a wheel, None where it is not known.
        swivels: Role of each joint that could be a swivel.
    """
    rolling = "".join(
        f"\n[[wheel]]\njoint = {_quoted(joint)}\n# radius = {radius or 0.1:.6g}  # m\n"
        "# driven = true  # false where no motor turns it\n"
        for joint, radius in wheels.items()
    )
    turning = "".join(
        f'\n[[swivel]]\njoint = {_quoted(joint)}\nrole = "{role}"  # {", ".join(SWIVEL_ROLES)}\n'
        for joint, role in (swivels or {}).items()
    )
    return f'type = "{kind}"  # {", ".join(DRIVE_TYPES)}\n{rolling}{turning}'


def _quoted(name: str) -> str:
    """Return a name as a TOML string: JSON's are such."""
    return json.dumps(name, ensure_ascii=False)
