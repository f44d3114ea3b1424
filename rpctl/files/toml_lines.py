"""Where in a TOML file a setting is: its reader keeps no lines."""

from __future__ import annotations

import re
from collections import Counter

KEY = r"""(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)"""
KEYS = rf"{KEY}(?:[ \t]*\.[ \t]*{KEY})*"
HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({KEYS})[ \t]*\]")
SETTING = re.compile(rf"[ \t]*({KEYS})[ \t]*=")
QUOTES = re.compile(r"""["' \t]""")


def line_of(text: str, path: str) -> int | None:
    """Return the line of a setting, or of the nearest table around it; None: it has none.

    Args:
        text: The file's.
        path: Of the setting, as ``study.count``, ``scatter."plant.delay"`` or
            ``kinematic.base_obstacles[2].radius``.
    """
    wanted = QUOTES.sub("", path)
    found: tuple[int, int] | None = None  # length of what matches, line
    for name, line in _places(text):
        inside = wanted == name or (wanted.startswith(name) and wanted[len(name)] in ".[")
        if inside and (found is None or len(name) > found[0]):
            found = len(name), line
    return None if found is None else found[1]


def _places(text: str) -> list[tuple[str, int]]:
    """Return the tables and settings of a file by their paths, without quotes, and their lines."""
    places, table, numbers = [], "", Counter[str]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := HEADER.match(line):
            table = QUOTES.sub("", header[2])
            if header[1] == "[[":
                numbers[table] += 1
                table = f"{table}[{numbers[table]}]"
            places.append((table, number))
        elif setting := SETTING.match(line):
            key = QUOTES.sub("", setting[1])
            places.append((f"{table}.{key}" if table else key, number))
    return places
