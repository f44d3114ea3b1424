"""From the command line, as a user or a script meets it: one message, no traceback, no hang."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pytest
import trimesh
from typer.testing import CliRunner

from rpctl.cli.app import app
from tests.description.corpus import BASE
from tests.description.test_fuzz import patience

PATIENCE = 60  # s; a hang, however slow the machine
BOX = '<box size="0.5 0.4 0.2"/>'


def rpctl(*words: object, **settings: str) -> tuple[int, str, str]:
    with patience(PATIENCE):
        done = CliRunner(env=settings).invoke(app, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit), words
    return done.exit_code, done.stdout, done.stderr


def _loop(path: Path) -> None:
    path.symlink_to(path.with_name("other.urdf"))
    path.with_name("other.urdf").symlink_to(path)


def _unreadable(path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    path.write_text(BASE, encoding="utf-8")
    path.chmod(0)


ODD: dict[str, tuple[Callable[[Path], object], str]] = {
    "a folder": (Path.mkdir, "this is a folder"),
    "an empty file": (Path.touch, "the file is empty"),
    "no file": (lambda path: None, "No such file or directory"),
    "not readable": (_unreadable, "Permission denied"),
    "a program": (lambda path: path.write_bytes(b"\x7fELF\2\1\1" + bytes(200)), "a program"),
    "random bytes": (lambda path: path.write_bytes(bytes(range(256)) * 40), "a zero byte"),
    "a fifo": (os.mkfifo, "not a regular file"),
    "a device": (lambda path: path.symlink_to("/dev/null"), "not a regular file"),
    "an endless device": (lambda path: path.symlink_to("/dev/zero"), "not a regular file"),
    "links in a loop": (_loop, "Too many levels of symbolic links"),
    "a link to nothing": (lambda path: path.symlink_to("nowhere"), "No such file or directory"),
}


@pytest.mark.parametrize("suffix", [".urdf", ".xacro"])
@pytest.mark.parametrize("name", ODD)
def test_what_is_no_robot_is_told(name: str, suffix: str, tmp_path: Path) -> None:
    make, expected = ODD[name]
    path = tmp_path / f"robot{suffix}"
    make(path)
    code, out, err = rpctl("inspect", path)
    assert (code, out) == (2, "")
    assert err.startswith(f"{path}:")
    assert "error: " in err
    if suffix == ".urdf" or name not in ("an empty file", "a program", "random bytes"):
        assert expected in err  # the rest is xacro's to refuse
    assert len(err.splitlines()) == 1


def test_too_little_memory_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def exhaust(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("rpctl.cli.options.LoadOptions.load", exhaust)
    code, out, err = rpctl("inspect", tmp_path / "robot.urdf")
    assert (code, out) == (2, "")
    assert err.startswith("out of memory; is the file or a cap (RPCTL_MAX_...) too large?")


def workspace(folder: Path) -> Path:
    """Return a robot whose mesh lies in a package that is nowhere around it."""
    mesh = folder / "far" / "parts" / "meshes" / "box.stl"
    mesh.parent.mkdir(parents=True)
    trimesh.creation.box((0.5, 0.4, 0.2)).export(mesh)
    path = folder / "here" / "robot.urdf"
    path.parent.mkdir()
    named = '<mesh filename="package://parts/meshes/box.stl"/>'
    path.write_text(BASE.replace(BOX, named), encoding="utf-8")
    return path


def test_packages_are_declared(tmp_path: Path) -> None:
    path, far = workspace(tmp_path), tmp_path / "far"
    code, _, err = rpctl("inspect", path, "--strict")
    assert code == 2
    assert 'package "parts" was not found; declare a folder above it with --package' in err
    for words, settings in (
        (["--package-dir", far], {}),
        (["--package-dir", tmp_path, "--package-dir", far / "parts"], {}),
        ([], {"ROS_PACKAGE_PATH": str(far)}),
    ):
        assert rpctl("inspect", path, "--strict", *words, **settings)[0] == 0
    copytree(far, tmp_path / "prefix" / "share")
    assert rpctl("inspect", path, "--strict", AMENT_PREFIX_PATH=str(tmp_path / "prefix"))[0] == 0
    for command in ("inspect", "verify", "track", "derive", "expand"):
        code, _, err = rpctl(command, path, "--package-dir", tmp_path / "nowhere")
        assert code == 2
        assert err == (
            f"{tmp_path}/nowhere: no such folder; give a package, or a folder with packages\n"
        )
