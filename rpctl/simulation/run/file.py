"""The file of a run: what ``numpy.savez_compressed`` writes, checked before it is believed.

Each array of :class:`~rpctl.simulation.run.log.Log` that does not follow from others is an entry,
and ``header`` holds the bytes of a JSON object: all else of the run. NumPy alone reads it::

    with np.load("run.npz") as file:
        header, t, q, tau = json.loads(bytes(file["header"])), file["t"], file["q"], file["tau"]

Places keep every bit; rates and efforts seven digits. What follows from a robot that the header
cannot bring back stands in the file, too.
"""

from __future__ import annotations

import json
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import InputError, RpctlError, RunFileError, one_line, require_known
from rpctl.files.caps import cap, how_to_raise, open_input
from rpctl.files.records import read_record, to_plain
from rpctl.files.strict_json import read_json
from rpctl.files.writing import writing
from rpctl.simulation.run.header import Header, require_plain
from rpctl.simulation.run.log import COLUMNS, KEPT, MIN_SAMPLES, SINGLE, Log

SCHEMA = 7
PRECISIONS = ("double", "single")
HEADER = "header"  # the one entry that is no array of the log
MAX_HEADER = 48 * 2**20  # bytes: a URDF of 32 MB, and what else there is
MAX_SINGLE = float(np.finfo(np.float32).max)
MAX_NUMBER = 1e100  # of a sample: no robot has such, and the square of a larger one may overflow
MAY_BE_INFINITE = ("load_range", "slip_range")  # or no number
TOGETHER = (  # an array, and one that is not missing where it is not
    ("ee", "ee_ref"),
    ("ee_ref", "ee"),
    ("tip_margin", "zmp"),
    ("tip_margin", "contact_load"),
    ("tip_margin", "slip_ratio"),
    ("slip_range", "load_range"),
)
FIX = "it is damaged or was made up; track the robot again"
MAX_TOLD = 300  # characters of a fault
SUFFIX = ".npy"  # of an entry's name in the archive
MAX_READ = 2**21  # bytes that zipfile may ask for at once: a directory of entries may be any size
MAX_ENTRIES = 200
TEXT_TYPE = b"|u1"  # of the header's bytes
ENCRYPTED = 0x1  # a flag of an entry
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
ARRAY_HEADER = re.compile(  # as NumPy writes it
    rb"\{'descr': '(<f4|<f8|\|u1)', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,15}, ?)*(?:\d{1,15})?)\),? ?\}\s*"
)
FAULTS = (  # what zipfile raises of damaged files
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, ValueError, RuntimeError,
    KeyError, IndexError, OverflowError, NotImplementedError,
)  # fmt: skip

Numbers = NDArray[Any]


class EntryError(RpctlError):
    """An entry of a run's file that is not what it must be."""


class DamagedError(EntryError):
    """A file that is no archive of arrays."""


