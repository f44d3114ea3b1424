"""What xacro files say without being evaluated: their arguments, and which files they include."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

FIND = re.compile(r"^\s*(?:\$\(\s*find\s+([^\s()]+)\s*\)|package://([^/\s]+))(/.*)$")
OLD_ELEMENTS = ("macro", "property", "include")  # written without a prefix before ROS Jade


@dataclass
class FileScan:
    """What one file says.

    Attributes:
        arguments: Name, default (None: it has none) and line of each argument that it declares.
        includes: The files that it includes, as they are written.
        old_element: Name and line of the first element of xacro that lacks its prefix.
    """

    arguments: list[tuple[str, str | None, int]] = field(default_factory=list)
    includes: list[str] = field(default_factory=list)
    old_element: tuple[str, int] | None = None


def scan(data: bytes) -> FileScan:
    """Return what a file's bytes say, up to where they are no XML."""
    found, parser, depth = FileScan(), expat.ParserCreate(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        name, line = attributes.get("name", ""), parser.CurrentLineNumber
        if tag == "xacro:arg" and name:
            found.arguments.append((name, attributes.get("default"), line))
        elif tag == "xacro:include":
            found.includes.append(attributes.get("filename", ""))
        elif depth == 2 and tag in OLD_ELEMENTS and found.old_element is None:  # below <robot>
            found.old_element = tag, line

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    with suppress(expat.ExpatError):
        parser.Parse(data, True)
    return found


def scan_all(
    files: Iterable[str], find: Callable[[str], tuple[str, ...]], read: Callable[[str], bytes]
) -> dict[str, FileScan]:
    """Return what files say, and those that they include by names without variables, by file.

    Args:
        files: The files that are known.
        find: Returns the folders of a package.
        read: Returns a file's bytes, none where it cannot be read.
    """
    found: dict[str, FileScan] = {}
    queue = [os.path.normpath(file) for file in files]
    while queue:
        file = queue.pop(0)
        if file in found:
            continue
        found[file] = scan(read(file))
        for spec in found[file].includes:
            path = _included(file, spec, find)
            if path is not None:
                queue.append(os.path.normpath(path))
    return found


def constant_defaults(scans: Mapping[str, FileScan]) -> dict[str, str]:
    """Return the defaults without variables that files declare, by argument; the first counts."""
    found: dict[str, str] = {}
    for each in scans.values():
        for name, default, _ in each.arguments:
            if default is not None and "$" not in default:
                found.setdefault(name, default)
    return found


def _included(file: str, spec: str, find: Callable[[str], tuple[str, ...]]) -> str | None:
    """Return the path of an include, if it can be told without evaluating anything."""
    named = FIND.match(spec)
    if named:
        folders = find(named[1] or named[2])
        path = folders[0] + named[3] if folders else "$"
    else:
        path = str(Path(file).parent / spec)
    return None if "$" in path or "*" in path else path
