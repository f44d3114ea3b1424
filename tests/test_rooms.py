"""The house: a room imports only from rooms above it, and nobody imports meshcat."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import rpctl
from tests.package_statements import modules

ROOMS = [
    "arrays",
    "math",
    "errors",
    "files",
    "libraries",
    "kernels",
    "description",
    "drive",
    "robot",
]
ROOMS += [
    "dynamics",
    "equivalence",
    "engines",
    "reference",
    "control",
    "derive",
    "simulation",
    "study",
]
ROOMS += ["view", "cli"]
NOT_FOR = {"control": {"equivalence"}, "dynamics": {"equivalence"}}


@cache
def imports() -> tuple[tuple[Path, str, str], ...]:
    """Return (file, room, imported module) of the whole package."""
    return tuple(read_imports())


def read_imports() -> Iterator[tuple[Path, str, str]]:
    """Yield them, file by file."""
    for module in modules():
        room = module.file.parts[0].removesuffix(".py")
        if room in ("__init__", "__main__"):
            continue
        assert not module.relative, f"{module.file}: import by the full name"
        for name in module.imports:
            yield module.file, room, name
        for of, name in module.names:
            yield module.file, room, f"{of}.{name}"


def test_data_flows_one_way() -> None:
    wrong = []
    for file, room, module in imports():
        head, _, rest = module.partition(".")
        other = rest.split(".")[0]
        if head != "rpctl" or other not in ROOMS or other == room:
            continue
        if ROOMS.index(other) > ROOMS.index(room) or other in NOT_FOR.get(room, ()):
            wrong.append(f"{file.as_posix()} imports {module}")
    assert not wrong


def test_what_is_looked_for_in_a_room_below_is_named() -> None:
    """By `library`, when it is asked for: the test of imports does not see it."""
    found = set()
    for module in modules():
        text = (Path(rpctl.__file__).parent / module.file).read_text(encoding="utf-8")
        room = module.file.parts[0].removesuffix(".py")
        for name in re.findall(r'library\("rpctl\.([\w.]+)"\)', text):
            if ROOMS.index(name.partition(".")[0]) > ROOMS.index(room):
                found.add((room, name))
    shown = {(room, "view.pages.page") for room in ("robot", "equivalence", "simulation", "study")}
    assert found == shown | {("simulation", "view.film"), ("control", "simulation.config")}


def test_no_circle_of_imports() -> None:
    graph: dict[str, set[str]] = {}
    for file, _, module in imports():
        name = ".".join(("rpctl", *file.with_suffix("").parts))
        graph.setdefault(name, set()).update((module, module.rpartition(".")[0]))
    tuple(TopologicalSorter(graph).static_order())  # raises CycleError, which names the circle


def test_rooms_above_the_robot_know_nothing_of_pinocchio() -> None:
    above = ROOMS[: ROOMS.index("robot")]
    wrong = [
        f"{file.as_posix()} imports {module}"
        for file, room, module in imports()
        if room in above and module.startswith(("pinocchio", "rpctl.robot"))
    ]
    assert not wrong


def test_only_the_view_draws_and_nobody_imports_meshcat() -> None:
    heavy = {"meshcat": (), "matplotlib": ("view",), "trimesh": ("view", "description")}
    wrong = [
        f"{file}: {module}"
        for file, room, module in imports()
        if room not in heavy.get(module.split(".")[0], [room])
    ]
    assert not wrong


def test_closed_forms_say_that_sympy_is_missing() -> None:
    code = "import sys; sys.modules['sympy'] = None; import rpctl; rpctl.derive_law"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "run pip install 'sympy<" in done.stderr.splitlines()[-1]


def modules_after(code: str) -> set[str]:
    """Return the packages that a fresh interpreter has loaded after running code."""
    code += "; import sys; print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {module.partition(".")[0] for module in done.stderr.split()}


def test_importing_rpctl_imports_no_other_package() -> None:
    standard = sys.stdlib_module_names | modules_after("pass")
    assert modules_after("import rpctl") - standard == {"rpctl"}


def test_the_model_needs_no_viewer() -> None:
    heavy = {"meshcat", "trimesh", "matplotlib", "yourdfpy", "IPython", "casadi", "sympy", "typer"}
    loaded = modules_after("import rpctl; rpctl.load; rpctl.track; rpctl.ReducedDynamics")
    assert "pinocchio" in loaded
    assert not heavy & loaded


@pytest.mark.parametrize("word", ["--help", "robots"])
def test_what_needs_no_robot_loads_no_engine(word: str) -> None:
    heavy = {"scipy", "pinocchio", "casadi", "matplotlib", "trimesh", "yourdfpy", "meshcat"}
    loaded = modules_after(f"from rpctl.cli.app import app; app(['{word}'], standalone_mode=False)")
    assert "typer" in loaded
    assert not heavy & loaded


def test_every_public_name_is_there() -> None:
    assert dir(rpctl) == rpctl.__all__
    assert "track" in rpctl.__all__
    for name in rpctl.__all__:
        assert getattr(rpctl, name).__name__ == name
    with pytest.raises(AttributeError, match="module 'rpctl' has no attribute 'lode'"):
        rpctl.__getattr__("lode")