def write_run(path: str | Path, header: Header, log: Log, precision: str = "double") -> Path:
    """Write the file of a run; it is there whole or not at all.

    Args:
        path: The file.
        header: What the run is besides its samples.
        log: The samples.
        precision: ``"double"``, or ``"single"`` for seven digits of all but the time.

    Raises:
        RpctlError: The file cannot be written, or a number does not fit single precision.
    """
    require_known("precision", [precision], PRECISIONS)
    single = precision == "single"
    told = np.frombuffer(json.dumps(header_as_plain(header)).encode(), np.uint8)
    with writing(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        _add(archive, HEADER, told)
        for name in _saved(header, single):  # one after another, for all take much memory
            numbers = getattr(log, name)
            fits = COLUMNS[name].kept == SINGLE and np.abs(numbers).max(initial=0.0) < MAX_SINGLE
            short = name != "t" and (single or fits)
            _add(archive, name, np.asfortranarray(in_single(name, numbers) if short else numbers))
    return Path(path)


def _add(archive: zipfile.ZipFile, name: str, numbers: Numbers) -> None:
    """Add an entry, as ``numpy.savez_compressed`` does."""
    with archive.open(name + SUFFIX, "w", force_zip64=True) as entry:
        np.lib.format.write_array(entry, numbers, allow_pickle=False)


def _saved(header: Header, single: bool) -> tuple[str, ...]:
    """Return the arrays that a file holds.

    The tracking error is the small difference of large numbers, and so is what becomes of energy.
    """
    if not header.robot.rebuilds:
        return tuple(COLUMNS)
    return (*KEPT, "energy", "e") if single else (*KEPT, "energy")


def in_single(name: str, numbers: Array) -> Numbers:
    """Return numbers in single precision, rounded towards 0: none exceeds a limit by it.

    Raises:
        RpctlError: One is too large.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        short = numbers.astype(np.float32)
        larger = np.abs(short) > np.abs(numbers)
    if (larger & np.isinf(short)).any():
        raise RpctlError(f'"{name}" is too large for single precision')
    return np.where(larger, np.nextafter(short, np.float32(0.0)), short)


def header_as_plain(header: Header) -> dict[str, Any]:
    """Return a header as the JSON of a file has it."""
    return {"schema": SCHEMA, **to_plain(header)}


def read_run(path: str | Path) -> tuple[Header, dict[str, Array]]:
    """Return the header and the arrays of the file of a run; arrays are read-only.

    Raises:
        RunFileError: The file is missing, is no run, is damaged, or has another schema. The entry
            that is to blame is named.
    """
    with blamed(path), open_input(path, "MAX_RUN_BYTES", "a run.npz") as file:
        archive = _Archive(file)
        if HEADER not in archive.shapes:
            raise RunFileError(f"{path}: not a run of rpctl; give a run.npz that it wrote")
        header = read_header(archive.text(HEADER), path)
        return header, archive.arrays(header)


def read_chunk(path: Path, header: Header) -> dict[str, Array]:
    """Return the arrays of a chunk of a run that was stopped.

    Raises:
        RunFileError: The file is missing, damaged, or no chunk of such a run.
    """
    with blamed(path), open_input(path, "MAX_RUN_BYTES", "the folder of a stopped run") as file:
        return _Archive(file).arrays(header, chunk=True)


@contextmanager
def blamed(path: str | Path) -> Iterator[None]:
    """Turn what is wrong with an entry into what is wrong with a file."""
    try:
        yield
    except InputError as error:
        raise RunFileError(f"{path}: {error.fault}") from None
    except DamagedError as error:
        raise RunFileError(f"{path}: damaged or not a run of rpctl: {error}") from None
    except EntryError as error:
        raise RunFileError(f"{path}: {error}; {FIX}") from None


def read_header(data: bytes, path: str | Path) -> Header:
    """Return what a header says.

    Args:
        data: Its JSON.
        path: The file that it is of.

    Raises:
        RunFileError: It has another schema.
        EntryError: It is no header; what is wrong is named by its place.
    """
    try:
        plain = read_json(data.decode())
    except ValueError as error:  # also of bytes that are no text
        raise EntryError(f"not JSON of a run: {one_line(str(error))}") from None
    if not isinstance(plain, dict):
        raise EntryError("not JSON of a run")
    schema = plain.pop("schema", None)
    if schema != SCHEMA:
        raise RunFileError(
            f"{path}: schema {one_line(repr(schema)[:40])}, this rpctl reads {SCHEMA}; track the "
            "robot again"
        )
    faults = require_plain(plain)
    header = None
    if not faults:
        header = read_record(Header, plain, HEADER, faults)
    if header is not None:
        faults += [*header.robot.faults(), *header.ground.faults()]
        if not header.wall_time > 0.0:
            faults.append(f"header.wall_time is {header.wall_time:g}, no positive number")
    if header is None or faults:
        raise EntryError("; ".join([one_line(fault)[:MAX_TOLD] for fault in faults[:2]]))
    return header


def check_arrays(shapes: Mapping[str, tuple[int, ...]], header: Header, chunk: bool) -> None:
    """Refuse arrays that are missing, not known, or of other shapes than the header's names say.

    Args:
        shapes: By name, the samples' dimension first.
        header: What the run is.
        chunk: Whether nothing is there that follows from others; a chunk may be of one sample, and
            has a column for each limit that had bound by then.

    Raises:
        EntryError: Naming the entry.
    """
    needed = set(KEPT if chunk or header.robot.rebuilds else COLUMNS)
    if wrong := (needed - shapes.keys()) | (shapes.keys() - COLUMNS.keys()):
        listed = ", ".join(one_line(name) for name in sorted(wrong)[:10])
        raise EntryError(f"entries missing or not known: {listed}")
    lengths = sorted({shape[0] if shape else 0 for shape in shapes.values()})
    if len(lengths) != 1:
        raise EntryError(f"arrays of differing lengths {lengths}")
    if lengths[0] < (1 if chunk else MIN_SAMPLES):
        raise EntryError(f'entry "t" has {lengths[0]} samples; a run has {MIN_SAMPLES} or more')
    sizes = header.sizes()
    for name, shape in shapes.items():
        wanted = tuple(sizes.get(size, size) for size in COLUMNS[name].sizes)
        fits = shape[1:] == wanted or (COLUMNS[name].absent and _is_missing(shape))
        if chunk and name == "active_limits":
            fits = len(shape) == 2 and shape[1] <= sizes["bound_limits"]
        if not fits:
            raise EntryError(f'entry "{name}" does not fit its names: {shape[1:]}, not {wanted}')
    for name, other in TOGETHER:
        there = {name, other} <= shapes.keys() and not _is_missing(shapes[name])
        if there and _is_missing(shapes[other]):
            raise EntryError(f'entry "{other}" has no samples, but "{name}" has')


def _is_missing(shape: tuple[int, ...]) -> bool:
    return shape[1:] == (0,)


def check_numbers(name: str, numbers: Array) -> None:
    """Refuse numbers that are not finite where they must be, and time that does not run.

    Args:
        name: Of the entry.
        numbers: All samples.

    Raises:
        EntryError: Naming the entry.
    """
    if name not in MAY_BE_INFINITE and not (np.abs(numbers) <= MAX_NUMBER).all():
        raise EntryError(
            f'entry "{name}" has numbers that are not finite, or beyond ±{MAX_NUMBER:g}'
        )
    if name == "t" and not (np.diff(numbers) > 0.0).all():
        raise EntryError('entry "t" does not increase: each time must be later than the one before')


class _Archive:
    """An archive of arrays; nothing large is read before sizes and shapes were compared.

    Args:
        file: The archive.

    Raises:
        EntryError: It holds what no archive of arrays does.

    Attributes:
        shapes: Shape of each array, by name.
    """

    def __init__(self, file: BinaryIO) -> None:
        with _readable():
            self._archive = zipfile.ZipFile(_Bounded(file))
        infos, most = self._archive.infolist(), cap("MAX_RUN_BYTES")
        if len(infos) > MAX_ENTRIES:
            raise EntryError(f"{len(infos)} entries, over {MAX_ENTRIES}")
        if (total := sum(info.file_size for info in infos)) > most:
            raise EntryError(
                f"its entries take {total} bytes, over {most}; {how_to_raise('MAX_RUN_BYTES')}"
            )
        self.shapes: dict[str, tuple[int, ...]] = {}
        for info in infos:
            name, suffix = one_line(info.filename[: -len(SUFFIX)]), info.filename[-len(SUFFIX) :]
            if suffix != SUFFIX or "/" in name or "\\" in name:
                raise EntryError(f'entry "{one_line(info.filename)}" is not an array')
            if name in self.shapes:
                raise EntryError(f'entry "{name}" occurs twice')
            self.shapes[name] = self._shape(info, name)

    def _shape(self, info: zipfile.ZipInfo, name: str) -> tuple[int, ...]:
        """Return the shape of an array, its header read without evaluating anything."""
        if info.compress_type not in METHODS or info.flag_bits & ENCRYPTED:
            raise EntryError(f'entry "{name}" is encrypted or not deflated')
        with _readable(f'entry "{name}": '), self._archive.open(info) as file:
            start = file.read(10)
            length = int.from_bytes(start[8:], "little")
            known = ARRAY_HEADER.fullmatch(file.read(length)) if length <= 1024 else None
        of_type = known is not None and (known[1] == TEXT_TYPE) == (name == HEADER)
        if start[:8] != b"\x93NUMPY\x01\x00" or known is None or not of_type:
            raise EntryError(f'entry "{name}" is not an array of numbers')
        shape = tuple(int(size) for size in known[3].replace(b" ", b"").split(b",") if size)
        if 10 + length + np.dtype(known[1].decode()).itemsize * math.prod(shape) != info.file_size:
            raise EntryError(f'entry "{name}": its size is not that of its shape {shape}')
        return shape

    def _read(self, name: str) -> Numbers:
        with _readable(f'entry "{name}": '), self._archive.open(name + SUFFIX) as file:
            return np.asarray(np.lib.format.read_array(file, allow_pickle=False))

    def text(self, name: str) -> bytes:
        """Return the bytes of a text, which is no array of numbers."""
        if len(shape := self.shapes[name]) != 1:
            raise EntryError(f'entry "{name}" is not JSON of a run')
        if shape[0] > MAX_HEADER:
            raise EntryError(f'entry "{name}": over {MAX_HEADER} bytes')
        return self._read(name).tobytes()

    def arrays(self, header: Header, chunk: bool = False) -> dict[str, Array]:
        """Return the arrays of numbers; ``chunk`` as of :func:`check_arrays`."""
        shapes = {name: shape for name, shape in self.shapes.items() if name != HEADER}
        check_arrays(shapes, header, chunk)
        arrays = {}
        for name in shapes:
            arrays[name] = array = self._read(name).astype(np.float64, copy=False)
            array.setflags(write=False)
            check_numbers(name, array)
        return arrays


class _Bounded:
    """A file of which no read takes more than its bound, whatever a header says."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(MAX_READ + 1 if size < 0 else min(size, MAX_READ + 1))
        if len(data) > MAX_READ:
            raise zipfile.BadZipFile("a table of contents that is not that of an array file")
        return data


@contextmanager
def _readable(where: str = "") -> Iterator[None]:
    """Turn what zipfile raises of damaged files into one error."""
    try:
        yield
    except FAULTS as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise DamagedError(f"{where}unreadable ({one_line(reason)})") from None
