"""The laws by their names, those that have none, and what a user is told of those of a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import isabstract
from typing import Any, NoReturn

import numpy as np

from rpctl.control.balance import Balance
from rpctl.control.bandwidth import LATENESS_S, Gains, usual_gains
from rpctl.control.baselines import FeedbackLinearization, Kanayama, Samson
from rpctl.control.bounded import BoundedDynamic, IntegralDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.horizon.law import Horizon
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.obstacles import OBSTACLES, Obstacle
from rpctl.control.safeguards import require_callable
from rpctl.control.twist_law import BaseLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_known
from rpctl.files.own_code import MARK, own_file, own_thing
from rpctl.files.records import CHOICES, Choice, fields_of, read_record
from rpctl.libraries import library
from rpctl.robot.model import Robot

KINEMATIC_LAWS: dict[str, Callable[[], KinematicLaw]] = {
    "unified": UnifiedKinematic,
    "paper": PaperKinematic,
    "end-effector": EndEffector,
    "horizon": Horizon,
    "kanayama": Kanayama,
    "samson": Samson,
    "feedback-linearization": FeedbackLinearization,
}
DYNAMIC_LAWS: dict[str, Callable[[], DynamicLaw]] = {
    "paper": PaperDynamic,
    "bounded": BoundedDynamic,
    "integral": IntegralDynamic,
    "balance": Balance,
}
LAWS: dict[str, Mapping[str, Callable[[], Any]]] = {
    "kinematic": KINEMATIC_LAWS,
    "dynamic": DYNAMIC_LAWS,
}
KINEMATIC_CHOICE = Choice("kinematic law", "law", KINEMATIC_LAWS)
DYNAMIC_CHOICE = Choice("dynamic law", "law", DYNAMIC_LAWS)
OBSTACLE_CHOICE = Choice("obstacle", "shape", OBSTACLES)
CHOICES.update(  # what a setting may be, by its type
    {KinematicLaw: KINEMATIC_CHOICE, DynamicLaw: DYNAMIC_CHOICE, Obstacle: OBSTACLE_CHOICE}
)


def read_law(kind: str, given: Any) -> Any:
    """Return a law that is given, or that of a name with its default settings.

    All that takes laws reads them so. The kinematic law ``own.py:MyLaw`` is the user's own.

    Args:
        kind: ``"kinematic"`` or ``"dynamic"``.
        given: A name, a law, or a plain function.

    Raises:
        UnknownNameError: There is no such law.
        RpctlError: It is no law of this kind; the user's file cannot be run, or has no such law.
    """
    if isinstance(given, str) and MARK in given and kind == "kinematic":
        return own_law(given)()
    if isinstance(given, str):
        require_known(f"{kind} law", [given], LAWS[kind])
        return LAWS[kind][given]()
    require_callable(kind, given)
    for other in LAWS.keys() - {kind}:
        if type(given) in LAWS[other].values():
            raise RpctlError(f"{kind} is {name_of(given)}, a law for {other}=")
    return given


def own_law(name: str) -> Callable[[], BaseLaw]:
    """Return the class of a user's own law by its name, ``own.py:MyLaw``; its file is run.

    Raises:
        RpctlError: The file cannot be run, or has no such law, or one that lacks a setting.
    """
    law = own_thing(name, "a file with a law, such as own.py:MyLaw")
    path, _, word = name.rpartition(":")
    if not (isinstance(law, type) and issubclass(law, BaseLaw)) or isabstract(law):
        raise RpctlError(
            f"{path}: {word} is not a law; give a subclass of rpctl.BaseLaw that has unicycle(at)"
        )
    lacks = [key for key, each in fields_of(law).items() if each.default is dataclasses.MISSING]
    if lacks:
        raise RpctlError(f"{path}: {word} has no default for {', '.join(lacks)}; give one")
    return law


def read_own_laws(table: Any, where: str, faults: list[str]) -> Any:
    """Return a law's table of a user's file in which the laws of the user's own are made.

    Args:
        table: The table.
        where: Its place in the file.
        faults: All that is wrong with the file so far.
    """
    if not isinstance(table, Mapping):
        return table
    made = {key: read_own_laws(each, f"{where}.{key}", faults) for key, each in table.items()}
    if not isinstance(made.get("law"), str) or MARK not in made["law"]:
        return made
    try:
        law = own_law(made.pop("law"))
    except RpctlError as error:
        faults.append(f"{where}.law: {error}")
        return None
    return read_record(law, made, where, faults)


def own_digests(law: object) -> dict[str, str]:
    """Return digests of the files of a user's own laws, of a law and of those within it."""
    file = own_file(type(law))
    found = {} if file is None else {file.path: file.digest}
    for value in settings_of(law).values():
        found |= own_digests(value)
    return found


def configuration(config: Any, robot: Robot, kinematic: Any, dynamic: Any) -> Any:
    """Return a :class:`rpctl.Config`, or that of the path of a TOML, with laws that win over its.

    It is of a room below, which takes its laws from here: so it is looked for when it is asked for.
    """
    found = library("rpctl.simulation.config").as_config(config, robot)
    return found.with_laws(kinematic, dynamic)


OBSTACLE_NAMES = {kind: name for name, kind in OBSTACLES.items()}


@dataclass(frozen=True)
class Unregistered:
    """A law or an obstacle that rpctl has no name for; it cannot be started.

    Attributes:
        name: Name of its class or function.
        settings: Its settings by name: numbers, texts, tuples, mappings, discs and half-planes;
            all else, laws as well, is unregistered in turn.
    """

    name: str
    settings: Mapping[str, object] = field(default_factory=dict)

    def named_table(self, key: str) -> dict[str, Any]:
        """Return what a run's file says of it."""
        return {key: self.name, "settings": to_json(self.settings)}

    def start(self, *_: object) -> NoReturn:
        """Refuse to start.

        Raises:
            RpctlError: Always.
        """
        raise RpctlError(
            f"only the name of the law {self.name} is known, not its code; give the law itself"
        )


