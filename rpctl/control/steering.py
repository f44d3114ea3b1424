"""A desired twist of the base as its quasi-velocities: speeds and steering rates, in scalars."""

from __future__ import annotations

import math as numbers
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.control.error import Tracking, base_error, base_error_rate
from rpctl.drive.drive import Drive
from rpctl.drive.steering import steered_angles
from rpctl.kernels.scalars import clipped, dot, rounded
from rpctl.kernels.sheet import Sheet
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import BASE_NV, Robot

SLOW_SPEED = 0.1  # m/s: well below it steering follows the reference, well above it the twist
PULLING_SPEED = 0.02  # m/s: well above it the hitch of what is pulled is bounded by being pulled
STEERING_HORIZON_RATIO = 0.25  # of the law's horizon: steering has to be faster than the base
# Largest deviation of the steering direction from the reference's unit direction.
AXLE_MAX_DEVIATION = 1.0  # of bases with an axle
STEERED_MAX_DEVIATION = 0.8  # of other bases, as a fraction of the largest possible one, ...
MIN_DEVIATION = 0.2  # ... but at least this
RATE_FRACTION = 0.9  # of a steered joint's fastest rate: the largest one commanded
BRAKE_TIME = 0.3  # s: approach to a steering limit, twice the dynamic law's horizon
ANGLE_MARGIN = 0.02  # rad between a commanded steering angle and the joint's limits


class Rolling(NamedTuple):
    """How a base rolls whose wheels all steer, at one state."""

    rows: Sequence[Sequence[Any]]  # (3, 1 + n_steered) of P's twist by the base's ν
    drift: Sequence[Any]  # (3,) of P's twist that the steering rates make
    unit_drift: Sequence[Any]  # (3,) with a speed of 1 beside them


class Measured(NamedTuple):
    """A robot's state in scalars, as far as kinematic laws read it."""

    pose: Sequence[Any]  # (3,) of the root link: x, y in m, heading in rad
    twist: Sequence[Any]  # (3,) of P
    joints: Sequence[Any]  # (n_joints,) positions of the arm
    joint_rates: Sequence[Any]  # (n_joints,)
    steered: Sequence[Any] = ()  # (n_steered,) positions of steered joints, rad
    steering_rates: Sequence[Any] = ()  # (n_steered,)
    rolling: Rolling | None = None  # of a base whose wheels all steer

    @staticmethod
    def sizes(robot: Robot) -> list[int]:
        """Return how many numbers each part has, those of ``rolling`` one by one."""
        joints, steered = len(robot.joints), len(robot.drive.steered)
        sizes = [BASE_NV, BASE_NV, joints, joints, steered, steered]
        if steered and not robot.drive.has_axle:
            sizes += [BASE_NV * (1 + steered), BASE_NV, BASE_NV]
        return sizes

    @classmethod
    def of(cls, robot: Robot, column: Any) -> Measured:
        """Return the parts of a column (n, 1) in which they stand one after the other."""
        sizes = cls.sizes(robot)
        parts = [
            math.vertsplit(part) for part in math.vertsplit(column, np.cumsum([0, *sizes]).tolist())
        ]
        if len(parts) == 6:
            return cls(*parts)
        *state, rows, drift, unit_drift = parts
        width = len(rows) // BASE_NV
        rows = [rows[width * i : width * (i + 1)] for i in range(BASE_NV)]
        return cls(*state)._replace(rolling=Rolling(rows, drift, unit_drift))


