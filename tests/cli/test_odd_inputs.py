"""Every input of every kind that is odd is answered with one message and exit code 2."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.description.test_shell import rpctl
from tests.grids import cells

LONG = "a" * 300  # characters: more than a file's name may have
INPUTS = {
    "robot": ("inspect", "{}.urdf"),
    "xacro": ("inspect", "{}.xacro"),
    "drive": ("inspect", "paper", "--drive", "{}.toml"),
    "home": ("inspect", "paper", "--home", "{}.srdf:home"),
    "config": ("track", "paper", "--config", "{}.toml"),
    "path": ("track", "paper", "--reference", "{}.toml"),
    "table": ("track", "paper", "--reference", "{}.csv"),
    "run": ("view", "{}.npz", "--png", "a.png"),
    "plot": ("plot", "{}.npz"),
}


def answer(words: tuple[str, ...], name: str) -> str:
    code, out, err = rpctl(*(word.format(name) for word in words))
    assert (code, out) == (2, ""), err
    return " ".join(err.split())


@pytest.mark.parametrize("kind", cells(INPUTS, ["drive"], INPUTS))
def test_what_is_no_file_is_told(kind: str, tmp_path: Path) -> None:
    name = tmp_path / "input"
    (form,) = (word for word in INPUTS[kind] if "{}" in word)
    path = Path(form.format(name).removesuffix(":home"))
    os.mkfifo(path)
    assert "a pipe, not a regular file" in answer(INPUTS[kind], str(name))
    path.unlink()
    path.symlink_to("/dev/zero")
    assert "a character device, not a regular file" in answer(INPUTS[kind], str(name))
    path.unlink()
    path.symlink_to(path)
    assert "Too many levels of symbolic links" in answer(INPUTS[kind], str(name))


@pytest.mark.parametrize("kind", cells(INPUTS, ["home", "run", "plot"], INPUTS))
def test_a_name_that_no_file_can_have_is_told(kind: str) -> None:
    assert "File name too long" in answer(INPUTS[kind], LONG)


@pytest.mark.parametrize(
    "words",
    [("inspect", "{}"), ("view", "{}"), ("inspect", "paper", "--package-dir", "{}")],
)
@pytest.mark.parametrize("name", [LONG, "~nobody-is-called-so/a.urdf"])
def test_a_name_that_may_be_a_folder_is_told(words: tuple[str, ...], name: str) -> None:
    assert name[:40] in answer(words, name).replace(" ", "")


@pytest.mark.parametrize(
    ("kind", "content", "told"),
    [
        ("config", "a = " + "[" * 3000, ".toml:1: error: nested over 30 deep; write it flatter"),
        ("drive", "track = " + "9" * 400, ".toml:1: error: track: is a whole number of more than"),
        ("path", "waypoints = [[0, 0], [1e400, 1]]", "waypoints[2][1]: is larger than"),
        ("table", "t;x;y\n0;1;2\n", ".csv:1: error: columns are separated by semicolons; use"),
        ("config", "\ufeff[run]\nsize = nan", ".toml:2: error: run.size: is nan; give a finite n"),
    ],
)  # fmt: skip
def test_what_is_in_it_is_told(kind: str, content: str, told: str, tmp_path: Path) -> None:
    path = Path(INPUTS[kind][-1].format(tmp_path / "input"))
    path.write_text(content, encoding="utf-8")
    assert told in answer(INPUTS[kind], str(tmp_path / "input"))
