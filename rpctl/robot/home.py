"""The home posture: given joint by joint, by a state of an SRDF, by a word, or chosen."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rpctl.description.records import Joint
from rpctl.description.srdf import read_state
from rpctl.errors import Finding, RpctlError, is_number, require_known
from rpctl.robot.model import Robot
from rpctl.robot.posture import find_posture, judge

AUTO, ZERO = "auto", "zero"
STATE = re.compile(r"(?P<path>.*\.srdf(?:\.xacro)?)(?::(?P<state>.*))?", re.IGNORECASE)
BEYOND_LIMIT = 1e-9  # rad or m; a position this far outside is at the limit
FORMS = f"NAME=POSITION, {AUTO}, {ZERO}, or a state of an SRDF, as robot.srdf:home"


def with_home(robot: Robot, home: Mapping[str, float] | Sequence[str]) -> Robot:
    """Return a robot with its home posture set, and the findings about it.

    Joints that nothing is said of are at 0, or the nearest position well inside their limits,
    wherever the arm can work from there. A branch of the arm that is near a singular posture
    there, whose joints turn about nearly one axis, or that reaches into the ground takes a posture
    of its own; so does every branch for ``"auto"``, and none for ``"zero"``.

    Args:
        robot: The robot, at its default home.
        home: Positions by joint (rad or m); or words: ``NAME=POSITION``, several by commas, a
            state of an SRDF (``robot.srdf:home``), ``auto`` or ``zero``, the later ones over the
            earlier ones.

    Raises:
        RpctlError: A word is none of these, a joint is none of the arm's, or a position is
            outside the limits.
        DescriptionError: The SRDF cannot be used.
    """
    findings: list[Finding] = []
    word, named = _wish(robot, home, findings)
    posture, reasons = robot.home, tuple[str, ...]()
    if word != ZERO and not named.keys() >= {*robot.joint_names}:
        posture, reasons = find_posture(robot, robot.home, force=word == AUTO)
    if reasons and word != AUTO:
        text = f"rpctl chose the home posture: at zero, {'; '.join(reasons)}"
        findings.append(
            Finding("info", None, f"{text}; --home sets another, --home {ZERO} keeps zero")
        )
    if named:
        posture = posture.copy()
        for index, joint in enumerate(robot.joints):
            posture[index] = named.get(joint.name, posture[index])
        findings += [
            Finding("info", None, f"at home, {reason}") for reason in judge(robot, posture)
        ]
    at_home = dict(zip(robot.joint_names, posture.tolist(), strict=True))
    settings = replace(robot.loaded_with, home=at_home)
    return replace(robot, loaded_with=settings, findings=(*robot.findings, *findings))


def _wish(
    robot: Robot, home: Mapping[str, float] | Sequence[str], findings: list[Finding]
) -> tuple[str, dict[str, float]]:
    """Return which word was asked for, and the positions of joints (rad or m), all checked.

    Args:
        findings: Gets what of a file could not be used.
    """
    if isinstance(home, Mapping):
        return "", {name: _checked(robot, name, position) for name, position in home.items()}
    word, positions = "", dict[str, float]()
    for item in home:
        state = STATE.fullmatch(item)
        if item in (AUTO, ZERO):
            word = item
        elif state:
            positions |= _state(robot, state["path"], state["state"] or "", findings)
        else:
            pairs = map(_pair, item.split(","))
            positions |= {name: _checked(robot, name, position) for name, position in pairs}
    return word, positions


def _pair(text: str) -> tuple[str, float]:
    """Return the name and the position of ``NAME=POSITION``."""
    name, given, position = text.strip().partition("=")
    if not given:
        raise RpctlError(f"home {text!r} is not known; give {FORMS}")
    try:
        return name.strip(), float(position)
    except ValueError:
        raise RpctlError(f"home {text!r}: {position!r} is not a number; write NAME=0.1") from None


def _checked(robot: Robot, name: str, position: float) -> float:
    """Return the position of a joint at home.

    Raises:
        RpctlError: The joint is none of the arm's, or the position is none of its.
    """
    if name in robot.locked:
        raise RpctlError(
            f"home of {name}: this joint is frozen at {robot.locked[name]:g}; --free {name} lets "
            f"it move, --lock {name}=POSITION moves it"
        )
    require_known("joint at home", [name], robot.joint_names)
    if not is_number(position):
        raise RpctlError(f"home of {name} is {position!r}; give a number, rad or m")
    joint = robot.description.joint[name]
    if _outside(joint, position):
        raise RpctlError(
            f"home of {name} is {position:g}, outside its limits; give {_limits(joint)}"
        )
    return float(np.clip(position, joint.lower, joint.upper))


def _state(robot: Robot, path: str, state: str, findings: list[Finding]) -> dict[str, float]:
    """Return the positions of an SRDF's state; what the arm has no use for is told."""
    arm, known = {joint.name: joint for joint in robot.joints}, robot.description.joint
    positions, strange, still = dict[str, float](), list[str](), list[str]()
    for name, (value, line) in read_state(path, state, robot.description.read_with).items():
        joint = arm.get(name)
        if joint is not None:
            positions[name] = float(np.clip(value, joint.lower, joint.upper))
            if _outside(joint, value):
                text = (
                    f'{path}:{line}: state "{state}" puts {name} at {value:g}; its limits are '
                    f"{_limits(joint)}, and rpctl uses the nearer one"
                )
                findings.append(Finding("warning", None, text))
        elif name not in known:
            strange.append(f"{name} (line {line})")
        elif robot.locked.get(name, value) != value:
            still.append(name)
    if strange:
        text = f'{path}: joints of state "{state}" that the robot does not have are left out: '
        findings.append(Finding("warning", None, text + ", ".join(strange)))
    if still:
        text = f'{path}: frozen joints keep their positions, not those of state "{state}": '
        findings.append(Finding("info", None, text + ", ".join(still)))
    return positions


def _outside(joint: Joint, position: float) -> bool:
    return not joint.lower - BEYOND_LIMIT <= position <= joint.upper + BEYOND_LIMIT


def _limits(joint: Joint) -> str:
    unit = "m" if joint.kind == "prismatic" else "rad"
    return f"{joint.lower:g} to {joint.upper:g} {unit}"
