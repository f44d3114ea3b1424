"""Files of one set, killed at any moment of their writing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rpctl.errors import RpctlError
from rpctl.files import writing as together
from rpctl.files.writing import write_atomically, write_together

OLD, NEW = (dict.fromkeys(("a.json", "a.csv", "a.png"), each) for each in (b"old", b"new"))


class Killed(BaseException):
    """What no handler expects."""


def found(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("moment", range(6))
def test_no_moment_leaves_two_sets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: int
) -> None:
    """Two removals and three writings; a file of the user's stays."""
    write_together(tmp_path, OLD)
    (tmp_path / "mine.txt").write_bytes(b"mine")
    steps, remove = iter(range(moment)), Path.unlink

    def step() -> None:
        if next(steps, None) is None:
            raise Killed

    def unlink(path: Path, **options: Any) -> None:
        if path.name in OLD:
            step()
        remove(path, **options)

    def write(*words: Any, **options: Any) -> Path:
        step()
        return write_atomically(*words, **options)

    monkeypatch.setattr(Path, "unlink", unlink)
    monkeypatch.setattr(together, "write_atomically", write)
    try:
        write_together(tmp_path, NEW)
    except Killed:
        assert moment < 5
    left = found(tmp_path)
    assert left.pop("mine.txt") == b"mine"
    assert len(set(left.values())) == 1
    assert "a.json" in left
    assert left == NEW or moment < 5


def test_a_file_in_place_of_the_folder_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(RpctlError, match="cannot be made"):
        write_together(tmp_path / "file" / "folder", NEW)


def test_what_cannot_be_removed_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv").mkdir()
    with pytest.raises(RpctlError, match="cannot be written"):
        write_together(tmp_path, NEW)
    assert not (tmp_path / "a.json").exists()
