"""The controllers of a base in files of ROS parameters (YAML) beside its description."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from glob import escape
from itertools import islice
from pathlib import Path
from typing import Any

from rpctl.description.package_index import MANIFEST
from rpctl.description.packages import find_packages
from rpctl.description.records import Description
from rpctl.drive.plugins import (
    BaseControl,
    SimulatorTags,
    kind_of,
    read_number,
    read_simulator_tags,
)

MAX_FILES = 100  # that are read
MAX_FILE_BYTES = 2**17  # of one; the largest public ones have a tenth
MAX_DEPTH = 20  # of tables in tables
FLAGS = ("true", "false")
PARAMETERS = "ros__parameters"  # the table of a node's parameters in ROS 2


@dataclass(frozen=True)
class _Entry:
    """A value of a file of parameters: the keys that lead to it, and its line."""

    keys: tuple[str, ...]
    value: str | list[str]
    line: int


def read_controls(description: Description) -> SimulatorTags:
    """Return what a URDF tells simulators, and the controllers that it names or that lie near."""
    tags = read_simulator_tags(description)
    controllers = find_controllers(description, tags.parameters)
    return replace(tags, controls=(*tags.controls, *controllers))


def find_controllers(description: Description, named: Sequence[Path]) -> tuple[BaseControl, ...]:
    """Return the controllers that are made for the wheels of a description.

    They are in the files that the URDF names, or else in the packages beside its own that are
    called after the same robot (``x_control`` beside ``x_description``). Files that contradict one
    another there are for variants of the robot, and count for none.

    Args:
        description: The robot.
        named: Files of parameters that its plugins name.
    """
    packages = find_packages(description.path, description.read_with.package_dirs)
    own = [path for path in named if packages.allow(os.path.realpath(path))]
    controllers = _of_robot(description, own)
    if controllers:
        return controllers
    near = _of_robot(description, list(islice(_neighbours(description.path), MAX_FILES)))
    facts = {(c.kind, c.radius, c.separation, c.separation_multiplier) for c in near}
    return near[:1] if len(facts) == 1 else ()


def _of_robot(description: Description, files: Sequence[Path]) -> tuple[BaseControl, ...]:
    """Return the controllers in files whose wheels are all joints of the robot."""
    return tuple(
        controller
        for file in files
        for controller in _controllers(file)
        if controller.joints and all(name in description.joint for name in controller.joints)
    )


def _neighbours(path: Path) -> Iterator[Path]:
    """Yield the files of parameters of the packages that are called after the same robot."""
    package = next((f for f in path.absolute().parents if (f / MANIFEST).is_file()), None)
    if package is None:
        return
    robot = package.name.removesuffix("_description")
    for folder in sorted(package.parent.glob(f"{escape(robot)}_*")):
        if (folder / MANIFEST).is_file():
            yield from sorted((*folder.glob("config/*.yaml"), *folder.glob("config/*/*.yaml")))


def _controllers(file: Path) -> Iterator[BaseControl]:
    """Yield the controllers of a base in a file of parameters; none, if it cannot be read."""
    entries = _read(file)
    types = {e.keys[-2]: e.value for e in entries if e.keys[-1] == "type" and len(e.keys) > 1}
    groups: dict[str, list[_Entry]] = {}
    for entry in entries:
        if len(entry.keys) > 1 and entry.keys[-1] != "type":
            groups.setdefault(entry.keys[-2], []).append(entry)
    for name, group in groups.items():
        kind = kind_of(str(types.get(name, ""))) or kind_of(name)
        if kind is None:
            continue
        values = {entry.keys[-1]: entry for entry in group}
        yield BaseControl(
            kind=kind,
            label=f'controller "{name}" ({"/".join(file.parts[-3:])}:{group[0].line})',
            line=None,
            joints=tuple(dict.fromkeys(joint for e in group for joint in _wheel_joints(e))),
            radius=_number(values, "wheel_radius"),
            separation=_number(values, "wheel_separation") or _number(values, "wheel_separation_y"),
            radius_multiplier=_number(values, "wheel_radius_multiplier")
            or _number(values, "left_wheel_radius_multiplier")
            or 1.0,
            separation_multiplier=_number(values, "wheel_separation_multiplier") or 1.0,
        )


def _wheel_joints(entry: _Entry) -> list[str]:
    """Return the joints that an entry names as wheels'."""
    key = entry.keys[-1]
    if "wheel" not in key or "multiplier" in key or "separation" in key or "radius" in key:
        return []
    texts = entry.value if isinstance(entry.value, list) else [entry.value]
    return [text for text in texts if read_number(text) is None and text.lower() not in FLAGS]


def _number(values: dict[str, _Entry], key: str) -> float | None:
    entry = values.get(key)
    return None if entry is None else read_number(entry.value)


def _read(file: Path) -> list[_Entry]:
    """Return the entries of a file of parameters; none, if it is too long or no YAML."""
    import yaml

    try:
        with file.open("rb") as opened:
            data = opened.read(MAX_FILE_BYTES + 1)
        if len(data) > MAX_FILE_BYTES:
            return []
        root = yaml.compose(data.decode("utf-8"), Loader=yaml.SafeLoader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return []
    return list(_entries(root, ()))


def _entries(node: Any, keys: tuple[str, ...]) -> Iterator[_Entry]:
    """Yield the scalars and lists of scalars below a node; dots in keys are tables, too."""
    import yaml

    if isinstance(node, yaml.MappingNode) and len(keys) < MAX_DEPTH:
        for key, value in node.value:
            words = [w for w in str(key.value).split(".") if w not in ("", PARAMETERS)]
            yield from _entries(value, (*keys, *words))
    elif isinstance(node, yaml.ScalarNode) and keys:
        yield _Entry(keys, str(node.value), node.start_mark.line + 1)
    elif isinstance(node, yaml.SequenceNode) and keys:
        texts = [str(each.value) for each in node.value if isinstance(each, yaml.ScalarNode)]
        yield _Entry(keys, texts, node.start_mark.line + 1)
