"""What is said of the arguments and variables of a file of xacro: missing, unknown, or declared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from rpctl.description.expansion_answer import ENVIRONMENT, Answer
from rpctl.description.findings import excerpt
from rpctl.description.read_settings import ReadSettings
from rpctl.errors import Finding, format_finding


@dataclass(frozen=True)
class XacroArgument:
    """An argument that a file of xacro declares.

    Attributes:
        name: Its name.
        default: What it is if nobody gives it, as it is written; None: somebody has to.
        file: The file that declares it.
        line: The line there.
    """

    name: str
    default: str | None
    file: str
    line: int


def declared_arguments(answer: Answer) -> tuple[XacroArgument, ...]:
    """Return the arguments that an answer tells; of one declared twice, the first counts."""
    found: dict[str, XacroArgument] = {}
    for each in answer["arguments"]:
        found.setdefault(each[0], XacroArgument(*each))
    return tuple(found.values())


def missing_argument(path: Path, answer: Answer) -> list[str]:
    """Return the lines of the message on an argument that nobody gives, with those declared."""
    name, declared = answer["argument"], declared_arguments(answer)
    names = [each.name for each in declared]
    hint = _nearest(name, names) if name not in names else ", for it is declared too late"
    fault = f'xacro: argument "{excerpt(name)}" has no value; add {name}:=VALUE{hint}'
    place = str(answer.get("file") or path)
    lines = [format_finding(place, Finding("error", answer["line"], fault))]
    return lines + listed(declared)


def missing_variable(path: Path, answer: Answer) -> list[str]:
    """Return the message on a variable of the environment that nobody gives."""
    name = excerpt(answer["variable"])
    fault = f'xacro: environment variable "{name}" has no value, for a file sees none of yours'
    finding = Finding("error", answer.get("line"), f"{fault}; add {ENVIRONMENT}{name}:=VALUE")
    return [format_finding(str(answer.get("file") or path), finding)]


def unused_arguments(path: Path, answer: Answer, settings: ReadSettings) -> list[str]:
    """Return the lines of the message on given arguments that nothing declares or looks up.

    Args:
        path: The file.
        answer: Of the process that expanded it.
        settings: How it was expanded.
    """
    declared = declared_arguments(answer)
    names = [each.name for each in declared]
    variables = [name for name in settings.xacro_args if name.startswith(ENVIRONMENT)]
    strange = [name for name in variables if name.removeprefix(ENVIRONMENT) not in answer["asked"]]
    unknown = [name for name in answer["unused"] if name not in names]
    lines = [
        format_finding(
            str(path),
            Finding("error", None, f'no file declares the argument "{excerpt(name)}"'
                    f"{_nearest(name, names) or '; leave it out'}"),
        )
        for name in unknown
    ]  # fmt: skip
    lines += [] if lines == [] else listed(declared)
    for name in strange:
        fault = f'no expression asks for "{excerpt(name)}"'
        fault += (
            _nearest(name, [ENVIRONMENT + each for each in answer["asked"]]) or "; leave it out"
        )
        lines.append(format_finding(str(path), Finding("error", None, fault)))
    return lines


def listed(declared: Iterable[XacroArgument]) -> list[str]:
    """Return a line for each argument that is declared."""
    return [
        format_finding(
            each.file,
            Finding("info", each.line, f"declares {each.name}, " + (
                "without a default" if each.default is None
                else f'which is "{excerpt(each.default)}" by default')),
        )
        for each in declared
    ]  # fmt: skip


def _nearest(name: str, names: Iterable[str]) -> str:
    near = get_close_matches(name, list(names), n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
