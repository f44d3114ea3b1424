"""The rows of the certificate that look at the robot's own shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpctl.drive.drive import Drive
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.file_drive import quantities
from rpctl.equivalence.measure import worst
from rpctl.equivalence.reading import Reading
from rpctl.equivalence.row import Check, Skipped
from rpctl.equivalence.state import State
from rpctl.equivalence.wheel_slip import FileMotion, Slip, slip
from rpctl.robot.model import BASE_NV

SHAPES = "the file's shapes"
SLIDING = 0.02  # of the speed: the sine of the angle up to which axles pass for parallel
PLACED = 1e-9  # m, rad: rounding of a chain of frames; a file's own rounding is 1000 times more
SPEEDS = 1e-12  # of the robot's speed: the rounding of two sums of a few products
NOTED = 1e-3  # of the speed: what slides by design by less is not told
DECLARED = "declared numbers"


class Geometry:
    """The rows of one robot.

    Args:
        dynamics: The dynamics under test.
        reading: The robot's file.
    """

    def __init__(self, dynamics: ReducedDynamics, reading: Reading) -> None:
        self._dynamics, self._reading = dynamics, reading
        gaps = _differences(reading.drive, reading.measured).items()
        self._declared = {label: told for label, (_, told) in gaps if told}

    def skipped(self) -> tuple[Skipped, ...]:
        """Return the row that says which wheels have no shape."""
        names = self._reading.shapeless
        if not names:
            return ()
        text = f"no shape of {', '.join(names)} can be read: the radius is taken as the drive's"
        return (Skipped("wheels' radii", SHAPES, text),)

    def record(self) -> Iterator[Check]:
        """Compare the drive's numbers with those measured on the file."""
        drive = self._dynamics.robot.drive
        gaps = _differences(drive, self._reading.drive)
        if drive.wheels:
            label = max(gaps, key=lambda each: gaps[each][0], default="")
            gap, told = gaps.get(label, (0.0, ""))
            entry = f"{label}: {told} as drawn" if told else ""
            yield Check("drive's geometry", SHAPES, gap, PLACED, entry=entry)

    def at(self, state: State) -> Iterator[Check]:
        """Follow the wheels at S ν through the file: what slips, and what ν says of the base."""
        if not self._dynamics.robot.drive.wheels:
            return
        measured = self._reading.measured
        found = self._slip(self._reading.drive, state)
        yield _sliding("wheels' contact at S ν", found, _by_design(found))
        names = list(found.base)
        gap = np.array([found.base[n] - state.nu[k] for k, n in enumerate(names)])
        yield worst("base speeds ν", SHAPES, gap / (found.speed or 1.0), SPEEDS, names)
        if self._declared:
            told = (f"{label}: {text} as drawn" for label, text in self._declared.items())
            yield _sliding(DECLARED, self._slip(measured, state), "; ".join(told))

    def _slip(self, drive: Drive, state: State) -> Slip:
        robot, raw = self._dynamics.robot, self._reading.raw
        v = self._dynamics.basis(state.q) @ state.nu
        moving = robot.model.names[2:]
        positions = {name: robot.joint_position(state.q, name) for name in moving}
        positions |= robot.locked
        rates = {name: float(v[robot.velocity_index(name)]) for name in moving}
        return slip(FileMotion(raw, drive, positions, v[:BASE_NV], rates, raw.poses(positions)))


def _sliding(name: str, found: Slip, note: str) -> Check:
    """Return what slides fastest where the ground should hold it."""
    sizes = {key: size if np.isfinite(size) else np.inf for key, size in found.held.items()}
    key = max(sizes, key=lambda each: sizes[each])
    return Check(name, SHAPES, sizes[key], SLIDING, entry=_told(key, sizes[key]), note=note)


def _by_design(found: Slip) -> str:
    """Return what the drive's model lets slide, in words."""
    key = max(found.designed, key=lambda each: found.designed[each], default="")
    size = found.designed.get(key, 0.0)
    return f"by the drive's model {_told(key, size)}" if size >= NOTED else ""


def _told(key: str, size: float) -> str:
    """Return how fast what slides; where it is too little to be told, what slides fastest."""
    wheel, _, direction = key.rpartition(", ")
    if size < NOTED:
        return key
    return f"{wheel} slides {direction} at {100.0 * size:.2g} % of the robot's speed"


def _differences(drive: Drive, measured: Drive) -> dict[str, tuple[float, str]]:
    """Return the numbers that differ: by how much, and, beyond rounding, both in words."""
    found = {}
    for (label, one), (_, other) in zip(quantities(drive), quantities(measured), strict=True):
        gap = np.abs(one - other)
        size = float(np.where(np.isfinite(gap), gap, np.inf).max())
        found[label] = size, ""
        if not size <= PLACED:
            texts = (", ".join(f"{value:.6g}" for value in each) for each in (one, other))
            found[label] = size, " in the drive, ".join(texts)
    return found
