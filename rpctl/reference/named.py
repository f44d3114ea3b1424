"""The references that have a name, and arm motions beside them that keep the links clear."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeGuard

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.steering import turning_radius
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_known
from rpctl.reference import paths
from rpctl.reference.fitting import (
    LIMIT_SHARE,
    Usage,
    assumptions,
    fit_arm,
    reason,
    slow_down,
    too_weak,
    usage_of,
)
from rpctl.reference.motion import configurations
from rpctl.reference.path_reference import PathReference, Waves, waves
from rpctl.reference.sizing import WISHES, Sizing, SizingRequest, comfortable_radius, robot_length
from rpctl.robot.collision import TOUCH_M, CollisionModel, collision_model
from rpctl.robot.leaning import MAX_LEAN, LeaningRobot
from rpctl.robot.model import Robot
from rpctl.robot.pair_motion import approach_rates, joint_motion, joint_travel

RAMP_TIME = 3.0  # s, of a path for a robot 1 m long
LAP_TIME = 20.0  # s; such a path is run through once in this time, soft start included
LAP_RATE = 2.0 * math.pi / (LAP_TIME - 0.5 * RAMP_TIME)
CURVE = np.linspace(0.0, 2.0 * math.pi, 101)  # where a path's speed and curvature are evaluated
LONGEST_DEFAULT = 120.0  # s; a longer lap is tracked so far unless the user says more
SMALLEST_SHARE = 0.25  # of the robot's length: a path that shrinks for slow wheels stays larger

KNOWN = 4  # answers that are kept: the references of a robot share its arm's motion
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


BASE_PATHS: dict[str, NamedPath] = {
    "line": NamedPath(lambda _: paths.line(1.0), 6.0, 0.3, closed=False),
    "reverse": NamedPath(lambda _: paths.line(-1.0), 6.0, 0.3, closed=False),
    "spin": NamedPath(lambda _: paths.spin(), None, LAP_RATE),
    "circle": NamedPath(paths.circle, 1.0, LAP_RATE),
    "eight": NamedPath(
        lambda size: paths.eight(size, 0.5 * size), 1.5, 1.5 * math.sqrt(2.0) * LAP_RATE
    ),
}


@lru_cache(maxsize=KNOWN)
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
    require_known("reference", [name], BASE_PATHS)
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
        speed = paced.rate * _top_speed(shape.make(size))
        why = reason(usage, robot, bool(wish.speed))
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
        wish.refuse(f"a {name} is not a closed path; give its size, the length in m", "laps")
    radius = turning_radius(drive, robot.description.joint)
    least = _least_size(shape, 1.0 / robot.sharpest_bend if _rides(robot) else radius)
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
    radius = comfortable_radius(robot)
    if _rides(robot):  # at its own pace, the bend by a share of its steering leans it by that, too
        faster = max(1.0, (wish.speed or 0.0) / robot.balancing_speed(MAX_LEAN))
        radius = faster**2 / (LIMIT_SHARE * robot.sharpest_bend)
    least = _least_size(shape, radius)
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
    # Accelerations stay what they are.
    comfort = shape.speed * stretch ** (-0.5 if shape.size is None else 0.5)
    path, robot = shape.make(size), dynamics.robot
    if _rides(robot):
        comfort = robot.balancing_speed(MAX_LEAN)
    speed = wish.speed or comfort
    rate, lap = speed / _top_speed(path), _lap(shape, size)
    ramp = RAMP_TIME * math.sqrt(stretch) * max(1.0, speed / comfort)
    ramp = min(ramp, lap * min(wish.laps or 1.0, 1.0) / rate)  # half of the way at most
    ramp = 0.0 if _rides(robot) else ramp  # it begins in motion
    reference, usage = PathReference(path, rate, arm, ramp, lap=lap), None
    if wish.speed is None:
        reference, usage = slow_down(dynamics, reference)
    else:
        usage = usage_of(dynamics, reference)
    if _rides(robot):
        robot.require_speed(reference.rate * float(path(CURVE).twist[:, 0, 0].min()))
    return reference, usage


def _rides(robot: Robot) -> TypeGuard[LeaningRobot]:
    """Return whether a robot is a bicycle that leans: it can neither stand nor go slowly."""
    return isinstance(robot, LeaningRobot) and robot.rolls_sideways


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
    """Return the size of the direction of travel (101, 3) along a lap."""
    return np.abs(path(CURVE).twist[:, 0])


MARGIN_M = 0.01  # m: what links keep where they would touch at the full swing
KEPT_AT_MOST = 0.5  # of a pair's distance at home: links that are near there cannot keep more
STEP = 0.8  # factor by which the swings are reduced until the links are clear
MAX_STEPS = 24  # of these, to half a percent
MEETING_PERIODS = 16  # of the slowest wave, after which the waves meet as at the start
SAMPLES = 2001  # postures that are looked at in this time
LOOK_M = 2e-3  # m: how far a pair may move on before it is looked at again, at least


def clear_waves(arm: Waves, robot: Robot) -> tuple[Waves, str]:
    """Return an arm's motion that keeps links clear of each other and of the ground.

    Returns:
        The motion, all its swings reduced by one factor where it needs that, and what for; it is
        the same object where it needs nothing.
    """
    if not arm.amplitude.any():
        return arm, ""
    shares = (tuple(each.tolist()) for each in (arm.centre, arm.amplitude, arm.rate))
    factor, why = _clear_factor(collision_model(robot), *shares)
    return (arm if factor == 1.0 else replace(arm, amplitude=factor * arm.amplitude)), why


@lru_cache(maxsize=KNOWN)
def _clear_factor(model: CollisionModel, *shares: tuple[float, ...]) -> tuple[float, str]:
    """Return the factor of the swing that keeps links clear, and what it is for.

    Args:
        *shares: Centre, amplitude and rate of the joints' waves.
    """
    if not len(model.pairs):
        return 1.0, ""
    scan, factor, near = _WaveScan(Waves(*map(np.array, shares)), model), 1.0, None
    for step in range(MAX_STEPS):
        factor = STEP**step
        found = scan.too_near(factor, MARGIN_M if step else TOUCH_M)
        if found is None:
            break
        near = found
    else:
        factor = 0.0
    if near is None:
        return 1.0, ""
    first, second = (model.shapes[k].link for k in model.pairs[near].tolist())
    return factor, f"swing reduced to {100.0 * factor:.0f} % to keep {first} clear of {second}"


class _WaveScan:
    """Follows the pairs of a model along a motion, until its waves meet again."""

    def __init__(self, arm: Waves, model: CollisionModel) -> None:
        self._arm, self._model, self._distances = arm, model, model.distances()
        end = MEETING_PERIODS * 2.0 * math.pi / float(arm.rate.min())
        self._sines = np.sin(np.linspace(0.0, end, SAMPLES)[:, None] * arm.rate)
        ends = self._configurations(np.outer([0.0, 1.0], np.ones(len(arm.rate))))
        rates = approach_rates(model, joint_travel(model.robot, ends))
        self._way = rates @ joint_motion(model.robot, ends)[0]  # (n,) m: at full swing
        moved = joint_motion(model.robot, self._configurations(self._sines))
        # How much nearer pairs can have come at full swing (SAMPLES, n), m.
        self._paths = np.pad(np.cumsum(moved, axis=0), ((1, 0), (0, 0))) @ rates.T
        self._distances.place(ends[0])
        # Distances of all pairs at home (n,), m.
        self._home = np.array([*map(self._distances.distance, range(len(model.pairs)))])

    def too_near(self, factor: float, margin: float) -> int | None:
        """Return a pair that does not keep its distance at this factor of the swing, or None.

        Between two looks a pair comes no nearer than the joints' motion allows, so it is looked at
        only where it can have come too near.

        Args:
            margin: Distance that pairs keep, m, or ``KEPT_AT_MOST`` of that at home.
        """
        need = np.minimum(margin, KEPT_AT_MOST * self._home)  # (n,) m: what the pairs keep
        slack = self._home - need  # (n,) m: how much nearer they may come
        left = np.flatnonzero(factor * self._way > slack)
        if not left.size:
            return None
        goal = slack[left]
        for sines, gone in zip(self._sines, factor * self._paths[:, left], strict=True):
            due = np.flatnonzero(gone >= goal)
            if due.size:
                self._distances.place(self._configurations(factor * sines[None])[0])
            for row in due.tolist():
                pair = int(left[row])
                room = self._distances.distance(pair) - need[pair]
                if room < 0.0:
                    return pair
                goal[row] = gone[row] + max(room, LOOK_M)
        return None

    def _configurations(self, sines: Array) -> Array:
        """Return q (K, nq) where the waves have these sines (K, n_joints)."""
        joints = self._arm.centre + self._arm.amplitude * sines
        return configurations(self._model.robot, np.zeros((len(sines), 3)), joints)
