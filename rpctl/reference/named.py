"""The references that have a name: line, reverse, spin, circle and eight."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.steering import turning_radius
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference import paths
from rpctl.reference.clear_waves import clear_waves
from rpctl.reference.fitting import (
    Usage,
    assumptions,
    fit_arm,
    reason,
    slow_down,
    too_weak,
    usage_of,
)
from rpctl.reference.limits import comfortable_radius
from rpctl.reference.path_reference import PathReference, Waves, waves
from rpctl.reference.sizing import WISHES, Sizing, SizingRequest, robot_length
from rpctl.robot.model import Robot

RAMP_TIME = 3.0  # s, of a path for a robot 1 m long
LAP_TIME = 20.0  # s; such a path is run through once in this time, soft start included
LAP_RATE = 2.0 * math.pi / (LAP_TIME - 0.5 * RAMP_TIME)
CURVATURE_SAMPLES = 101  # points at which a path's speed and curvature are evaluated
LONGEST_DEFAULT = 120.0  # s; a longer lap is tracked so far unless the user says more
SMALLEST_SHARE = 0.25  # of the robot's length: a path that shrinks for slow wheels stays larger

WORTH_SHRINKING = 0.75  # of a lap's time: a path of half the size must take less


@dataclass(frozen=True)
class NamedPath:
    """A path by its size, and what both are on a robot 1 m long.

    Attributes:
        make: Returns the path of a size (m).
        size: m; None of a path without one.
        speed: The largest along the path, m/s; of one that turns on the spot, rad/s.
        closed: Whether it is closed, a lap each 2π of its parameter; else that is a length.
    """

    make: Callable[[float], paths.Path]
    size: float | None
    speed: float
    closed: bool = True

    def comfortable_speed(self, stretch: float) -> float:
        """Return the speed at ``stretch`` times the size: accelerations stay what they are."""
        return self.speed * (stretch**-0.5 if self.size is None else stretch**0.5)


BASE_PATHS: dict[str, NamedPath] = {
    "line": NamedPath(lambda _: paths.line(1.0), 6.0, 0.3, closed=False),
    "reverse": NamedPath(lambda _: paths.line(-1.0), 6.0, 0.3, closed=False),
    "spin": NamedPath(lambda _: paths.spin(), None, LAP_RATE),
    "circle": NamedPath(paths.circle, 1.0, LAP_RATE),
    "eight": NamedPath(
        lambda size: paths.eight(size, 0.5 * size), 1.5, 1.5 * math.sqrt(2.0) * LAP_RATE
    ),
}


def reference_by_name(
    robot: Robot, name: str, wish: SizingRequest | None = None, collisions: bool = True
) -> PathReference:
    """Return one of the named references (``line``, ``reverse``, ``spin``, ``circle``, ``eight``).

    The arm swings about its home posture; a fixed base moves its arm only. Size and speed follow
    from the robot: its length, the bends that it can steer, and half of what wheels, swivels and
    actuators allow; see :class:`~rpctl.reference.sizing.Sizing`. What is given is kept as it is.

    Args:
        collisions: Whether the arm swings less where links would come too near to each other or
            to the ground.
    """
    if name not in BASE_PATHS:
        raise UnknownNameError("reference", name, BASE_PATHS)
    shape, wish = BASE_PATHS[name], wish or SizingRequest()
    _require_sense(robot, name, wish)
    dynamics, length = ReducedDynamics(robot), robot_length(robot)
    arm, reduced = fit_arm(dynamics, waves(robot, length))
    arm, crowded = clear_waves(arm, robot) if collisions else (arm, "")
    arm_note = "; ".join(filter(None, (reduced, crowded, too_weak(dynamics))))
    size = speed = turns = None
    why = ""
    if robot.drive.base_speeds:
        size, paced, usage = _fit(dynamics, shape, wish, arm, length)
        turns = wish.laps or 1.0
        lasts = paced.lap * turns / paced.rate + 0.5 * paced.ramp
        lasts = lasts if wish.laps else min(lasts, LONGEST_DEFAULT)
        speed, why = (
            paced.rate * _top_speed(shape.make(size)),
            reason(usage, robot, bool(wish.speed)),
        )
        size, turns = None if shape.size is None else size, turns if shape.closed else None
    else:
        ramp, lasts = (math.sqrt(length) * time for time in (RAMP_TIME, LAP_TIME))
        paced = PathReference(None, 0.0, arm, ramp)
    sizing = Sizing(name, size, speed, turns, lasts, why, arm_note, assumptions(robot))
    return replace(paced, default_duration=lasts, sizing=sizing)


def _require_sense(robot: Robot, name: str, wish: SizingRequest) -> None:
    """Refuse what makes no sense for a robot and a reference."""
    shape, drive = BASE_PATHS[name], robot.drive
    if not drive.base_speeds:
        wish.refuse(f"{robot.name} has a fixed base, so {name} moves its arm only", *WISHES)
        return
    if name == "spin" and drive.has_axle and drive.steered:
        raise RpctlError(
            f"{robot.name} cannot follow a spin: a {drive.type} base does not turn on the "
            "spot; take line, reverse, circle or eight"
        )
    if shape.size is None:
        wish.refuse(f"a {name} has no size; give its speed, rad/s", "size")
    if not shape.closed:
        wish.refuse(f"a {name} does not close; give its size, the length in m", "laps")
    least = _least_size(shape, turning_radius(drive, robot.description.joint))
    if wish.size is not None and wish.size < least:
        raise RpctlError(
            f"{robot.name} cannot steer along a {name} of {wish.size:g} m; "
            f"{math.ceil(100.0 * least) / 100.0:g} m is the least size"
        )


def _fit(
    dynamics: ReducedDynamics, shape: NamedPath, wish: SizingRequest, arm: Waves, length: float
) -> tuple[float, PathReference, Usage | None]:
    """Return the size (m), the reference without its record, and what limits its pace, if any.

    Where the limits make a lap take twice its usual time, it shrinks as long as that helps: wheels
    that are busy turning the base gain nothing by tighter bends.
    """
    robot = dynamics.robot
    least = _least_size(shape, comfortable_radius(robot))
    size = wish.size or (length if shape.size is None else max(shape.size * length, least))
    fixed = wish.size is not None or wish.speed is not None or shape.size is None
    reference, usage = _paced(dynamics, shape, size, wish, arm)
    time = _lap(shape, size) / reference.rate
    while not fixed and time > 2.0 * LAP_TIME * max(1.0, math.sqrt(length)):
        half, before = 0.5 * size, time
        smaller = _paced(dynamics, shape, half, wish, arm)
        time = _lap(shape, half) / smaller[0].rate
        if half < max(least, SMALLEST_SHARE * length) or time > WORTH_SHRINKING * before:
            break
        size, (reference, usage) = half, smaller
    return size, reference, usage


def _paced(
    dynamics: ReducedDynamics, shape: NamedPath, size: float, wish: SizingRequest, arm: Waves
) -> tuple[PathReference, Usage | None]:
    """Return a path of a size at the speed that is wished, or that the limits leave."""
    stretch = size if shape.size is None else size / shape.size
    comfort, path = shape.comfortable_speed(stretch), shape.make(size)
    speed = wish.speed or comfort
    rate, lap = speed / _top_speed(path), _lap(shape, size)
    ramp = RAMP_TIME * math.sqrt(stretch) * max(1.0, speed / comfort)
    ramp = min(ramp, lap * min(wish.laps or 1.0, 1.0) / rate)  # half of the way at most
    reference = PathReference(path, rate, arm, ramp, lap=lap)
    if wish.speed is not None:
        return reference, usage_of(dynamics, reference)
    return slow_down(dynamics, reference)


def _lap(shape: NamedPath, size: float) -> float:
    """Return by how much the path's parameter grows in a lap."""
    return 2.0 * math.pi if shape.closed else size


def _top_speed(path: paths.Path) -> float:
    """Return the largest speed by the path's parameter, m; of a turn on the spot its rate, rad."""
    moved, _, turned = _directions(path).T
    return float(moved.max() if moved.any() else turned.max())


def _least_size(shape: NamedPath, radius: float) -> float:
    """Return the size (m) at which a path bends with this radius (m) where it is sharpest."""
    if shape.size is None:
        return 0.0
    moved, _, turned = _directions(shape.make(1.0)).T
    return float((turned / moved).max()) * radius


def _directions(path: paths.Path) -> Array:
    """Return the size of the direction of travel (CURVATURE_SAMPLES, 3) along a lap."""
    places = np.linspace(0.0, 2.0 * math.pi, CURVATURE_SAMPLES)
    return np.abs(path(places).direction[:, 0])
