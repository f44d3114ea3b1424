"""What is said of an expansion: missing packages, arguments and variables, and what is left out."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any

from rpctl.description.packages import DECLARE, find_packages
from rpctl.description.records import ReadSettings
from rpctl.description.urdf.findings import excerpt
from rpctl.description.xacro.files import ENVIRONMENT, Answer
from rpctl.errors import Finding, RpctlError, format_finding, printable

WARNING_PREFIX = "warning: "  # how xacro begins one; the lines after it tell the place
RUN_IT = "correct it, or run `xacro` on the file yourself"
MAX_CHOICES = 20  # values of an argument that a message lists
MAX_LISTED = 1000  # names in a folder that are looked at

Place = tuple[str, int | None]  # a file and a line


class ExpansionError(RpctlError):
    """A file of xacro that cannot be expanded."""


def say(place: Path | str, line: int | None, text: str, severity: str = "error") -> str:
    """Return a line of a message."""
    return format_finding(str(place), Finding(severity, line, text))


def refusal(path: Path, fault: str) -> ExpansionError:
    """Return the error that says what is wrong, and how to mend it."""
    return ExpansionError(say(path, None, fault))


def refuse_faults(path: Path, answer: Answer, settings: ReadSettings) -> None:
    """Raise what an answer says to be wrong, missing packages all at once.

    Raises:
        ExpansionError: Something is wrong.
    """
    wants = [w for w in answer["wants"] if w[3] != "text"]
    lines = []
    if wants and not settings.ignore_missing_packages:
        lines += _missing_packages(path, answer, settings)
    if "argument" in answer:
        lines += missing_argument(path, answer, settings)
    elif "variable" in answer:
        name = excerpt(answer["variable"])
        fault = (
            f'xacro: environment variable "{name}" has no value, as the file cannot read your '
            f"environment; add {ENVIRONMENT}{name}:=VALUE"
        )
        lines.append(say(answer.get("file") or path, answer.get("line"), fault))
    elif "error" in answer and not lines:
        lines += _fault(path, answer)
    elif not lines:
        lines += unused_arguments(path, answer, settings)
        lines += [
            say(_short(file, path), line, f"<{tag}> is a xacro element without its prefix, which "
                                          f"xacro would drop; write <xacro:{tag} …>")
            for file, tag, line in answer["plain"]
        ]  # fmt: skip
        if not lines and answer["defined"] and "<link" not in answer["text"]:
            lines.append(_uncalled(path, answer["defined"]))
    if lines:
        raise ExpansionError("\n".join(lines))


def findings_of(path: Path, answer: Answer, settings: ReadSettings) -> tuple[Finding, ...]:
    """Return what else an answer says: xacro's warnings, what was left out, odd declarations."""
    warnings = [
        *(
            f"xacro: {line.removeprefix(WARNING_PREFIX)}"
            for line in answer["told"].splitlines()
            if line.startswith(WARNING_PREFIX)
        ),
        *(
            f"{_short(file, path)} does not declare the prefix xacro; "
            'add xmlns:xacro="http://www.ros.org/wiki/xacro" to <robot>'
            for file in answer["undeclared"]
        ),
        *_left_out(path, answer),
        *filter(None, [answer["open"]]),
    ]
    texts = [w for w in answer["wants"] if w[3] == "text"]
    ours = {*os.environ}  # looked up by text: no variable has any name that a file may ask for
    notes = [
        *(
            f'argument "{name}" is used before it is declared; xacro uses its default'
            for name in answer["early"]
        ),
        *(
            f'environment variable "{name}" is hidden from the file; add '
            f"{ENVIRONMENT}{name}:=VALUE if it needs it"
            for name in answer["asked"]
            if name in ours and ENVIRONMENT + name not in settings.xacro_args
        ),
        *(
            f'package "{package}" was not found; only text refers to it ({_places(places, path)})'
            for package, places in _by_name(texts).items()
        ),
        *(
            f'"{path}" does not exist until its package is installed; rpctl reads {place}'
            for path, place in dict.fromkeys(map(tuple, answer["moved"]))
        ),
    ]
    return (
        *(Finding("warning", None, text) for text in warnings),
        *(Finding("info", None, text) for text in notes),
    )


