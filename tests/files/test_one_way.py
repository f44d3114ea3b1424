"""Every input is opened by the one way: no other call of the package opens a file to read it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import rpctl

PACKAGE = Path(rpctl.__file__).parent
OPENING = {"open", "fdopen", "read_text", "read_bytes", "memmap", "fromfile", "loadtxt",
           "genfromtxt", "iterparse", "open_code", "fileinput"}  # fmt: skip
OF_MODULES = {("np", "load"), ("numpy", "load"), ("ET", "parse"), ("etree", "parse"),
              ("trimesh", "load"), ("json", "load"), ("tomllib", "load"),
              ("yaml", "load"), ("pickle", "load")}  # fmt: skip
WORDS = re.compile(  # without one of them a module is not worth parsing
    "|".join(rf"\b{word}\b" for word in (*OPENING, *{name for _, name in OF_MODULES}))
)
ELSEWHERE = {  # what opens no input, and why
    "files/caps.py": "it is the one way",
    "files/writing.py": "opens what it writes",
    "files/worker.py": "opens the null device, for what a worker prints",
    "simulation/run/file.py": "opens entries of an archive that the one way opened",
    "simulation/run/part.py": "opens the lock of the folder that it writes to",
    "cli/terminal.py": "opens the null device in a closed stream's place",
    "derive/text.py": "reads the package's own templates",
    "kernels/cache.py": "reads back what it has written, if it is its own",
    "description/xacro/hooks.py": "replaces xacro's open by asking for what the one way reads",
    "engines/mujoco/settings.py": "reads what the one way has read, as numbers",
    "study/store.py": "adds to what it writes, and reads the package's own modules",
    "view/film.py": "writes a film, and reads back what it has written",
    "view/serve/live.py": "reads back the report that it has written",
    "view/pages/page.py": "reads the package's own assets",
    "view/pages/third_party.py": "reads the installed meshcat's script, whose hash is recorded",
}


def calls(text: str) -> list[int]:
    """Return the lines of a module's calls, and of its methods passed on, that open a file."""
    found: list[int] = []
    if not WORDS.search(text):
        return found
    nodes = list(ast.walk(ast.parse(text)))
    own = {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    own |= {
        alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom) and str(node.module) == "rpctl.files.caps"
        for alias in node.names
    }
    for node in nodes:
        if isinstance(node, ast.Attribute):
            module = node.value.id if isinstance(node.value, ast.Name) else ""
            if node.attr in OPENING or (module, node.attr) in OF_MODULES:
                found.append(node.lineno)
        elif isinstance(node, ast.Name) and node.id in OPENING - own:
            found.append(node.lineno)
    return found


def test_every_input_is_opened_by_the_one_way() -> None:
    found = []
    for file in sorted(PACKAGE.rglob("*.py")):
        relative = file.relative_to(PACKAGE).as_posix()
        if relative not in ELSEWHERE:
            found += [f"{relative}:{line}" for line in calls(file.read_text(encoding="utf-8"))]
    assert not found


@pytest.mark.parametrize(
    "text",
    [
        "open(path)", "with path.open() as file: pass", "Path(path).read_text()",
        "serve(path.read_bytes)", "os.open(path, 0)", "io.open(path)", "np.load(path)",
        "np.memmap(path)", "etree.parse(path)", "from numpy import loadtxt; loadtxt(path)",
    ],
)  # fmt: skip
def test_another_way_is_found(text: str) -> None:
    assert calls(text) == [1]


@pytest.mark.parametrize(
    "text",
    [
        "from rpctl.files.caps import read_text\nread_text(path, cap, kind)",
        "def read_text(file): pass\nread_text(1)", "tomllib.loads(text)", "opened(path)",
    ],
)  # fmt: skip
def test_the_one_way_is_none_of_them(text: str) -> None:
    assert not calls(text)


def test_what_is_left_out_is_there() -> None:
    assert all((PACKAGE / name).is_file() for name in ELSEWHERE)
