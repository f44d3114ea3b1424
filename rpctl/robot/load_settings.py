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
            help=f"{', '.join(DRIVE_TYPES)}, or a drive file (TOML).",
            metavar="TYPE|FILE",
        ),
    ] = None
    density: Annotated[
        float | None,
        Setting(
            "kg/m³",
            help="Estimate the inertias that the file lacks from the links' shapes.",
            metavar="KG_PER_M3",
        ),
    ] = None
    strict: Annotated[
        bool, Setting(help="Take warnings, and what was assumed of the drive, as errors.")
    ] = False
    package_dirs: Annotated[
        tuple[str, ...],
        Setting(
            help="Where package:// and $(find ...) look: a package, or a folder that holds some at "
            "any depth, as ~/ws/src. Repeatable.",
            metavar="DIR",
        ),
    ] = ()
    ignore_missing_packages: Annotated[
        bool,
        Setting(help="Leave out what a .xacro includes from packages that are not found."),
    ] = False
    xacro_args: Annotated[
        Mapping[str, str],
        Setting(
            help="An argument of a .xacro; a plain word NAME:=VALUE says the same. env:NAME:=VALUE "
            "is a variable for its $(env NAME), which sees none of yours. Repeatable.",
            metavar="NAME:=VALUE",
        ),
    ] = field(default_factory=dict)
    end_effector: Annotated[
        str | None, Setting(help="The link to track; else the arm's last.", metavar="LINK")
    ] = None
    home: Annotated[
        Mapping[str, float] | tuple[str, ...],
        Setting(
            "rad or m",
            help="Where the arm starts: joints (rad or m; several by commas), a state of an SRDF, "
            "a posture to work from, or zero. Repeatable.",
            metavar="NAME=POSITION|FILE.srdf:STATE|auto|zero",
        ),
    ] = ()
    free: Annotated[
        tuple[str, ...],
        Setting(
            help="Let joints move, by name or pattern, that are frozen by default, as a gripper's "
            "are. Repeatable.",
            metavar="NAME",
        ),
    ] = ()
    losses: Annotated[bool, Setting(help="Leave out the damping and friction of the joints.")] = (
        True
    )
    armature: Annotated[
        bool | Mapping[str, float],
        Setting(
            "kg·m² or kg",
            help="Inertia of the motors' rotors seen from their joints, I n2: that of the file's "
            "transmissions, and of joints by name or pattern (kg m2, or kg). Repeatable.",
            metavar="file|NAME=KG_M2",
        ),
    ] = False
    root: Annotated[
        str | None,
        OneOf(ROOTS),
        Setting(
            help="Whether the root link stays level (planar) or pitches, rolls and rises (free); "
            "by default as the robot stands.",
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