def reference_direction(sheet: Sheet, state: ReferenceState) -> list[Any]:
    """Write the direction of travel (3,) of a reference, with its first two derivatives.

    That of :func:`rpctl.reference.motion.direction`: where a reference gives none, its
    twist, and where there is neither, straight ahead.

    Args:
        sheet: Where to write.
        state: The reference, in symbols; a direction of zeros is none.
    """
    assert state.direction is not None
    given = sheet.named("g_any", sum(each**2 for each in state.direction[0]))
    moves = sheet.named("t_any", sum(each**2 for each in state.twist))
    ahead, still, found = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), []
    others = zip(state.twist, state.twist_dot, still, strict=True)
    rests = zip(ahead, still, still, strict=True)
    for i, (other, rest) in enumerate(zip(others, rests, strict=True)):
        levels = []
        for mark, own, twist, else_ in zip(
            ("", "_dot", "_ddot"), (row[i] for row in state.direction), other, rest, strict=True
        ):
            value = math.if_else(given > 0.0, own, math.if_else(moves > 0.0, twist, else_))
            levels.append(sheet.symbol(f"G{i + 1}{mark}", value))
        sheet.moves(levels[0], levels[1])
        sheet.moves(levels[1], levels[2])
        found.append(levels[0])
    return found


def base_command(
    sheet: Sheet, robot: Robot, at: Tracking, twist: Sequence[Any], measured: Measured, h: Any
) -> tuple[list[Any], list[Any]]:
    """Write the base's part of ν_d and of ν̇_d, for a twist that it follows as far as it can.

    Without steered wheels these are the twist's own entries. Steered wheels turn towards
    m = ĝ + u t⊥/(u² + ρ²): ĝ is the reference's direction, u and t⊥ are the twist's parts along
    and across it. At speed m is the twist's own direction; near standstill, where the direction of
    a small twist says nothing, m tends to ĝ; far off ĝ it is drawn back smoothly. The angles δ*
    and their rates are exact; then

        δ̇_d = δ̇* + (δ* − δ)/h_s,    δ̈_d = δ̈_r + (δ̇* − δ̇)/h_s,    h_s = h/4,

    predictive laws of first order, whose one approximation is the reference's δ̈_r for δ̈*. The
    hitch of an articulated base takes part in its turning, see :func:`_bend`.

    Args:
        sheet: Where to write.
        robot: The robot.
        at: The reference.
        twist: Desired twist (3,) of the base.
        measured: The robot's state.
        h: Prediction time of the law, s.
    """
    drive = robot.drive
    if not drive.steered:
        keep = [0, 2] if drive.has_axle else list(range(len(drive.base_speeds)))
        return [twist[k] for k in keep], [sheet.rate(twist[k]) for k in keep]
    time = sheet.named("h_s", STEERING_HORIZON_RATIO * h)
    towards = _direction(sheet, drive, at.direction, twist)
    wanted = steered_angles(sheet, drive, _of_root(sheet, robot, "m", towards), "d")
    along = steered_angles(sheet, drive, _of_root(sheet, robot, "r", at.direction), "f")
    bend = _bend(sheet, robot, at, twist, measured) if drive.type == "articulated" else None
    commands = [
        _joint_command(sheet, robot, k, measured, angles, time, bend)
        for k, angles in enumerate(zip(wanted, along, strict=True))
    ]
    rates, changes = (list(part) for part in zip(*commands, strict=True))
    speed, change = twist[0], sheet.rate(twist[0])
    if measured.rolling is not None:
        speed, change = _rolling(sheet, drive, twist, measured, changes)
    return [speed, *rates], [change, *changes]


def _of_root(sheet: Sheet, robot: Robot, mark: str, twist: Sequence[Any]) -> list[Any]:
    """Write P's twist as one of the root link."""
    rows = robot.root_velocity.tolist()
    return [sheet.named(f"{mark}{i}", dot(row, twist)) for i, row in enumerate(rows, start=1)]


def _weighted(weights: Sequence[float], a: Sequence[Any], b: Sequence[Any]) -> Any:
    return sum(w * x * y for w, x, y in zip(weights, a, b, strict=True))


