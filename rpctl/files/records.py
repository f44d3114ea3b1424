"""Typed records: one frozen dataclass is a group of settings, their types, units, ranges and words.

    @dataclass(frozen=True)
    class Brake(Record):
        time: Annotated[float, POSITIVE, Setting("s", "brake time", "Until the robot stands.")] = .1
        shape: Annotated[str, OneOf("disc", "drum")] = "disc"
        weights: Annotated[Mapping[str, float], NOT_NEGATIVE] = field(default_factory=dict)

A record refuses what is out of range when it is made, all of it at once. Files are read and written
from the same fields:

- ``read_record(kind, data, where, faults)`` makes one of JSON's or TOML's tables, or returns None
  and adds all that is wrong, each with its place, to ``faults``;
- ``read_toml(path, kind, what)`` does it for a whole file and raises with the lines;
- ``to_plain(record)`` is the way back, for JSON or TOML, without what is None by default;
- ``json_schema(kind)`` is what editors complete a file from;
- ``settings_of(record or kind)`` are all numbers and words in it by dotted name, with their
  ``Setting`` and range; ``fields_of(kind)`` those of one record.

A record that may be None is switched off by ``false`` in a file. What a field of a type in
``CHOICES`` may be is named in its table: ``law = "horizon"``. ``IN_PYTHON`` marks a field that no
file can say. Types are float, int, bool, str, Literal, records, Mapping, tuple, and Any as it is.

pydantic would check the types, a third of this; ranges of what Python makes, tables that name their
class, ``false`` for none, and faults in words that end in a way out would be written around it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from rpctl.errors import LARGEST, SMALLEST, RpctlError, UnknownNameError
from rpctl.files import toml
from rpctl.files.own_code import own_file

Made = TypeVar("Made")
Plain = dict[str, Any]


SIGNED = "a positive number"  # what a range wants where the sign is wrong, not the magnitude


@dataclass(frozen=True)
class Setting:
    """The meaning of a field of a record, given as ``Annotated[TYPE, Setting(...)]``.

    Attributes:
        unit: Unit in SI, or empty.
        label: Name of the field in a report.
        help: One sentence for help texts.
        metavar: Placeholder on the command line; empty: one that follows from the type.
    """

    unit: str = ""
    label: str = ""
    help: str = ""
    metavar: str = dataclasses.field(default="", kw_only=True)


@dataclass(frozen=True)
class Range:
    """The numbers that a field may have, ends included.

    Attributes:
        low: The least.
        high: The most.
        wanted: Them in words, where the ends do not say it best.
        below: Whether the most is excluded.
        or_zero: Whether 0 is one of them, too.
    """

    low: float = -LARGEST
    high: float = LARGEST
    wanted: str = ""
    below: bool = False
    or_zero: bool = False

    def fault(self, name: str, value: Any) -> str:
        """Return why a value is refused; empty if it is not."""
        inside = self.low <= value <= self.high and not (self.below and value == self.high)
        if inside or (self.or_zero and value == 0.0):
            return ""
        signed = self.wanted == SIGNED and 0.0 < value < math.inf  # its magnitude is wrong
        ends = f"numbers from {self.low:g} to {self.high:g}"
        return f"{name} is {value:g}; give {ends if signed or not self.wanted else self.wanted}"


@dataclass(frozen=True)
class OneOf:
    """The words that a field may be."""

    words: tuple[str, ...]

    def fault(self, name: str, value: Any) -> str:
        """Return why a word is refused; empty if it is not."""
        if value in self.words:
            return ""
        return f'{name} is "{value}"; give {" or ".join(self.words)}'


POSITIVE = Range(SMALLEST, LARGEST, SIGNED)
POSITIVE_OR_NONE = Range(SMALLEST, LARGEST, SIGNED, or_zero=True)
NOT_NEGATIVE = Range(0.0, LARGEST, "0 or more")
WITHIN = Range()
SHARE = Range(0.0, 1.0, "a fraction from 0 to less than 1", below=True)
IN_PYTHON = Setting(label="a file cannot store it")


class Choice(NamedTuple):
    """The classes that a table can name: laws, or obstacles."""

    label: str
    key: str  # of the name
    factories: Mapping[str, Callable[..., Any]]  # by name


CHOICES: dict[object, Choice] = {}  # by the type of a field; rpctl.control.registry has them
TYPE_LABELS: dict[object, str] = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}


class OutOfRangeError(RpctlError):
    """Settings that are out of range.

    Attributes:
        faults: Each of them in words.
    """

    def __init__(self, faults: list[str]) -> None:
        self.faults = faults
        super().__init__("; ".join(faults))


class Record:
    """Base of the dataclasses whose fields say what they may be."""

    of: ClassVar[str] = ""  # what messages say before a field's name: "noise of "

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        faults = list(_range_faults(self))
        if faults:
            raise OutOfRangeError(faults)


class FieldType(NamedTuple):
    """A field: its type without what is said of it, and that."""

    name: str
    type: Any
    limit: Range | OneOf | None
    setting: Setting
    default: Any


@cache
def fields_of(kind: Any) -> dict[str, FieldType]:
    """Return the fields of a record's class that can be given, by name."""
    hints = get_type_hints(kind, include_extras=True)
    made = {item.name: item for item in dataclasses.fields(kind) if item.init}
    return {name: _field(item, hints[name]) for name, item in made.items()}


