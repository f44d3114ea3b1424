"""The one reader of TOML: what a file holds, or every reason why not."""

from __future__ import annotations

from pathlib import Path

import pytest

from rpctl.errors import DescriptionError
from rpctl.files.toml import Table, read


def sizes(data: Table, faults: list[str]) -> list[float]:
    faults += [f"{name} is {size}; give a positive size" for name, size in data.items() if size < 0]
    return list(data.values())


def refusal(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(DescriptionError) as caught:
        read(path, sizes, "a file of sizes")
    return str(caught.value)


def test_a_file_is_read_with_either_end_of_line_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "sizes.toml"
    for content in (b"a = 1\nb = 2.5\n", b"\xef\xbb\xbfa = 1\r\nb = 2.5\r\n"):
        path.write_bytes(content)
        assert read(path, sizes, "a file of sizes") == [1, 2.5]


def test_all_faults_are_named_at_once(tmp_path: Path) -> None:
    path = tmp_path / "sizes.toml"
    assert refusal(path, b"a = -1\nb = 2\nc = -3\n").splitlines() == [
        f"{path}: error: a is -1; give a positive size",
        f"{path}: error: c is -3; give a positive size",
    ]


@pytest.mark.parametrize(
    ("content", "line", "reason"),
    [
        (b"a = 1\nb = x\n", ":2", "not TOML: Invalid value; a file of sizes is TOML"),
        (b"a = 1\n\na = 2\n", ":3", "not TOML: Cannot overwrite a value; a file of sizes is TOML"),
        (b"a = 1\n# caf\xe9\n", ":2", "not UTF-8 (invalid continuation byte); save it as UTF-8"),
        (b"a = ", "", "not TOML: Invalid value (at end of document); a file of sizes is TOML"),
    ],
)  # fmt: skip
def test_what_is_no_toml_is_named_with_its_line(
    content: bytes, line: str, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "sizes.toml"
    assert refusal(path, content) == f"{path}{line}: error: {reason}"


def test_a_file_that_is_missing_or_too_long_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DescriptionError, match="No such file or directory; give a file of sizes"):
        read(tmp_path / "none.toml", sizes, "a file of sizes")
    monkeypatch.setenv("RPCTL_MAX_TOML_BYTES", "5")
    assert "over 5 bytes; if it is meant, set RPCTL_MAX_TOML_BYTES" in refusal(
        tmp_path / "sizes.toml", b"a = 11"
    )
    (tmp_path / "sizes.toml").write_bytes(b"a = 1")
    assert read(tmp_path / "sizes.toml", sizes, "a file of sizes") == [1]
