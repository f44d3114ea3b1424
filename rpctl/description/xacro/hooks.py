"""xacro's own functions, so changed that it goes on past a package that is not there.

Used in the process that expands xacro only: it changes the module for good. Arguments, variables,
files and packages are what its owner gives it; files that are not evaluated are scanned.
"""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.dom import expatbuilder
from xml.parsers import expat
from xml.parsers.expat import ExpatError

from rpctl.files.worker import Channel

PACKAGE = "package://"
MESH_PACKAGE = re.compile(r"<mesh\b[^>]*[\"']package://([\w.-]+)/")
NAME = re.compile(r"[\w.-]*[\w-][\w.-]*")  # of a package: no path
READ, GONE = b"\1", b"\0"  # how the reply to a request for a file begins
MAX_REPLY = 2**40  # bytes; who replies has caps of its own
FIND = re.compile(r"^\s*(?:\$\(\s*find\s+([^\s()]+)\s*\)|package://([^/\s]+))(/.*)$")
# What a URDF has of its own; a macro may be called so, and means itself with its prefix only.
URDF_ELEMENTS = {
    "robot", "link", "joint", "material", "transmission", "gazebo", "ros2_control", "sensor",
    "plugin", "inertial", "visual", "collision", "origin", "mass", "inertia", "geometry", "box",
    "cylinder", "sphere", "capsule", "mesh", "color", "texture", "parent", "child", "axis", "limit",
    "mimic", "dynamics", "calibration", "safety_controller", "actuator", "loop", "group",
}  # fmt: skip
OPAQUE = ("gazebo", "transmission", "ros2_control", "sensor")  # their elements are others' business
COMMENT = re.compile(r"<!--(?:.*?-->|.*)", re.DOTALL)
ASKED = re.compile(r"\$\(\s*arg\s+([\w.-]+)\s*\)")
OLD_ELEMENTS = ("macro", "property", "include")  # written without a prefix before ROS Jade


class NotFoundError(Exception):
    """No folder of a package's name is known."""


