"""Packages: searched as rospack and colcon do, below declared folders and in the workspace."""

from __future__ import annotations

from pathlib import Path

import pytest

from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.packages import find_packages, forget, search, workspace
from tests.workspaces import package, write


@pytest.fixture(autouse=True)
def _fresh() -> None:
    forget()


def found(folder: Path) -> dict[str, tuple[str, ...]]:
    return search(str(folder))[0]


def test_packages_are_called_as_their_manifests_say_at_any_depth(tmp_path: Path) -> None:
    near, deep = package(tmp_path / "a"), package(tmp_path / "x" / "y" / "z" / "repo-2", "b")
    write(tmp_path / "c" / "package.xml", "<package><!-- <name>old</name> --><name> c </name>")
    write(tmp_path / "no_name" / "package.xml", "<package/>")
    assert found(tmp_path) == {"a": (str(near),), "b": (str(deep),), "c": (str(tmp_path / "c"),)}


@pytest.mark.parametrize("mark", ["COLCON_IGNORE", "CATKIN_IGNORE", "AMENT_IGNORE"])
def test_what_is_to_be_ignored_is_skipped(mark: str, tmp_path: Path) -> None:
    package(tmp_path / "src" / "a")
    package(tmp_path / "src" / "a" / "inside")
    package(tmp_path / ".hidden" / "b")
    write(tmp_path / "build" / mark, "")
    package(tmp_path / "build" / "c")
    assert found(tmp_path).keys() == {"a"}


def test_symlinks_are_followed_once(tmp_path: Path) -> None:
    there = package(tmp_path / "elsewhere" / "a")
    (tmp_path / "ws" / "src").mkdir(parents=True)
    (tmp_path / "ws" / "src" / "loop").symlink_to(tmp_path / "ws")
    (tmp_path / "ws" / "src" / "self").symlink_to("self")
    (tmp_path / "ws" / "src" / "one").symlink_to(there)
    (tmp_path / "ws" / "src" / "two").symlink_to(there)
    assert found(tmp_path / "ws") == {"a": (str(there),)}


def test_a_search_is_bounded_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(8):
        (tmp_path / f"f{k}").mkdir()
    deep = package(tmp_path / "f9" / "g" / "a")
    urdf = tmp_path / "f0" / "r.urdf"
    monkeypatch.setenv("RPCTL_MAX_FOLDERS", "11")
    packages = find_packages(urdf, [tmp_path])
    assert packages.find("a") == ()
    assert f"the search of {tmp_path} was stopped; to allow it, set RPCTL_MAX_FOLDERS" in (
        packages.remark
    )
    monkeypatch.setenv("RPCTL_MAX_FOLDERS", "12")
    forget()
    packages = find_packages(urdf, [tmp_path])
    assert packages.find("a") == (str(deep),)
    assert packages.remark == ""


def test_a_path_is_no_name(tmp_path: Path) -> None:
    package(tmp_path / "src" / "a" / "b")
    packages = find_packages(tmp_path / "src" / "bot" / "r.urdf", [tmp_path / "src"])
    for name in ("", ".", "..", "a/b", "../src", "b\0"):
        assert packages.find(name) == ()


def test_meshes_by_path_may_lie_in_fellow_packages_only(tmp_path: Path) -> None:
    package(tmp_path / "src" / "bot")
    mesh = write(package(tmp_path / "src" / "repo" / "parts") / "a.stl", "")
    write(tmp_path / "src" / "loose" / "a.stl", "")
    paths = MeshPaths(tmp_path / "src" / "bot" / "r.urdf")
    assert paths.resolve("../repo/parts/a.stl") == mesh
    with pytest.raises(MeshError, match="refused: it lies outside"):
        paths.resolve("../loose/a.stl")


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (["ws/.catkin_workspace", "ws/src/repo/.git/"], "ws/src"),
        (["ws/build/", "ws/install/", "ws/src/repo/.git/"], "ws/src"),
        (["ws/.catkin_workspace", ".git/"], "ws/src"),
        (["ws/build/", "ws/install/", ".git/"], "ws/src"),
        (["ws/build/", "ws/.git/"], "ws"),
        (["ws/src/repo/.git/"], "ws/src"),
        (["ws/src/repo/.git/", "ws/.git/"], "ws"),
        (["ws/src/repo/bot/package.xml"], "ws/src"),
    ],
)
def test_the_workspace_of_a_file(made: list[str], expected: str, tmp_path: Path) -> None:
    for name in made:
        path = tmp_path / name
        if name.endswith("/"):
            path.mkdir(parents=True)
        else:
            write(path, "")
    file = tmp_path / "ws" / "src" / "repo" / "bot" / "urdf" / "r.urdf"
    assert workspace(file) == str(tmp_path / expected)


def test_no_home_is_searched_unasked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "me"))
    (tmp_path / "me" / ".git").mkdir(parents=True)
    package(tmp_path / "me" / "bot")
    assert workspace(tmp_path / "me" / "bot" / "r.urdf") is None
    (tmp_path / ".git").mkdir()
    assert workspace(tmp_path / "me" / "bot" / "r.urdf") is None
    assert workspace(Path("/src/bot/r.urdf")) is None


def test_many_meshes_of_a_missing_package_are_one_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[str] = []

    def entries(folder: str) -> dict[str, str]:
        searched.append(folder)
        return {}

    monkeypatch.setattr("rpctl.description.packages._entries", entries)
    paths = MeshPaths(tmp_path / "bot" / "r.urdf", [tmp_path / "packages"])
    for k in range(20):
        with pytest.raises(MeshError, match='package "gone" was not found'):
            paths.resolve(f"package://gone/{k}.stl")
    assert searched == [str(tmp_path / "packages")]
