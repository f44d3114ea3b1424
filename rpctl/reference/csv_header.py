"""The columns that a table of poses may have, and what is wrong with those that a header names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches

from rpctl.description.findings import Fault, excerpt, parse_numbers
from rpctl.reference.csv_rows import separator_fault

BASE_COLUMNS, HEADING = ("x", "y"), "theta"
EE_COLUMNS, QUATERNION = ("ee_x", "ee_y", "ee_z"), ("ee_qx", "ee_qy", "ee_qz", "ee_qw")
POSE_COLUMNS = (*BASE_COLUMNS, HEADING, *EE_COLUMNS, *QUATERNION)
OTHER_NAMES = {
    "t": ("time", "times", "timestamp", "stamp", "sec", "seconds", "zeit", "temps", "tiempo"),
    HEADING: ("yaw", "heading", "orientation", "angle", "phi", "psi", "th", "θ"),
}
ORIENTATION = "orientation."  # of a field of a message; by itself it means the heading
TRAJECTORY_CELLS = 8  # time, position, quaternion
TRAJECTORY_TO_TABLE = (
    '(echo t,x,y,theta; awk \'!/^#/ {print $1","$2","$3","2*atan2($7,$8)}\' FILE) > NEW.csv'
)
MEANT = {other: name for name, others in OTHER_NAMES.items() for other in others}


def header_faults(names: list[str], joints: Sequence[str]) -> list[str]:
    """Return what is wrong with a table's columns; nothing if the list is empty.

    Args:
        names: What its first row names.
        joints: Names of the robot's joints.
    """
    if _is_trajectory(names):
        return [
            "a trajectory of time, position and quaternion between blanks; make a table of it, as "
            f"{TRAJECTORY_TO_TABLE} does"
        ]
    if fault := separator_fault(names):
        return [fault]
    if all(map(_is_number, names)):
        return ["numbers where the columns' names belong; write them above, as t,x,y,theta"]
    known = ("t", *POSE_COLUMNS, *joints)
    faults = []
    for name in dict.fromkeys(names):
        if name not in known:
            faults.append(f'column "{excerpt(name)}" is not known; {_hint(name, known)}')
        if names.count(name) > 1:
            faults.append(f'column "{excerpt(name)}" comes {names.count(name)} times; keep one')
    return faults + _missing(names)


def _missing(names: list[str]) -> list[str]:
    faults = []
    if "t" not in names:
        faults.append("no column t; add the time in s")
    for group in (BASE_COLUMNS, EE_COLUMNS, QUATERNION):
        missing = [name for name in group if name not in names]
        if missing and len(missing) < len(group):
            there = next(name for name in group if name in names)
            faults.append(f"column {', '.join(missing)} is missing beside {there}; add it")
    for name, needed in ((HEADING, BASE_COLUMNS), (QUATERNION[0], EE_COLUMNS)):
        if name in names and needed[0] not in names:
            faults.append(f"column {name} needs {', '.join(needed)} beside it; add them")
    if not faults and len(names) == 1:
        faults.append("only times; add x,y or ee_x,ee_y,ee_z or joints")
    return faults


def _hint(name: str, known: Sequence[str]) -> str:
    """Return which column is meant by a name: without its unit and case, or by another word."""
    plain = name.partition("[")[0].partition("(")[0].strip("% _").casefold()
    if ORIENTATION in plain:
        return "give theta = 2 atan2(z, w) of the quaternion instead, in rad"
    plain = re.split(r"[./]", plain)[-1]  # of a field of a message: pose.pose.position.x
    folded = {each.casefold(): each for each in known}
    near = get_close_matches(plain, folded, n=1, cutoff=0.5)
    meant = folded.get(plain) or MEANT.get(plain) or (folded[near[0]] if near else None)
    return f"did you mean {meant}?" if meant else f"columns are {', '.join(known)}"


def _is_trajectory(names: list[str]) -> bool:
    """Return whether a row is one of ``timestamp tx ty tz qx qy qz qw``, between blanks."""
    cells = names[0].split() if len(names) == 1 else []
    return len(cells) == TRAJECTORY_CELLS and all(map(_is_number, cells))


def _is_number(text: str) -> bool:
    try:
        parse_numbers(text, 1)
    except Fault:
        return False
    return True
