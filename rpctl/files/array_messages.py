"""Numbers and arrays as bytes between processes, so that neither runs what the other sends."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

LENGTH = 8  # bytes that tell how long the head is
MAX_HEAD = 2**20  # bytes of a head
KINDS = ("|u1", "|i1", "<u4", "<f4", "<f8")  # of numbers that an array may hold
MAX_AXES = 2


def pack(head: Mapping[str, Any], arrays: Sequence[NDArray[Any]] = ()) -> bytes:
    """Return a message of what JSON can say, and arrays."""
    solid = [np.ascontiguousarray(array) for array in arrays]
    text = json.dumps([head, [(array.dtype.str, array.shape) for array in solid]]).encode()
    return b"".join([len(text).to_bytes(LENGTH, "big"), text, *(each.tobytes() for each in solid)])


def unpack(message: bytes) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return what a message says; its arrays are read-only, and it may come from anybody.

    Raises:
        ValueError: It is no such message.
    """
    size = int.from_bytes(message[:LENGTH], "big")
    if size > min(MAX_HEAD, len(message) - LENGTH):
        raise ValueError("a message whose head is longer than it may be")
    try:
        head, layout = json.loads(message[LENGTH : LENGTH + size])
        shapes = [(str(kind), tuple(shape)) for kind, shape in layout]
    except (ValueError, TypeError, RecursionError):
        raise ValueError("a message whose head cannot be read") from None
    if not isinstance(head, dict):
        raise ValueError("a message without a head")
    arrays, offset = [], LENGTH + size
    for kind, shape in shapes:
        array = _array(message, offset, kind, shape)
        arrays.append(array)
        offset += array.nbytes
    if offset != len(message):
        raise ValueError("a message of another length than it says")
    return head, arrays


def _array(message: bytes, offset: int, kind: str, shape: tuple[Any, ...]) -> NDArray[Any]:
    """Return the array that begins at a byte of a message.

    Args:
        message: The whole message.
        offset: Where the array begins.
        kind: Of its numbers.
        shape: Of the array.
    """
    whole = all(type(count) is int and 0 <= count <= len(message) for count in shape)
    if kind not in KINDS or len(shape) > MAX_AXES or not whole:
        raise ValueError("a message with an array that is none")
    count = math.prod(shape)
    if count * np.dtype(kind).itemsize > len(message) - offset:
        raise ValueError("a message shorter than it says")
    return np.frombuffer(message, kind, count, offset).reshape(shape)
