"""``LoadSettings``: how a robot is loaded, once for calls, commands, runs and certificates."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypedDict

from rpctl.description.records import as_xacro
from rpctl.drive.drive import DRIVE_TYPES, Drive
from rpctl.files.records import OneOf, Setting

if TYPE_CHECKING:
    from typing import Unpack  # of Python 3.11; never imported when it runs


class Payload(NamedTuple):
    """A load fixed to a link; see :func:`rpctl.with_payload`."""

    link: str
    mass: float  # kg
    com: tuple[float, ...]  # (3,) in the link's frame, m
    inertia: tuple[tuple[float, ...], ...]  # (3, 3) about com, along the link's axes, kg·m²


PLANAR, FREE = "planar", "free"
ROOTS = PLANAR, FREE  # what the root link may do: stay level, or pitch, roll and rise


class LoadKeywords(TypedDict, total=False):
    """The keywords of :func:`rpctl.load`, which explains each."""

    lock: Iterable[str] | Mapping[str, float]
    density: float | None
    end_effector: str | None
    strict: bool
    package_dirs: Iterable[str | Path]
    xacro_args: Mapping[str, object] | None
    ignore_missing_packages: bool
    home: str | Mapping[str, float] | Iterable[str] | None
    free: Iterable[str]
    losses: bool
    armature: bool | Mapping[str, float]
    root: str | None


@dataclass(frozen=True)
class LoadSettings:
    """What is said of a robot besides the name of its file; :func:`rpctl.load` explains each.

    A robot keeps those with which it loads again: patterns resolved to names, defaults to values.
    What a ``Setting`` says of a field is said of its option on the command line.
    """

    lock: Annotated[
        Mapping[str, float],
        Setting(
            "rad or m",
            help="Freeze joints, by name or pattern, at a position (rad or m; default 0). "
            "Repeatable.",
            metavar="NAME[=POSITION]",
        ),
    ] = field(default_factory=dict)
    drive: Annotated[
        Drive | str | None,
        Setting(
            help=f"{', '.join(DRIVE_TYPES)}, or a drive file (TOML); default: detected.",
            metavar="TYPE|FILE",
        ),
    ] = None
    density: Annotated[
        float | None,
        Setting(
            "kg/m³",
            help="Estimate missing masses and inertias from the links' shapes, at this density.",
            metavar="KG_PER_M3",
        ),
    ] = None
    strict: Annotated[
        bool, Setting(help="Treat warnings, and assumptions about the drive, as errors.")
    ] = False
    package_dirs: Annotated[
        tuple[str, ...],
        Setting(
            help="Folder in which package:// and $(find ...) look: a package, or a folder with "
            "packages at any depth, such as ~/ws/src. Repeatable.",
            metavar="DIR",
        ),
    ] = ()
    ignore_missing_packages: Annotated[
        bool,
        Setting(help="Leave out what a .xacro includes from packages that rpctl cannot find."),
    ] = False
    xacro_args: Annotated[
        Mapping[str, str],
        Setting(
            help="Argument of a .xacro; --xacro-arg itself can be left out. env:NAME:=VALUE sets "
            "$(env NAME), which does not read your environment. Repeatable.",
            metavar="NAME:=VALUE",
        ),
    ] = field(default_factory=dict)
    end_effector: Annotated[
        str | None,
        Setting(
            help="Link that tracks an end-effector reference; default: the last link of the arm.",
            metavar="LINK",
        ),
    ] = None
    home: Annotated[
        Mapping[str, float] | tuple[str, ...],
        Setting(
            "rad or m",
            help="Home posture of the arm, where it starts: joint positions (rad or m, separated "
            "by commas), a state of an SRDF, auto for a posture that rpctl chooses, or "
            "zero. Repeatable.",
            metavar="NAME=POSITION|FILE.srdf:STATE|auto|zero",
        ),
    ] = ()
    free: Annotated[
        tuple[str, ...],
        Setting(
            help="Let joints move, by name or pattern, that rpctl freezes by default, such as "
            "those of a gripper. Repeatable.",
            metavar="NAME",
        ),
    ] = ()
    losses: Annotated[bool, Setting(help="Ignore the damping and friction of the joints.")] = True
    armature: Annotated[
        bool | Mapping[str, float],
        Setting(
            "kg·m² or kg",
            help="Rotor inertia of the motors, reflected to their joints (I n2): file, from the "
            "transmissions in the URDF, or for joints by name or pattern (kg m2, or kg). "
            "Repeatable.",
            metavar="file|NAME=KG_M2",
        ),
    ] = False
    root: Annotated[
        str | None,
        OneOf(ROOTS),
        Setting(
            help="Motion of the root link: planar, it stays level; free, it pitches, rolls and "
            "rises. Default: free if the robot must balance.",
            metavar="planar|free",
        ),
    ] = None
    payloads: tuple[Payload, ...] = ()  # that it carries besides, in the order they were put on

    @staticmethod
    def of(drive: Drive | str | Path | None = None, **given: Unpack[LoadKeywords]) -> LoadSettings:
        """Return the settings that the drive and the keywords of :func:`rpctl.load` say."""
        plain: dict[str, Any] = {**given}
        for name in ("package_dirs", "free", "home"):
            if not isinstance(plain.get(name), Mapping):
                plain[name] = _texts(plain.get(name) or ())
        lock, arguments = plain.get("lock") or (), plain.get("xacro_args") or {}
        plain["lock"] = lock if isinstance(lock, Mapping) else dict.fromkeys(_texts(lock), 0.0)
        plain["xacro_args"] = {name: as_xacro(value) for name, value in arguments.items()}
        if isinstance(drive, Path):  # no name of a type, though it look like one
            drive = str(drive) if drive.suffix else os.path.join(".", drive)  # noqa: PTH118
        return LoadSettings(drive=drive, **plain)

    @property
    def rotors(self) -> Mapping[str, float] | None:
        """Inertias that are given besides the file's, by pattern; None: no rotors count."""
        if isinstance(self.armature, bool):
            return {} if self.armature else None
        return self.armature

    def arguments(self) -> dict[str, Any]:
        """Return the keywords with which :func:`rpctl.load` does the same, as plain values.

        A drive that was given as such is a mapping of its fields; payloads are left out.
        """
        keywords = asdict(self)
        del keywords["strict"], keywords["payloads"]
        return keywords


def _texts(given: str | Path | Iterable[str | Path]) -> tuple[str, ...]:
    """Return one text, or several, as texts."""
    return tuple(map(str, (given,) if isinstance(given, str | Path) else given))
