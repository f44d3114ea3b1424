"""What a run keeps of its robot and of how that robot stands on the ground."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rpctl.drive.drive import BASE_SPEEDS, TRAILING, Drive
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.robot.model import Robot

ROLES = ("steered", "follower", "mimic", *TRAILING)  # of a swivel
NAMES = (
    "quasi_velocities", "actuators", "joint_names", "steering_names", "other_names", "wheels_ref",
)  # fmt: skip
SAME_LENGTH = (  # lists of one item each for one another's
    ("joint_names", "units"),
    ("joint_names", "lower_limits"),
    ("joint_names", "upper_limits"),
    ("actuators", "effort_limits"),
    ("actuators", "velocity_limits"),
    ("steering_names", "steering_limits"),
    ("other_names", "other_limits"),
)
Load = tuple[
    str, float, tuple[float, ...], tuple[tuple[float, ...], ...]
]  # link, mass, centre of mass, inertia


@dataclass(frozen=True, kw_only=True)
class RobotFacts:
    """The robot of a run: how to load it again, its coordinates and their limits.

    Attributes:
        name: Name of the robot.
        source: What the robot was loaded from.
        urdf_sha256: Digest of its URDF.
        locked: Positions of its frozen joints, rad or m.
        drive: Its drive.
        density: Density from which its missing inertias were estimated, kg/m³, or None.
        package_dirs: Folders where its packages lay.
        xacro_args: Values of the arguments of its .xacro, by name.
        ignore_missing_packages: Whether includes from packages that were not found were left out.
        home: Positions of its arm's joints at home, rad or m.
        free: Patterns of joints that were not frozen by default.
        payloads: Loads that it carried besides its file's: link, mass, centre of mass, inertia.
        losses: Whether the damping and friction of its file counted.
        armature: Inertias of rotors by pattern of joint names, besides those of its file, kg·m² or
            kg; None: no rotors counted.
        quasi_velocities: Names of ν.
        actuators: Names of τ.
        joint_names: Names of the arm's joints.
        units: Unit of each joint's position, ``"rad"`` or ``"m"``.
        effort_limits: Limits of τ, N·m or N; inf where the URDF gives none.
        velocity_limits: Limits of the actuators' rates, rad/s or m/s; inf where the URDF gives
            none.
        lower_limits: Lower limits of the arm's positions, rad or m; -inf where there is none.
        upper_limits: Upper limits of the arm's positions, rad or m; inf where there is none.
        steering_names: Joints that steer wheels.
        steering_limits: Their limits (lower, upper), rad.
        other_names: Moving joints that are not the arm's: wheels', swivels, mimic joints.
        other_limits: Their limits (lower, upper, velocity); rad or m, rad/s or m/s.
        end_effector: The link that was tracked, or None.
        urdf: Its URDF, of a .xacro what it became. It may hold surrogates: see :func:`urdf_bytes`.
        file_sha256: Digest of its file, which is that of its URDF but for a .xacro.
        nq: Length of q.
        wheels_ref: Joints of the reference robot that follow from its motion: those that are
            steered, wheels, casters.
        rebuilds: Whether these facts alone bring the model back: nothing of it was estimated from
            meshes or changed in Python.
    """

    name: str
    source: str
    urdf_sha256: str
    locked: Mapping[str, float]
    drive: Drive
    density: float | None = None
    package_dirs: tuple[str, ...]
    xacro_args: Mapping[str, str]
    ignore_missing_packages: bool
    home: Mapping[str, float]
    free: tuple[str, ...]
    payloads: tuple[Load, ...]
    losses: bool
    armature: Mapping[str, float] | None = None
    quasi_velocities: tuple[str, ...]
    actuators: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: tuple[Literal["rad", "m"], ...]
    effort_limits: tuple[float, ...]
    velocity_limits: tuple[float, ...]
    lower_limits: tuple[float, ...]
    upper_limits: tuple[float, ...]
    steering_names: tuple[str, ...]
    steering_limits: tuple[tuple[float, float], ...]
    other_names: tuple[str, ...]
    other_limits: tuple[tuple[float, float, float], ...]
    end_effector: str | None = None
    urdf: str = field(repr=False)
    file_sha256: str
    nq: int
    wheels_ref: tuple[str, ...]
    rebuilds: bool

    def faults(self) -> list[str]:
        """Return what is no robot's, in words."""
        faults = [
            f"{name} is {getattr(self, name)[:80]!r}; it must be 64 hexadecimal digits"
            for name in ("urdf_sha256", "file_sha256")
            if not re.fullmatch("[0-9a-f]{64}", getattr(self, name))
        ]
        faults += [
            f"{name} must be a list of distinct names"
            for name in NAMES
            if len(set(getattr(self, name))) < len(getattr(self, name))
        ]
        faults += [
            f"{second} must be as long as {first}"
            for first, second in SAME_LENGTH
            if len(getattr(self, first)) != len(getattr(self, second))
        ]
        if self.drive.type not in BASE_SPEEDS:
            faults.append(f"drive.type is {self.drive.type[:80]!r}; give {', '.join(BASE_SPEEDS)}")
        faults += [
            f"drive.swivels: {swivel.role[:80]!r} is none of {', '.join(ROLES)}"
            for swivel in self.drive.swivels
            if swivel.role not in ROLES
        ]
        positive = [wheel.radius for wheel in self.drive.wheels]
        positive += [load[1] for load in self.payloads]
        positive += [] if self.density is None else [self.density]
        shapes = {(len(com), *map(len, rows)) for _, _, com, rows in self.payloads}
        if not shapes <= {(3, 3, 3, 3)}:
            faults.append("payloads need centres of mass (3,) and inertias (3, 3)")
        if not all(number > 0.0 for number in positive):
            faults.append("radii, masses of payloads and density must be positive numbers")
        return faults

    @property
    def coordinates(self) -> tuple[object, ...]:
        """What the numbers of a sample are of."""
        return self.nq, *(getattr(self, name) for name in NAMES)