class Hooks:
    """What an evaluation ran into.

    Attributes:
        files: The files that were read, in order.
        found: Folders of the packages that were found, by name.
        wants: Package, file, line (None: not known) and use (``"include"``, ``"file"``,
            ``"text"``) of each package that was not found.
        left_out: File, line and name of each macro call that was left out, for the macro may be
            defined in an include that was.
        undeclared: Files that use the prefix without declaring it.
        moved: Path and place of each include that lies elsewhere in its package's source than an
            installation would have it.
    """

    def __init__(
        self, xacro: Any, substitution_args: Any, outside: Outside, environment: Environment
    ) -> None:
        """Keep what the functions need.

        Args:
            substitution_args: Its module that evaluates ``$(...)``.
        """
        self.xacro = xacro
        self._substitution_args = substitution_args
        self.find_all = lru_cache(maxsize=None)(outside.find)
        self._outside = outside
        self._environment = environment
        self._text_of = lru_cache(maxsize=None)(  # none of a file that cannot be read
            lambda file: outside.bytes_of(file).decode("utf-8", "replace")
        )
        self.files: list[str] = []
        self.found: dict[str, str] = {}
        self.wants: list[tuple[str, str, int | None, str]] = []
        self.left_out: list[tuple[str, int | None, str]] = []
        self.undeclared: list[str] = []
        self.moved: list[tuple[str, str]] = []
        self._original = {
            name: getattr(xacro, name)
            for name in ("parse", "process_include", "handle_macro_call", "abs_filename_spec")
        }

    def install(self) -> None:
        """Put the changed functions in their places."""
        for name in self._original:
            setattr(self.xacro, name, getattr(self, name))
        self.xacro.open, self.xacro.glob = self._outside.open, self._outside
        for name, function in (
            ("env", self._environment.required),
            ("optenv", self._environment.optional),
            ("find", self.find),  # xacro looks for packages in an installed ROS only
        ):
            setattr(self._substitution_args, f"_eval_{name}", function)
            self._substitution_args._eval_dict[name] = function
        self._substitution_args._eval_dirname = lambda _: str(Path(self.file).absolute().parent)

    @property
    def file(self) -> str:
        """The file of what is evaluated: where its macro was defined, else the one being read."""
        macros = self.xacro.macrostack or ()
        histories = [macro.history[-1][-1] for macro in macros if macro.history]
        return str((histories or [file for file in self.xacro.filestack if file])[-1])

    @property
    def lacks_includes(self) -> bool:
        """Whether an include was left out."""
        return any(use == "include" for *_, use in self.wants)

    def find(self, name: str) -> str:
        """Return a package's folder; where there is none, its name as a URL.

        Raises:
            ValueError: It cannot be the name of a package.
        """
        if not NAME.fullmatch(name):
            raise ValueError(f'"{name}" is not the name of a package')
        folders = self.find_all(name)
        if folders:
            self.found[name] = folders[0]
            return folders[0]
        for line in self.lines(rf"\bfind\b[\s('\"]*{re.escape(name)}\b"):
            self._want(name, line, "text")
        return PACKAGE + name

    def want_meshes(self) -> None:
        """Note the packages of meshes in the files that were read that are not found, either."""
        for file in dict.fromkeys(self.files):
            for line, text in enumerate(self._text_of(file).split("\n"), 1):
                for name in MESH_PACKAGE.findall(text):
                    if not self.find_all(name):
                        self.wants.append((name, file, line, "text"))

    def abs_filename_spec(self, spec: str) -> str:
        """Return the path of a file that is to be read; ``package://`` is looked up.

        Raises:
            NotFoundError: There is no such package.
        """
        if not str(spec).startswith(PACKAGE):
            return str(self._original["abs_filename_spec"](spec))
        name, _, rest = spec.removeprefix(PACKAGE).partition("/")
        folders = self.find_all(name)
        if not folders:
            raise NotFoundError(name)
        self.found[name] = folders[0]
        return f"{folders[0]}/{rest}"

    def process_include(self, element: Any, macros: Any, symbols: Any, func: Any) -> None:
        """Include a file, or leave it out where its package is not there."""
        spec = element.getAttribute("filename")
        try:
            path = self.xacro.abs_filename_spec(str(self.xacro.eval_text(spec, symbols)))
            place = self._outside.place(path)
            if place is not None:
                self.moved.append((path, place))
                element.setAttribute("filename", place)
        except NotFoundError as error:
            if element.getAttribute("optional").lower() not in ("true", "1"):
                self._want(str(error), self.lines(re.escape(spec))[0], "include")
            self.xacro.remove_previous_comments(element)
            self.xacro.replace_node(element, by=None)
            return
        except Exception:  # xacro says it better
            pass
        self._original["process_include"](element, macros, symbols, func)

    def handle_macro_call(self, node: Any, macros: Any, symbols: Any) -> bool:
        """Expand a call, or leave it out where its macro may be in an include that was.

        Args:
            node: The element, a call or not.

        Returns:
            Whether it was a call.
        """
        tag = node.tagName
        if self.lacks_includes and tag.startswith("xacro:") and tag != "xacro:call":
            try:
                self.xacro.resolve_macro(tag.removeprefix("xacro:"), macros, symbols)
            except KeyError:
                lines = self.lines(rf"<{re.escape(tag)}(?![\w.:-])")
                taken = {line for file, line, _ in self.left_out if file == self.file}
                line = next((line for line in lines if line not in taken), None)
                self.left_out.append((self.file, line, tag))
                self.xacro.replace_node(node, by=None)
                return True
        return bool(self._original["handle_macro_call"](node, macros, symbols))

    def parse(self, text: Any, filename: str | None = None) -> Any:
        """Return the tree of a file, also where it does not declare the prefix xacro."""
        if filename:
            self.files.append(filename)
        try:
            return self._original["parse"](text, filename)
        except ExpatError as error:
            if filename is None or "unbound prefix" not in str(error):
                raise
            self.undeclared.append(filename)
            return expatbuilder.parseString(self._text_of(filename), namespaces=False)

    def lines(self, pattern: str) -> list[int | None]:
        """Return the lines of the file being evaluated that hold a pattern; else [None]."""
        lines = enumerate(self._text_of(self.file).split("\n"), 1)
        return [k for k, line in lines if re.search(pattern, line)] or [None]

    def _want(self, package: str, line: int | None, use: str) -> None:
        """Note that a line wants a package; an include says more than a text."""
        file = self.file
        if use == "include":
            self.wants = [w for w in self.wants if w != (package, file, line, "text")]
        elif (package, file, line, "include") in self.wants:
            return
        if (package, file, line, use) not in self.wants:
            self.wants.append((package, file, line, use))


class NotGivenError(Exception):
    """A variable of the environment that nobody gives."""


class Arguments(dict[str, str]):
    """Values of arguments that remember which of them were looked up.

    Attributes:
        used: Names that were looked up.
        early: Names that were, before their declaration was reached.
    """

    def __init__(self, given: dict[str, str], defaults: Callable[[], dict[str, str]]) -> None:
        """Keep the values that are given.

        Args:
            given: Values by name.
            defaults: Returns defaults that are declared somewhere, without variables.
        """
        super().__init__(given)
        self._defaults = defaults
        self.used: set[str] = set()
        self.early: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.used.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        if not super().__contains__(name) and name in (declared := self._defaults()):
            self.early.add(name)
            return declared[name]
        return super().__getitem__(name)


class Environment:
    """The variables that a file is given; it sees none of the user's.

    Attributes:
        asked: Names that were looked up.
    """

    def __init__(self, given: dict[str, str]) -> None:
        self._given = given
        self.asked: set[str] = set()

    def required(self, name: str) -> str:
        """Return a variable's value, for ``$(env NAME)``.

        Raises:
            NotGivenError: Nobody gives it.
        """
        if (value := self.optional(name, None)) is None:
            raise NotGivenError(name)
        return value

    def optional(self, name: str, default: Any = "") -> Any:
        """Return a variable's value or a default, for ``$(optenv NAME DEFAULT)``."""
        self.asked.add(str(name))
        return self._given.get(name, default)


