"""``.npz`` files of others: each entry's name, kind and size are checked before any is read."""

from __future__ import annotations

import math
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, one_line
from rpctl.files.caps import how_to_raise

SUFFIX = ".npy"  # of an entry's name in the file
PIECE = 2**20  # bytes that one read asks for
MAX_READ = 2**21  # bytes that zipfile may ask for at once: a directory of entries may be any size
MAX_ENTRIES = 200  # of a file
MAX_HEADER = 4096  # bytes; NumPy's own take 118
ENCRYPTED = 0x1  # a flag of an entry
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
HEADER = re.compile(  # as NumPy writes it
    r"\{'descr': '([^']{1,12})', 'fortran_order': (True|False), "
    r"'shape': \(((?:\d{1,15}, ?)*(?:\d{1,15})?)\),? ?\}\s*"
)
ITEM = re.compile(r"(<f8|\|u1|<U)(\d{0,9})")
ITEM_SIZES = {"<f8": 8, "|u1": 1, "<U": 4}
FAULTS = (  # what zipfile raises of damaged files
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, ValueError, RuntimeError,
    KeyError, IndexError, OverflowError, NotImplementedError,
)  # fmt: skip


Filled = Callable[[Array, int, int], object]


class NpzError(RpctlError):
    """An ``.npz`` file that is damaged, or holds what it may not."""


@dataclass(frozen=True)
class NpzEntry:
    """What the header of an entry says.

    Attributes:
        name: Its name, without ``.npy``.
        kind: ``"<f8"`` (numbers), ``"|u1"`` (bytes) or ``"<U"`` (text).
        characters: Of a text's items.
        shape: Of the array.
        fortran: Whether the first index runs fastest.
        offset: Bytes of the header.
    """

    name: str
    kind: str
    characters: int
    shape: tuple[int, ...]
    fortran: bool
    offset: int

    @property
    def nbytes(self) -> int:
        """Bytes of the array."""
        return ITEM_SIZES[self.kind] * self.characters * math.prod(self.shape)


class Npz:
    """An open ``.npz`` file: its entries by name; see :func:`open_npz`."""

    def __init__(self, archive: zipfile.ZipFile, max_bytes: int) -> None:
        infos = archive.infolist()
        if len(infos) > MAX_ENTRIES:
            raise NpzError(f"{len(infos)} entries, over {MAX_ENTRIES}")
        names = [info.filename for info in infos]
        for info in infos:
            _require_plain(info, names)
        if (total := sum(info.file_size for info in infos)) > max_bytes:
            raise NpzError(
                f"its entries take {total} bytes, over {max_bytes}; {how_to_raise('MAX_RUN_BYTES')}"
            )
        self._archive = archive
        self._infos = {info.filename.removesuffix(SUFFIX): info for info in infos}
        self.names = tuple(self._infos)

    def entry(self, name: str) -> NpzEntry:
        """Return what an entry's header says, if that is what its declared size says.

        Raises:
            NpzError: It is damaged, or an array of other things than doubles, bytes or text.
        """
        with self._open(name) as file:
            entry = _read_header(name, file)
        if entry.offset + entry.nbytes != self._infos[name].file_size:
            raise NpzError(f'entry "{name}": its size is not that of its shape {entry.shape}')
        return entry

    def pieces(self, entry: NpzEntry, sizes: Iterable[int] | None = None) -> Iterator[bytes]:
        """Yield an entry's bytes in pieces; at the end its checksum is compared.

        Args:
            entry: From :meth:`entry`.
            sizes: Bytes of each piece, together the entry's; None: pieces of one bounded size.

        Raises:
            NpzError: It is damaged.
        """
        if sizes is None:
            sizes = (min(PIECE, entry.nbytes - at) for at in range(0, entry.nbytes, PIECE))
        with self._open(entry.name) as file:
            _exactly(file, entry.offset, entry.name)
            for size in sizes:
                yield _exactly(file, size, entry.name)
            if file.read(1):
                raise NpzError(f'entry "{entry.name}": longer than it says')

    def text(self, name: str, max_characters: int) -> str:
        """Return the one text that an entry holds.

        Args:
            name: Of the entry.
            max_characters: More are refused before they are read.

        Raises:
            NpzError: It is damaged, too long, or no text.
        """
        entry = self.entry(name)
        if entry.kind != "<U" or entry.shape != ():
            raise NpzError(f'entry "{name}": no text')
        if entry.characters > max_characters:
            raise NpzError(f'entry "{name}": over {max_characters} characters')
        data = b"".join(self.pieces(entry))
        try:
            return data.decode("utf-32-le", "surrogatepass").rstrip("\0")
        except UnicodeDecodeError:
            raise NpzError(f'entry "{name}": no text') from None

    def numbers(self, entry: NpzEntry, out: Array, filled: Filled | None = None) -> None:
        """Read an entry of numbers into an array of its shape.

        Args:
            entry: From :meth:`entry`.
            out: Filled; it may be larger than memory unless the entry's first index runs fastest.
            filled: Called with ``out`` as one row, the first of the numbers that were filled, and
                the one behind the last.

        Raises:
            NpzError: It is damaged.
        """
        if entry.fortran:  # none of rpctl's own arrays are so
            whole = np.frombuffer(b"".join(self.pieces(entry)), "<f8")
            out[...] = whole.reshape(entry.shape, order="F")
            return
        flat, first = out.reshape(-1), 0
        for piece in self.pieces(entry):
            numbers = np.frombuffer(piece, "<f8")
            last = first + len(numbers)
            flat[first:last] = numbers
            if filled is not None:
                filled(flat, first, last)
            first = last

    @contextmanager
    def _open(self, name: str) -> Iterator[zipfile.ZipExtFile]:
        if name not in self._infos:
            raise NpzError(f'entry "{name}" is missing')
        with _faults(f'entry "{name}": '), self._archive.open(self._infos[name]) as file:
            yield file  # type: ignore[misc]