def unregistered(thing: object) -> Unregistered:
    """Return the name of a law, an obstacle or a function, and its settings if it has fields."""
    if isinstance(thing, Unregistered):
        return thing
    settings = {name: _plain(value) for name, value in settings_of(thing).items()}
    return Unregistered(name_of(thing), settings)


def name_of(thing: object) -> str:
    """Return the name of a law's or an obstacle's class, or of a function."""
    if isinstance(thing, Unregistered):
        return thing.name
    return str(getattr(thing, "__name__", type(thing).__name__))


def settings_of(thing: object) -> Mapping[str, object]:
    """Return the settings of a law or an obstacle by name; nothing if it has no fields."""
    if isinstance(thing, Unregistered):
        return thing.settings
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        return {item.name: getattr(thing, item.name) for item in dataclasses.fields(thing)}
    return {}


def to_json(value: object) -> Any:
    """Return what JSON says of an :class:`Unregistered`, or of one of its settings."""
    if isinstance(value, Unregistered):
        return {"law": value.name, "settings": to_json(value.settings)}
    if type(value) in OBSTACLE_NAMES:
        return {"shape": OBSTACLE_NAMES[type(value)], **vars(value)}  # type: ignore[index]
    if isinstance(value, Mapping):
        return {key: to_json(each) for key, each in value.items()}
    return [to_json(each) for each in value] if isinstance(value, tuple) else value


def from_json(value: Any) -> Any:
    """Return what :func:`to_json` took apart."""
    if isinstance(value, list):
        return tuple(map(from_json, value))
    if not isinstance(value, Mapping):
        return value
    for key in ("shape", "law"):
        if isinstance(value.get(key), str):
            rest = {name: each for name, each in value.items() if name != key}
            return _named_from_json(value[key], from_json(rest.get("settings", rest)))
    return {key: from_json(each) for key, each in value.items()}


def _named_from_json(name: str, settings: Mapping[str, Any]) -> object:
    """Return an obstacle, or what there is no name for."""
    try:
        return OBSTACLES[name](**settings)
    except (TypeError, KeyError, RpctlError):
        return Unregistered(name, settings)


def _plain(value: object) -> object:
    """Return a setting as :class:`Unregistered` holds it."""
    if (
        value is None
        or isinstance(value, str | bool | int | float)
        or type(value) in OBSTACLE_NAMES
    ):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list | np.ndarray):
        return tuple(map(_plain, value))
    return value.item() if isinstance(value, np.generic) else unregistered(value)


IGNORED = "limits of efforts, rates and positions, and the sampling"
LIMITLESS = "ignores limits of speeds, rates and positions"
UNLEASHED = "has no leash (large errors cause high speeds)"
LINE = "does not reduce the lateral error on a straight line"
GAIN_SYMBOLS = {"horizon": ("h", "s"), "horizon_dyn": ("h1", "s"), "gain": ("k", "1/s")}


def law_sentences(
    dynamics: ReducedDynamics, kinematic: object, dynamic: object, period: float
) -> tuple[str, ...]:
    """Return sentences on the laws: what those of the paper ignore, how fast the others are.

    Args:
        dynamic: The dynamic law; None where speeds are the output.
        period: Control period, s.
    """
    base = kinematic.base if isinstance(kinematic, EndEffector) else kinematic
    found = []
    if isinstance(base, PaperKinematic):
        found.append(_paper_kinematic(base, dynamics.robot))
    if isinstance(dynamic, PaperDynamic):
        ignored = IGNORED if not dynamic.midpoint else IGNORED.partition(", and")[0]
        found.append(f"the paper's dynamic law ignores {ignored}")
    elif isinstance(dynamic, BoundedDynamic | IntegralDynamic):
        found.append(_gains_as_set(base, dynamic, period))
    return tuple(found)


def _paper_kinematic(law: PaperKinematic, robot: Robot) -> str:
    """Return what the paper's kinematic law does not do, on this robot."""
    rest = [UNLEASHED] if law.leash is None and robot.drive.base_speeds else []
    rest += [LINE] if robot.drive.base_speeds and not robot.drive.omnidirectional else []
    *first, last = [LIMITLESS, *rest]
    return f"the paper's kinematic law {', '.join(first)}{' and ' * bool(first)}{last}"


def _gains_as_set(base: object, dynamic: BoundedDynamic | IntegralDynamic, period: float) -> str:
    """Return the gains in one sentence: those of the period, and those that are set."""
    settings = {**vars(getattr(dynamic, "inner", dynamic)), **vars(dynamic)}
    if isinstance(base, BaseLaw):
        settings |= vars(base)
    if isinstance(base, PaperKinematic):
        settings["joint_horizon"] = base.joint_horizon or base.horizon
    given = [
        f"{who} {symbol} {settings[key]:.2g} {unit}"
        for name, (symbol, unit) in GAIN_SYMBOLS.items()
        for who, key in (("base", name), ("joints", f"joint_{name}"))
        if settings.get(key) is not None
    ]
    as_set = f"; as set: {', '.join(given)}" if given else ""
    return f"{gains_sentence(usual_gains(period))}{as_set}"


def gains_sentence(gains: Gains) -> str:
    """Return the gains that a control period leaves, in one sentence."""
    bandwidth, h, h1, k = gains
    return (
        f"gains: {bandwidth:.2g} Hz (h {h:.2g} s, h1 {h1:.2g} s, k {k:.2g} 1/s), as half a period "
        f"and {1e3 * LATENESS_S:g} ms of delay allow"
    )
