"""What an expansion is given: arguments, variables, and what it may ask of the outside.

Used in the process that expands xacro only.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import Any

from rpctl.description.expansion_answer import GONE
from rpctl.files.worker import Channel

MAX_REPLY = 2**40  # bytes; who replies has caps of its own


class NotGivenError(Exception):
    """A variable of the environment that nobody gives."""


class Arguments(dict[str, str]):
    """Values of arguments that remember which of them were looked up.

    Attributes:
        used: Names that were looked up.
        early: Names that were, before their declaration was reached.
    """

    def __init__(self, given: dict[str, str], defaults: Callable[[], dict[str, str]]) -> None:
        """Keep the values that are given.

        Args:
            given: Values by name.
            defaults: Returns defaults that are declared somewhere, without variables.
        """
        super().__init__(given)
        self._defaults = defaults
        self.used: set[str] = set()
        self.early: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.used.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        if not super().__contains__(name) and name in (declared := self._defaults()):
            self.early.add(name)
            return declared[name]
        return super().__getitem__(name)


class Environment:
    """The variables that a file is given; it sees none of the user's.

    Attributes:
        asked: Names that were looked up.
    """

    def __init__(self, given: dict[str, str]) -> None:
        self._given = given
        self.asked: set[str] = set()

    def required(self, name: str) -> str:
        """Return a variable's value, for ``$(env NAME)``.

        Raises:
            NotGivenError: Nobody gives it.
        """
        if (value := self.optional(name, None)) is None:
            raise NotGivenError(name)
        return value

    def optional(self, name: str, default: Any = "") -> Any:
        """Return a variable's value or a default, for ``$(optenv NAME DEFAULT)``."""
        self.asked.add(str(name))
        return self._given.get(name, default)


class Outside:
    """Files and packages, asked of who started the process."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    def read(self, path: str) -> bytes:
        """Return a file's bytes.

        Raises:
            OSError: There is no such file, or it may not be read.
        """
        reply = self._ask("read", path)
        if reply[:1] == GONE:
            number, reason = json.loads(reply[1:])
            raise OSError(number, reason, path)
        return reply[1:]

    def bytes_of(self, path: str) -> bytes:
        """Return a file's bytes, none where it cannot be read."""
        try:
            return self.read(path)
        except OSError:
            return b""

    def open(self, path: Any) -> io.TextIOWrapper:
        """Open a text file for reading, for xacro's own ``open``."""
        return io.TextIOWrapper(io.BytesIO(self.read(str(path))), "utf-8")

    def find(self, name: str) -> tuple[str, ...]:
        """Return the folders that a package's name may mean, the likeliest first."""
        return tuple(json.loads(self._ask("find", name)))

    def place(self, path: str) -> str | None:
        """Return where a file of a package lies in its source, if not where its path says."""
        place = json.loads(self._ask("place", path))
        return None if place is None else str(place)

    def glob(self, pattern: str) -> list[str]:
        """Return the files that a pattern names, for xacro's own ``glob.glob``."""
        return list(json.loads(self._ask("match", pattern)))

    def _ask(self, verb: str, text: str) -> bytes:
        self._channel.send(json.dumps((verb, text)).encode())
        return self._channel.receive(MAX_REPLY)
