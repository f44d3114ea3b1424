"""Slip of each wheel: the velocity of its lowest point, computed through the user's file.

The motion v = S ν is of the dynamics under test; everything else is of the file: wheels as drawn
(:mod:`rpctl.equivalence.file_drive`), frames, axes, and a walk from the root link to each wheel,

    v_c = v + ω × p + Σ q̇_i a_i × (p − o_i)   over the joints on the way,

for the material point p below the wheel's centre. Slip is relative to the robot's speed, which is
that of the fastest of its wheels' centres, or of a tyre that its steering twists.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Drive, Wheel
from rpctl.equivalence.file_drive import LENGTH_ROUNDING_M, MAX_AXLE_OFFSET
from rpctl.equivalence.raw_file import TURNING, RawFile

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class FileMotion:
    """A robot in motion, as its file places it; all in the root link's axes.

    Attributes:
        raw: The file.
        drive: Its drive, measured on it.
        positions: Positions of the joints, rad or m.
        twist: Velocity of the root link (x, y, turn), m/s and rad/s.
        rates: Rates of the joints, rad/s or m/s.
        poses: Poses (4, 4) of the links.
    """

    raw: RawFile
    drive: Drive
    positions: Mapping[str, float]
    twist: Array
    rates: Mapping[str, float]
    poses: Mapping[str, Array]

    def velocity(self, link: str, point: Array) -> Array:
        """Return the velocity (3,) of a point of a link."""
        vx, vy, turn = self.twist
        velocity = np.array([vx - turn * point[1], vy + turn * point[0], 0.0])
        for joint in self.raw.chain(link):
            rate, pose = self.rates.get(joint.name, 0.0), self.poses[joint.child]
            axis = pose[:3, :3] @ joint.axis
            arm = np.cross(axis, point - pose[:3, 3]) if joint.type in TURNING else axis
            velocity = velocity + rate * arm
        return velocity


@dataclass(frozen=True)
class WheelMotion:
    """A wheel in motion.

    Attributes:
        wheel: The wheel.
        centre: Its centre (3,), m.
        ahead: Unit direction (3,) in which it rolls when it turns about its axle.
        left: To the left of that (3,).
        slip: Velocity (3,) of its lowest point, m/s.
        speed: Of its centre, m/s.
        rim_speed: Its rate times its radius, m/s.
    """

    wheel: Wheel
    centre: Array
    ahead: Array
    left: Array
    slip: Array
    speed: float
    rim_speed: float


@dataclass(frozen=True)
class Slip:
    """What slips at one state.

    Attributes:
        speed: The robot's speed, m/s.
        constrained: Slip where the ground holds, by wheel and direction, relative to the speed.
        by_design: Slip that the drive model allows, by wheel and direction, relative to the speed.
        base: The base's own quasi-velocities as the file's places make them, by name.
    """

    speed: float
    constrained: Mapping[str, float]
    by_design: Mapping[str, float]
    base: Mapping[str, float]


def slip(motion: FileMotion) -> Slip:
    """Return what slips.

    The ground holds a wheel along its heading and sideways; a roller, an omni wheel and one that
    slides in one direction only. Sideways one constraint keeps P: axles off it slide, as those of a
    skid-steer drive do. Swivels that share a lateral force are held sideways on average, and so are
    a swivel's wheels that stand one behind the other, as a trailer's two axles do.
    """
    drive, wheels = motion.drive, [_rolling(motion, wheel) for wheel in motion.drive.wheels]
    twist = {each.joint: abs(motion.rates.get(each.joint, 0.0)) for each in drive.steered}
    speeds = (max(e.speed, twist.get(e.wheel.swivel or "", 0.0) * e.wheel.radius) for e in wheels)
    speed = max(speeds, default=0.0)
    constrained: dict[str, float] = {}
    by_design: dict[str, float] = {}
    for each in wheels:
        wheel, direction, held = each.wheel, "forward", each.ahead
        rollers = wheel.swivel is None and not wheel.slides and drive.type in ("mecanum", "omni")
        if rollers and drive.type == "mecanum":
            direction, held = "along its roller", np.array([*wheel.direction, 0.0])
        constrained[f"{wheel.joint}, {direction}"] = float(held @ each.slip)
        if not rollers:
            found = constrained if _held_sideways(drive, each, wheels) else by_design
            found[f"{wheel.joint}, sideways"] = float(each.left @ each.slip)
    constrained |= _on_average(drive, wheels)
    if drive.has_axle:
        constrained["P, sideways"] = float(
            _left(drive) @ motion.velocity(motion.raw.root, _point(drive))
        )
    scale = 1.0 / speed if speed else 1.0
    return Slip(
        speed=speed,
        constrained={key: scale * abs(size) for key, size in constrained.items()},
        by_design={key: scale * abs(size) for key, size in by_design.items()},
        base=_base_speeds(motion, wheels),
    )


def _base_speeds(motion: FileMotion, wheels: Sequence[WheelMotion]) -> dict[str, float]:
    """Return the base's own quasi-velocities: v, of P or the first steered wheels; vx, vy; ω."""
    drive, (vx, vy, turn) = motion.drive, motion.twist
    ahead = np.cross(_left(drive), UP)
    values = {"vx": vx, "vy": vy, "omega": turn}
    values["v"] = ahead @ motion.velocity(motion.raw.root, _point(drive))
    if drive.steered and not drive.has_axle:
        first = drive.steered[0]
        angle = first.heading + first.sign * motion.positions[first.joint]
        ahead = np.array([math.cos(angle), math.sin(angle), 0.0])
        carried = [each for each in wheels if each.wheel.swivel == first.joint]
        values["v"] = np.mean([np.sign(each.ahead @ ahead) * each.rim_speed for each in carried])
    return {name: float(values[name]) for name in drive.base_speeds if name in values}


