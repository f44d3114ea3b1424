"""What plugins and controllers tell of a base, and how it compares with the geometry."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from glob import escape
from itertools import islice
from pathlib import Path
from typing import Any

from rpctl.description.packages import MANIFEST, find_packages
from rpctl.description.records import Description
from rpctl.description.urdf.joints import positive_number
from rpctl.drive.drive import Drive
from rpctl.errors import DescriptionError, Finding
from rpctl.files.caps import read_text

PLANAR = "planar"  # moves the base any way, whatever its wheels: weak evidence
KINDS = (  # words of a plugin's file or name, or of a controller's type, without _ and -
    ("mecanum", "mecanum"),
    ("skidsteer", "skid-steer"),
    ("diffdrive", "differential"),
    ("differentialdrive", "differential"),
    ("ackermann", "car-like"),
    ("tricycle", "tricycle"),
    ("omnidrive", "omni"),
    ("omniwheel", "omni"),
    ("planarmove", PLANAR),
    ("forcebasedmove", PLANAR),
)
Texts = tuple[str, ...]
JOINT_KEY = re.compile(r".*joint(name)?s?")  # names a wheel's joint, as one with "wheel" does,
NO_JOINT = re.compile("steer|multiplier|separation|radius")  # if none of these is in it
MAX_FILES = 100  # that are read
MAX_CHARACTERS = 2**19  # of all that are read, for one robot; YAML takes 8 s per million
MAX_NODES = 100_000  # of one file: with aliases, a few lines stand for billions
MAX_DEPTH = 20  # of tables in tables
FLAGS = ("true", "false")
PARAMETERS = "ros__parameters"  # the table of a node's parameters in ROS 2
MAX_DIFFERENCE = 0.01  # of a length; files round
KINDS_OF = {  # drives that a plugin or controller of a kind can move
    "differential": ("differential", "skid-steer"),
    "skid-steer": ("differential", "skid-steer"),
    "mecanum": ("mecanum",),
    "omni": ("omni", "mecanum"),
    "car-like": ("car-like", "tricycle", "bicycle", "steered", "articulated"),
    "tricycle": ("tricycle", "bicycle", "car-like", "articulated"),
}


@dataclass(frozen=True)
class BaseControl:
    """A plugin or a controller that moves the base.

    Attributes:
        kind: Type of the drive that it is made for, or ``"planar"`` for any.
        label: What to call it in a sentence.
        line: Its line in the URDF; None for one of another file.
        joints: Joints that it names as wheels'.
        radius: Of the wheels, m, or None.
        separation: Distance between the left and the right wheels, m, or None.
        radius_multiplier: Factor of the radius in its odometry.
        separation_multiplier: Factor of the separation.
    """

    kind: str
    label: str
    line: int | None
    joints: tuple[str, ...] = ()
    radius: float | None = None
    separation: float | None = None
    radius_multiplier: float = 1.0
    separation_multiplier: float = 1.0


def read_controls(description: Description) -> tuple[BaseControl, ...]:
    """Return the plugins that move the base, and the controllers that it names or that lie near."""
    return (*plugin_controls(description), *find_controllers(description))


def plugin_controls(description: Description) -> tuple[BaseControl, ...]:
    """Return the plugins that move the base."""
    kinds = ((kind_of(f"{each.file} {each.name}"), each) for each in description.plugins)
    return tuple(
        _control(kind, f'plugin "{plugin.file or plugin.name}"', plugin.line, plugin.texts)
        for kind, plugin in kinds
        if kind is not None
    )


def kind_of(text: str) -> str | None:
    """Return the type of drive that a name of a plugin or a controller mentions, or None."""
    words = re.sub(r"[_\-\s]", "", text.lower())
    return next((kind for word, kind in KINDS if word in words), None)


def _control(kind: str, label: str, line: int | None, texts: Mapping[str, Texts]) -> BaseControl:
    """Return a control of the base whose settings are texts by key, in small letters without _."""

    def first(*keys: str) -> float | None:
        numbers = (positive_number(text) for key in keys for text in texts.get(key, ()))
        return next((number for number in numbers if number is not None), None)

    radius, diameter = first("wheelradius"), first("wheeldiameter")
    named = (
        text
        for key, values in texts.items()
        if ("wheel" in key or JOINT_KEY.fullmatch(key)) and not NO_JOINT.search(key)
        for text in values
        if positive_number(text) is None and text.lower() not in FLAGS
    )
    return BaseControl(
        kind=kind,
        label=label,
        line=line,
        joints=tuple(dict.fromkeys(named)),
        radius=0.5 * diameter if radius is None and diameter is not None else radius,
        separation=first("wheelseparation", "wheelseparationy"),
        radius_multiplier=first("wheelradiusmultiplier", "leftwheelradiusmultiplier") or 1.0,
        separation_multiplier=first("wheelseparationmultiplier") or 1.0,
    )


@dataclass(frozen=True)
class _Entry:
    """Values of a file of parameters: the keys that lead to them, and their line."""

    keys: tuple[str, ...]
    texts: Texts
    line: int


def find_controllers(description: Description) -> tuple[BaseControl, ...]:
    """Return the controllers that are made for the wheels of a description.

    They are in the files that the URDF names, or else in the packages beside its own that are
    called after the same robot (``x_control`` beside ``x_description``). Files that contradict one
    another there are for variants of the robot, and count for none.
    """
    named = (
        Path(text) for each in description.plugins for text in each.texts.get("parameters", ())
    )
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
    tables: dict[str, list[_Entry]] = {}
    for entry in _read(text):
        if len(entry.keys) > 1:
            tables.setdefault(entry.keys[-2], []).append(entry)
    for name, entries in tables.items():
        types = [text for each in entries if each.keys[-1] == "type" for text in each.texts]
        settings = [each for each in entries if each.keys[-1] != "type"]
        kind = kind_of(types[-1] if types else "") or kind_of(name)
        if kind is not None and settings:
            place = f"{'/'.join(file.parts[-3:])}:{settings[0].line}"
            texts = {each.keys[-1].lower().replace("_", ""): each.texts for each in settings}
            yield _control(kind, f'controller "{name}" ({place})', None, texts)


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
            entries.append(_Entry(keys, (str(node.value),), node.start_mark.line + 1))
        elif isinstance(node, yaml.SequenceNode) and keys:
            texts = (str(each.value) for each in node.value if isinstance(each, yaml.ScalarNode))
            entries.append(_Entry(keys, tuple(texts), node.start_mark.line + 1))
    return []


def _words(key: Any) -> list[str]:
    """Return the words of a key: dots in it are tables, too."""
    return [word for word in str(key.value).split(".") if word not in ("", PARAMETERS)]


def vendor_findings(drive: Drive, controls: Iterable[BaseControl]) -> tuple[Finding, ...]:
    """Return where plugins and controllers differ from a drive's geometry, in findings.

    A differing kind or radius is a warning: one of the two is wrong. The separation of the wheels
    is the odometry's, which vendors tune for skid-steer drives: there it is a remark, and the way
    to take theirs.

    Args:
        drive: The drive, as the geometry has it.
    """
    if drive.type == "fixed" or "drive" in drive.declared:
        return ()
    real = (control for control in controls if control.kind != PLANAR)
    found = [finding for control in real for finding in _compare(drive, control)]
    return tuple(dict.fromkeys(found))


def _compare(drive: Drive, control: BaseControl) -> Iterator[Finding]:
    """Yield where a plugin or a controller differs from a drive."""
    if drive.type not in KINDS_OF[control.kind]:
        yield Finding(
            "warning",
            control.line,
            f"{control.label} is made for {control.kind} drives, and by its wheels the drive is "
            f"{drive.type}; choose with --drive",
        )
        return
    rolling = [w for w in drive.wheels if w.driven and not w.slides]
    named = [w for w in rolling if w.joint in control.joints] or rolling
    if control.radius is not None and named:
        theirs = control.radius * control.radius_multiplier
        ours = named[0].radius
        if _differ(theirs, ours):
            yield Finding(
                "warning",
                control.line,
                f"{control.label} has wheels of radius {theirs:.4g} "
                f'm{_factor(control.radius, control.radius_multiplier)}, where "{named[0].joint}" '
                f"has {ours:.4g} m ({named[0].source}); rpctl uses the latter; a drive file can "
                "set another",
            )
    yield from _compare_separation(drive, control)


def _compare_separation(drive: Drive, control: BaseControl) -> Iterator[Finding]:
    """Yield that the wheels are not as far apart as a plugin or a controller has it."""
    own = drive.track if control.separation is None else control.separation
    theirs = own * control.separation_multiplier
    if drive.type not in ("differential", "skid-steer") or not _differ(theirs, drive.track):
        return
    how = _factor(own, control.separation_multiplier)
    skids = drive.type == "skid-steer"
    fix = (
        f"to use theirs, set track = {theirs:.4g} in a drive file"
        if skids
        else "correct one of them"
    )
    yield Finding(
        "info" if skids else "warning",
        control.line,
        f"{control.label} has the wheels {theirs:.4g} m apart{how}, the geometry {drive.track:.4g} "
        f"m, which is taken; {fix}",
    )


def _differ(theirs: float, ours: float) -> bool:
    return abs(theirs - ours) > MAX_DIFFERENCE * ours


def _factor(length: float, multiplier: float) -> str:
    return "" if multiplier == 1.0 else f" ({length:.4g} times its multiplier {multiplier:.4g})"