def _rolling(
    sheet: Sheet, drive: Drive, twist: Sequence[Any], measured: Measured, changes: Sequence[Any]
) -> tuple[Any, Any]:
    """Write the base's speed ν₁, and its rate, whose twist is nearest to the desired one.

    With the present steering the twist is T = n ν₁ + T_δ, T_δ the part due to steering rates of
    wheels beside their axis: ν₁ = n·(t − T_δ)/n·n. Ṡ is linear in the steering rates and does not
    depend on ν₁, so ṅ is the difference of two drifts.

    Args:
        sheet: Where to write.
        drive: The drive.
        twist: Desired twist (3,) of the base.
        measured: The robot's state.
        changes: Commanded accelerations of the steered joints (n_steered,).
    """
    assert measured.rolling is not None
    rows, drift, unit_drift = measured.rolling
    weights, n, t, t_dot = twist_weights(drive), [row[0] for row in rows], [], []
    for i, row in enumerate(rows):
        t.append(sheet.named(f"rest{i + 1}", twist[i] - dot(row[1:], measured.steering_rates)))
        t_dot.append(sheet.rate(twist[i]) - dot(row[1:], changes) - drift[i])
    n_dot = [a - b for a, b in zip(unit_drift, drift, strict=True)]
    square = sheet.named("n_square", _weighted(weights, n, n))
    speed = sheet.named("v_1", _weighted(weights, n, t) / square)
    rate = _weighted(weights, n_dot, t) + _weighted(weights, n, t_dot)
    rate -= 2.0 * speed * _weighted(weights, n, n_dot)
    return speed, sheet.named("v_1_dot", rate / square)


def leading(
    sheet: Sheet, robot: Robot, at: Tracking, pose: Sequence[Any], state: ReferenceState,
    measured: Measured,
) -> Tracking:  # fmt: skip
    """Write what a law reads of the axle that leads: of an articulated base backwards its rear one.

    What leads pulls the rest, whose hitch then stays bounded; what is pushed has to be steered from
    behind, and its lateral error first grows. The rear axle of the reference bends as its direction
    would in a steady turn.

    Args:
        sheet: Where to write.
        robot: The robot.
        at: What a law reads of P.
        pose: Of P (3,).
        state: The reference.
        measured: The robot's state.
    """
    (angle,) = steered_angles(sheet, robot.drive, _of_root(sheet, robot, "g", at.direction), "g")
    angle = sheet.named("bend_r", angle)
    rate = sheet.named("bend_r_dot", sheet.rate(angle))
    wanted, twist = _rear(sheet, robot, "w", state.pose, at.twist, angle, rate)
    _, ahead = _rear(sheet, robot, "l", state.pose, at.direction, angle, 0.0)
    bend = sheet.symbol("bend", measured.steered[0])
    sheet.moves(bend, measured.steering_rates[0])
    own, moving = _rear(sheet, robot, "o", pose, at.own_twist, bend, measured.steering_rates[0])
    error = [sheet.symbol(f"e_rear{i}", e) for i, e in enumerate(base_error(wanted, own), start=1)]
    for each, change in zip(error, base_error_rate(error, twist, moving), strict=True):
        sheet.moves(each, change)
    parts = [twist, [sheet.rate(each) for each in twist], ahead, error, error, moving]
    back = _back(at)
    chosen = [
        [sheet.named(f"lead{k}{i}", math.if_else(back, *pair)) for i, pair in enumerate(pairs)]
        for k, pairs in enumerate(
            zip(rear, front, strict=True) for rear, front in zip(parts, at[1:], strict=True)
        )
    ]
    return Tracking(sheet, *chosen)


def of_front(
    sheet: Sheet, robot: Robot, at: Tracking, speed: Any, turn: Any, measured: Measured
) -> tuple[Any, Any]:
    """Return the speed and turning rate of P at which the leading axle has those that are asked."""
    (swivel,), heading = robot.drive.steered, robot.drive.heading
    angle = swivel.heading - heading + swivel.sign * sheet.definitions["bend"][0]
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = np.subtract(swivel.pivot, robot.drive.point)
    along = numbers.cos(heading) * x + numbers.sin(heading) * y
    left = numbers.cos(heading) * y - numbers.sin(heading) * x
    across = -swivel.trail * turn
    turning = sheet.named("front_turn", (sin * speed + cos * across) / along)
    back = _back(at)
    moved = cos * speed - sin * across + turning * left
    return math.if_else(back, moved, speed), math.if_else(back, turning, turn)


