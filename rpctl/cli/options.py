"""The options that commands share."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rpctl.cli.words import XACRO_OPTION, read_words
from rpctl.description.xacro.expansion import list_arguments
from rpctl.description.xacro.messages import XacroArgument
from rpctl.drive.drive_file import DRIVE_TYPES
from rpctl.errors import RpctlError
from rpctl.files.records import FieldType, Range, setting_of
from rpctl.robot.load_settings import LoadSettings
from rpctl.robot.sources import find_source

if TYPE_CHECKING:
    from rpctl.robot.model import Robot

FROM_FILE = "file"  # of --armature: what the transmissions say
MAX_WORD = 40  # characters of a name in that of a folder: at most 160 of its 255 bytes
CHECK_FAILED = 1  # exit code: not equivalent, or a limit broken

RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF or .xacro file, or a name listed by `rpctl robots`."
    ),
]
PackageDirOption = Annotated[
    list[str] | None,
    typer.Option(
        "--package-dir",
        metavar="DIR",
        help="Where package:// and $(find ...) look: a package, or a folder that holds some at any "
        "depth, as ~/ws/src. Repeatable.",
    ),
]
IgnoreOption = Annotated[
    bool,
    typer.Option(
        "--ignore-missing-packages",
        help="Leave out what a .xacro includes from packages that are not found.",
    ),
]
XacroArgsOption = Annotated[
    list[str] | None,
    typer.Option(
        XACRO_OPTION,
        metavar="NAME:=VALUE",
        help="An argument of a .xacro; a plain word NAME:=VALUE says the same. env:NAME:=VALUE is "
        "a variable for its $(env NAME), which sees none of yours. Repeatable.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON on stdout and everything else on stderr.")
]


@dataclass(frozen=True)
class FieldOptions:
    """Options made of the fields of a record; a mapping holds those that are given, by field.

    Attributes:
        kind: The record's class.
        names: Of the fields.
        flags: Names of options that are not their fields', by field.
    """

    kind: Any
    names: tuple[str, ...]
    flags: Mapping[str, str] = field(default_factory=dict)

    def parameters(self) -> list[inspect.Parameter]:
        """Return the options as parameters of a command, None where they are not given."""
        return [self._parameter(setting_of(self.kind, name)) for name in self.names]

    def _parameter(self, item: FieldType) -> inspect.Parameter:
        whole = item.type is int and isinstance(item.limit, Range)
        flag = f"--{item.name.replace('_', '-')}"
        option = typer.Option(
            self.flags.get(item.name, flag),
            metavar=item.setting.metavar or None,
            help=item.setting.help,
            min=item.limit.low if whole and isinstance(item.limit, Range) else None,
        )
        # words that the command reads itself: a triple, or a number or a word
        kind = next((k for k in (float, int, bool) if item.type in (k, k | None)), str)
        hint = Annotated[kind | None, option]  # type: ignore[valid-type]
        keyword = inspect.Parameter.KEYWORD_ONLY
        return inspect.Parameter(item.name, keyword, default=None, annotation=hint)


REFERENCE_FIELDS = ("size", "speed", "laps", "smooth", "retime")  # of RunSettings


@dataclass(frozen=True)
class LoadOptions:
    """The options of every command that loads a robot; see ``rpctl.load``."""

    lock: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[=POSITION]",
            help="Freeze joints, by name or pattern, at a position (rad or m; default 0). "
            "Repeatable.",
        ),
    ] = None
    drive: Annotated[
        str | None,
        typer.Option(
            metavar="TYPE|FILE", help=f"{', '.join(DRIVE_TYPES)}, or a drive file (TOML)."
        ),
    ] = None
    density: Annotated[
        float | None,
        typer.Option(
            metavar="KG_PER_M3",
            help="Estimate the inertias that the file lacks from the links' shapes.",
        ),
    ] = None
    strict: Annotated[
        bool,
        typer.Option(
            "--strict", help="Take warnings, and what was assumed of the drive, as errors."
        ),
    ] = False
    package_dir: PackageDirOption = None
    ignore_missing_packages: IgnoreOption = False
    xacro_args: XacroArgsOption = None
    end_effector: Annotated[
        str | None, typer.Option(metavar="LINK", help="The link to track; else the arm's last.")
    ] = None
    home: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=POSITION|FILE.srdf:STATE|auto|zero",
            help="Where the arm starts: joints (rad or m; several by commas), a state of an SRDF, "
            "a posture to work from, or zero. Repeatable.",
        ),
    ] = None
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Let joints move, by name or pattern, that are frozen by default, as a gripper's "
            "are. Repeatable.",
        ),
    ] = None
    no_losses: Annotated[
        bool,
        typer.Option("--no-losses", help="Leave out the damping and friction of the joints."),
    ] = False
    armature: Annotated[
        list[str] | None,
        typer.Option(
            metavar="file|NAME=KG_M2",
            help="Inertia of the motors' rotors seen from their joints, I n2: that of the file's "
            "transmissions, and of joints by name or pattern (kg m2, or kg). Repeatable.",
        ),
    ] = None

    def arguments(self, source: str) -> tuple[XacroArgument, ...]:
        """Return the arguments that the xacro of a robot declares.

        Raises:
            RpctlError: An option is wrong, or there is no such robot.
        """
        place = find_source(source)
        return list_arguments(place.path, place.read_settings(self.settings()))

    def load(self, source: str) -> Robot:
        """Load the robot that is called ``source``.

        Raises:
            RpctlError: An option is wrong, or the robot cannot be loaded.
        """
        from rpctl.robot.load import load_robot  # it takes its time

        return load_robot(source, self.settings())

    def settings(self) -> LoadSettings:
        """Return what they say of a robot.

        Raises:
            RpctlError: An option is wrong.
        """
        return LoadSettings(
            drive=self.drive,
            lock=_positions(self.lock),
            density=self.density,
            end_effector=self.end_effector,
            strict=self.strict,
            package_dirs=tuple(self.package_dir or ()),
            xacro_args=read_words(self.xacro_args),
            ignore_missing_packages=self.ignore_missing_packages,
            home=tuple(self.home or ()),
            free=tuple(self.free or ()),
            losses=not self.no_losses,
            armature=_armature(self.armature),
        )

    def words(self) -> list[str]:
        """Return them as words of a command line, so that it can be told to a user."""
        found: list[str] = []
        for item in fields(self):
            value = getattr(self, item.name)
            if value == item.default:
                continue
            flag = XACRO_OPTION if item.name == "xacro_args" else f"--{item.name.replace('_', '-')}"
            each = value if isinstance(value, list) else [value]
            found += [flag] if value is True else [w for one in each for w in (flag, str(one))]
        return found


def _positions(items: Iterable[str] | None) -> dict[str, float]:
    """Return the positions of ``NAME[=POSITION]`` by name.

    Raises:
        RpctlError: A position is no number.
    """
    positions: dict[str, float] = {}
    for item in items or ():
        name, given, position = item.partition("=")
        try:
            positions[name] = float(position) if given else 0.0
        except ValueError:
            raise RpctlError(
                f"--lock {item}: {position!r} is not a number; write NAME=0.1"
            ) from None
    return positions


def _armature(items: Iterable[str] | None) -> bool | dict[str, float]:
    """Return what ``file`` and ``NAME=KG_M2`` say of rotors, as :func:`rpctl.load` takes it.

    Raises:
        RpctlError: An inertia is no number.
    """
    given: dict[str, float] = {}
    for item in items or ():
        name, _, inertia = item.partition("=")
        if item == FROM_FILE:
            continue
        try:
            given[name] = float(inertia)
        except ValueError:
            raise RpctlError(
                f"--armature {item}: write NAME=0.01, in kg m2, or {FROM_FILE} for what the file's "
                "transmissions say"
            ) from None
    return given or bool(items)


def read_triple(text: str) -> tuple[float, float, float]:
    """Return the three numbers of ``X,Y,THETA``.

    Raises:
        RpctlError: They are not three numbers.
    """
    try:
        x, y, theta = (float(word) for word in text.split(","))
    except ValueError:
        raise RpctlError(f"--initial-error {text}: give three numbers, as 0.1,-0.1,0.1") from None
    return x, y, theta


def split_names(text: str) -> list[str]:
    """Return the names of ``NAME,...``."""
    return [word.strip() for word in text.split(",") if word.strip()]


def default_folder(robot: str, what: str) -> Path:
    """Return the folder below ``runs`` for results; no name leads out of it, or is too long.

    Args:
        robot: The robot's name.
        what: Of its results, as the name of a reference.
    """
    words = (re.sub(r"[^\w.-]", "_", word).lstrip("-.")[:MAX_WORD] or "_" for word in (robot, what))
    return Path("runs") / "-".join(words)
