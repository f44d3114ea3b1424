"""The options that commands share, and what they mean."""

from __future__ import annotations

from typing import Annotated

import typer

from rpctl.cli.show import progress_bar
from rpctl.drive.drive_file import DRIVE_TYPES
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.verify import verify
from rpctl.errors import RpctlError
from rpctl.robot.load import load
from rpctl.robot.model import Robot

CHECK_FAILED = 1  # exit code: not equivalent, or a limit broken
RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF or .xacro file, or a name listed by `rpctl robots`."
    ),
]
LockOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME[=POSITION]",
        help="Freeze joints, by name or pattern, at a position (rad or m; default 0). Repeatable.",
    ),
]
DriveOption = Annotated[
    str | None,
    typer.Option(
        metavar="TYPE|FILE",
        help=f"{', '.join(DRIVE_TYPES)}, or a drive file (TOML).",
    ),
]
DensityOption = Annotated[
    float | None,
    typer.Option(
        metavar="KG_PER_M3",
        help="Estimate the inertias that the file lacks from the links' shapes.",
    ),
]
PackageDirOption = Annotated[
    list[str] | None,
    typer.Option(
        "--package-dir",
        metavar="DIR",
        help="Where package:// and $(find ...) look: a package, or a folder that holds some. "
        "Repeatable.",
    ),
]
StrictOption = Annotated[
    bool,
    typer.Option("--strict", help="Take warnings, and what was assumed of the drive, as errors."),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON on stdout and everything else on stderr.")
]


def load_robot(
    source: str,
    drive: str | None,
    lock: list[str] | None,
    density: float | None,
    strict: bool,
    package_dirs: list[str] | None,
) -> Robot:
    """Return the robot that the options name.

    Raises:
        RpctlError: An option is wrong, or the robot cannot be loaded.
    """
    positions = {}
    for item in lock or []:
        name, given, position = item.partition("=")
        try:
            positions[name] = float(position) if given else 0.0
        except ValueError:
            raise RpctlError(
                f"--lock {item}: {position!r} is not a number; write NAME=0.1"
            ) from None
    return load(source, drive, positions, density, strict=strict, package_dirs=package_dirs or ())


def read_triple(text: str) -> tuple[float, ...]:
    """Return the three numbers of ``X,Y,THETA``.

    Raises:
        RpctlError: They are not three numbers.
    """
    try:
        x, y, theta = (float(word) for word in text.split(","))
    except ValueError:
        raise RpctlError(f"--initial-error {text}: give three numbers, as 0.1,-0.1,0.1") from None
    return x, y, theta


def certify(
    robot: Robot,
    samples: int,
    seed: int,
    engines: list[str],
    strict: bool = False,
    contact: bool = False,
) -> Certificate:
    """Verify a robot, with a bar on a terminal."""
    with progress_bar("verify") as advance:
        return verify(
            robot, samples, seed, engines, lambda done: advance(done, samples), strict, contact
        )
