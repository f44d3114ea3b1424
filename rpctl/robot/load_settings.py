"""``LoadSettings``: how a robot is loaded, once for calls, commands, runs and certificates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

from rpctl.drive.drive import Drive


class Payload(NamedTuple):
    """A load fixed to a link; see :func:`rpctl.with_payload`."""

    link: str
    mass: float  # kg
    com: tuple[float, ...]  # (3,) in the link's frame, m
    inertia: tuple[tuple[float, ...], ...]  # (3, 3) about com, along the link's axes, kg·m²


@dataclass(frozen=True)
class LoadSettings:
    """What is said of a robot besides the name of its file; :func:`rpctl.load` explains each.

    A robot keeps those with which it loads again: patterns resolved to names, defaults to values.

    Attributes:
        drive: The drive, its type or a drive file; None finds it.
        lock: Positions of frozen joints by pattern of their names, rad or m.
        density: Density from which missing inertias are estimated, kg/m³, or None.
        end_effector: Link to track; None takes the arm's last.
        strict: Whether warnings, and what is assumed of the drive, are errors.
        package_dirs: Folders that the user declares: packages, or folders that hold packages.
        xacro_args: Values of the arguments of a .xacro, by name.
        ignore_missing_packages: Whether includes from packages that are not found are left out.
        home: Positions of the arm's joints at home by name, rad or m; or words.
        free: Patterns of joints that are not frozen by default.
        losses: Whether the damping and friction of the file count.
        armature: Whether the rotors that the file tells of count; or inertias by pattern of joint
            names, kg·m² or kg, which add to those.
        payloads: Loads that it carries besides, in the order in which they were put on.
    """

    drive: Drive | str | None = None
    lock: Mapping[str, float] = field(default_factory=dict)
    density: float | None = None
    end_effector: str | None = None
    strict: bool = False
    package_dirs: tuple[str, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    ignore_missing_packages: bool = False
    home: Mapping[str, float] | tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    losses: bool = True
    armature: bool | Mapping[str, float] = False
    payloads: tuple[Payload, ...] = ()

    @property
    def rotors(self) -> Mapping[str, float] | None:
        """Inertias that are given besides the file's, by pattern; None: no rotors count."""
        if isinstance(self.armature, bool):
            return {} if self.armature else None
        return self.armature

    def arguments(self) -> dict[str, Any]:
        """Return the keywords with which :func:`rpctl.load` does the same, as plain values.

        A drive that was given as such is a mapping of its fields; payloads are left out.
        """
        keywords = asdict(self)
        del keywords["strict"], keywords["payloads"]
        return keywords
