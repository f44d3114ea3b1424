"""The configuration of a run: its laws, limits and circumstances, and its file in TOML."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from rpctl.control.dynamic import PaperDynamic
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.registry import (
    DYNAMIC_LAWS,
    KINEMATIC_LAWS,
    dynamic_by_name,
    kinematic_by_name,
)
from rpctl.control.settings import (
    DYNAMIC_REGISTRY,
    KINEMATIC_REGISTRY,
    Table,
    from_table,
    named_from_table,
    named_to_table,
    to_table,
)
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import DescriptionError, Finding
from rpctl.files.writing import write_atomically

if sys.version_info >= (3, 11):
    import tomllib
else:  # the standard library has it from 3.11 on
    import tomli as tomllib

HEADER = (
    "# A run of rpctl: rpctl track ROBOT --config FILE. What is left out keeps its default.\n\n"
)


@dataclass(frozen=True)
class LimitOverrides:
    """Limits that take the place of the URDF's, by pattern of joint names.

    Attributes:
        effort: N·m or N.
        velocity: rad/s or m/s.
    """

    effort: Mapping[str, float] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RunSettings:
    """What a run is besides its laws.

    Attributes:
        reference: Its name or file.
        duration: s; None: as long as the reference moves.
        initial_error: Tracking error (x1, x2, x3) at the start, m, m, rad.
        control_period: s.
        plant_step: s.
        friction: Coefficient between wheels and ground.
    """

    reference: str = "eight"
    duration: float | None = None
    initial_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    control_period: float = 0.002
    plant_step: float = 0.002
    friction: float = FRICTION


@dataclass(frozen=True)
class Config:
    """All that a run is but its robot.

    Attributes:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        run: The rest.
        limits: Limits that take the place of the URDF's.
    """

    kinematic: KinematicLaw = field(default_factory=UnifiedKinematic)
    dynamic: DynamicLaw = field(default_factory=PaperDynamic)
    run: RunSettings = field(default_factory=RunSettings)
    limits: LimitOverrides = field(default_factory=LimitOverrides)

    def with_laws(self, kinematic: str | None, dynamic: str | None) -> Config:
        """Return a configuration with these laws, by name; those that it has keep their settings.

        Raises:
            UnknownNameError: There is no such law.
        """
        laws: Table = {}
        if kinematic is not None and type(self.kinematic) is not KINEMATIC_LAWS.get(kinematic):
            laws["kinematic"] = kinematic_by_name(kinematic)
        if dynamic is not None and type(self.dynamic) is not DYNAMIC_LAWS.get(dynamic):
            laws["dynamic"] = dynamic_by_name(dynamic)
        return dataclasses.replace(self, **laws)

    def with_run(self, **settings: Any) -> Config:
        """Return a configuration in which the settings of ``run`` that are not None are others."""
        given = {key: value for key, value in settings.items() if value is not None}
        return dataclasses.replace(self, run=dataclasses.replace(self.run, **given))


def read_config(path: str | Path) -> Config:
    """Read a configuration; what the file leaves out keeps its default.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise _refused(path, [f"{error.strerror or error}; give a configuration file"]) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise _refused(path, [f"not TOML: {error}; a configuration is TOML"]) from None
    faults: list[str] = []
    tables: Table = {}
    for key, table in data.items():
        if key == "kinematic":
            tables[key] = named_from_table(table, KINEMATIC_REGISTRY, key, faults)
        elif key == "dynamic":
            tables[key] = named_from_table(table, DYNAMIC_REGISTRY, key, faults)
        elif key not in ("run", "limits"):
            faults.append(f"{key}: is no table of a configuration; it has kinematic, dynamic, run "
                          "and limits")  # fmt: skip
        elif not isinstance(table, dict):
            faults.append(f"{key}: is {table!r}; write [{key}]")
        else:
            kind = RunSettings if key == "run" else LimitOverrides
            tables[key] = from_table(kind, table, key, faults)
    if faults:
        raise _refused(path, faults)
    return Config(**tables)


def write_config(config: Config, path: str | Path) -> Path:
    """Write a configuration, complete: reading it gives it back.

    Raises:
        RpctlError: A law has no name or a setting that no file can say; the file cannot be written.
    """
    tables = {
        "kinematic": named_to_table(config.kinematic, KINEMATIC_REGISTRY),
        "dynamic": named_to_table(config.dynamic, DYNAMIC_REGISTRY),
        "run": to_table(config.run),
        "limits": to_table(config.limits),
    }
    return write_atomically(path, (HEADER + tomli_w.dumps(tables)).encode())


def _refused(path: str | Path, faults: list[str]) -> DescriptionError:
    return DescriptionError(path, [Finding("error", None, fault) for fault in faults])
