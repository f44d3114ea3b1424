"""Run files taken apart, damaged and put together again, for tests of their reader."""

from __future__ import annotations

import io
import json
import random
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rpctl import Run

CENTRAL, END = b"PK\x01\x02", b"PK\x05\x06"  # marks of a directory's entries and of its end
HEADERS = (  # of an array; the shape goes into the braces
    "{'descr': '|O', 'fortran_order': False, 'shape': (%d, %d), }",
    "{'descr': '<i8', 'fortran_order': False, 'shape': (%d, %d), }",
    "{'descr': '<f8', 'fortran_order': True, 'shape': (%d, %d), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1%d, %d), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-%d, %d), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (%d99999999, %d), }",
    "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (%d, %d), }",
    "__import__('os').system('true') or (%d, %d)",
    "{'descr': '<f8', 'shape': (%d, %d)}",
    "(" * 300 + "%d, %d",
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 3, 10**17, 0.5, -1e300, 1e308, 5e-324, float("nan"), float("inf"),
    "", "x", "\x1b[31m", "\u202e", "\ud800", "\udcff", "\0", "a" * 200_001, [], {}, [[]],
    [1.0, 2.0], ["x"], {"x": 1}, {"law": "paper"}, {"shape": "disc"}, [None] * 5,
)  # fmt: skip


@dataclass(frozen=True)
class Parts:
    """A run's file: its header and its arrays."""

    header: dict[str, Any]
    arrays: Mapping[str, np.ndarray[Any, np.dtype[Any]]]

    def text(self) -> str:
        return json.dumps(self.header)

    def members(self, text: str | None = None) -> list[tuple[str, bytes]]:
        header = np.frombuffer((self.text() if text is None else text).encode(), np.uint8)
        entries = {"header": header, **self.arrays}
        return [(f"{name}.npy", npy(array)) for name, array in entries.items()]

    def whole(self, text: str | None = None) -> bytes:
        return zipped(self.members(text))

    def changed(self, **arrays: Any) -> Parts:
        """Return a file with other arrays; None leaves one out."""
        kept = {n: a for n, a in {**self.arrays, **arrays}.items() if a is not None}
        return replace(self, arrays=kept)


def parts_of(run: Run, folder: Path) -> Parts:
    """Return the parts of a run's file."""
    path = run.save(folder / "parts.npz")
    with np.load(path, allow_pickle=False) as stored:
        entries = {name: stored[name] for name in stored}
    return Parts(json.loads(bytes(entries.pop("header"))), entries)


