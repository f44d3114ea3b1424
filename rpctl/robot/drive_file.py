"""The drive file: TOML in which a user says which wheels a robot drives on."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpctl.errors import DescriptionError, Finding

if sys.version_info >= (3, 11):
    import tomllib
else:  # the standard library has it from 3.11 on
    import tomli as tomllib

TYPES = ("differential", "skid-steer", "mecanum", "fixed")


@dataclass(frozen=True)
class DriveSpec:
    """What is said of a drive.

    Attributes:
        type: Its type, or None to find it.
        radii: The wheels' joints, and their radii (m) or None to find them; None for any joints.
    """

    type: str | None = None
    radii: dict[str, float | None] | None = None


def read_drive(path: str | Path) -> DriveSpec:
    """Read a drive file.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise _refused(path, [f"{error.strerror or error}; give a drive file"]) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise _refused(path, [f"not TOML: {error}; a drive file is TOML"]) from None
    extra = data.keys() - {"type", "wheel"}
    faults = [f'"{key}" is not known; a drive file has type and [[wheel]]' for key in extra]
    kind = data.get("type")
    if kind not in TYPES:
        faults.append(f"type is {kind!r}; use one of {', '.join(TYPES)}")
    wheels = data.get("wheel", [])
    if not isinstance(wheels, list):
        faults.append("wheel is one table; write [[wheel]] before each")
        wheels = []
    radii: dict[str, float | None] = {}
    for number, wheel in enumerate(wheels, start=1):
        joint, radius = _wheel(faults, f"wheel {number}", wheel)
        if joint in radii:
            faults.append(f'wheel {number}: joint "{joint}" is named twice')
        radii[joint] = radius
    if faults:
        raise _refused(path, faults)
    return DriveSpec(kind, radii or None)


def _wheel(faults: list[str], where: str, wheel: Any) -> tuple[str, float | None]:
    if not isinstance(wheel, dict):
        faults.append(f"{where} is not a table; write [[wheel]] before it")
        return "", None
    extra = wheel.keys() - {"joint", "radius"}
    faults += [f'{where}: "{key}" is not known; a wheel has joint and radius' for key in extra]
    joint, radius = wheel.get("joint"), wheel.get("radius")
    if not isinstance(joint, str) or not joint:
        faults.append(f'{where} has no joint; write joint = "NAME"')
    if radius is not None and not (
        isinstance(radius, int | float)
        and not isinstance(radius, bool)
        and math.isfinite(radius)
        and radius > 0
    ):
        faults.append(f"{where}: radius is {radius!r}; give a positive number of metres")
        radius = None
    return str(joint), None if radius is None else float(radius)


def suggest(kind: str, joints: Iterable[str]) -> str:
    """Return a drive file to start from, naming the joints that could carry wheels."""
    wheels = "".join(f'\n[[wheel]]\njoint = "{joint}"\n# radius = 0.1  # m\n' for joint in joints)
    return f'type = "{kind}"  # {", ".join(TYPES)}\n{wheels}'


def _refused(path: str | Path, faults: list[str]) -> DescriptionError:
    return DescriptionError(path, [Finding("error", None, fault) for fault in faults])
