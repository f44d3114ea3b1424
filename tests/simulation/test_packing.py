"""Packed columns: every bit comes back, and smooth motion takes little room."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.simulation.packing import pack, unpack

SEED = 20_260_714
ROWS = (1, 2, 3, 4, 5, 8, 9, 17, 100, 257)


def bits(columns: Array) -> Any:
    return np.ascontiguousarray(columns).view(np.int64)


def columns_of(kind: str, rows: int) -> Array:
    """Return columns (4, rows) of a kind."""
    random = np.random.default_rng([SEED, rows])
    if kind == "any bits":
        return random.integers(-(2**63), 2**63 - 1, (4, rows), endpoint=True).view(np.float64)
    if kind == "noise":
        return random.normal(scale=1e3, size=(4, rows))
    if kind == "edges":
        edges = [0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, 1.7e308, -1.7e308]
        return random.choice(edges, (4, rows))
    return np.sin(np.linspace(0.0, 3.0, rows) * np.array([[1.0], [2.0], [0.0], [-5.0]]))


@pytest.mark.parametrize("kind", ["any bits", "noise", "edges", "smooth"])
def test_every_bit_comes_back(kind: str) -> None:
    for rows in ROWS:
        columns = columns_of(kind, rows)
        planes = pack(columns)
        assert planes.shape == (4, 8, rows)
        assert planes.dtype == np.uint8
        np.testing.assert_array_equal(bits(unpack(planes)), bits(columns))
        with np.errstate(all="ignore"):
            rounded = columns.astype(np.float32).astype(np.float64)
        np.testing.assert_array_equal(bits(unpack(pack(rounded, True), True)), bits(rounded))


def test_a_column_is_packed_alike_alone_and_beside_others() -> None:
    """So that a file does not depend on how many columns fit in memory at once."""
    columns = columns_of("noise", 100)
    alone = np.concatenate([pack(column[None]) for column in columns])
    np.testing.assert_array_equal(alone, pack(columns))


def test_polynomials_of_degree_nine_leave_nothing_inside() -> None:
    """Of whole numbers small enough that sums are exact; at the ends neighbours are missing."""
    t = np.arange(-16.0, 17.0)
    codes = pack(np.array([3.0 * t - 7.0, t**9])).transpose(0, 2, 1).copy().view("<i8")[:, :, 0]
    finest = codes[:, 17:]  # the numbers in between
    assert not finest[:, 4:12].any()
    assert finest[1, [0, 3, 12, 15]].all()
    tenth = pack((t**10)[None]).transpose(0, 2, 1).copy().view("<i8")[:, :, 0]
    assert tenth[:, 17:][:, 4:12].all()


def test_smooth_columns_take_two_bits_of_noise() -> None:
    """A smooth column is known to its last bits but for the rounding of its own numbers."""
    columns = 1.5 + np.sin(np.linspace(0.0, 6.0, 4096))[None]
    packed = len(zlib.compress(pack(columns).tobytes(), 9))
    assert packed < 0.10 * columns.nbytes
    assert packed < len(zlib.compress(columns.tobytes(), 9)) / 8
    rounded = columns.astype(np.float32).astype(np.float64)
    single, double = (len(zlib.compress(pack(rounded, s).tobytes(), 9)) for s in (True, False))
    assert single < 0.8 * packed < 0.4 * double
