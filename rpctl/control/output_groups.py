"""What robots take in the place of efforts, group by group of their joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from rpctl.errors import RpctlError
from rpctl.files.records import POSITIVE, OneOf, Range, Record, Setting
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern, matching

BASE, REST = "base", "*"  # pattern of the base's speeds; one that may match nothing
TWIST, WHEELS, STEERING, POSITION, RATES, EFFORT = (
    "twist", "wheel-speeds", "steering", "position", "velocity", "effort",
)  # fmt: skip
SPEED_KINDS = (RATES, TWIST, WHEELS, STEERING, POSITION)
GROUP_KINDS = (*SPEED_KINDS, EFFORT)
OF_ARMS = (RATES, POSITION, EFFORT)
OUTPUT_WORDS = "|".join((EFFORT, *SPEED_KINDS, "GROUP=KIND,..."))  # of a command line
TWISTS = (("v", "omega"), ("vx", "vy", "omega"))  # speeds of bases that a twist determines
MAX_DEAD_TIME = 2.0  # s: no motion can be foretold for longer
MAX_LAG = 10.0  # s
LAG = Range(0.0, MAX_LAG, f"a time in s, from 0 to {MAX_LAG:g}")
DEAD_TIME = Range(0.0, MAX_DEAD_TIME, f"a time in s, from 0 to {MAX_DEAD_TIME:g}")


@dataclass(frozen=True, kw_only=True)
class OutputGroup(Record):
    """The command of one group of quasi-velocities, its lag, and its bounds.

    ``kind`` is one of

    - ``"velocity"``: the quasi-velocities of the group, m/s or rad/s;
    - ``"twist"``: the base's v and ω, or v_x, v_y and ω, of P along its own axes;
    - ``"wheel-speeds"``: rates of the driven wheels, rad/s, and angles of their swivels, rad;
    - ``"steering"``: the speed v of P (m/s), and the angle (rad) of a single wheel on the vehicle's
      middle line that replaces the steered ones and turns on the same circle (Ackermann);
    - ``"position"``: positions of the arm's joints (rad or m), with rates and accelerations. A
      servo with lag T, T q̇ = p − q, follows them as T q̈ = ṗ − q̇, like a robot that takes rates ṗ;
    - ``"effort"``: efforts of the arm's joints (N·m or N), from the dynamic law on a base that its
      own controllers move, see :class:`~rpctl.control.arm_efforts.ArmEfforts`. They act at once,
      within the limits of the URDF.

    ``speeds``, ``accelerations`` and ``jerks`` bound the resulting motion of the model, by pattern
    of the names of the group's quasi-velocities.
    """

    kind: Annotated[str, OneOf(GROUP_KINDS), Setting("", "Sent", "Kind of command.")] = field(
        default=RATES, kw_only=False
    )
    lag: Annotated[
        float | None, LAG, Setting("s", "Lag", "First-order lag; default: that of the output.")
    ] = field(default=None, kw_only=False)
    dead_time: Annotated[
        float | None,
        DEAD_TIME,
        Setting("s", "Dead time", "Dead time; default: that of the output."),
    ] = field(default=None, kw_only=False)
    speeds: Annotated[
        Mapping[str, float], POSITIVE, Setting("m/s or rad/s", "Speeds", "Largest speeds.")
    ] = field(default_factory=dict)
    accelerations: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting("m/s² or rad/s²", "Accelerations", "Largest accelerations."),
    ] = field(default_factory=dict)
    jerks: Annotated[
        Mapping[str, float], POSITIVE, Setting("m/s³ or rad/s³", "Jerks", "Largest jerks.")
    ] = field(default_factory=dict)


Member = tuple[OutputGroup, tuple[str, ...]]  # a group, and the names of its quasi-velocities


def as_groups(given: Mapping[str, str | OutputGroup]) -> dict[str, OutputGroup]:
    """Return groups by pattern, which may be given by their kind alone."""
    return {
        name: each if isinstance(each, OutputGroup) else OutputGroup(each)
        for name, each in given.items()
    }


def members(groups: Mapping[str, OutputGroup], robot: Robot) -> dict[str, Member]:
    """Return the groups on a robot, by pattern.

    Args:
        groups: By ``"base"``, or by pattern of the names of the arm's joints.

    Raises:
        RpctlError: A quasi-velocity is in no group or in two, or a group is of a kind that the
            robot cannot be sent.
        UnknownNameError: A pattern matches no joint of the arm.
    """
    base, found = robot.drive.base_speeds, dict[str, Member]()
    for pattern, group in groups.items():
        if pattern == BASE:
            _require_base(group.kind, robot)
            found[BASE] = group, base
        elif robot.joint_names or pattern != REST:
            names = tuple(matching(pattern, robot.joint_names, "joint of the arm"))
            if group.kind not in OF_ARMS:
                raise RpctlError(
                    f"{pattern} cannot be sent {group.kind}: these are joints of an arm; give "
                    f"{', '.join(OF_ARMS[:-1])} or {OF_ARMS[-1]}"
                )
            if group.kind == EFFORT and group != OutputGroup(EFFORT):
                raise RpctlError(
                    f"{pattern} takes efforts, which act at once and within the URDF's limits: "
                    "leave out its lag, dead time and bounds"
                )
            found[pattern] = group, names
    for name in robot.quasi_velocities:
        own = [pattern for pattern, (_, names) in found.items() if name in names]
        if len(own) != 1:
            where = f"in the groups {' and '.join(own)}" if own else "in no group"
            raise RpctlError(
                f"{name} is {where} of the output; give each one group, as "
                + (f'"{BASE}": "{TWIST}"' if name in base else f'"{name}": "{POSITION}"')
            )
    return found


def _require_base(kind: str, robot: Robot) -> None:
    """Refuse a kind of output that does not move a robot's base."""
    drive = robot.drive
    one, free = len(drive.steered) == 1, drive.base_speeds in TWISTS
    for wrong, why in (
        (not drive.base_speeds, f"{robot.name} has a fixed base; leave out the group {BASE}"),
        (kind == POSITION, f"a base does not take {POSITION}; give {WHEELS} or {RATES}"),
        (
            kind == EFFORT,
            "rpctl does not support a base that takes efforts beside groups of the arm; give "
            f'{WHEELS} or {RATES}, or output="{EFFORT}" for the whole robot',
        ),
        (
            kind == TWIST and not free,
            f"a {kind} tells the {drive.type} base of {robot.name} nothing of its steering while "
            f"it stands; give {STEERING if one else WHEELS}",
        ),
        (
            kind == STEERING and not one,
            f"{kind} applies to bases with one steering angle; the base of {robot.name} is "
            f"{drive.type}: give {TWIST if free else WHEELS}",
        ),
    ):
        if wrong:
            raise RpctlError(why)


def by_quasi_velocity(
    groups: Mapping[str, OutputGroup], robot: Robot
) -> dict[str, dict[str, float]]:
    """Return what groups say of each quasi-velocity: lags and the like by name, by their fields.

    Raises:
        RpctlError: As :func:`members`.
        UnknownNameError: A bound matches nothing of its group.
    """
    bounds = ("speeds", "accelerations", "jerks")
    found = {name: dict[str, float]() for name in ("lags", "dead_times", *bounds)}
    for group, names in members(groups, robot).values():
        for what, given in (("lags", group.lag), ("dead_times", group.dead_time)):
            value = 0.0 if group.kind == EFFORT else given
            found[what] |= {} if value is None else dict.fromkeys(names, value)
        for what in bounds:
            found[what] |= by_pattern(getattr(group, what), names, "quasi-velocity of its group")
    return found
