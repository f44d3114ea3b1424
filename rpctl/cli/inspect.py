"""The command that tells what a robot is: ``rpctl inspect``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from rpctl.cli.ci import findings_of, sarif, told
from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, read_settings, tell
from rpctl.cli.terminal import console, escape, format_limit, new_table
from rpctl.description.urdf.findings import condense
from rpctl.description.xacro.expansion import list_arguments
from rpctl.description.xacro.messages import XacroArgument
from rpctl.drive.drive import TYPES_WITH_AXLE, draft
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.standing import stand_at_home
from rpctl.errors import Finding, RpctlError, listed
from rpctl.files.writing import write_atomically
from rpctl.reference.fitting import too_weak
from rpctl.robot.inspection import facts
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot
from rpctl.robot.sources import find_source

SEVERITY_STYLES = {"error": "bold red", "warning": "yellow", "info": "dim"}
ASKED = "a drive file"  # what a doubt asks for
MAX_LISTED_NAMES = 8  # names that a line lists


def inspect_command(
    robot: RobotArgument,
    options: LoadOptions,
    list_xacro_args: Annotated[
        bool,
        typer.Option(
            "--xacro-args", help="List the arguments that its .xacro declares, and nothing else."
        ),
    ] = False,
    sarif_file: Annotated[
        Path | None,
        typer.Option(
            "--sarif", metavar="FILE", help="Write the findings in the robot's file as SARIF too."
        ),
    ] = None,
    balance: Annotated[
        bool,
        typer.Option(
            "--balance",
            help="Simulate from how far a robot that leans can be brought upright again; takes "
            "some ten seconds.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show a robot's drive, wheels and joints, and what is doubtful in its file."""
    if list_xacro_args:
        source = find_source(robot)
        declared = list_arguments(source.path, source.read_settings(read_settings(options.given)))
        tell(as_json, lambda: list(map(asdict, declared)), partial(show_arguments, declared))
        return
    with told(sarif_file, lambda error: sarif(find_source(robot).path, findings_of(error))):
        loaded = _with_faults(options.load(robot))
    if sarif_file is not None:
        write_atomically(sarif_file, sarif(loaded.description.path, loaded.findings))
    margin = _margin(loaded) if balance else None
    known = {} if margin is None else {"balance": margin}
    tell(as_json, lambda: facts(loaded) | known, partial(show_robot, loaded))
    if margin is not None and not as_json:
        console().print(_balanced(**margin))


def _with_faults(robot: Robot) -> Robot:
    """Return a robot with the findings that it does not stand at home, or cannot hold itself."""
    if not robot.dof:
        return robot
    dynamics = ReducedDynamics(robot)
    weak = too_weak(dynamics) if robot.joints else ""
    standing = stand_at_home(dynamics)
    fallen = (
        f"it does not stand in its home posture: {standing.fault}"
        if standing and standing.fault
        else ""
    )
    faults = (Finding("warning", None, text) for text in (fallen, weak) if text)
    return replace(robot, findings=(*robot.findings, *faults))


def _margin(robot: Robot) -> dict[str, float]:
    """Return what can be balanced of a robot that leans.

    Raises:
        RpctlError: It stands by itself, or no law balances it.
    """
    if not isinstance(robot, LeaningRobot):
        raise RpctlError(f"{robot.name} does not lean, so there is nothing to balance")
    from rpctl.control.balance_margin import margin  # the laws take their time

    return margin(robot)._asdict()


def _balanced(speed: float, controllability: float, tilt: float) -> str:
    """Return in a line what can be balanced."""
    where = f"at {speed:.2f} m/s" if speed else "standing"
    return (
        f"[bold]balanced[/] from up to {tilt:.2f} rad, {where}, in simulation with its effort "
        "limits and unlimited grip; smallest singular value of the controllability matrix "
        f"{controllability:.3g}"
    )