@dataclass(frozen=True)
class GroundFacts:
    """How the robot of a run stands on the ground.

    Attributes:
        contacts: Names of the contacts, wheels first; none for a fixed base, and of a robot that
            leans its wheels.
        points: Their places (x, y) in the root link's frame, joints at 0 or frozen, m.
        axles: Wheels (indices) that share each lateral force.
        notes: What keeps loads and margins from being defined or unique.
        friction: Coefficient between wheels and ground that the log's ``slip_ratio`` is for.
        wheels: How many of the contacts are wheels.
    """

    contacts: tuple[str, ...]
    points: tuple[tuple[float, float], ...]
    axles: tuple[tuple[int, ...], ...]
    notes: tuple[str, ...]
    friction: float
    wheels: int = 0

    def faults(self) -> list[str]:
        """Return what is no ground's, in words."""
        found = []
        if len(self.points) != len(self.contacts):
            found.append("ground.points must be as long as contacts")
        if not 0 <= self.wheels <= len(self.contacts):
            found.append(f"ground.wheels is {self.wheels}, of {len(self.contacts)} contacts")
        if any(not 0 <= wheel < self.wheels for axle in self.axles for wheel in axle):
            found.append(f"ground.axles must be of the {self.wheels} wheels on the ground")
        return found


def robot_facts(robot: Robot) -> RobotFacts:
    """Return what a run keeps of its robot."""
    described, steered, others = robot.description.joint, steered_joints(robot), other_joints(robot)
    swivels, rest = [described[name] for name in steered], [described[name] for name in others]
    reading = robot.description.read_with
    return RobotFacts(
        name=robot.name,
        source=robot.source,
        urdf_sha256=robot.description.sha256,
        locked=dict(robot.locked),
        drive=robot.drive,
        density=robot.loaded_with.density,
        package_dirs=tuple(map(str, reading.package_dirs)),
        xacro_args=dict(reading.xacro_args),
        ignore_missing_packages=reading.ignore_missing_packages,
        home=dict(zip(robot.joint_names, robot.home.tolist(), strict=True)),
        free=robot.loaded_with.free,
        payloads=robot.loaded_with.payloads,
        losses=robot.loaded_with.losses,
        armature=robot.loaded_with.rotors,
        quasi_velocities=robot.quasi_velocities,
        actuators=robot.actuators,
        joint_names=robot.joint_names,
        units=tuple("m" if joint.kind == "prismatic" else "rad" for joint in robot.joints),
        effort_limits=tuple(robot.effort_limits.tolist()),
        velocity_limits=tuple(described[name].velocity for name in robot.actuators),
        lower_limits=tuple(joint.lower for joint in robot.joints),
        upper_limits=tuple(joint.upper for joint in robot.joints),
        steering_names=steered,
        steering_limits=tuple((joint.lower, joint.upper) for joint in swivels),
        other_names=others,
        other_limits=tuple((joint.lower, joint.upper, joint.velocity) for joint in rest),
        end_effector=robot.end_effector,
        urdf=robot.description.urdf.decode("utf-8", "surrogateescape"),
        file_sha256=robot.description.file_sha256 or robot.description.sha256,
        nq=robot.nq,
        wheels_ref=reference_wheels(robot),
        rebuilds=robot.loaded_with.density is None and _has_masses_of_file(robot),
    )


