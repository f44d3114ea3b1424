"""Messages of numbers and arrays: what was packed is unpacked, and nothing else is believed."""

from __future__ import annotations

import json
from random import Random
from typing import Any

import numpy as np
import pytest

from rpctl.files.array_messages import KINDS, LENGTH, MAX_HEAD, pack, unpack

ARRAYS = [np.arange(6).reshape(3, 2).astype(kind) for kind in KINDS]


def test_what_is_packed_is_unpacked_read_only() -> None:
    head, arrays = unpack(
        pack({"word": "ü", "values": [1, 2.5, None]}, [*ARRAYS, np.empty((0, 3))])
    )
    assert head == {"word": "ü", "values": [1, 2.5, None]}
    assert [each.shape for each in arrays] == [(3, 2)] * len(KINDS) + [(0, 3)]
    for found, given in zip(arrays, ARRAYS, strict=False):
        np.testing.assert_array_equal(found, given)
        assert found.dtype == given.dtype
        assert not found.flags.writeable


def message(text: str, rest: bytes = b"") -> bytes:
    return len(text).to_bytes(LENGTH, "big") + text.encode() + rest


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        ("", b""),
        ("[]", b""),
        ("[1, []]", b""),
        ("[{}, 1]", b""),
        ('[{}, [["|u1"]]]', b""),
        ('[{}, [["|O", [1]]]]', bytes(8)),
        ('[{}, [["<f8", [1, 1, 1]]]]', bytes(8)),
        ('[{}, [["<f8", [-1]]]]', bytes(8)),
        ('[{}, [["<f8", [true]]]]', bytes(8)),
        ('[{}, [["<f8", [1, -1]]]]', bytes(8)),
        ('[{}, [["<f8", [1.0]]]]', bytes(8)),
        ('[{}, [["<f8", [4000000000, 4000000000]]]]', bytes(8)),
        ('[{}, [["<f8", [2]]]]', bytes(8)),
        ('[{}, [["<f8", [1]]]]', bytes(9)),
        ("[" * 100_000, b""),
        (json.dumps([{"word": "x" * MAX_HEAD}, []]), b""),
    ],
)
def test_a_message_that_lies_is_refused(text: str, rest: bytes) -> None:
    with pytest.raises(ValueError, match="a message"):
        unpack(message(text, rest))


def test_damaged_messages_are_read_or_refused() -> None:
    random, whole = Random(14), pack({"word": "a"}, ARRAYS)
    refused = 0
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[random.randrange(random.choice((40, len(whole))))] ^= 1 << random.randrange(8)
        end = random.randrange(len(whole))
        found: tuple[dict[str, Any], list[Any]]
        try:
            found = unpack(bytes(damaged[: random.choice((len(whole), end))]))
        except ValueError:
            refused += 1
        else:
            assert sum(each.nbytes for each in found[1]) <= len(whole)
    assert 150 < refused < 300
