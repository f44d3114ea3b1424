"""One thing that the model takes for simpler than the file has it."""

from __future__ import annotations

from dataclasses import dataclass

from rpctl.description.records import Joint


@dataclass(frozen=True)
class Idealisation:
    """What is idealised, by how much, and in words.

    Attributes:
        what: The kind, a word or two.
        value: The number.
        unit: Its unit.
        sentence: Both in words, with the joints that it is of and their lines.
    """

    what: str
    value: float
    unit: str
    sentence: str


def listed(*joints: Joint) -> str:
    """Return joints by name, with their lines of the file."""
    return ", ".join(f'"{joint.name}" (line {joint.line})' for joint in joints)
