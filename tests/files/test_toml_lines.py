"""Where a setting is in a file, however it is written."""

from __future__ import annotations

import pytest

from rpctl.files.toml import line_of

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
