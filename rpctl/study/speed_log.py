"""``SpeedLog``: speeds that were commanded and measured, of a run, a real robot's log or arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.csv_file import refusal
from rpctl.reference.csv_rows import TextRow, read_rows, separator_fault
from rpctl.simulation.run import Run

MIN_SAMPLES = 10
# What a commanded column's name holds, and what the measured one holds in its place.
PAIRS = (("commanded", "measured"), ("nu_cmd_", "nu_"))
EXAMPLE = "t,commanded,measured, or t,v_commanded,v_measured,omega_commanded,omega_measured"


@dataclass(frozen=True)
class SpeedLog:
    """Speeds of n channels at K times: what was commanded from then on, and what was measured.

    Attributes:
        t: Times (K,), increasing, s.
        commanded: (K, n), each held until the next; one channel may be (K,). m/s or rad/s.
        measured: As ``commanded``.
        names: Of the channels; empty: their numbers.
    """

    t: Array
    commanded: Array
    measured: Array
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays, read-only; refuse what is no log."""
        t = np.array(self.t, dtype=float)
        commanded, measured = (
            np.array(each, dtype=float) for each in (self.commanded, self.measured)
        )
        if commanded.ndim == 1:
            commanded, measured = commanded[:, None], measured.reshape(len(measured), -1)
        if t.ndim != 1 or commanded.ndim != 2 or not len(t) == len(commanded) == len(measured):
            raise RpctlError("give as many commanded and measured speeds as times")
        if commanded.shape != measured.shape:
            raise RpctlError(
                f"{commanded.shape[1]} channels are commanded and {measured.shape[1]} measured; "
                "give the same"
            )
        if len(t) < MIN_SAMPLES:
            raise RpctlError(f"{len(t)} samples; give {MIN_SAMPLES} or more")
        if not all(np.isfinite(each).all() for each in (t, commanded, measured)):
            raise RpctlError("the log holds numbers that are not finite; leave those rows out")
        if not (np.diff(t) > 0.0).all():
            raise RpctlError(
                "the log's times do not increase; sort it, and leave out what is twice"
            )
        names = tuple(self.names) or tuple(f"channel {k + 1}" for k in range(commanded.shape[1]))
        if len(names) != commanded.shape[1]:
            raise RpctlError(f"{len(names)} names for {commanded.shape[1]} channels; give the same")
        for name, value in (("t", t), ("commanded", commanded), ("measured", measured)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "names", names)


def log_of_run(run: Run) -> SpeedLog:
    """Return the speeds of a run.

    Raises:
        RpctlError: Its output were efforts.
    """
    if not run.log.nu_cmd.shape[1]:
        raise RpctlError(
            "the run has no commanded speeds, its output were efforts; track with output velocity"
        )
    return SpeedLog(run.t, run.log.nu_cmd, run.nu, run.robot.quasi_velocities)


def read_speed_log(path: str | Path) -> SpeedLog:
    """Read a log in CSV: a header that names ``t`` and pairs of columns, and a row a sample.

    A pair is ``NAME_commanded`` and ``NAME_measured``, or just ``commanded`` and ``measured``, or
    the ``nu_cmd_NAME`` and ``nu_NAME`` of :meth:`Run.to_csv`. Other columns are not read.

    Raises:
        DescriptionError: The file is missing or has faults; they are named with their lines.
        RpctlError: It holds too few samples, or times that do not increase.
    """
    rows = read_rows(path)
    header = next(rows, None)
    if header is None:
        raise refusal(path, [(None, f"empty; give a header such as {EXAMPLE}, and rows")])
    names = header.cells
    channels = _channels(names)
    fault = separator_fault(names) or _header_fault(names, channels)
    if fault:
        raise refusal(path, [(header.line, fault)])
    wanted = [names.index("t")] + [k for pair in channels.values() for k in pair]
    values, faults = list[list[float]](), list[tuple[int | None, str]]()
    for row in rows:
        numbers = _numbers(row, names, wanted)
        if isinstance(numbers, str):
            faults.append((row.line, numbers))
        else:
            values.append(numbers)
    if faults:
        raise refusal(path, faults)
    table = np.array(values).reshape(-1, len(wanted))
    return SpeedLog(table[:, 0], table[:, 1::2], table[:, 2::2], tuple(channels))


def _channels(names: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Return the columns of commanded and measured speeds by the channel's name."""
    found = {}
    for commanded, measured in PAIRS:
        for index, name in enumerate(names):
            other = name.replace(commanded, measured, 1)
            if commanded in name and other in names:
                label = name.replace(commanded, "", 1).strip("_ .") or "speed"
                found[label] = index, names.index(other)
    return found


def _header_fault(names: Sequence[str], channels: dict[str, tuple[int, int]]) -> str:
    if "t" not in names:
        return f"no column t; name the columns as {EXAMPLE}"
    if not channels:
        return f"no commanded speed has a measured one beside it; name the columns as {EXAMPLE}"
    return ""


def _numbers(row: TextRow, names: Sequence[str], wanted: Sequence[int]) -> list[float] | str:
    """Return the numbers in some of a row's cells, or what is wrong with them.

    Args:
        row: The row.
        names: Of all columns.
        wanted: Indices of the cells.
    """
    if len(row.cells) != len(names):
        return f"{len(row.cells)} entries where the header names {len(names)}"
    found = [_number(row.cells[index]) for index in wanted]
    for index, number in zip(wanted, found, strict=True):
        if not math.isfinite(number):
            return f'{names[index]} "{row.cells[index]}" is no number; leave the row out'
    return found


def _number(text: str) -> float:
    """Return the number in a cell; NaN if there is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
