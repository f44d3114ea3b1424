"""The header of a run's file: all that a run is besides its samples, one record of records."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin, get_type_hints

from rpctl.control.registry import DYNAMIC_CHOICE, KINEMATIC_CHOICE, from_json, unregistered
from rpctl.errors import RpctlError
from rpctl.files.records import CHOICES, Choice, choice_to_plain
from rpctl.reference.sizing import Sizing
from rpctl.simulation.config import Config, delay_periods
from rpctl.simulation.merits.collision_facts import CollisionFacts
from rpctl.simulation.run.facts import GroundFacts, RobotFacts

MAX_CHARACTERS = 100_000  # of one text
MAX_ITEMS = 100_000  # of one list or mapping
MAX_FAULTS = 10
SURROGATES = re.compile("[\ud800-\udfff]")  # halves of characters: no text; a path may hold them
FILES = ("robot.urdf",)  # texts of any length
PATHS = (  # texts that may stand for bytes which are no text
    *FILES, "robot.source", "robot.package_dirs", "robot.xacro_args", "config.run.reference",
    "certificate", "config.kinematic", "config.dynamic",
)  # fmt: skip
LIMITS = (  # numbers that may be infinite
    "robot.effort_limits", "robot.velocity_limits", "robot.lower_limits", "robot.upper_limits",
    "robot.steering_limits", "robot.other_limits",
)  # fmt: skip
FIGURES = (  # and those that may be no number, too
    "kinematic_report", "certificate", "recording", "perturbed", "config.kinematic",
    "config.dynamic",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Header:
    """A run without its samples.

    Attributes:
        robot: The robot.
        ground: How it stands on the ground.
        config: Reference, laws, sample times and plant, all as they were simulated; a law of
            somebody's own is :class:`~rpctl.control.registry.Unregistered`.
        bound_limits: Joint and kind of each limit that ever bound the efforts.
        controller_model: Name of the robot that the controller computed with; None: this one.
        kinematic_report: What the kinematic law counted, by name.
        notes: Where the configuration is not what was asked for, in sentences.
        certificate: The certificate of the robot's dynamics, as a dict, or None.
        wall_time: What the simulation took, s.
        sizing: How large and fast its named reference is, and why; None of others.
        recording: What became of the rows of its reference's table and what they ask beyond the
            limits, as a dict; None of another reference.
        perturbed: What became of the run with a perturbed plant, as a dict, or None.
        collisions: How near its links came to things, and what they ran into; None where that was
            not looked for.
        law_sentences: What its laws ignore and how fast they are.
    """

    robot: RobotFacts
    ground: GroundFacts
    config: Config
    bound_limits: tuple[tuple[str, str], ...] = ()
    controller_model: str | None = None
    kinematic_report: Mapping[str, float]
    notes: tuple[str, ...] = ()
    certificate: Mapping[str, Any] | None = None
    wall_time: float
    sizing: Sizing | None = None
    recording: Mapping[str, Any] | None = None
    perturbed: Mapping[str, Any] | None = None
    collisions: CollisionFacts | None = None
    law_sentences: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what no run says."""
        for name in ("recording", "perturbed"):
            told = getattr(self, name)
            if told is not None and not isinstance(told.get("sentence"), str):
                raise RpctlError(f"{name} has no sentence")

    def sizes(self) -> dict[Any, int]:
        """Return how many there are of what a log's arrays have a column for."""
        robot, ground = self.robot, self.ground
        return {
            "q": robot.nq,
            "nu": len(robot.quasi_velocities),
            "actuators": len(robot.actuators),
            "joints": len(robot.joint_names),
            "e": 3 + len(robot.joint_names),
            "steering": len(robot.steering_names),
            "others": len(robot.other_names),
            "wheels_ref": len(robot.wheels_ref),
            "bound_limits": len(self.bound_limits),
            "contacts": len(ground.contacts),
            "wheels": ground.wheels,
            "axles": len(ground.axles),
        }