def _uncalled(path: Path, macros: Sequence[tuple[str, str, int]]) -> str:
    """Return that a file defines macros and calls none, and a file that calls the likeliest.

    Args:
        macros: Name, parameters and line of each, in the order of the file.
    """
    named = [each for each in macros if each[0] == _stem(path.name)]
    name, params, line = (named or macros)[-1]
    needed = [each for each in params.split() if not re.search(r":?=", each)]
    words = "".join(f' {each}="..."' for each in needed if each[0] != "*")
    blocks = [each.strip("*") for each in needed if each[0] == "*"]
    inside = "".join(f"<{each}>...</{each}>" for each in blocks)
    call = f"<xacro:{name}{words}>{inside}</xacro:{name}>"
    names = ", ".join(each for each, _, _ in macros)
    text = (
        f"it defines macros ({names}) but calls none, so there is no robot; write this file "
        "beside it"
    )
    wrapper = (
        f'\n<robot name="{name}" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'\n  <xacro:include filename="{path.name}"/>\n  {call}\n</robot>'
    )
    return say(path, line, f"{text}, fill in each ..., and load it:") + printable(wrapper, "\n")


def _left_out(path: Path, answer: Answer) -> list[str]:
    """Return, in sentences, what is missing for want of packages."""
    wants = [w for w in answer["wants"] if w[3] == "include"]
    calls = [(tag, file, line, "call") for file, line, tag in answer["left_out"]]
    return [
        *(f'left out, because package "{package}" was not found: the includes of '
          f'{_places(where, path)}'
          for package, where in _by_name(wants).items()),
        *(f"left out: <{tag}>, a macro that was not found ({_places(where, path)})"
          for tag, where in _by_name(calls).items()),
        *(f"left out: {phrase}" for phrase in answer["dropped"]),
    ]  # fmt: skip


def _missing_packages(path: Path, answer: Answer, settings: ReadSettings) -> list[str]:
    """Return the lines of the message that lists all packages that were not found."""
    needed = _by_name(w for w in answer["wants"] if w[3] != "text")
    texts = _by_name(w for w in answer["wants"] if w[3] == "text" and w[0] not in needed)
    names = [*needed, *texts]
    what, fix = "a package was", DECLARE
    if len(names) > 1:
        what, fix = f"{len(names)} packages were", DECLARE.replace("above it", "above them")
    remark = find_packages(path, settings.package_dirs).remark
    fault = (
        f"{what} not found: {', '.join(names)}; {fix}{remark}, or leave out what comes from them "
        "with --ignore-missing-packages"
    )
    return [
        say(path, None, fault),
        *(
            say(file, line, f'{use} package "{package}"', "info")
            for packages, use in ((needed, "needs"), (texts, "names"))
            for package, places in packages.items()
            for file, line in places
        ),
    ]


def _fault(path: Path, answer: Answer) -> list[str]:
    """Return the message on what xacro refuses."""
    if answer["old"]:
        file, tag, line = answer["old"][0]
        fault = (
            "this is xacro from before ROS Jade, whose elements had no prefix: write "
            f"<xacro:{tag}> for <{tag}>, and so for all, its calls, too"
        )
        return [say(file, line, fault)]
    macros, wants = answer.get("macros"), [w[0] for w in answer["wants"] if w[3] != "text"]
    within = f' (in macro "{excerpt(macros[-1])}")' if macros else ""
    missing = ", ".join(dict.fromkeys(wants))
    fix = f"it may be in a package that was not found ({missing}); {DECLARE}" if wants else RUN_IT
    fault = f"xacro: {answer['error']}{within}; {fix}"
    return [say(answer.get("file") or path, answer.get("line"), fault), *_choosing(answer)]