def _rolling(motion: FileMotion, wheel: Wheel) -> WheelMotion:
    joint = motion.raw.joint[wheel.joint]
    pose = motion.poses[joint.child]
    axle = pose[:3, :3] @ joint.axis
    centre = pose[:3, 3] + wheel.offset * axle
    down = (UP @ axle) * axle - UP
    contact = centre + wheel.radius * down / np.linalg.norm(down)
    slipping = motion.velocity(joint.child, contact)
    if wheel.shift and wheel.swivel is None:  # a declared track: it grips so far to its left
        slipping = slipping - motion.twist[2] * wheel.shift * np.cross(_left(motion.drive), UP)
    ahead = np.cross(axle, UP)
    ahead = ahead / np.linalg.norm(ahead)
    return WheelMotion(
        wheel=wheel,
        centre=centre,
        ahead=ahead,
        left=np.cross(UP, ahead),
        slip=slipping,
        speed=float(np.linalg.norm(motion.velocity(joint.parent, centre)[:2])),
        rim_speed=motion.rates[wheel.joint] * wheel.radius,
    )


def _held_sideways(drive: Drive, each: WheelMotion, wheels: Sequence[WheelMotion]) -> bool:
    """Return whether the ground holds a wheel sideways, by itself."""
    swivel = each.wheel.swivel
    if each.wheel.slides or len(_sharing(drive, swivel)) > 1:
        return False
    middle, ahead = _point(drive), np.cross(_left(drive), UP)
    if swivel is not None:
        carried = [other.centre for other in wheels if other.wheel.swivel == swivel]
        middle, ahead = np.mean(carried, axis=0), each.ahead
    arm = each.centre - middle
    abreast = abs(float(arm @ ahead))
    return abreast <= MAX_AXLE_OFFSET * float(np.linalg.norm(arm[:2])) + LENGTH_ROUNDING_M


def _on_average(drive: Drive, wheels: Sequence[WheelMotion]) -> dict[str, float]:
    """Return the mean sideways velocity of wheels that share a lateral force, by swivels, m/s."""
    groups: dict[tuple[str, ...], dict[str, list[float]]] = {}
    for each in wheels:
        name = each.wheel.swivel
        if name is not None and not _held_sideways(drive, each, wheels):
            side = math.copysign(1.0, float(each.left @ _left(drive)))
            parts = groups.setdefault(_sharing(drive, name), {})
            parts.setdefault(name, []).append(side * float(each.left @ each.slip))
    return {
        f"{' and '.join(group)}, sideways on average": float(
            np.mean([np.mean(sides) for sides in parts.values()])
        )
        for group, parts in groups.items()
    }


def _sharing(drive: Drive, swivel: str | None) -> tuple[str, ...]:
    """Return the swivels that share a lateral force with one, itself among them."""
    leader = {each.joint: each.shares or each.joint for each in drive.swivels}
    return tuple(name for name in leader if leader[name] == leader.get(swivel or ""))


def _left(drive: Drive) -> Array:
    return np.array([-math.sin(drive.heading), math.cos(drive.heading), 0.0])


def _point(drive: Drive) -> Array:
    return np.array([*drive.point, 0.0])