def _field(item: dataclasses.Field[Any], hint: Any) -> FieldType:
    said = hint.__metadata__ if get_origin(hint) is Annotated else ()
    limit = next((each for each in said if isinstance(each, Range | OneOf)), None)
    setting = next((each for each in said if isinstance(each, Setting)), Setting())
    default = item.default
    if item.default_factory is not dataclasses.MISSING:
        default = item.default_factory()
    return FieldType(item.name, get_args(hint)[0] if said else hint, limit, setting, default)


def settings_of(record: Any, above: str = "") -> dict[str, FieldType]:
    """Return all settings in a record by dotted name.

    Args:
        record: A record, or its class; only a record has the settings of the laws in it.
        above: What the names begin with.
    """
    kind = record if isinstance(record, type) else type(record)
    settings: dict[str, FieldType] = {}
    for name, each in fields_of(kind).items():
        value = None if isinstance(record, type) else getattr(record, name)
        inner = value if value is not None else _plain_type(each.type)
        if dataclasses.is_dataclass(inner):
            settings |= settings_of(inner, f"{above}{name}.")
        elif each.setting is not IN_PYTHON:
            settings[f"{above}{name}"] = each
    return settings


def _range_faults(record: Any) -> Iterator[str]:
    kind: Any = type(record)
    for name, each in fields_of(kind).items():
        value = getattr(record, name)
        if each.limit is None or value is None or isinstance(value, bool):
            continue
        if isinstance(value, Mapping):
            items = [(f"{name} of {key}", given) for key, given in value.items()]
        else:
            items = [(f"{record.of}{name}", value)]
        for label, given in items:
            for number in given if isinstance(given, tuple | list) else (given,):
                if isinstance(number, str) != isinstance(each.limit, OneOf):
                    continue  # a word beside numbers, as "auto"
                if fault := each.limit.fault(label, number):
                    yield fault


def read_toml(path: str | Path, kind: Callable[..., Made], what: str) -> Made:
    """Return the record that a TOML file holds.

    Args:
        path: The file.
        kind: The record's class.
        what: What the file is, in words: ``"a drive file"``.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    # It raises where there is no record, for then there are faults.
    return toml.read(path, lambda data, faults: read_record(kind, data, "", faults), what)  # type: ignore[return-value]


def read_record(
    kind: Callable[..., Made], data: Mapping[str, Any], where: str, faults: list[str]
) -> Made | None:
    """Return the record of a table, or None; what is wrong is added to the faults.

    Args:
        kind: The record's class.
        data: Any of its settings; the others keep their defaults, if they have any.
        where: Place of the table in the file: ``kinematic.base_obstacles[1]``; empty at its top.
        faults: All that is wrong with the file so far.
    """
    known, before, given = fields_of(kind), len(faults), dict[str, Any]()
    names = [name for name, each in known.items() if each.setting is not IN_PYTHON]
    for key, value in data.items():
        place = f"{where}.{key}" if where else key
        if key not in names:
            faults.append(f"{place}: {UnknownNameError('setting', key, names)}")
            continue
        count = len(faults)
        made = _read(value, known[key].type, place, faults)
        if len(faults) == count:
            given[key] = made
    missing = [n for n in names if known[n].default is dataclasses.MISSING and n not in data]
    if missing:
        faults.append(f"{where}{': ' * bool(where)}missing: {', '.join(missing)}")
        return None
    try:
        record = kind(**given)  # even if a fault is known: there may be another
    except RpctlError as error:
        several = error.faults if isinstance(error, OutOfRangeError) else [str(error)]
        faults += [f"{where}: {fault}" if where else fault for fault in several]
        return None
    except TypeError:  # a needed setting is among the faults
        return None
    return record if len(faults) == before else None


def _read(value: Any, hint: Any, where: str, faults: list[str]) -> Any:
    """Return the value that a file's stands for, or None; what is wrong is added to the faults."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _read(value, arguments[0], where, faults)
    if hint in CHOICES:
        return read_choice(value, CHOICES[hint], where, faults)
    if origin in (Union, UnionType):
        if (value is False and _may_be_off(hint)) or (value is None and NoneType in arguments):
            return None
        known = type(value) if type(value) in arguments else _plain_type(hint)
        return _read(value, known, where, faults)
    if dataclasses.is_dataclass(hint) or _is_mapping(origin):
        if not isinstance(value, Mapping):
            faults.append(f"{where}: is {value!r}; write {_head(where)}")
            return None
        if not _is_mapping(origin):
            return read_record(hint, value, where, faults)
        return {k: _read(v, arguments[1], f"{where}.{k}", faults) for k, v in value.items()}
    if origin is tuple:
        return _read_tuple(value, arguments, where, faults)
    return _read_scalar(value, hint, where, faults)


