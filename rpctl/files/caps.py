"""Caps that keep time and memory bounded, and how to raise them."""

from __future__ import annotations

import os

from rpctl.errors import RpctlError

MAX_BYTES = 32 * 2**20  # of a URDF; the largest public ones are near 1 MB
MAX_TOML_BYTES = 2**20  # of a file in TOML; a thousand waypoints have 50 kB, each MB takes 2 s
MAX_PARAMETER_BYTES = 2**17  # of a file of ROS parameters; the largest public ones have a tenth
MAX_ELEMENTS = 100_000  # of XML; the largest public URDFs have a tenth, and each takes 30 µs
MAX_ATTRIBUTES = 1_000_000  # of XML; each takes 300 bytes
MAX_LINKS = 2000  # Pinocchio's time grows with the square of the links
MAX_MOVING_JOINTS = 150  # Pinocchio's Data grows with their cube: .3 GB at 150, 2 GB at 300
MAX_MESH_BYTES = 256 * 2**20  # no robot's part is larger
MAX_STATES = 100_000  # that one certificate draws; TIAGo's take an hour
MAX_PICTURES = 20_000  # of one film: eleven minutes at 30 a second, which take an hour to draw
MAX_RUN_SECONDS = 86_400  # of computing that a run takes at least; an hour of TIAGo takes half
MAX_RUN_BYTES = 4 * 2**30  # of a run's samples; an hour of TIAGo at 2 ms is half of it
MAX_MESH_TRIANGLES = 1_000_000  # of one mesh file; the largest public ones have 400 000
MAX_MESH_PARTS = 5000  # pieces that one mesh file shows; a part shown twice is two
MAX_MESH_SECONDS = 40  # that one mesh may take; a million triangles take 4 of a free core
MAX_MESH_MEMORY = 2 * 2**30  # bytes that the process that reads meshes may take
MAX_XACRO_SECONDS = 30  # that a .xacro may take to expand; the largest public ones take 2
MAX_XACRO_MEMORY = 2**30  # bytes that its expansion may take
MAX_FOLDERS = 20_000  # that one search for packages looks into; 80 public repositories have 4300
MAX_ROWS = 100_000  # of a table of poses; 1 kHz for 100 s
MAX_SHOWN_BYTES = 2**31  # of a file in a run's folder whose mark is looked for, or digest taken
MAX_COLUMNS = 200  # of a table of poses; more than a robot has moving joints
MAX_REFERENCE_SECONDS = 86_400  # that a file's reference takes; a day
MAX_WAYPOINTS = 1000  # of a path: at half a metre a second it takes half an hour and more


def cap(name: str) -> int:
    """Return a cap: the environment's ``RPCTL_<name>``, else this module's constant.

    Raises:
        RpctlError: The environment's value is no positive integer.
    """
    text = os.environ.get(f"RPCTL_{name}")
    if text is None:
        return int(globals()[name])
    if not (text.isascii() and text.isdigit() and 0 < len(text) <= 18 and int(text) > 0):
        raise RpctlError(f"RPCTL_{name}={text[:40]!r} is no positive integer; correct or unset it")
    return int(text)


def how_to_raise(name: str) -> str:
    """Return how to raise a cap, as the end of a message."""
    return f"if it is meant, set RPCTL_{name} in the environment (rpctl.files.caps.{name})"
