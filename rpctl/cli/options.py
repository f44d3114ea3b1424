"""The options that commands share."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rpctl.cli.terminal import print_json
from rpctl.errors import RpctlError
from rpctl.files.records import FieldType, Plain, Range, fields_of
from rpctl.robot.load_settings import LoadSettings

if TYPE_CHECKING:
    from rpctl.robot.model import Robot

FROM_FILE = "file"  # of --armature: what the transmissions say
MAX_WORD = 40  # characters of a name in that of a folder: at most 160 of its 255 bytes
REPEATABLE = "Repeatable."  # so ends the help of an option that may be given several times
CHECK_FAILED = 1  # exit code: not equivalent, or a limit broken

RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF or .xacro file, or a name listed by `rpctl robots`."
    ),
]
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print the result as JSON on stdout, and messages on stderr."),
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

    def flag(self, name: str) -> str:
        """Return the option of a field."""
        return self.flags.get(name, f"--{name.replace('_', '-')}")

    def parameters(self) -> list[inspect.Parameter]:
        """Return the options as parameters of a command, None where they are not given."""
        return [self._parameter(fields_of(self.kind)[name]) for name in self.names]

    def given(self, values: Mapping[str, Any]) -> Plain:
        """Return the values of those that are given, of all options of a command."""
        return {name: values[name] for name in self.names if values[name] is not None}

    def _parameter(self, item: FieldType) -> inspect.Parameter:
        option = typer.Option(
            self.flag(item.name),
            metavar=item.setting.metavar or None,
            help=item.setting.help,
            min=item.limit.low if item.type is int and isinstance(item.limit, Range) else None,
        )
        # words that the command reads itself: a triple, or a number or a word
        kind = next((k for k in (float, int, bool) if item.type in (k, k | None)), str)
        repeated = item.setting.help.endswith(REPEATABLE)
        hint = Annotated[(list[str] if repeated else kind) | None, option]  # type: ignore[valid-type]
        return inspect.Parameter(
            item.name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=hint
        )


REFERENCE_FIELDS = ("size", "speed", "laps", "smooth", "retime")  # of RunSettings


READ_FIELDS = ("package_dirs", "ignore_missing_packages", "xacro_args")
LOADED = FieldOptions(
    LoadSettings,
    tuple(name for name, each in fields_of(LoadSettings).items() if each.setting.help),
    {"package_dirs": "--package-dir", "xacro_args": "--xacro-arg", "losses": "--no-losses"},
)
PANELS = {  # of a command's help, in order, behind the options in none of them: by field
    "Reference": (
        "reference", "goal", "arm_goal", "references", "duration", *REFERENCE_FIELDS,
        "initial_error",
    ),
    "Laws": (
        "kinematic", "dynamic", "laws", "bandwidth", "output", "lag", "dead_time", "delay",
        "rates", "control_period",
        "period",
    ),
    "Plant": ("plant", "plants", "friction", "allow_sag", "perturbed", "backend"),
    "Results": (
        "out", "html", "png", "video", "at", "pixels", "fps", "junit", "sarif_file",
        "max_megabytes", "live", "log", "single", "log_every", "collisions", "as_json",
    ),
    "Robot": LOADED.names,
}  # fmt: skip
ReadOptions = Annotated[Plain, FieldOptions(LoadSettings, READ_FIELDS, LOADED.flags)]


@dataclass(frozen=True)
class LoadOptions:
    """The options of every command that loads a robot; see ``rpctl.load``.

    Attributes:
        given: Their values, by the names of the settings.
    """

    given: Annotated[Plain, LOADED] = field(default_factory=dict)

    @property
    def strict(self) -> bool:
        """Whether warnings are errors."""
        return bool(self.given.get("strict"))

    @property
    def package_dirs(self) -> list[str]:
        """Folders that the user declares."""
        return self.given.get("package_dirs", [])

    def load(self, source: str) -> Robot:
        """Load the robot that is called ``source``.

        Raises:
            RpctlError: An option is wrong, or the robot cannot be loaded.
        """
        from rpctl.robot.load import load_robot  # it takes its time

        return load_robot(source, read_settings(self.given))

    def words(self) -> list[str]:
        """Return them as words of a command line, so that it can be told to a user."""
        found: list[str] = []
        for name, value in self.given.items():
            for each in value if isinstance(value, list) else [value]:
                found += [LOADED.flag(name)] if each is True else [LOADED.flag(name), str(each)]
        return found


def read_settings(given: Plain) -> LoadSettings:
    """Return what options say of a robot.

    Raises:
        RpctlError: One of them is wrong.
    """
    readers = {
        "lock": lambda items: _numbers(items, "--lock", "0", "NAME=0.1"),
        "armature": _armature,
        "xacro_args": _arguments,
    }
    read = {name: readers[name](value) for name, value in given.items() if name in readers}
    return LoadSettings.of(**{**given, **read, "losses": "losses" not in given})


def _arguments(words: Iterable[str]) -> dict[str, str]:
    """Return the values of ``NAME:=VALUE`` by name.

    Raises:
        RpctlError: A word is of another form.
    """
    values: dict[str, str] = {}
    for word in words:
        name, given, value = word.partition(":=")
        if not name or not given:
            raise RpctlError(f"--xacro-arg {word}: write NAME:=VALUE, such as arm:=true")
        values[name] = value
    return values


def _numbers(items: Iterable[str], option: str, default: str, form: str) -> dict[str, float]:
    """Return the numbers of ``NAME[=NUMBER]`` by name.

    Raises:
        RpctlError: One is no number.
    """
    numbers: dict[str, float] = {}
    for item in items:
        name, given, number = item.partition("=")
        try:
            numbers[name] = float(number if given else default)
        except ValueError:
            raise RpctlError(f"{option} {item}: {number!r} is not a number; write {form}") from None
    return numbers


def _armature(items: Iterable[str]) -> bool | dict[str, float]:
    """Return what ``file`` and ``NAME=KG_M2`` say of rotors, as :func:`rpctl.load` takes it."""
    form = f"NAME=0.01, in kg m2, or {FROM_FILE} for the inertias of the file's transmissions"
    return _numbers((item for item in items if item != FROM_FILE), "--armature", "", form) or True


def tell(
    as_json: bool, plain: Callable[[], Any], show: Callable[[], Any], passed: bool = True
) -> None:
    """Print what was found, and leave with ``CHECK_FAILED`` where it did not pass.

    Args:
        plain: Returns it as JSON says it.
        show: Prints it for people.
    """
    if as_json:
        print_json(plain())
    else:
        show()
    if not passed:
        raise typer.Exit(CHECK_FAILED)


def read_triple(text: str) -> tuple[float, float, float]:
    """Return the three numbers of ``X,Y,THETA``.

    Raises:
        RpctlError: They are not three numbers.
    """
    try:
        x, y, theta = (float(word) for word in text.split(","))
    except ValueError:
        raise RpctlError(
            f"--initial-error {text}: give three numbers, such as 0.1,-0.1,0.1"
        ) from None
    return x, y, theta


def split_names(text: str) -> list[str]:
    """Return the names of ``NAME,...``."""
    return [word.strip() for word in text.split(",") if word.strip()]


def default_folder(robot: str, what: str, file: str = "") -> Path:
    """Return the folder below ``runs`` for results; no name leads out of it, or is too long.

    Args:
        robot: The robot's name.
        what: Of its results, as the name of a reference.
        file: A file of the results: a folder that has it is left alone, and the next one, with a
            number at its end, taken; empty: results replace those before.
    """
    words = (re.sub(r"[^\w.-]", "_", word).lstrip("-.")[:MAX_WORD] or "_" for word in (robot, what))
    first = Path("runs") / "-".join(words)
    later = (first.with_name(f"{first.name}-{k}") for k in count(2))
    return next(path for path in chain([first], later) if not (file and (path / file).exists()))