def _read_tuple(value: Any, arguments: tuple[Any, ...], where: str, faults: list[str]) -> Any:
    """Return a row of values, or of tables."""
    tables = arguments[0] in CHOICES or dataclasses.is_dataclass(arguments[0])
    if tables and isinstance(value, list):
        places = enumerate(value, start=1)
        return tuple(_read(each, arguments[0], f"{where}[{k}]", faults) for k, each in places)
    if isinstance(value, list):
        kinds = arguments[:1] * len(value) if arguments[-1] is ... else arguments
        if len(value) == len(kinds):
            return tuple(_read(*each, where, faults) for each in zip(value, kinds, strict=True))
    wanted = "some" if arguments[-1] is ... else len(arguments)
    way = f"write [[{where}]]" if tables else f"give {wanted} numbers, [0.1, ...]"
    faults.append(f"{where}: is {value!r}; {way}")
    return None


def _read_scalar(value: Any, hint: Any, where: str, faults: list[str]) -> Any:
    """Return a number, a word or a truth, or None; what is wrong is added to the faults."""
    if hint is Any:
        return value
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            faults.append(f"{where}: is {value!r}; give one of {', '.join(get_args(hint))}")
        return value
    allowed = (int, float) if hint is float else (hint,)
    if hint not in TYPE_LABELS:
        faults.append(f"{where}: a file cannot store it; leave it out")
    elif not isinstance(value, allowed) or (isinstance(value, bool) and hint is not bool):
        faults.append(f"{where}: is {value!r}; give {TYPE_LABELS[hint]}")
    else:
        return hint(value)
    return None


def read_choice(data: Any, choice: Choice, where: str, faults: list[str]) -> Any:
    """Return the law or obstacle that a table names, or None; what is wrong joins the faults.

    Args:
        data: Its name and any of its settings.
        choice: What it may be.
        where: Place of the table in the file.
        faults: All that is wrong with the file so far.
    """
    if hasattr(data, "named_table") or own_file(type(data)):
        return data
    key = choice.key
    if not isinstance(data, Mapping) or not isinstance(data.get(key), str):
        faults.append(
            f"{where}: names no {key}; write {_head(where)}, then "
            f'{key} = "{next(iter(choice.factories))}"'
        )
        return None
    if data[key] not in choice.factories:
        faults.append(
            f"{where}.{key}: {UnknownNameError(choice.label, data[key], choice.factories)}"
        )
        return None
    settings = {name: value for name, value in data.items() if name != key}
    return read_record(choice.factories[data[key]], settings, where, faults)


class _NoPlainValue(Exception):
    """A value that no file can hold; it never leaves this file."""


def to_plain(record: Any) -> Plain:
    """Return a record as a table of JSON or TOML, without the settings that are None by default.

    Raises:
        RpctlError: A setting cannot be said in a file.
    """
    kind: Any = type(record)
    table: Plain = {}
    for name, each in fields_of(kind).items():
        value = getattr(record, name)
        try:
            table[name] = _plain(value, NoneType if each.setting is IN_PYTHON else each.type)
        except _NoPlainValue:
            if each.default is dataclasses.MISSING and not value:
                table[name] = None if value is None else []  # which JSON can say
            elif value is None and _may_be_off(each.type) and each.default is not None:
                table[name] = False
            elif value != each.default:
                raise RpctlError(
                    f"{type(record).__name__}.{name} is {value!r}, which a file cannot store"
                ) from None
    return table