def show_arguments(arguments: Sequence[XacroArgument]) -> None:
    """Print arguments of xacro with their defaults, and where they are declared."""
    table = new_table("argument", "default", "declared at")
    for each in arguments:
        default = "(none)" if each.default is None else each.default or '""'
        place = f"{Path(each.file).name}:{each.line}"
        table.add_row(escape(each.name), escape(default), escape(place))
    console().print(table if arguments else "its file declares no arguments")


def show_robot(robot: Robot) -> None:
    """Print what a robot is, the evidence for it, and what is doubtful."""
    out, known = console(), facts(robot)
    drive = known["drive"]
    out.print(f"[bold]{escape(robot.name)}[/]  {escape(known['file'])}", soft_wrap=True)
    grid = Table.grid(padding=(0, 2))
    for label, text in (*_drive_rows(drive), *_leaning_rows(known["leans"]), *_robot_rows(known)):
        grid.add_row(f"[dim]{label}", text)
    out.print(grid)
    if drive["wheels"]:
        out.print()
        out.print(_wheel_table(drive["wheels"]))
        out.print(*_reasons(drive["wheels"]), sep="\n")
    for rows, table in ((drive["swivels"], _swivel_table), (known["joints"], _joint_table)):
        if rows:
            out.print()
            out.print(table(rows))
    remarks = [*_remarks(robot, known["idealised"])]
    if remarks:
        out.print()
        out.print(*remarks, sep="\n")
    if any(ASKED in doubt for doubt in robot.drive.doubts):
        out.print(f"\n[yellow]{ASKED}[/] to edit and give with --drive FILE:")
        out.print(*map(escape, draft(robot.drive).splitlines()), sep="\n", soft_wrap=True)


