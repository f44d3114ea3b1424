"""The one reader of TOML: what a file holds, or every reason why not."""

from __future__ import annotations

from pathlib import Path

import pytest

from rpctl.errors import DescriptionError
from rpctl.files.strict_json import read_json
from rpctl.files.toml import MAX_DIGITS, MAX_NESTING, Table, line_of, read


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
    assert "over 5 bytes; to allow it, set RPCTL_MAX_TOML_BYTES" in refusal(
        tmp_path / "sizes.toml", b"a = 11"
    )
    (tmp_path / "sizes.toml").write_bytes(b"a = 1")
    assert read(tmp_path / "sizes.toml", sizes, "a file of sizes") == [1]


NINES = "9" * 400
TOO_DEEP = f"nested over {MAX_NESTING} deep; write it flatter"
TOO_LONG = f"digits; at most {MAX_DIGITS} are allowed"
OVER_64 = "is a whole number of more than 64 bits; give a smaller one"
BEYOND = "is larger than 1.8e308; give a smaller number"


def as_it_is(data: Table, faults: list[str]) -> Table:
    return data


@pytest.mark.parametrize(
    ("content", "line", "reason"),
    [
        ("b = 1\na = " + "[" * 3000, 2, TOO_DEEP),
        ("a = " + "[\n" * 3000 + "]" * 3000, MAX_NESTING + 1, TOO_DEEP),
        ("a = " + "{a=" * 3000 + "1" + "}" * 3000, 1, TOO_DEEP),
        ("b = 1\na" + ".a" * 100_000 + " = 1", 2, TOO_DEEP),
        ("[" + "a . " * 3000 + "b]", 1, TOO_DEEP),
        ("a = " + "9" * 5000, 1, f"a number of 5000 {TOO_LONG}"),
        ("a = [1.5, 2]\nb = [\n1,\n-" + "9" * 5000 + "]", 4, f"a number of 5000 {TOO_LONG}"),
    ],
)
def test_what_its_reader_could_not_take_is_named_with_its_line(
    content: str, line: int, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "sizes.toml"
    assert refusal(path, content.encode()) == f"{path}:{line}: error: {reason}"


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (f"a.b = {NINES}", f"a.b: {OVER_64}"),
        ("a = 9223372036854775808", f"a: {OVER_64}"),
        (f"a = 0x{NINES}", f"a: {OVER_64}"),
        ("[[a]]\n[[a]]\nb = [1, 1e400]", f"a[2].b[2]: {BEYOND}"),
        (f"a = -{NINES}.0", f"a: {BEYOND}"),
        ("a = inf", "a: is inf; give a finite number"),
        ("a = -inf", "a: is -inf; give a finite number"),
        ("a = nan", "a: is nan; give a finite number"),
        ('"a\\u001b[31m\\u202e" = nan', r"a\x1b[31m\u202e: is nan; give a finite number"),
    ],
)
def test_a_number_that_no_setting_can_have_is_named_by_its_key(
    content: str, fault: str, tmp_path: Path
) -> None:
    path = tmp_path / "sizes.toml"
    # it is on the last line; a key in escapes is not looked for
    line = "" if "\\u" in content else f":{1 + content.count(chr(10))}"
    assert refusal(path, content.encode()) == f"{path}{line}: error: {fault}"


def test_depth_that_keys_and_tables_reach_together_is_refused(tmp_path: Path) -> None:
    half = ".a" * (MAX_NESTING // 2 + 1)
    assert TOO_DEEP in refusal(tmp_path / "sizes.toml", f"[b{half}]\nb{half} = 1".encode())


def test_as_deep_and_as_long_as_it_may_be_is_read(tmp_path: Path) -> None:
    path = tmp_path / "sizes.toml"
    deep, most = MAX_NESTING - 1, 2**63
    lines = ("a = " + "[" * deep + "]" * deep, "b" + ".b" * deep + " = 1", f"c = [{most - 1}]",
             f"d = -{most}", "e = 1.7e308", f"f = 3.{'1' * MAX_DIGITS}", "[g]\nh = [[1.5, 2.5]]",
             "[[i]]")  # fmt: skip
    path.write_text("\n".join(lines), encoding="utf-8")
    data = read(path, as_it_is, "a file of sizes")
    assert (data["c"], data["d"], data["e"]) == ([most - 1], -most, 1.7e308)
    assert data["f"] == pytest.approx(3.0 + 1.0 / 9.0, abs=1e-15)


@pytest.mark.parametrize(
    "text", ["[" * 99, ".a" * 99, "9" * 999, '# \\" [', '\\"' + "{" * 99, "a''b\"\"" + "[" * 99]
)
def test_what_stands_in_a_text_or_a_comment_counts_for_nothing(text: str, tmp_path: Path) -> None:
    path = tmp_path / "texts.toml"
    basic = text.replace("\\", "\\\\").replace('"', '\\"')
    literal = text.replace("'", "")
    path.write_text(
        f'a = "{basic}" # {text}\nb = """{basic}\n""{basic}"""\n'
        + f"c = '{literal}'\nd = '''\n{text}\n'{text}'''\n# {text}\ne = {[0.5] * 99}\n",
        encoding="utf-8",
    )
    assert read(path, as_it_is, "a file of texts") == {
        "a": text,
        "b": f'{text}\n""{text}',
        "c": literal,
        "d": f"{text}\n'{text}",
        "e": [0.5] * 99,
    }


TEXT = """\
top = 1
[run]  # what is run
speed = 0.5
initial_error = [
  0.1, 0.2,
]
"odd key" . 'more' = 3

[ plant . masses ]
"arm_*" = 1.1
kinds.one = 2
[[wall]]
x = 1
[[ wall ]]
x = 2
shape = { size = 3 }
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("top", 1), ("run", 2), ("run.speed", 3), ("run.initial_error", 4),
        ("run.initial_error[2]", 4), ("run.oddkey.more", 7), ('run."odd key".more', 7),
        ("run.laps", 2), ("plant.masses.arm_*", 10), ('plant."masses".x', 9),
        ("plant.masses.kinds.one", 11), ("plant.masses.kinds.two", 9), ("wall[1].x", 13),
        ("wall[2].x", 15), ("wall[2].y", 14), ("wall[2].shape.size", 16), ("topping", None),
        ("plant", None), ("", None), ("runs.speed", None),
    ],
)  # fmt: skip
def test_the_nearest_line_is_found(path: str, line: int | None) -> None:
    assert line_of(TEXT, path) == line


def test_a_long_text_takes_linear_time() -> None:
    assert line_of('"' * 200_000 + "\n" + "[" * 200_000 + "\na" * 50_000, "a.b") is None


def test_whole_numbers_of_64_bits_are_read() -> None:
    for number in (2**63 - 1, 1 - 2**63, 10**18, 0):
        assert read_json(f'{{"seed": {number}}}') == {"seed": number}
    for number in (2**63, -(2**63), 10**19):
        with pytest.raises(ValueError, match=f"a whole number of {len(str(number))} digits"):
            read_json(f"[{number}]")
