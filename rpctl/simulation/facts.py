"""What a run keeps of its robot and of how that robot stands on the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rpctl.drive.drive import Drive
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.robot.model import Robot

MAX_URDF_BYTES = 4 * 2**20  # of a URDF that a run keeps; the largest public ones are near 1 MB


@dataclass(frozen=True)
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
        urdf: Its URDF, of a .xacro what it became; None where it is too long to be kept, and in
            older files. It may hold surrogates: see :func:`urdf_bytes`.
        file_sha256: Digest of its file, which is that of its URDF but for a .xacro; None in older
            files.
    """

    name: str
    source: str
    urdf_sha256: str
    locked: Mapping[str, float]
    drive: Drive
    density: float | None
    package_dirs: tuple[str, ...]
    xacro_args: Mapping[str, str]
    ignore_missing_packages: bool
    home: Mapping[str, float]
    free: tuple[str, ...]
    payloads: tuple[tuple[Any, ...], ...]
    losses: bool
    armature: Mapping[str, float] | None
    quasi_velocities: tuple[str, ...]
    actuators: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: tuple[str, ...]
    effort_limits: tuple[float, ...]
    velocity_limits: tuple[float, ...]
    lower_limits: tuple[float, ...]
    upper_limits: tuple[float, ...]
    steering_names: tuple[str, ...]
    steering_limits: tuple[tuple[float, float], ...]
    other_names: tuple[str, ...]
    other_limits: tuple[tuple[float, float, float], ...]
    end_effector: str | None
    urdf: str | None = field(default=None, repr=False)
    file_sha256: str | None = None


@dataclass(frozen=True)
class GroundFacts:
    """How the robot of a run stands on the ground.

    Attributes:
        contacts: Names of the contacts, wheels first; none for a fixed base.
        points: Their places (x, y) in the root link's frame, joints at 0 or frozen, m.
        axles: Wheels (indices) that share each lateral force.
        notes: What keeps loads and margins from being defined or unique.
        friction: Coefficient between wheels and ground that the log's ``slip_ratio`` is for.
    """

    contacts: tuple[str, ...]
    points: tuple[tuple[float, float], ...]
    axles: tuple[tuple[int, ...], ...]
    notes: tuple[str, ...]
    friction: float


def robot_facts(robot: Robot) -> RobotFacts:
    """Return what a run keeps of its robot."""
    described = robot.description.joint
    steered, others = steered_joints(robot), other_joints(robot)
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
        payloads=tuple(map(tuple, robot.loaded_with.payloads)),
        losses=robot.loaded_with.losses,
        armature=robot.loaded_with.armature,
        quasi_velocities=robot.quasi_velocities,
        actuators=robot.actuators,
        joint_names=robot.joint_names,
        units=tuple("m" if joint.kind == "prismatic" else "rad" for joint in robot.joints),
        effort_limits=tuple(robot.effort_limits.tolist()),
        velocity_limits=tuple(described[name].velocity for name in robot.actuators),
        lower_limits=tuple(joint.lower for joint in robot.joints),
        upper_limits=tuple(joint.upper for joint in robot.joints),
        steering_names=steered,
        steering_limits=tuple((described[name].lower, described[name].upper) for name in steered),
        other_names=others,
        other_limits=tuple(
            (described[name].lower, described[name].upper, described[name].velocity)
            for name in others
        ),
        end_effector=robot.end_effector,
        urdf=_text(robot.description.urdf),
        file_sha256=robot.description.file_sha256,
    )


def urdf_bytes(known: RobotFacts) -> bytes:
    """Return the bytes of the URDF that a run holds, exactly as they were; none: it holds none."""
    return (known.urdf or "").encode("utf-8", "surrogateescape")


def _text(urdf: bytes) -> str | None:
    """Return a URDF as text from which its bytes follow, whatever its encoding; None: too long."""
    return urdf.decode("utf-8", "surrogateescape") if len(urdf) <= MAX_URDF_BYTES else None


def ground_facts(contacts: Contacts | None, friction: float) -> GroundFacts:
    """Return what a run keeps of its contacts with the ground.

    Args:
        contacts: None for a fixed base.
        friction: Coefficient between wheels and ground.
    """
    if contacts is None:
        return GroundFacts((), (), (), (), friction)
    return GroundFacts(
        contacts=contacts.names,
        points=tuple((x, y) for x, y in contacts.points.tolist()),
        axles=contacts.axles,
        notes=contacts.notes,
        friction=friction,
    )


def steered_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that turn wheels, but for casters."""
    return tuple(swivel.joint for swivel in robot.drive.swivels if swivel.role != "caster")


def other_joints(robot: Robot) -> tuple[str, ...]:
    """Return the moving joints that are not the arm's: wheels', swivels, and mimic joints."""
    return tuple(name for name in robot.moving_joint_names if name not in robot.joint_names)
