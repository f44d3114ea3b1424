"""Whole numbers of 64 bits, as seeds are, are read; longer ones are nobody's."""

from __future__ import annotations

import pytest

from rpctl.files.strict_json import read_json


def test_whole_numbers_of_64_bits_are_read() -> None:
    for number in (2**63 - 1, 1 - 2**63, 10**18, 0):
        assert read_json(f'{{"seed": {number}}}') == {"seed": number}
    for number in (2**63, -(2**63), 10**19):
        with pytest.raises(ValueError, match=f"a whole number of {len(str(number))} digits"):
            read_json(f"[{number}]")
