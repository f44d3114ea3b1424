"""The robot's file, read again for the independent derivations, and the names they share.

The bytes are the user's (a .xacro's are its expansion). Links and joints come from yourdfpy, or,
where it cannot read the file, from :mod:`rpctl.equivalence.raw_file`; the drive's geometry from
:mod:`rpctl.equivalence.file_drive`.
"""

from __future__ import annotations

import io
import logging
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from rpctl.drive.drive import Drive
from rpctl.equivalence.file_drive import measure, with_declared
from rpctl.equivalence.raw_file import RawFile, read_file
from rpctl.libraries import lean_library
from rpctl.robot.model import Robot

YOURDFPY = ("yourdfpy", "trimesh")  # it takes trimesh along
# Trimesh imports them if they are there, which takes long; to read links and joints needs none.
UNUSED = (
    "networkx", "PIL", "shapely", "rtree", "jsonschema",
    "scipy.spatial", "scipy.optimize", "scipy.sparse", "scipy.ndimage",
)  # fmt: skip
MESH_SOURCE = "bounds of"  # so begins the source of a radius that a mesh tells


@dataclass(frozen=True)
class FileReading:
    """A robot's file as the derivations read it.

    Attributes:
        raw: Names, frames and shapes by the minimal reader.
        links: Links with ``name`` and ``inertial``, as yourdfpy has them.
        joints: Joints with ``name``, ``type``, ``parent``, ``child``, ``origin``, ``axis`` and
            ``mimic``.
        yourdfpy: Whether yourdfpy read the links and joints; else the minimal reader did.
        measured: The drive with its geometry measured on the file's shapes.
        drive: The same with the numbers that the user declared.
        shapeless: Wheels without a shape, whose radius is the record's.
    """

    raw: RawFile
    links: tuple[Any, ...]
    joints: tuple[Any, ...]
    yourdfpy: bool
    measured: Drive
    drive: Drive
    shapeless: tuple[str, ...]


def read(robot: Robot) -> FileReading:
    """Return a robot's file, read anew.

    Args:
        robot: The robot; of it only its bytes, names, roles and locked positions are used, and
            what :func:`shared` lists.
    """
    data = robot.description.raw
    raw = read_file(data)
    parsed = _by_yourdfpy(data, raw)
    measured, shapeless = measure(robot, raw)
    return FileReading(
        raw=raw,
        links=raw.links if parsed is None else tuple(parsed.links),
        joints=raw.joints if parsed is None else tuple(parsed.joints),
        yourdfpy=parsed is not None,
        measured=measured,
        drive=with_declared(measured, robot.drive),
        shapeless=shapeless,
    )


def shared(robot: Robot, reading: FileReading) -> tuple[str, ...]:
    """Return the inputs that all derivations share and none checks, as phrases."""
    drive, phrases = robot.drive, []
    if robot.description.expanded:
        given = robot.description.read_with.xacro_args
        words = "".join(f" {name}:={value}" for name, value in given.items())
        phrases.append("the expansion of the xacro" + (f" with{words}" if words else ""))
    if robot.losses is not None and robot.losses.friction.any():
        phrases.append("the rates below which friction is smooth")
    if robot.loaded_with.rotors:
        phrases.append(f"declared armature of {', '.join(robot.loaded_with.rotors)}")
    estimated = robot.description.estimated_links
    if estimated:
        phrases.append(f"estimated inertias of {', '.join(estimated)}")
    if "drive" in drive.declared:
        phrases.append("the drive, given as a whole")
    elif drive.declared:
        phrases.append(f"declared {', '.join(drive.declared)}")
    meshes = [w.joint for w in drive.wheels if w.source.startswith(MESH_SOURCE)]
    if meshes:
        phrases.append(f"the triangles of the meshes of {', '.join(meshes)}")
    if reading.shapeless:
        phrases.append(f"radius of {', '.join(reading.shapeless)}, which have no shape")
    return tuple(phrases)


def rotor_inertias(robot: Robot, raw: RawFile) -> dict[str, float]:
    """Return the inertia of each rotor that counts, seen from its joint, by name; kg·m² or kg.

    Args:
        robot: The robot; its locked joints and what the user said of rotors are used.
    """
    given = robot.loaded_with.rotors
    if given is None:
        return {}
    found = dict(raw.rotors)
    moving = [each.name for each in raw.joints if each.type != "fixed"]
    for pattern, inertia in given.items():
        found |= {name: inertia for name in moving if fnmatchcase(name, pattern)}
    free = set(moving) - robot.locked.keys()
    return {name: inertia for name, inertia in found.items() if inertia and name in free}


def _by_yourdfpy(data: bytes, raw: RawFile) -> Any:
    """Return the robot as yourdfpy reads it, or None where it cannot.

    It drops what it does not understand without a word, so the names must be all there.
    """
    quiet = logging.getLogger("yourdfpy")
    before, quiet.disabled = quiet.disabled, True
    try:
        parsed = lean_library("yourdfpy", YOURDFPY, UNUSED).URDF.load(
            io.BytesIO(data), build_scene_graph=False, load_meshes=False
        ).robot  # fmt: skip
    except Exception:  # it raises whatever its reading runs into
        return None
    finally:
        quiet.disabled = before
    links = {link.name: link.inertial is not None for link in parsed.links}
    joints = {joint.name: (joint.type, joint.parent, joint.child) for joint in parsed.joints}
    whole = links == {link.name: link.inertial is not None for link in raw.links} and joints == {
        joint.name: (joint.type, joint.parent, joint.child) for joint in raw.joints
    }
    return parsed if whole else None