@contextmanager
def open_npz(file: BinaryIO, max_bytes: int) -> Iterator[Npz]:
    """Yield an ``.npz`` file, its entries' names and declared sizes checked.

    Args:
        file: It, open.
        max_bytes: That its entries may declare together, and so take.

    Raises:
        NpzError: It is no ``.npz`` file, is damaged, too large, or holds what is no array.
    """
    with _faults(""):
        archive = zipfile.ZipFile(_Bounded(file))
    with archive:
        yield Npz(archive, max_bytes)


class _Bounded:
    """A file of which no read takes more than its bound, whatever a header says."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(MAX_READ + 1 if size < 0 else min(size, MAX_READ + 1))
        if len(data) > MAX_READ:
            raise zipfile.BadZipFile("a directory of entries that no array file has")
        return data


@contextmanager
def _faults(where: str) -> Iterator[None]:
    """Turn what zipfile raises of damaged files into one error."""
    try:
        yield
    except FAULTS as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise NpzError(f"{where}unreadable ({one_line(reason)})") from None


def _require_plain(info: zipfile.ZipInfo, names: Collection[str]) -> None:
    """Refuse an entry that NumPy would not have written."""
    name = one_line(info.filename)
    if not info.filename.endswith(SUFFIX) or "/" in name or "\\" in name:
        raise NpzError(f'entry "{name}" is no array')
    if list(names).count(info.filename) > 1:
        raise NpzError(f'entry "{name.removesuffix(SUFFIX)}" is there twice')
    if info.compress_type not in METHODS or info.flag_bits & ENCRYPTED:
        raise NpzError(f'entry "{name.removesuffix(SUFFIX)}" is encrypted or not deflated')


def _exactly(file: zipfile.ZipExtFile, size: int, name: str) -> bytes:
    """Return the next bytes, all of them."""
    pieces = bytearray()
    while len(pieces) < size:
        piece = file.read(min(size - len(pieces), PIECE))
        if not piece:
            raise NpzError(f'entry "{name}": shorter than it says')
        pieces += piece
    return bytes(pieces)


def _read_header(name: str, file: zipfile.ZipExtFile) -> NpzEntry:
    """Return what the header of an array says, read without evaluating anything."""
    start = _exactly(file, 8, name)
    version = start[6]
    if start[:6] != b"\x93NUMPY" or version not in (1, 2, 3) or start[7] != 0:
        raise NpzError(f'entry "{name}": no array of NumPy')
    size = _exactly(file, 2 if version == 1 else 4, name)
    length = int.from_bytes(size, "little")
    if length > MAX_HEADER:
        raise NpzError(f'entry "{name}": a header of {length} bytes')
    text = _exactly(file, length, name).decode("latin-1")
    found = HEADER.fullmatch(text)
    item = found and ITEM.fullmatch(found[1])
    if not found or not item or (item[2] != "" and item[1] != "<U"):
        raise NpzError(f'entry "{name}": no array of doubles, bytes or text')
    shape = tuple(int(size) for size in found[3].replace(" ", "").split(",") if size)
    characters = int(item[2] or 0) if item[1] == "<U" else 1
    offset = 8 + len(size) + length
    return NpzEntry(name, item[1], characters, shape, found[2] == "True", offset)
