"""Arguments of a .xacro as ROS users write them: words ``NAME:=VALUE`` on the command line."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from typer.core import TyperCommand

from rpctl.errors import RpctlError

XACRO_OPTION = "--xacro-arg"
WORD = re.compile(r"(?:env:)?[A-Za-z_][\w.-]*:=")  # how such a word begins


class WordsCommand(TyperCommand):
    """A command that takes the words wherever they stand."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line, such words as values of their option."""
        options = {name: each for each in self.params for name in each.opts}
        if XACRO_OPTION not in options:
            return super().parse_args(ctx, args)
        words: list[str] = []
        rest: list[str] = []
        valued = False  # whether the word before is an option that takes this one
        for arg in args:
            (words if not valued and WORD.match(arg) else rest).append(arg)
            option = options.get(arg)
            valued = not valued and option is not None and not getattr(option, "is_flag", True)
        return super().parse_args(ctx, [*(f"{XACRO_OPTION}={word}" for word in words), *rest])


def read_words(words: Iterable[str] | None) -> dict[str, str]:
    """Return the values of ``NAME:=VALUE`` by name.

    Raises:
        RpctlError: A word is of another form.
    """
    values: dict[str, str] = {}
    for word in words or ():
        name, given, value = word.partition(":=")
        if not name or not given:
            raise RpctlError(f"{XACRO_OPTION} {word}: write NAME:=VALUE, as arm:=true")
        values[name] = value
    return values
