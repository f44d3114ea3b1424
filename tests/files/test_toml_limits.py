"""What the reader of TOML could not take is refused before it; no number leaves floats' range."""

from __future__ import annotations

from pathlib import Path

import pytest

from rpctl.errors import DescriptionError
from rpctl.files.toml import MAX_DIGITS, MAX_NESTING, Table, read

NINES = "9" * 400
TOO_DEEP = f"nested over {MAX_NESTING} deep; write it flatter"
TOO_LONG = f"digits; {MAX_DIGITS} are the most"
OVER_64 = "is a whole number of over 64 bits; give a smaller one"
BEYOND = "is beyond the range of numbers, 1.8e308; give a smaller one"


def as_it_is(data: Table, faults: list[str]) -> Table:
    return data


def refusal(path: Path, content: str) -> str:
    path.write_text(content, encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        read(path, as_it_is, "a file of sizes")
    return str(caught.value)


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
    assert refusal(path, content) == f"{path}:{line}: error: {reason}"


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
    assert refusal(path, content) == f"{path}{line}: error: {fault}"


def test_depth_that_keys_and_tables_reach_together_is_refused(tmp_path: Path) -> None:
    half = ".a" * (MAX_NESTING // 2 + 1)
    assert TOO_DEEP in refusal(tmp_path / "sizes.toml", f"[b{half}]\nb{half} = 1")


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