def _remarks(robot: Robot, idealised: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield, as markup, what is doubtful, wrong or idealised, the weightiest first."""
    for doubt in robot.drive.doubts:
        yield f"[yellow]doubt[/] {escape(doubt)}"
    findings = condense(robot.findings)
    yield from (_finding(robot, each) for each in findings if each.severity != "info")
    for each in condense(Finding("info", None, each["sentence"]) for each in idealised):
        yield f"[dim]idealised[/] {escape(each.message)}"
    contacts = find_contacts(ReducedDynamics(robot))
    for note in contacts.notes if contacts else ():
        yield f"[dim]ground[/] {escape(note)}"
    yield from (_finding(robot, each) for each in findings if each.severity == "info")


def _finding(robot: Robot, finding: Finding) -> str:
    """Return a finding as markup, with its place in the robot's file."""
    place = robot.description.path.name + (f":{finding.line}" if finding.line else "")
    style = SEVERITY_STYLES[finding.severity]
    return f"[{style}]{finding.severity}[/] {escape(f'{place}: {finding.message}')}"


def _drive_rows(drive: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a label and markup for the drive, its evidence, and its measures."""
    yield "drive", f"[bold]{drive['type']}[/]"
    for sentence in drive["evidence"]:
        yield "", escape(sentence)
    if drive["wheels"]:
        x, y = drive["point"]
        what = "centre of rotation" if drive["type"] == "skid-steer" else "middle of the axle"
        what = what if drive["type"] in TYPES_WITH_AXLE else "origin of the root link"
        yield "track", f"{drive['track']:.4g} m; P, the {what}, at ({x:.4g}, {y:.4g}) m"
        height = round(-drive["ground"], 6) + 0.0
        yield (
            "root link",
            f"forward at {drive['heading_deg']:.4g}°, {height:.4g} m above the ground",
        )


def _leaning_rows(leans: Mapping[str, Any] | None) -> Iterator[tuple[str, str]]:
    """Yield a label and markup for about what a robot leans, if it does."""
    if leans is not None:
        text = f"about {leans['about']}: its {leans['tilt']} is free and must be balanced"
        yield "leans", escape(text)
        yield "", f"centre of mass {leans['height']:.3g} m above it in the home posture"


def _reasons(wheels: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield, as markup, the reason why each joint is a wheel; equal reasons are grouped."""
    reasons: dict[str, list[str]] = {}
    for wheel in wheels:
        reasons.setdefault(wheel["why"], []).append(wheel["joint"])
    for why, names in reasons.items():
        who = ", ".join(names) if len(reasons) > 1 else "each"
        yield f"[dim]{escape(f'{who} {why}')}[/]"


def _wheel_table(wheels: Sequence[Mapping[str, Any]]) -> Table:
    table = new_table("wheel", ">radius", "known from", "held by", "driven", ">velocity", ">effort")
    for wheel in wheels:
        table.add_row(
            escape(wheel["joint"]),
            f"{wheel['radius']:.4g} m",
            escape(wheel["source"]),
            escape(wheel["swivel"] or "root"),
            "yes" if wheel["driven"] else "no",
            format_limit(wheel["velocity"], "rad/s"),
            format_limit(wheel["effort"], "N·m"),
        )
    return table


def _swivel_table(swivels: Sequence[Mapping[str, Any]]) -> Table:
    table = new_table("swivel", "role", "driven", "at x, y", "trail", "because")
    for swivel in swivels:
        x, y = swivel["pivot"]
        table.add_row(
            escape(swivel["joint"]),
            swivel["role"],
            "yes" if swivel["driven"] else "no",
            f"{x:.4g}, {y:.4g} m",
            f"{-1e3 * swivel['trail']:.3g} mm" if swivel["trail"] else "-",
            escape(swivel["why"]),
        )
    return table


def _robot_rows(known: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a label and markup for what is known of the whole robot."""
    yield "mass", f"{known['mass']:.4g} kg"
    arm = {joint["name"] for joint in known["joints"]}
    yield "dof", f"{known['dof']} quasi-velocities"
    for name in known["quasi_velocities"]:
        if name not in arm:
            yield "", escape(f"{name}: {known['meanings'][name]}")
    if arm:
        joints = _name_list([joint["name"] for joint in known["joints"]])
        lead = "and the" if len(arm) < known["dof"] else "the"
        yield "", f"{lead} rate{'s' * (len(arm) > 1)} of {joints}"
    yield "end effector", escape(known["end_effector"] or "none")
    if known["estimated_links"]:
        yield "estimated", escape(f"mass and inertia of {', '.join(known['estimated_links'])}")
    if known["locked"]:
        yield "locked", _name_list(list(known["locked"]))
    if known["mimics"]:
        yield "mimic", escape(", ".join(known["mimics"]))
    for count, text in enumerate(_losses(known["losses"])):
        yield "" if count else "losses", escape(text)


def _losses(joints: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield damping, friction and rotor of joints, those that are alike together."""
    alike: dict[str, list[str]] = {}
    for joint in joints:
        slides = joint["type"] == "prismatic"
        units = ("N·s/m", "N", "kg") if slides else ("N·m·s/rad", "N·m", "kg·m²")
        words = (("damping", "damping"), ("friction", "friction"), ("armature", "rotor"))
        words_said = [
            f"{word} {joint[key]:.4g} {unit}"
            for (key, word), unit in zip(words, units, strict=True)
            if joint[key]
        ]
        alike.setdefault(", ".join(words_said), []).append(joint["joint"])
    for said, names in alike.items():
        yield f"{said}: {listed(names, MAX_LISTED_NAMES)}"


def _name_list(names: Sequence[str]) -> str:
    """Return names as markup, at most MAX_LISTED_NAMES of them."""
    more = " (--json lists them)" if len(names) > MAX_LISTED_NAMES else ""
    return escape(listed(names, MAX_LISTED_NAMES) + more)


def _joint_table(joints: Sequence[Mapping[str, Any]]) -> Table:
    table = new_table("joint", "type", ">lower", ">home", ">upper", ">velocity", ">effort")
    for joint in joints:
        unit, force = ("m", "N") if joint["type"] == "prismatic" else ("rad", "N·m")
        table.add_row(
            escape(joint["name"]),
            joint["type"],
            format_limit(joint["lower"], unit),
            f"{joint['home']:.3g} {unit}",
            format_limit(joint["upper"], unit),
            format_limit(joint["velocity"], f"{unit}/s"),
            format_limit(joint["effort"], force),
        )
    return table
