"""The controllers of a base in files of ROS parameters (YAML) beside its description."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
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
from rpctl.errors import DescriptionError
from rpctl.files.opening import read_text

MAX_FILES = 100  # that are read
MAX_CHARACTERS = 2**19  # of all that are read, for one robot; YAML takes 8 s per million
MAX_NODES = 100_000  # of one file: with aliases, a few lines stand for billions
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
        for file, text in _texts(files)
        for controller in _controllers(file, text)
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


def _texts(files: Sequence[Path]) -> Iterator[tuple[Path, str]]:
    """Yield the files that can be read, with their texts, up to all the characters there may be."""
    left = MAX_CHARACTERS
    for file in files:
        with suppress(DescriptionError):  # a file beside the robot's need not be one of parameters
            text = read_text(file, "MAX_PARAMETER_BYTES", "a file of parameters")
            left -= len(text)
            if left < 0:
                return
            yield file, text


def _controllers(file: Path, text: str) -> Iterator[BaseControl]:
    """Yield the controllers of a base in a file of parameters; none, if it is no YAML."""
    entries = _read(text)
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


def _read(text: str) -> list[_Entry]:
    """Return the entries of a file of parameters; none, if it is no YAML or too much of it."""
    import yaml

    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (ValueError, RecursionError, yaml.YAMLError):
        return []
    entries: list[_Entry] = []
    pending: list[tuple[Any, tuple[str, ...]]] = [(root, ())]
    for _ in range(MAX_NODES):
        if not pending:
            return entries
        node, keys = pending.pop()
        if isinstance(node, yaml.MappingNode) and len(keys) < MAX_DEPTH:
            pending += [(value, (*keys, *_words(key))) for key, value in reversed(node.value)]
        elif isinstance(node, yaml.ScalarNode) and keys:
            entries.append(_Entry(keys, str(node.value), node.start_mark.line + 1))
        elif isinstance(node, yaml.SequenceNode) and keys:
            texts = [str(each.value) for each in node.value if isinstance(each, yaml.ScalarNode)]
            entries.append(_Entry(keys, texts, node.start_mark.line + 1))
    return []


def _words(key: Any) -> list[str]:
    """Return the words of a key: dots in it are tables, too."""
    return [word for word in str(key.value).split(".") if word not in ("", PARAMETERS)]