def recorded(config: Config, periods: int) -> Config:
    """Return a configuration as a run keeps it: as it was simulated, and what a file can hold.

    Args:
        config: What was asked for.
        periods: Number of control periods that were simulated.
    """
    run, plant = config.run, config.plant
    plant = dataclasses.replace(
        plant,
        kind=plant.kind if plant.own is None else "own",
        delay=delay_periods(config.delay, run.control_period) * run.control_period,
        controller_model=None,
        own=None,
    )
    return dataclasses.replace(
        config,
        kinematic=recordable(config.kinematic, KINEMATIC_CHOICE),
        dynamic=recordable(config.dynamic, DYNAMIC_CHOICE),
        run=dataclasses.replace(
            run,
            duration=periods * run.control_period,
            initial_error=tuple(map(float, run.initial_error)),  # type: ignore[arg-type]
        ),
        plant=plant,
    )


def recordable(law: Any, kind: Choice) -> Any:
    """Return a law as a run keeps it: what a file cannot name, in it or itself, is unregistered.

    Args:
        law: A law, or an obstacle of one.
        kind: Which of them it is.
    """
    if type(law) not in kind.factories.values():
        return unregistered(law)
    changes: dict[str, object] = {}
    for name, hint in get_type_hints(type(law)).items():
        value = getattr(law, name)
        if hint in CHOICES:
            changes[name] = recordable(value, CHOICES[hint])
        elif get_origin(hint) is tuple and get_args(hint)[0] in CHOICES:
            changes[name] = tuple(recordable(v, CHOICES[get_args(hint)[0]]) for v in value)
    try:
        found = dataclasses.replace(law, **changes)
        choice_to_plain(found, kind)
    except RpctlError:  # a setting that no file can say
        return unregistered(law)
    return found


def require_plain(header: dict[str, Any]) -> list[str]:
    """Return what is wrong with a header's texts, numbers and sizes, whatever they are for."""
    faults: list[str] = []
    _walk(header, "", faults)
    if isinstance(config := header.get("config"), dict):
        header["config"] = {name: _with_unregistered(table) for name, table in config.items()}
    return faults


def _walk(value: Any, where: str, faults: list[str]) -> None:
    """Add what is wrong with a value of JSON, and what is in it, to the faults."""
    if len(faults) >= MAX_FAULTS:
        return
    if isinstance(value, str):
        faults += _text_faults(value, where)
    elif isinstance(value, dict | list):
        if len(value) > MAX_ITEMS:
            faults.append(f'entry "{where}" has over {MAX_ITEMS} items')
            return
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, each in pairs:
            place = f"{where}.{key}" if where else str(key)
            if isinstance(key, str) and _text_faults(key, where):
                faults.append(f'entry "{where}" has a name that is not text')
            _walk(each, place if isinstance(value, dict) else where, faults)
    elif isinstance(value, float) and not math.isfinite(value):
        is_limit = math.isinf(value) and where.startswith(LIMITS)
        if not is_limit and not where.startswith(FIGURES):
            faults.append(f'entry "{where}" is {value}; it must be a finite number')


def _text_faults(text: str, where: str) -> list[str]:
    if "\0" in text or (len(text) > MAX_CHARACTERS and where not in FILES):
        return [f'entry "{where}" must be a text of at most {MAX_CHARACTERS} characters']
    if SURROGATES.search(text):
        try:
            text.encode("utf-8", "surrogateescape")
        except UnicodeEncodeError:
            return [f'entry "{where}" must be a text']
        if not where.startswith(PATHS):
            return [f'entry "{where}" must be a text']
    return []


def _with_unregistered(value: Any) -> Any:
    """Return a table in which those of laws and obstacles without a name are replaced."""
    if isinstance(value, list):
        return [_with_unregistered(each) for each in value]
    if not isinstance(value, dict):
        return value
    if "settings" in value:
        return from_json(value)
    return {key: _with_unregistered(each) for key, each in value.items()}
