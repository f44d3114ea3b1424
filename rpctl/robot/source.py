"""``Source``: the file that a path or a name stands for, and what goes with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rpctl.description.packages import require_folders
from rpctl.description.read_settings import ReadSettings, read_settings


@dataclass(frozen=True)
class Source:
    """The file of a robot, and how it is loaded unless the user says otherwise.

    Attributes:
        path: The file.
        name: The name that stands for it; None for a path.
        drive: Type of the drive, where nothing in the file tells it.
        lock: Joint name patterns that are frozen.
        package_dirs: Folders that hold its packages.
        xacro_args: Values of the arguments of its xacro.
    """

    path: Path
    name: str | None = None
    drive: str | None = None
    lock: tuple[str, ...] = ()
    package_dirs: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)

    def read_settings(
        self,
        package_dirs: Iterable[str | Path] = (),
        xacro_args: Mapping[str, object] | None = None,
        ignore_missing_packages: bool = False,
    ) -> ReadSettings:
        """Return how its file is read: as the user says, who comes first, and as it needs.

        Args:
            package_dirs: Packages, or folders that hold packages, of the user.
            xacro_args: Values of arguments, of the user.
            ignore_missing_packages: Whether includes from packages not found are left out.

        Raises:
            RpctlError: One of the folders is none.
        """
        return read_settings(
            dict.fromkeys((*require_folders(package_dirs), *self.package_dirs)),
            {**self.xacro_args, **(xacro_args or {})},
            ignore_missing_packages,
        )