def _back(at: Tracking) -> Any:
    return at.direction[0] < 0.0


def _rear(
    sheet: Sheet, robot: Robot, name: str, pose: Any, twist: Any, angle: Any, rate: Any
) -> tuple[list[Any], list[Any]]:  # fmt: skip
    """Write pose (3,) and twist (3,) of an articulated base's rear axle, from those of P."""
    (swivel,), (px, py) = robot.drive.steered, robot.drive.point
    (x, y), heading = swivel.pivot, swivel.heading + swivel.sign * angle
    cos, sin = math.cos(heading), math.sin(heading)
    root = pose[2] - robot.drive.heading
    c, s = math.cos(root), math.sin(root)
    dx, dy = x - px + swivel.trail * cos, y - py + swivel.trail * sin
    place = [pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, root + heading]
    ahead, left, turn = _of_root(sheet, robot, f"{name}_root", twist)
    V, turned = (ahead - turn * y, left + turn * x), turn + swivel.sign * rate
    moved = [cos * V[0] + sin * V[1], cos * V[1] - sin * V[0] + swivel.trail * turned, turned]
    return place, [sheet.named(f"{name}_rear{i}", each) for i, each in enumerate(moved, start=1)]


def _bend(
    sheet: Sheet, robot: Robot, at: Tracking, twist: Sequence[Any], measured: Measured
) -> tuple[Any, Any]:
    """Write the rate of an articulated base's hitch that turns it as a twist asks, and its weight.

    The rear axle's row is n·V + k (ω + φ̇) = 0, with V the hitch's velocity and k the trail, so
    that φ̇ = −(n·V + k ω)/k. What leads (:func:`leading`) pulls the rest at a speed p, and φ stays
    bounded. At rest, and while the base still moves the other way, it does not: the weight,
    p²/(p² + v_p²), is 0 there.

    Args:
        sheet: Where to write.
        robot: The robot.
        at: What a law reads of P.
        twist: Desired twist (3,) of P.
        measured: The robot's state.
    """
    (swivel,) = robot.drive.steered
    (x, y), (ahead, left, turn) = swivel.pivot, _of_root(sheet, robot, "b", twist)
    heading = swivel.heading + swivel.sign * sheet.definitions["bend"][0]
    cos, sin = math.cos(heading), math.sin(heading)
    V = ahead - turn * y, left + turn * x
    speed = -numbers.copysign(1.0, swivel.trail) * (cos * V[0] + sin * V[1])
    towed = math.fmax(math.if_else(_back(at), -speed, speed), 0.0)
    rate = -swivel.sign * ((cos * V[1] - sin * V[0]) / swivel.trail + turn)
    weight = sheet.named("towed", towed**2 / (towed**2 + PULLING_SPEED**2))
    return weight, sheet.named("bend_free", rate)


