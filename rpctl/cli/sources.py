"""The commands about files of robots: ``rpctl expand`` and ``rpctl robots``. They load no robot."""

from __future__ import annotations

from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, ReadOptions, read_settings
from rpctl.cli.terminal import console, escape, new_table, print_document, print_json, say
from rpctl.description.xacro.expansion import expand
from rpctl.errors import format_finding
from rpctl.files.caps import read_source
from rpctl.robot.catalog import ENTRIES, Entry
from rpctl.robot.sources import PACKAGE, PublicRobot, cache_folder, find_source, list_robots


def expand_command(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="A .xacro file, or a name listed by `rpctl robots`. "
            "xacro evaluates the file's expressions.",
        ),
    ],
    options: ReadOptions,
    as_json: JsonOption = False,
) -> None:
    """Print the URDF that a .xacro expands to; line numbers in messages refer to it."""
    found = find_source(robot)
    read_source(found.path)  # or say why it cannot be
    expansion = expand(found.path, found.read_settings(read_settings(options)))
    for finding in expansion.findings:
        say(format_finding(str(found.path), finding), err=True)
    if as_json:
        print_json({"file": str(found.path), "text": expansion.text})
    else:
        print_document(expansion.text, xml=True)


def robots_command(as_json: JsonOption = False) -> None:
    """List the robots that can be loaded by name: rpctl's own, and those of other packages."""
    public = list_robots()
    cached = [robot for robot in public if robot.cached]
    if as_json:
        print_json([*map(_own, ENTRIES), *map(_public, cached)])
        return
    table = new_table("name", "base", "description")
    for each in (*map(_own, ENTRIES), *map(_public, cached)):
        table.add_row(each["name"], each["base"], escape(each["summary"]))
    console().print(table)
    missing = [robot.name for robot in public if robot.wheeled and not robot.cached]
    if missing:
        console().print(
            f"[dim]wheeled robots of {PACKAGE} that are not in its cache "
            f"({escape(str(cache_folder()))}): {escape(', '.join(missing))}; `python -m {PACKAGE} "
            "pull NAME` downloads one[/]"
        )


def _own(entry: Entry) -> dict[str, str]:
    return {
        "name": entry.name,
        "base": entry.base,
        "summary": entry.summary,
        "file": str(entry.path),
    }


def _public(robot: PublicRobot) -> dict[str, str]:
    return {
        "name": robot.name,
        "base": "wheeled" if robot.wheeled else "fixed",
        "summary": f"{robot.robot}, {', '.join(robot.tags)} ({PACKAGE})",
        "file": str(robot.file),
    }