class Outside:
    """Files and packages, asked of who started the process."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    def read(self, path: str) -> bytes:
        """Return a file's bytes.

        Raises:
            OSError: There is no such file, or it may not be read.
        """
        reply = self._ask("read", path)
        if reply[:1] == GONE:
            number, reason = json.loads(reply[1:])
            raise OSError(number, reason, path)
        return reply[1:]

    def bytes_of(self, path: str) -> bytes:
        """Return a file's bytes, none where it cannot be read."""
        try:
            return self.read(path)
        except OSError:
            return b""

    def open(self, path: Any) -> io.TextIOWrapper:
        """Open a text file for reading, for xacro's own ``open``."""
        return io.TextIOWrapper(io.BytesIO(self.read(str(path))), "utf-8")

    def find(self, name: str) -> tuple[str, ...]:
        """Return the folders that a package's name may mean, the likeliest first."""
        return tuple(json.loads(self._ask("find", name)))

    def place(self, path: str) -> str | None:
        """Return where a file of a package lies in its source, if not where its path says."""
        place = json.loads(self._ask("place", path))
        return None if place is None else str(place)

    def glob(self, pattern: str) -> list[str]:
        """Return the files that a pattern names, for xacro's own ``glob.glob``."""
        return list(json.loads(self._ask("match", pattern)))

    def _ask(self, verb: str, text: str) -> bytes:
        self._channel.send(json.dumps((verb, text)).encode())
        return self._channel.receive(MAX_REPLY)


@dataclass
class FileScan:
    """What one file says.

    Attributes:
        arguments: Name, default (None: it has none) and line of each argument that it declares.
        includes: The files that it includes, as they are written.
        old_element: Name and line of the first element of xacro that lacks its prefix.
        macros: Parameters and line of each macro that it defines, by name.
        plain: First line of each element without a prefix that could be one's.
        asked: Names of the arguments that it looks up.
    """

    arguments: list[tuple[str, str | None, int]] = field(default_factory=list)
    includes: list[str] = field(default_factory=list)
    old_element: tuple[str, int] | None = None
    macros: dict[str, tuple[str, int]] = field(default_factory=dict)
    plain: dict[str, int] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)


def scan(data: bytes) -> FileScan:
    """Return what a file's bytes say, up to where they are no XML."""
    parser, above = expat.ParserCreate(), list[str]()
    text = COMMENT.sub("", data.decode("utf-8", "replace"))
    found = FileScan(asked=[*dict.fromkeys(ASKED.findall(text))])

    def start(tag: str, attributes: dict[str, str]) -> None:
        name, line = attributes.get("name", ""), parser.CurrentLineNumber
        if tag == "xacro:arg" and name:
            found.arguments.append((name, attributes.get("default"), line))
        elif tag == "xacro:include":
            found.includes.append(attributes.get("filename", ""))
        elif tag == "xacro:macro":
            found.macros[name.removeprefix("xacro:")] = attributes.get("params", ""), line
        elif len(above) == 1 and tag in OLD_ELEMENTS and found.old_element is None:
            found.old_element = tag, line  # below <robot>
        elif ":" not in tag and tag not in URDF_ELEMENTS and not {*above} & {*OPAQUE}:
            found.plain.setdefault(tag, line)
        above.append(tag)

    parser.StartElementHandler, parser.EndElementHandler = start, lambda _: above.pop()
    with suppress(expat.ExpatError):
        parser.Parse(data, True)
    return found


def scan_all(
    files: Iterable[str], find: Callable[[str], tuple[str, ...]], read: Callable[[str], bytes]
) -> dict[str, FileScan]:
    """Return what files say, and those that they include by names without variables, by file.

    Args:
        read: Returns a file's bytes, none where it cannot be read.
    """
    found: dict[str, FileScan] = {}
    queue = [os.path.normpath(file) for file in files]
    while queue:
        file = queue.pop(0)
        if file in found:
            continue
        found[file] = scan(read(file))
        for spec in found[file].includes:
            path = _included(file, spec, find)
            if path is not None:
                queue.append(os.path.normpath(path))
    return found


def constant_defaults(scans: Mapping[str, FileScan]) -> dict[str, str]:
    """Return the defaults without variables that files declare, by argument; the first counts."""
    declared = [each for scan in scans.values() for each in scan.arguments]
    return {
        name: default
        for name, default, _ in reversed(declared)
        if default is not None and "$" not in default
    }


def _included(file: str, spec: str, find: Callable[[str], tuple[str, ...]]) -> str | None:
    """Return the path of an include, if it can be told without evaluating anything."""
    path = str(Path(file).parent / spec)
    if named := FIND.match(spec):
        folders = find(named[1] or named[2])
        path = folders[0] + named[3] if folders else "$"
    return None if "$" in path or "*" in path else path
