"""xacro's own functions, so changed that it goes on past a package that is not there.

Used in the process that expands xacro only: it changes the module for good.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.dom import expatbuilder
from xml.parsers.expat import ExpatError

from rpctl.description.xacro_inputs import Environment, Outside

PACKAGE = "package://"
MESH_PACKAGE = re.compile(r"<mesh\b[^>]*[\"']package://([\w.-]+)/")
NAME = re.compile(r"[\w.-]*[\w-][\w.-]*")  # of a package: no path


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
            xacro: The module.
            substitution_args: Its module that evaluates ``$(...)``.
            outside: Reads files and finds packages.
            environment: The variables that the file is given.
        """
        self.xacro = xacro
        self._substitution_args = substitution_args
        self.find_all = lru_cache(maxsize=None)(outside.find)
        self._outside = outside
        self._environment = environment
        self._text_of = lru_cache(maxsize=None)(self._read_text)
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
        substitution_args = self._substitution_args
        for name in self._original:
            setattr(self.xacro, name, getattr(self, name))
        self.xacro.open, self.xacro.glob = self._outside.open, self._outside
        substitution_args._eval_env = self._environment.required
        substitution_args._eval_optenv = self._environment.optional
        substitution_args._eval_dict["env"] = self._environment.required
        substitution_args._eval_dict["optenv"] = self._environment.optional
        # xacro looks for packages in an installed ROS only.
        substitution_args._eval_find = self.find
        substitution_args._eval_dict["find"] = self.find
        substitution_args._eval_dirname = lambda _: str(Path(self.file).absolute().parent)

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
            raise ValueError(f'"{name}" is no name of a package')
        folders = self.find_all(name)
        if folders:
            self.found[name] = folders[0]
            return folders[0]
        pattern = rf"\bfind\b[\s('\"]*{re.escape(name)}\b"
        for line in self.lines(pattern):
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
        """Include a file, or leave it out where its package is not there.

        Args:
            element: The include.
            macros: The macros that are known here.
            symbols: The properties that are known here.
            func: Evaluates the content.
        """
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
            macros: The macros that are known here.
            symbols: The properties that are known here.

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
        text = self._text_of(self.file)
        lines = enumerate(text.split("\n"), 1)
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

    def _read_text(self, file: str) -> str:
        """Return a file's text, none where it cannot be read."""
        return self._outside.bytes_of(file).decode("utf-8", "replace")