def npy(array: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def zipped(members: list[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", method) as archive:
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data, method)
    return buffer.getvalue()


def with_header(data: bytes, header: str, version: int = 1) -> bytes:
    """Return an array's bytes under another header."""
    length = int.from_bytes(data[8:10], "little")
    text = header.encode("latin-1") + b"\n"
    return (
        data[:6]
        + bytes([version, 0])
        + len(text).to_bytes(2, "little")
        + text
        + data[10 + length :]
    )


def damaged(parts: Parts, chance: random.Random) -> bytes:
    """Return a file whose bytes, names or headers were damaged: the same run, or none."""
    members = parts.members()
    which = chance.choice((0, 2))  # the header, or q
    name, data = members[which]

    def put(*changed: tuple[str, bytes]) -> bytes:
        return zipped([*members[:which], *changed, *members[which + 1 :]])

    def flipped(whole: bytes) -> bytes:
        found = bytearray(whole)
        for _ in range(chance.choice((1, 1, 2, 8))):
            found[chance.randrange(len(found))] ^= 1 << chance.randrange(8)
        return bytes(found)

    def directory() -> bytes:
        """Flip bytes of the directory, where the sizes, methods and flags are."""
        whole = zipped(members)
        start = whole.index(CENTRAL)
        return whole[:start] + flipped(whole[start:])

    def sizes() -> bytes:
        """Declare other sizes, up to those that stand for a size of 64 bits."""
        whole = bytearray(zipped(members))
        at = whole.index(CENTRAL) + chance.choice((16, 20, 24, 42))  # CRC, packed, size, offset
        whole[at : at + 4] = chance.choice((b"\xff" * 4, b"\0" * 4, chance.randbytes(4)))
        return bytes(whole)

    def headed() -> bytes:
        header = chance.choice(HEADERS) % parts.arrays["q"].shape
        return put((name, with_header(data, header, chance.choice((0, 1, 1, 1, 2, 3, 9)))))

    cut = chance.randrange(len(data))
    ways: tuple[Callable[[], bytes], ...] = (
        lambda: put(),
        lambda: put((name, data), (name, data)),
        lambda: put((name, data), (name, b"")),
        lambda: put((chance.choice(("../", "/", "x", "\\")) + name, data)),
        lambda: put((name.removesuffix(".npy"), data)),
        lambda: put((name, data), ("extra.npy", npy(np.zeros(3)))),
        lambda: put((name, data[:cut])),
        lambda: put((name, data + b"\0" * 7)),
        lambda: put((name, npy(np.array("{}")))),
        lambda: put((name, npy(np.array(["{}", "{}"])))),
        lambda: zipped(members, chance.choice((zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))),
        lambda: zipped(members, zipfile.ZIP_STORED),
        lambda: flipped(zipped(members)),
        lambda: zipped(members)[: chance.randrange(len(zipped(members)))],
        lambda: chance.randbytes(chance.randrange(100)) + zipped(members),
        lambda: zipped(members) + chance.randbytes(chance.randrange(100)),
        directory, directory, sizes, sizes, headed, headed,
    )  # fmt: skip
    return chance.choice(ways)()


def rewritten(parts: Parts, chance: random.Random) -> bytes:
    """Return a sound file with another value, name or sample somewhere: another run, or none."""
    if chance.random() < 0.2:
        name = chance.choice(list(parts.arrays))
        return parts.changed(**{name: _other(parts.arrays[name], chance)}).whole()
    return parts.whole(rewritten_json(parts.text(), chance))


def rewritten_json(text: str, chance: random.Random) -> str:
    """Return a text of JSON with another value, name, digit or nesting somewhere."""
    header = json.loads(text)
    holder, key = chance.choice(list(_places(header)))
    way = chance.randrange(7)
    if way <= 2:
        holder[key] = chance.choice(VALUES)
    elif way == 3:
        del holder[key]
    elif way == 4:
        holder[key] = nested(holder[key], chance.choice((1, 30, 3000)))
    elif way == 5:
        text = json.dumps(header).replace('{"', f'{{"{chance.choice(list(header))}": 1, "', 1)
        digits = chance.choice(("1" * 400 + ".", "1" * 400, "-0.", "1e999, 0."))
        return text.replace("0.", digits, 1)
    elif isinstance(holder, dict):
        holder[chance.choice(("x", "robot", "\ud800", ""))] = holder.pop(key)
    return json.dumps(header)


def nested(value: Any, depth: int) -> Any:
    """Return a value in as many lists."""
    for _ in range(min(depth, 900)):
        value = [value]
    return value


def _other(array: Any, chance: random.Random) -> Any:
    """Return an array cut, doubled, or with some other numbers in it."""
    way = chance.randrange(3)
    if way == 0:
        return array[: chance.choice((0, 1, 2, len(array) // 2))]
    if way == 1:
        return np.concatenate([array, array], axis=-1)
    other = array.copy()
    if other.size:
        with np.errstate(over="ignore"):  # 1e300 in single precision
            other.flat[chance.randrange(other.size)] = chance.choice(
                (np.nan, np.inf, 1e30, -1e30, 0.5, 1e300)
            )
    return other


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the holder and the key of each value in JSON; of long lists the first few."""
    pairs: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        pairs = list(value.items())
    elif isinstance(value, list):
        pairs = list(enumerate(value[:4]))
    for key, each in pairs:
        yield value, key
        yield from _places(each)