def _joint_command(
    sheet: Sheet,
    robot: Robot,
    k: int,
    measured: Measured,
    angles: tuple[Any, Any],
    time: Any,
    bend: tuple[Any, Any] | None,
) -> tuple[Any, Any]:
    """Write the commanded rate and acceleration of a steered joint, within its limits.

    Args:
        sheet: Where to write.
        robot: The robot.
        k: Which of the steered joints.
        measured: The robot's state.
        angles: Where the joint shall be, and where it is on the reference, rad.
        time: Prediction time, s.
        bend: Weight of another rate, and that rate, rad/s; see :func:`_bend`.
    """
    limits, name = robot.steering_limits, f"s{k + 1}"
    lower, upper = float(limits.lower[k]) + ANGLE_MARGIN, float(limits.upper[k]) - ANGLE_MARGIN
    fastest = RATE_FRACTION * float(limits.fastest[k])
    actual, rate = measured.steered[k], measured.steering_rates[k]
    angle, feed = angles[0], sheet.rate(sheet.rate(angles[1]))
    # A wheel may as well roll backwards: δ* counts modulo π.
    turns = rounded((actual - angle) / numbers.pi)
    wanted = sheet.named(f"{name}_any", angle + numbers.pi * turns)
    goal = _within(sheet, f"{name}_goal", wanted, lower, upper)
    free = sheet.named(f"{name}_free", wanted == goal)
    follow = sheet.named(f"{name}_rate", math.if_else(free, sheet.rate(angle), 0.0))
    asked = sheet.named(f"{name}_ask", follow + (goal - actual) / time)
    change = math.if_else(free, feed, 0.0) + (follow - rate) / time
    if bend is not None:
        weight, other = bend
        change += weight * (sheet.rate(other) - change) + sheet.rate(weight) * (other - asked)
        asked = sheet.named(f"{name}_bent", asked + weight * (other - asked))
    # The nearer a limit, the slower towards it: (limit − δ)/BRAKE_TIME, which never passes it.
    near = [(limit - actual) / BRAKE_TIME for limit in (lower, upper)]
    least = -fastest if numbers.isinf(lower) else clipped(near[0], -fastest, numbers.inf)
    most = fastest if numbers.isinf(upper) else clipped(near[1], -numbers.inf, fastest)
    least, most = sheet.named(f"{name}_min", least), sheet.named(f"{name}_max", most)
    bound = _within(sheet, f"{name}_d", asked, least, most)
    braking = -rate / BRAKE_TIME
    if numbers.isfinite(fastest):
        braking = math.if_else(math.fabs(bound) < fastest, braking, 0.0)
    return bound, sheet.named(f"{name}_d_dot", math.if_else(bound == asked, change, braking))


def _within(sheet: Sheet, name: str, value: Any, lower: Any, upper: Any) -> Any:
    """Write a value within bounds; the upper one prevails."""
    raised = sheet.named(f"{name}_up", clipped(value, lower, numbers.inf))
    return sheet.named(name, clipped(raised, -numbers.inf, upper))


def _direction(sheet: Sheet, drive: Drive, g: Sequence[Any], t: Sequence[Any]) -> list[Any]:
    """Write m (3,), the direction in which the wheels steer the base."""
    W = twist_weights(drive)
    size = sheet.named("g_size", math.sqrt(_weighted(W, g, g)))
    unit = [sheet.named(f"gh{i}", each / size) for i, each in enumerate(g, start=1)]
    u = sheet.named("along", _weighted(W, unit, t))
    gain = sheet.named("gain", u / (u**2 + SLOW_SPEED**2))
    off = [
        sheet.named(f"dev{i}", gain * (each - u * own))
        for i, (each, own) in enumerate(zip(t, unit, strict=True), start=1)
    ]
    ratio = _weighted(W, off, off) / max_deviation(drive) ** 2
    level = sheet.named("level", math.sqrt(1.0 + ratio))
    return [own + each / level for own, each in zip(unit, off, strict=True)]


def max_deviation(drive: Drive) -> float:
    """Return the largest deviation of m from ĝ that leaves the steering well defined.

    Where only steered wheels carry the base, its centre of rotation must not lie on the line
    through the first two steered pivots: there their axles do not determine it.
    """
    if drive.has_axle:
        return AXLE_MAX_DEVIATION
    first, second = (np.array(swivel.pivot) for swivel in drive.steered[:2])
    along, off = second - first, np.array(drive.point) - first
    apart = abs(along[0] * off[1] - along[1] * off[0]) / float(np.linalg.norm(along))
    reach = numbers.sqrt(twist_weights(drive)[2])
    return max(float(STEERED_MAX_DEVIATION * apart / reach), MIN_DEVIATION)


def twist_weights(drive: Drive) -> list[float]:
    """Return the weights (3,) of a twist's entries: turning counts by the steered wheels' reach."""
    reach = max(numbers.dist(drive.point, swivel.pivot) for swivel in drive.steered)
    return [1.0, 1.0, reach**2]