def _choosing(answer: Answer) -> list[str]:
    """Return lines on the arguments whose defaults are part of the path of a missing file."""
    path = Path(answer.get("no_file", ""))
    lines = []
    for each in declared_arguments(answer):
        at = next((k for k, part in enumerate(path.parts) if _stem(part) == each.default), None)
        if at is not None:
            (line,), choices = listed([each]), _choices(path, at)
            lines.append(line + (f"; there are {', '.join(choices)}" if choices else ""))
    return lines


def _choices(path: Path, at: int) -> list[str]:
    """Return what a part of a path may be so that there is a file, at most MAX_CHOICES of it.

    Args:
        path: The path, where there is none.
    """
    folder, rest = Path(*path.parts[:at]), path.parts[at + 1 :]
    try:
        names = sorted(each.name for each in islice(folder.iterdir(), MAX_LISTED))
    except OSError:
        return []
    if rest:
        return [name for name in names if Path(folder, name, *rest).is_file()][:MAX_CHOICES]
    alike = [name for name in names if Path(name).suffixes == path.suffixes]
    return [_stem(name) for name in alike][:MAX_CHOICES]


def _stem(name: str) -> str:
    """Return a file's name up to its first dot."""
    return name.partition(".")[0]


def _by_name(wants: Iterable[Any]) -> dict[str, list[Place]]:
    """Return the places that want each package, or call each macro."""
    found: dict[str, list[Place]] = defaultdict(list)
    for name, file, line, _ in wants:
        found[name].append((file, line))
    return found


def _places(places: Iterable[Place], path: Path) -> str:
    """Return places in few words; files are named without their folders."""
    said = (f"{_short(file, path)}:{line}" if line else _short(file, path) for file, line in places)
    return ", ".join(dict.fromkeys(said))


def _short(file: str, path: Path) -> str:
    return Path(file or path).name


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


def missing_argument(path: Path, answer: Answer, settings: ReadSettings) -> list[str]:
    """Return the lines of the message on arguments that nobody gives, with those declared."""
    name, declared = answer["argument"], declared_arguments(answer)
    names = [each.name for each in declared]
    hint = _nearest(name, names) if name not in names else ", because it is declared too late"
    others = {*answer["open_arguments"]} - {name, *settings.xacro_args}
    more = "".join(f" {excerpt(each)}:=VALUE" for each in sorted(others))
    fault = f'xacro: argument "{excerpt(name)}" has no value; add {name}:=VALUE{more}{hint}'
    return [say(answer.get("file") or path, answer["line"], fault), *listed(declared)]


def unused_arguments(path: Path, answer: Answer, settings: ReadSettings) -> list[str]:
    """Return the lines of the message on given arguments that nothing declares or looks up."""
    declared = declared_arguments(answer)
    names = [each.name for each in declared]
    variables = [name for name in settings.xacro_args if name.startswith(ENVIRONMENT)]
    strange = [name for name in variables if name.removeprefix(ENVIRONMENT) not in answer["asked"]]
    unknown = [name for name in answer["unused"] if name not in names]
    asked, leave = [ENVIRONMENT + each for each in answer["asked"]], "; leave it out"
    return [
        *(
            say(path, None, f'no file declares the argument "{excerpt(name)}"'
                f"{_nearest(name, names) or leave}")
            for name in unknown
        ),
        *(listed(declared) if unknown else ()),
        *(
            say(path, None, 'no expression uses '
                            f'"{excerpt(name)}"{_nearest(name, asked) or leave}')
            for name in strange
        ),
    ]  # fmt: skip


def listed(declared: Iterable[XacroArgument]) -> list[str]:
    """Return a line for each argument that is declared."""
    lines = []
    for each in declared:
        default = "without a default"
        if each.default is not None:
            default = f'which is "{excerpt(each.default)}" by default'
        lines.append(say(each.file, each.line, f"declares {each.name}, {default}", "info"))
    return lines


def _nearest(name: str, names: Iterable[str]) -> str:
    near = get_close_matches(name, list(names), n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
