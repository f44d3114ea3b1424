"""Names of robot_descriptions: read from its modules without running them, never fetched."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.robot.sources import find_source, list_robots
from tests.workspaces import fixed, link, package, write, xacro

LISTS = """
DESCRIPTIONS: Dict[str, Description] = {
    "cart_description": Description(
        formats={Format.URDF}, tags={"wheeled"}, robot="Cart", maker="M", dof=2),
    "lift_description": Description(formats={Format.URDF, Format.SRDF}, tags={"arm"}, robot="L"),
    "patched_description": Description(formats={Format.URDF}, tags={"mobile_manipulator"},
        robot="P"),
    "cart_mj_description": Description(formats={Format.MJCF}, tags={"wheeled"}, robot="Cart"),
}
"""
REPOSITORIES = """
REPOSITORIES: Dict[str, Repository] = {
    "carts": Repository(url="https://example.org/carts.git", commit="1", cache_path="carts"),
    "parts": Repository(url="https://example.org/parts.git", commit="1", cache_path="all_parts"),
}
"""
MODULE = """
from os import getenv as _getenv, path as _path
from ._cache import clone_to_cache as _clone_to_cache
raise RuntimeError("imported")
REPOSITORY_PATH: str = _clone_to_cache("carts", commit=_getenv("ROBOT_DESCRIPTION_COMMIT", None))
PACKAGE_PATH: str = _path.join(REPOSITORY_PATH, "robots", "cart_pkg")
"""
PLAIN = MODULE + 'URDF_PATH: str = _path.join(PACKAGE_PATH, "urdf", "cart.urdf")\n'
XACRO = (
    MODULE
    + """
PARTS_PATH = _clone_to_cache("parts")
BASE_ARGS = {"mass": "4"}
XACRO_ARGS = BASE_ARGS.copy()
XACRO_PATH: str = _path.join(PACKAGE_PATH, "lift.urdf.xacro")
XACRO_PACKAGE_PATHS: dict[str, str] = {"lift_parts": _path.join(PARTS_PATH, "deep", "lift_parts")}
"""
)
PATCHED = (
    MODULE
    + """
_ORIGINAL: str = _path.join(PACKAGE_PATH, "urdf", "patched.urdf")
def _patch(path): ...
URDF_PATH: str = _patch(_ORIGINAL)
"""
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install a package like robot_descriptions, whose modules break when run; return its cache."""
    folder = tmp_path / "site" / "robot_descriptions"
    write(folder / "__init__.py", "raise RuntimeError('imported')")
    for name, text in (
        ("_descriptions", LISTS), ("_repositories", REPOSITORIES), ("cart_description", PLAIN),
        ("lift_description", XACRO), ("patched_description", PATCHED),
        ("cart_mj_description", MODULE + 'MJCF_PATH: str = "x"'),
    ):  # fmt: skip
        write(folder / f"{name}.py", text)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.delitem(sys.modules, "robot_descriptions", raising=False)
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ROBOT_DESCRIPTION_COMMIT", raising=False)
    return tmp_path / "cache"


def fill(cache: Path) -> None:
    robots = cache / "carts" / "robots" / "cart_pkg"
    write(robots / "urdf" / "cart.urdf", f'<robot name="c">{link("base", "3")}</robot>')
    xacro(
        robots / "lift.urdf.xacro", '<xacro:arg name="mass" default="1"/>',
        '<xacro:include filename="$(find lift_parts)/p.xacro"/>', link("base", "$(arg mass)"),
    )  # fmt: skip
    xacro(package(cache / "all_parts" / "deep" / "lift_parts") / "p.xacro", link("p", "2"),
          fixed("j", "base", "p"))  # fmt: skip


def test_a_name_loads_what_is_in_the_cache(cache: Path) -> None:
    fill(cache)
    robot = rpctl.load("cart_description", "fixed")
    assert (robot.name, robot.source, robot.mass) == ("cart_description", "cart_description", 3.0)
    assert robot.description.path == cache / "carts" / "robots" / "cart_pkg" / "urdf" / "cart.urdf"
    assert "robot_descriptions" not in sys.modules


def test_a_xacro_has_its_packages_and_arguments(cache: Path) -> None:
    pytest.importorskip("xacro")
    fill(cache)
    found = find_source("lift_description")
    assert found.xacro_args == {"mass": "4"}
    assert rpctl.load("lift_description", "fixed").mass == 6.0
    assert rpctl.load("lift_description", "fixed", xacro_args={"mass": 5}).mass == 7.0


def test_what_is_not_in_the_cache_is_told_with_the_command(cache: Path) -> None:
    with pytest.raises(RpctlError) as caught:
        rpctl.load("cart_description")
    assert str(caught.value) == (
        f"cart_description is not in the cache of robot_descriptions, {cache}; "
        "`python -m robot_descriptions pull cart_description` downloads it"
    )
    assert not cache.exists()
    with pytest.raises(UnknownNameError, match="did you mean cart_description"):
        rpctl.load("cat_description")


def test_robots_lists_what_is_there(cache: Path) -> None:
    assert [(r.name, r.wheeled, r.cached) for r in list_robots()] == [
        ("cart_description", True, False),
        ("lift_description", False, False),
        ("patched_description", True, False),
    ]
    fill(cache)
    listed = json.loads(CliRunner().invoke(app, ["robots", "--json"]).stdout)
    public = [entry for entry in listed if entry["name"].endswith("_description")]
    assert [(entry["name"], entry["base"], entry["summary"]) for entry in public] == [
        ("cart_description", "wheeled", "Cart, wheeled (robot_descriptions)"),
        ("lift_description", "fixed", "L, arm (robot_descriptions)"),
    ]
    shown = CliRunner().invoke(app, ["robots"]).stdout
    assert "patched_description; `python -m robot_descriptions pull NAME`" in " ".join(
        shown.split()
    )


def test_without_the_package_its_names_say_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rpctl.robot.sources._folder", lambda: None)
    with pytest.raises(RpctlError, match=r"run pip install 'robot.des.*', then `python -m"):
        rpctl.load("fetch_description")
    with pytest.raises(UnknownNameError, match="did you mean tiago"):
        rpctl.load("tiagoo")