def urdf_bytes(known: RobotFacts) -> bytes:
    """Return the bytes of the URDF that a run holds, exactly as they were."""
    return known.urdf.encode("utf-8", "surrogateescape")


def _has_masses_of_file(robot: Robot) -> bool:
    """Return whether a model weighs what its description says, so that nobody has scaled it."""
    described = sum(link.mass or 0.0 for link in robot.description.links)
    return math.isclose(robot.mass, described, rel_tol=1e-9)


def ground_facts(robot: Robot, contacts: Contacts | None, friction: float) -> GroundFacts:
    """Return what a run keeps of its contacts with the ground.

    Args:
        robot: The robot.
        contacts: None for a fixed base, and of one that leans: its wheels.
        friction: Coefficient between wheels and ground.
    """
    if contacts is None:
        wheels = robot.drive.wheels
        poses = [robot.tree.pose(robot.description.joint[wheel.joint].child) for wheel in wheels]
        points = tuple(
            (float(x), float(y))
            for pose, wheel in zip(poses, wheels, strict=True)
            for x, y, _ in [pose[:3, 3] + wheel.offset * pose[:3, :3] @ np.array(wheel.axis)]
        )
        names = tuple(wheel.joint for wheel in wheels)
        return GroundFacts(names, points, (), (), friction, len(names))
    return GroundFacts(
        contacts=contacts.names,
        points=tuple((x, y) for x, y in contacts.points.tolist()),
        axles=contacts.axles,
        notes=contacts.notes,
        friction=friction,
        wheels=len(contacts.along),
    )


def steered_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that turn wheels, but for casters."""
    return tuple(swivel.joint for swivel in robot.drive.swivels if not swivel.trails)


def other_joints(robot: Robot) -> tuple[str, ...]:
    """Return the moving joints that are not the arm's: wheels', swivels, and mimic joints."""
    return tuple(name for name in robot.moving_joint_names if name not in robot.joint_names)


def reference_wheels(robot: Robot) -> tuple[str, ...]:
    """Return the joints that a reference's motion turns: steered ones, wheels, casters."""
    drive = robot.drive
    steered = tuple(swivel.joint for swivel in drive.steered)
    casters = tuple(swivel.joint for swivel in drive.swivels if swivel.trails)
    return (*steered, *(wheel.joint for wheel in drive.wheels), *casters)
