"""Run files taken apart, damaged and put together again, for tests of their reader."""

from __future__ import annotations

import io
import json
import random
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpctl import Run
from rpctl.arrays import Array
from rpctl.simulation.packing import pack
from rpctl.simulation.run import entries_of

CENTRAL, END = b"PK\x01\x02", b"PK\x05\x06"  # marks of a directory's entries and of its end
HEADERS = (  # of an array; the shape of the columns' goes into the braces
    "{'descr': '|O', 'fortran_order': False, 'shape': (%d, %d, %d), }",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (%d, %d, %d), }",
    "{'descr': '|u1', 'fortran_order': True, 'shape': (%d, %d, %d), }",
    "{'descr': '|u1', 'fortran_order': False, 'shape': (1%d, %d, %d), }",
    "{'descr': '|u1', 'fortran_order': False, 'shape': (%d, 4, 2, %d, %d), }",
    "{'descr': '|u1', 'fortran_order': False, 'shape': (-%d, %d, %d), }",
    "{'descr': '|u1', 'fortran_order': False, 'shape': (%d99999999, %d, %d), }",
    "{'descr': [('a', '|u1')], 'fortran_order': False, 'shape': (%d, %d, %d), }",
    "__import__('os').system('true') or (%d, %d, %d)",
    "{'descr': '|u1', 'shape': (%d, %d, %d)}",
    "(" * 300 + "%d, %d, %d",
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 3, 10**17, 0.5, -1e300, 1e308, 5e-324, float("nan"), float("inf"),
    "", "x", "\x1b[31m", "\u202e", "\ud800", "\udcff", "\0", "a" * 200_001, [], {}, [[]],
    [1.0, 2.0], ["x"], {"x": 1}, {"law": "paper"}, {"shape": "disc"}, [None] * 5,
)  # fmt: skip


@dataclass(frozen=True)
class Parts:
    """A run's file: its JSON and its columns, as they were before they were packed."""

    meta: dict[str, Any]
    planes: np.ndarray[Any, np.dtype[np.uint8]]

    def text(self) -> str:
        return json.dumps(self.meta, ensure_ascii=False)

    def members(self) -> list[tuple[str, bytes]]:
        return [("meta.npy", npy(np.array(self.text()))), ("columns.npy", npy(self.planes))]


def parts_of(run: Run) -> Parts:
    """Return the parts of a run's file, each column of each array kept for itself."""
    meta, arrays = entries_of(run)
    layout: dict[str, Any] = {}
    columns: list[Array] = []
    for name, array in arrays.items():
        flat = array.reshape(len(array), -1)
        numbers = [[len(columns) + k] for k in range(flat.shape[1])]
        layout[name] = {"shape": list(array.shape[1:]), "columns": numbers}
        columns += list(flat.T)
    head = json.loads(json.dumps(meta, default=lambda number: number.tolist()))
    packed = {"schema": 6, "precision": "double", **head, "columns": layout}
    return Parts(packed, pack(np.array(columns)))


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
    which = chance.randrange(2)
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
        header = chance.choice(HEADERS) % parts.planes.shape
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
        lambda: put((name, npy(parts.planes if which == 0 else np.array("{}")))),
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
    text, planes = parts.text(), parts.planes
    if chance.random() < 0.2:
        planes = _other_planes(planes, chance)
    else:
        text = rewritten_json(text, chance)
    return zipped([("meta.npy", npy(np.array(text))), ("columns.npy", npy(planes))])


def rewritten_older(whole: bytes, chance: random.Random) -> bytes:
    """Return an older file, whose arrays are entries of their own, with another value of JSON."""
    with np.load(io.BytesIO(whole), allow_pickle=False) as stored:
        entries = {name: stored[name] for name in stored}
    entries["meta"] = np.array(rewritten_json(str(entries["meta"]), chance))
    return zipped([(f"{name}.npy", npy(array)) for name, array in entries.items()])


def rewritten_json(text: str, chance: random.Random) -> str:
    """Return a text of JSON with another value, name, digit or nesting somewhere."""
    meta = json.loads(text)
    holder, key = chance.choice(list(_places(meta)))
    way = chance.randrange(7)
    if way <= 2:
        holder[key] = chance.choice(VALUES)
    elif way == 3:
        del holder[key]
    elif way == 4:
        holder[key] = nested(holder[key], chance.choice((1, 30, 3000)))
    elif way == 5:
        text = json.dumps(meta).replace('{"', f'{{"{chance.choice(list(meta))}": 1, "', 1)
        digits = chance.choice(("1" * 400 + ".", "1" * 400, "-0.", "1e999, 0."))
        return text.replace("0.", digits, 1)
    elif isinstance(holder, dict):
        holder[chance.choice(("x", "robot", "\ud800", ""))] = holder.pop(key)
    return json.dumps(meta, ensure_ascii=chance.random() < 0.5)


def nested(value: Any, depth: int) -> Any:
    """Return a value in as many lists."""
    for _ in range(min(depth, 900)):
        value = [value]
    return value


def with_samples(parts: Parts, name: str, change: Callable[[Array], Array]) -> bytes:
    """Return a file with other samples of one array.

    Args:
        parts: Of the file.
        name: Of the array.
        change: From what its columns (n, K) are to what they become.
    """
    from rpctl.simulation.packing import unpack

    columns = unpack(parts.planes)
    numbers = [of[0] for of in parts.meta["columns"][name]["columns"]]
    columns[numbers] = change(columns[numbers])
    return zipped(replace(parts, planes=pack(columns)).members())


def _other_planes(planes: Any, chance: random.Random) -> Any:
    """Return columns with some of them exchanged, cut, doubled, or of other bytes."""
    count, _, rows = planes.shape
    row = chance.randrange(count)
    if chance.random() < 0.3:
        return planes[:, :, : chance.choice((0, 1, 2, rows // 2))]
    if chance.random() < 0.3:
        return np.concatenate([planes[:row], planes[row + chance.randrange(2) :]])
    other = planes.copy()
    other[row] = np.frombuffer(chance.randbytes(8 * rows), np.uint8).reshape(8, rows)
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
