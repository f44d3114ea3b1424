"""What is written of a robot: ``derive`` its equations, ``export`` MJCF or a ROS 2 package.

``rpctl check`` proves an MJCF file again.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, tell
from rpctl.cli.terminal import console, escape, print_document, print_json, say
from rpctl.cli.verify import print_rows
from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.engines.mujoco.check import MjcfCheck
from rpctl.engines.mujoco.export import MjcfExport
from rpctl.errors import RpctlError, require_known
from rpctl.files.writing import require_writable, write_atomically
from rpctl.robot.leaning import LeaningRobot

FORMATS = {  # and the options that each has alone, by field
    "mjcf": {
        "friction": "--friction",
        "wheel_width": "--wheel-width",
        "meshes": "--no-meshes",
    },
    "ros2_control": {
        "law": "--law",
        "dynamic": "--dynamic",
        "period": "--control-period",
        "output": "--output",
        "delay": "--delay",
        "rates": "--rates",
    },
}


@dataclass(frozen=True)
class ExportOptions:
    """What is written, and where."""

    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="mjcf|ros2_control",
            help="mjcf: a MuJoCo model. ros2_control: a ROS 2 package that runs the law.",
        ),
    ] = "mjcf"
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="File of the model, default ROBOT.xml, or folder of the package, default "
            "ROBOT_controller.",
        ),
    ] = None
    friction: Annotated[
        float, typer.Option(metavar="MU", help="Friction coefficient between wheels and ground.")
    ] = 0.7
    wheel_width: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Make the wheels cylinders of this width, m, which scrub as they turn; default: "
            "crowned wheels, which touch the ground at one point, as in rpctl's model.",
        ),
    ] = None
    meshes: Annotated[
        bool,
        typer.Option(
            "--meshes/--no-meshes",
            help="Write the visual meshes too, into a folder beside the model.",
        ),
    ] = True
    law: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:CLASS",
            help="Kinematic law, as for `rpctl derive`; default: unified.",
        ),
    ] = None
    dynamic: Annotated[str, typer.Option(metavar="paper", help="Dynamic law.")] = "paper"
    period: Annotated[
        float,
        typer.Option(
            "--control-period",
            metavar="S",
            help="Control period of the controller manager, s.",
        ),
    ] = USUAL_PERIOD
    output: Annotated[
        str, typer.Option(metavar="effort|velocity", help="What the controller commands.")
    ] = "effort"
    delay: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="As for `rpctl track`: default of the package's parameter; the gains suit it.",
        ),
    ] = None
    rates: Annotated[
        str | None,
        typer.Option(
            metavar="measured|estimated",
            help="As for `rpctl track`: default of the package's parameter.",
        ),
    ] = None

    def require_own(self) -> None:
        """Refuse a format that is not known, and options of another one.

        Raises:
            RpctlError: There is one.
        """
        require_known("format", [self.form], FORMATS)
        for own in (options for form, options in FORMATS.items() if form != self.form):
            for name, option in own.items():
                if getattr(self, name) != getattr(ExportOptions, name):
                    raise RpctlError(f"--format {self.form} has no {option}; leave it out")


def export_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: ExportOptions,
    as_json: JsonOption = False,
) -> None:
    """Write a robot as a MuJoCo model, once MuJoCo agrees with it, or a law as a ROS 2 package."""
    settings.require_own()
    if settings.form == "ros2_control":
        _export_ros2(robot, options, settings, as_json)
        return
    from rpctl.simulation.mjcf_file import export_mjcf

    if settings.out is not None:
        require_writable(settings.out)
    os.environ.setdefault("MUJOCO_GL", "disable")  # it draws nothing here, and looks for displays
    loaded = options.load(robot)
    path = settings.out if settings.out is not None else Path(f"{file_name(loaded.name)}.xml")
    found = export_mjcf(
        loaded,
        path,
        friction=settings.friction,
        wheel_width=settings.wheel_width,
        meshes=settings.meshes,
    )
    tell(as_json, found.to_dict, partial(show_export, found), found.written)


def _export_ros2(robot: str, options: LoadOptions, settings: ExportOptions, as_json: bool) -> None:
    """Write a ROS 2 package."""
    from rpctl.derive.ros2_control import export_ros2_control, package_name

    loaded = options.load(robot)
    folder = settings.out if settings.out is not None else Path(package_name(loaded))
    made = export_ros2_control(
        loaded,
        folder,
        settings.law or "unified",
        settings.dynamic,
        settings.period,
        settings.output,
        delay=settings.delay,
        rates=settings.rates,
    )
    if as_json:
        print_json({**asdict(made), "folder": str(made.folder)})
    else:
        say(
            f"wrote the package {made.name} into {made.folder}; at most {made.operations} per "
            "sample"
        )
        say(f"it has not been run under ROS: see What was not run in {made.folder / 'README.md'}")


def file_name(robot: str) -> str:
    """Return a robot's name as that of a file."""
    return (
        "".join(c if c.isalnum() or c in "._-" else "_" for c in robot).lstrip("-.")[:80] or "robot"
    )


