"""A run as one flat table: a row a sample, a column a number."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run.facts import GroundFacts, RobotFacts
from rpctl.simulation.run.log import Log

POSE = ("x", "y", "theta")
POINT = ("x", "y", "z")
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet takes for the beginning of one
CSV_ROWS = 2000  # that are text at once
ERRORS = ("longitudinal", "lateral", "heading")


def columns(log: Log, robot: RobotFacts, ground: GroundFacts) -> dict[str, Array]:
    """Return the columns (K,) of a run by name, in SI units.

    ``t``; of P ``x``, ``y``, ``theta``; each joint's position by the joint's name (behind
    ``joint_`` where that name is taken, as "x" is, or would begin a formula); both again with
    ``_ref``. Then, by prefix, ``e_`` tracking errors, ``nu_``, ``nu_d_``, ``nu_cmd_``, ``nu_ref_``
    quasi-velocities, ``tau_`` efforts, ``rate_`` rates of the actuators' joints, ``ee_`` the end
    effector, ``load_`` vertical forces of the ground, and single figures by their name in the log.
    """
    joints = robot.joint_names
    groups: list[tuple[str, Iterable[str], Array, str]] = [
        ("", POSE, log.base, ""),
        ("", joints, log.joints, ""),
        ("", POSE, log.base_ref, "_ref"),
        ("", joints, log.joints_ref, "_ref"),
        ("", robot.other_names, log.others, ""),
        ("e_", (*ERRORS, *joints), log.e, ""),
        ("nu_", robot.quasi_velocities, log.nu, ""),
        ("nu_d_", robot.quasi_velocities, log.nu_d, ""),
        ("nu_cmd_", robot.quasi_velocities, log.nu_cmd, ""),
        ("nu_ref_", robot.quasi_velocities, log.nu_ref, ""),
        ("tau_", robot.actuators, log.tau, ""),
        ("rate_", robot.actuators, log.rates, ""),
        ("ee_", POINT, log.ee, ""),
        ("ee_", POINT, log.ee_ref, "_ref"),
        ("load_", ground.contacts, log.contact_load, ""),
        ("zmp_", ("x", "y"), log.zmp, ""),
    ]
    table = {"t": log.t}
    for prefix, names, values, suffix in groups:
        if values.shape[1]:  # what is not defined for a robot has no columns
            for name, column in zip(names, values.T, strict=True):
                label = f"{prefix}{name}{suffix}"
                taken = label in table or label.startswith(FORMULA)
                table[f"joint_{label}" if taken else label] = column
    for name in ("ee_angle", "tip_margin", "slip_ratio", "energy", "work", "lost"):
        values = getattr(log, name)
        if values.ndim == 1:
            table[name] = values
    return table


def csv_blocks(table: Mapping[str, Array]) -> Iterator[str]:
    """Yield a table as CSV, a header and a row a sample; a number is as exact as it was.

    Args:
        table: Columns (K,) by name.
    """
    columns = list(table.values())
    yield _csv([list(table)])
    for first in range(0, len(columns[0]), CSV_ROWS):
        rows = [column[first : first + CSV_ROWS] for column in columns]
        yield _csv(np.column_stack(rows).tolist())


def _csv(rows: Iterable[Iterable[object]]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()
