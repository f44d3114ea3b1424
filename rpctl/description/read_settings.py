"""How the file of a robot is read: where its packages lie, and the arguments of its xacro."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rpctl.description.packages import require_folders


@dataclass(frozen=True)
class ReadSettings:
    """How the file of a robot is read.

    Attributes:
        package_dirs: Folders that the user declares: packages, or folders that hold packages.
        xacro_args: Values of the arguments (``<xacro:arg>``) of a .xacro, as texts, by name.
        ignore_missing_packages: Whether includes from packages that are not found are left out.
    """

    package_dirs: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    ignore_missing_packages: bool = False


READ_DEFAULTS = ReadSettings()


def read_settings(
    package_dirs: Iterable[str | Path] = (),
    xacro_args: Mapping[str, object] | None = None,
    ignore_missing_packages: bool = False,
) -> ReadSettings:
    """Return settings from what a user gives.

    Args:
        package_dirs: Packages, or folders that hold packages.
        xacro_args: Values by name: texts, numbers, or truth values.
        ignore_missing_packages: Whether includes from packages that are not found are left out.

    Raises:
        RpctlError: One of the folders is none.
    """
    texts = {name: _as_xacro(value) for name, value in (xacro_args or {}).items()}
    return ReadSettings(require_folders(package_dirs), texts, ignore_missing_packages)


def _as_xacro(value: object) -> str:
    """Return a value as xacro has it; its truth values are written small."""
    return str(value).lower() if isinstance(value, bool) else str(value)