def choice_to_plain(thing: object, choice: Choice) -> Plain:
    """Return the name and settings of a law or an obstacle.

    Raises:
        RpctlError: Its class has no name, or a file cannot hold one of its settings.
    """
    for name, known in choice.factories.items():
        if type(thing) is known:
            return {choice.key: name, **to_plain(thing)}
    if hasattr(thing, "named_table"):
        return thing.named_table(choice.key)
    if file := own_file(type(thing)):
        return {choice.key: f"{file.path}:{type(thing).__name__}", **to_plain(thing)}
    raise RpctlError(
        f"{type(thing).__name__} is none of {', '.join(choice.factories)}; a file cannot name it"
    )


def _plain(value: Any, hint: Any) -> Any:
    """Return what a file holds of a value."""
    if hint is Any:
        return value
    if get_origin(hint) in (Union, UnionType) and value is not None:
        hint = _plain_type(hint)
    if hint in CHOICES:
        return choice_to_plain(value, CHOICES[hint])
    if dataclasses.is_dataclass(hint):
        return to_plain(value)
    if isinstance(value, Mapping):
        inner = get_args(hint)[1]
        return {key: _plain(each, inner) for key, each in value.items()}
    if isinstance(value, tuple | list) and value:
        inner = get_args(hint)
        kinds = inner[:1] * len(value) if inner[-1] is ... else inner
        return [_plain(*each) for each in zip(value, kinds, strict=True)]
    if isinstance(value, str | float | int):
        return value
    raise _NoPlainValue


def _plain_type(hint: Any) -> Any:
    """Return T of ``T | None``, and the first of other unions."""
    if get_origin(hint) not in (Union, UnionType):
        return hint
    return next(each for each in get_args(hint) if each is not NoneType)


def _may_be_off(hint: Any) -> bool:
    """Return whether a setting is a record or None, for which a file says ``false``."""
    return NoneType in get_args(hint) and dataclasses.is_dataclass(_plain_type(hint))


def _is_mapping(origin: Any) -> bool:
    return isinstance(origin, type) and issubclass(origin, Mapping)


def _head(where: str) -> str:
    return f"[[{where[: where.index('[')]}]]" if "[" in where else f"[{where}]"


def json_schema(kind: Any) -> Plain:
    """Return the JSON Schema (draft 2020-12) of a record, with units, ranges and words."""
    defined: Plain = {}
    return {**_object_schema(kind, defined), "$defs": defined}


def _object_schema(kind: Any, defined: Plain) -> Plain:
    properties: Plain = {}
    for name, each in fields_of(kind).items():
        if each.setting is IN_PYTHON:
            continue
        words = [each.setting.help, each.setting.unit and f"[{each.setting.unit}]"]
        schema = _type_schema(each.type, each.limit, defined)
        if any(words):
            schema["description"] = " ".join(word for word in words if word)
        if isinstance(each.default, str | float | int):
            schema["default"] = each.default
        properties[name] = schema
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _type_schema(hint: Any, limit: Range | OneOf | None, defined: Plain) -> Plain:
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in CHOICES:
        key, named = CHOICES[hint].key, CHOICES[hint].factories.items()
        return {"anyOf": [_referred(k, defined, **{key: {"const": n}}) for n, k in named]}
    if origin in (Union, UnionType):
        kinds = [each for each in arguments if each is not NoneType]
        known = [each for each in kinds if each in TYPE_LABELS] or [_plain_type(hint)]
        schemas = [_type_schema(each, limit, defined) for each in known]
        schemas += [{"const": False}] * _may_be_off(hint)
        return schemas[0] if len(schemas) == 1 else {"anyOf": schemas}
    if dataclasses.is_dataclass(hint):
        return _referred(hint, defined)
    if _is_mapping(origin):
        values = _type_schema(arguments[1], limit, defined)
        return {"type": "object", "additionalProperties": values}
    if origin is tuple:
        size = (
            {} if arguments[-1] is ... else dict.fromkeys(("minItems", "maxItems"), len(arguments))
        )
        return {"type": "array", "items": _type_schema(arguments[0], limit, defined), **size}
    schema: Plain = {"type": {float: "number", int: "integer", bool: "boolean"}.get(hint, "string")}
    if isinstance(limit, OneOf):
        schema["enum"] = [*limit.words]
    elif limit is not None and hint in (float, int):
        end = "exclusiveMaximum" if limit.below else "maximum"
        schema |= {"minimum": limit.low, end: limit.high}
    return schema


def _referred(kind: Any, defined: Plain, **named: Plain) -> Plain:
    """Return a reference to a record's schema, which has the key that names it besides."""
    name = kind.__name__
    if name not in defined:
        defined[name] = {}  # it may hold itself
        schema = _object_schema(kind, defined)
        defined[name] |= {**schema, "properties": {**named, **schema["properties"]}}
    return {"$ref": f"#/$defs/{name}"}
