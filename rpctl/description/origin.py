"""<origin>: a pose in the frame of the parent."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.findings import Findings
from rpctl.description.records import rotation_rpy

MAX_LENGTH_M = 100.0  # m; above it a length is probably in mm
MAX_ANGLE = 4.0 * math.pi  # rad; above it an angle is probably in degrees


def read_origin(findings: Findings, element: Any) -> Array:
    """Return the pose (4, 4) of an element's <origin>, read-only; the identity without one."""
    origin = findings.only(element, "origin")
    placement = np.eye(4)
    if origin is not None:
        xyz = findings.numbers(origin, "xyz", 3, "0 0 0")
        rpy = findings.numbers(origin, "rpy", 3, "0 0 0")
        placement[:3, 3] = xyz
        if any(rpy):
            placement[:3, :3] = rotation_rpy(*rpy)
        _doubt(findings, origin, xyz, rpy)
    placement.setflags(write=False)
    return placement


def _doubt(findings: Findings, origin: Any, xyz: list[float], rpy: list[float]) -> None:
    if origin.get("quat_xyzw") is not None:
        findings.error(origin, "<origin quat_xyzw> is not read; write the turn as rpy (rad)")
    if max(map(abs, xyz)) > MAX_LENGTH_M:
        where = f'<origin xyz="{origin.get("xyz")}">'
        findings.warn(origin, f"{where} is over {MAX_LENGTH_M:g} m away; is it in mm? give m")
    if max(map(abs, rpy)) > MAX_ANGLE:
        where = f'<origin rpy="{origin.get("rpy")}">'
        findings.warn(origin, f"{where} is over two turns; is it in degrees? give rad")