def show_export(found: MjcfExport) -> None:
    """Print what was compared, and where the file is."""
    print_rows(found.checks, found.skipped, found.notes)
    out = console()
    if not found.written:
        failed = ", ".join(check.name for check in found.checks if not check.passed)
        out.print(f"[bold red]✗[/] [bold]not written[/]: {escape(failed)}")
        return
    meshes = f" and {len(found.meshes)} meshes" if found.meshes else ""
    out.print(
        f"[green]✓[/] [bold]wrote {escape(str(found.path))}[/]{meshes}; certificate "
        f"{found.digest[:16]}; look at it with: python -m mujoco.viewer "
        f"--mjcf={escape(str(found.path))}"
    )


def check_command(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="An MJCF file that `rpctl export` wrote.")
    ],
    options: LoadOptions,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help="Compare with this robot, loaded with the options here; default: the robot "
            "stored in the file.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Verify an exported MuJoCo model and list its edits; exit 1 if one can change the motion."""
    from rpctl.simulation.mjcf_file import check_mjcf

    os.environ.setdefault("MUJOCO_GL", "disable")  # it draws nothing here, and looks for displays
    found = check_mjcf(
        file, None if robot is None else options.load(robot), package_dirs=options.package_dirs
    )
    tell(as_json, found.to_dict, partial(show_check, found), found.passed)


def show_check(found: MjcfCheck) -> None:
    """Print what was edited, what was compared, and whether the certificate holds."""
    print_rows(found.checks, found.skipped, found.notes)
    out = console()
    for edit in found.edits:
        mark = "[bold red]edited[/]" if edit.matters else "[dim]edited, harmless[/]"
        out.print(f"{mark} {escape(edit.sentence)}")
    own = found.certificate
    said = f"{own.robot}, certificate {own.digest[:16]}, rpctl {own.made_with.get('rpctl', '?')}"
    if found.passed:
        out.print(
            "[green]✓[/] [bold]valid[/]: the file describes the robot that was exported: "
            f"{escape(said)}"
        )
        return
    count = sum(edit.matters for edit in found.edits)
    why = f"{count} edit{'s' if count != 1 else ''} that can change the motion" if count else (
        ", ".join(check.name for check in found.checks if not check.passed) + " failed"
    )  # fmt: skip
    out.print(f"[bold red]✗[/] [bold]void[/]: {escape(why)}; {escape(said)}")


@dataclass(frozen=True)
class DeriveOptions:
    """What is written of a robot, and where."""

    form: Annotated[
        str, typer.Option("--format", metavar="text|latex|python|c", help="Language to write.")
    ] = "text"
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Keep masses and lengths symbolic.")
    ] = False
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="M/S",
            help="Speed about which to linearise a robot that leans; default: a bicycle at any "
            "speed, others at rest.",
        ),
    ] = None
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File to write; default: stdout."),
    ] = None
    law: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:CLASS",
            help="Write this kinematic law, its derivative and the dynamic law, up to the "
            "efforts; with --format c, a whole controller in one file.",
        ),
    ] = None
    dynamic: Annotated[str, typer.Option(metavar="paper", help="Dynamic law, with --law.")] = (
        "paper"
    )
    precision: Annotated[
        str,
        typer.Option(metavar="double|float", help="Floating-point type of the C code, with --law."),
    ] = "double"
    period: Annotated[
        float,
        typer.Option(
            "--control-period",
            metavar="S",
            help="Control period of the loop that will run the law, s, with --law; the joints' "
            "gains depend on it.",
        ),
    ] = USUAL_PERIOD


def derive_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: DeriveOptions,
    as_json: JsonOption = False,
) -> None:
    """Write the reduced equations of motion, or a control law, as text, LaTeX, Python or C."""
    from rpctl.derive.linear_form import linear_form
    from rpctl.derive.write import derive, derive_law  # SymPy takes long to import

    if settings.out is not None:
        require_writable(settings.out)
    shown: dict[str, object] = {"robot": robot, "format": settings.form}
    if settings.law is None:
        _require_law(settings.dynamic, settings.precision)
        loaded = options.load(robot)
        text, cost = derive(loaded, settings.form, settings.parameters, settings.speed), None
        if isinstance(loaded, LeaningRobot):
            form = linear_form(loaded, settings.speed)
            matrices = {name: matrix.tolist() for name, matrix in form.matrices.items()}
            shown = form._asdict() | {"matrices": matrices} | shown
    elif settings.parameters or settings.speed is not None:
        raise RpctlError("--law writes numbers, for all speeds; leave out --parameters and --speed")
    else:
        text, cost = derive_law(
            options.load(robot),
            kinematic=settings.law,
            dynamic=settings.dynamic,
            format=settings.form,
            precision=settings.precision,
            period=settings.period,
        )
        shown |= {
            "law": settings.law,
            "dynamic": settings.dynamic,
            "operations": cost and asdict(cost),
        }
    if settings.out is not None:
        write_atomically(settings.out, text.encode())
    if as_json:
        print_json({**shown, "text": text})
    elif settings.out is not None:
        say(f"wrote {settings.out}" + (f"; at most {cost} per sample" if cost else ""))
    else:
        print_document(text)


def _require_law(dynamic: str, precision: str) -> None:
    """Refuse options that only a law has."""
    given = {"--dynamic": dynamic != "paper", "--precision": precision != "double"}
    for name in (option for option, changed in given.items() if changed):
        raise RpctlError(f"{name} applies to a law; give --law too, as --law unified")
