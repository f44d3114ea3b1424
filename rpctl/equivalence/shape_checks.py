"""The rows of the certificate that look at the robot's own shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpctl.drive.drive import Drive
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Check, Skipped, worst
from rpctl.equivalence.file_drive import UPRIGHT_ROUNDING, FileReading, quantities
from rpctl.equivalence.leaning_rows import LeaningFileRows
from rpctl.equivalence.state import State
from rpctl.equivalence.wheel_slip import FileMotion, Slip, slip
from rpctl.robot.model import BASE_NV, Robot

SHAPES = "the file's shapes"
SLIDING_TOLERANCE = 0.02  # of the speed: the sine of the angle up to which axles pass for parallel
PLACEMENT_TOLERANCE = (
    1e-9  # m, rad: rounding of a chain of frames; a file's own rounding is 1000 times more
)
SPEED_TOLERANCE = 1e-12  # of the robot's speed: the rounding of two sums of a few products
MIN_NOTED_SLIDING = 1e-3  # of the speed: what slides by design by less is not told
DECLARED = "declared numbers"


class Geometry:
    """The rows of one robot."""

    def __init__(self, dynamics: ReducedDynamics, reading: FileReading) -> None:
        self._dynamics, self._reading = dynamics, reading
        gaps = _differences(reading.drive, reading.measured).items()
        self._limit = _sliding_limit(dynamics.robot, reading)
        self._declared = {label: difference for label, (_, difference) in gaps if difference}

    def skipped(self) -> tuple[Skipped, ...]:
        """Return the row that says which wheels have no shape."""
        names = self._reading.shapeless
        if not names:
            return ()
        text = f"no shape of {', '.join(names)} can be read: the radius is that of the drive"
        return (Skipped("wheels' radii", SHAPES, text),)

    def record(self) -> Iterator[Check]:
        """Compare the drive's numbers with those measured on the file."""
        drive = self._dynamics.robot.drive
        gaps = _differences(drive, self._reading.drive)
        if drive.wheels:
            label = max(gaps, key=lambda each: gaps[each][0], default="")
            gap, difference = gaps.get(label, (0.0, ""))
            entry = f"{label}: {difference} as drawn" if difference else ""
            yield Check("drive's geometry", SHAPES, gap, PLACEMENT_TOLERANCE, entry=entry)

    def at(self, state: State) -> Iterator[Check]:
        """Follow the wheels at S ν through the file: what slips, and what ν says of the base."""
        if not self._dynamics.robot.drive.wheels:
            return
        measured = self._reading.measured
        found = self._slip(self._reading.drive, state)
        yield _sliding("wheels' contact at S ν", found, _design_note(found), self._limit)
        names = list(found.base)
        gap = np.array([found.base[n] - state.nu[k] for k, n in enumerate(names)])
        yield worst("base speeds ν", SHAPES, gap / (found.speed or 1.0), SPEED_TOLERANCE, names)
        if self._declared:
            difference = (f"{label}: {text} as drawn" for label, text in self._declared.items())
            yield _sliding(
                DECLARED, self._slip(measured, state), "; ".join(difference), self._limit
            )

    def _slip(self, drive: Drive, state: State) -> Slip:
        robot, raw = self._dynamics.robot, self._reading.raw
        v = self._dynamics.basis(state.q) @ state.nu
        moving = robot.moving_joint_names
        positions = {name: robot.joint_position(state.q, name) for name in moving}
        positions |= robot.locked
        rates = {name: float(v[robot.velocity_index(name)]) for name in moving}
        return slip(FileMotion(raw, drive, positions, v[:BASE_NV], rates, raw.poses(positions)))


class LeaningGeometry(Geometry):
    """The rows of one robot that leans.

    Args:
        rows: Those of its wheels, as the file's places have them.
    """

    def __init__(
        self, dynamics: ReducedDynamics, reading: FileReading, rows: LeaningFileRows
    ) -> None:
        super().__init__(dynamics, reading)
        self._rows = rows

    def at(self, state: State) -> Iterator[Check]:
        """Follow both wheels at S ν through the file: what slips, and what ν says."""
        robot = self._dynamics.robot
        v = self._dynamics.basis(state.q) @ state.nu
        L, _ = self._rows.equations(state.q, np.zeros(robot.nv))
        found, speed = L @ v, float(np.abs(v).max()) or 1.0
        held = len(L) - robot.dof
        wheels = [wheel.joint for wheel in robot.drive.wheels]
        moved = np.abs(found[:held]).max(initial=0.0) / speed
        text = f"{' and '.join(wheels)}, ahead, aside and up"
        yield Check("wheels' contact at S ν", SHAPES, float(moved), SPEED_TOLERANCE, entry=text)
        names = list(robot.quasi_velocities)
        yield worst(
            "base speeds ν", SHAPES, (found[held:] - state.nu) / speed, SPEED_TOLERANCE, names
        )


def _sliding_limit(robot: Robot, reading: FileReading) -> float:
    """Return how much of the robot's speed may slide.

    Where an axis leans, the model turns a contact about the place where the axis meets the ground,
    which takes it off by up to twice its distance from there: that times the sine.
    """
    poses = reading.raw.poses(robot.locked)
    joints = [reading.raw.joint[swivel.joint] for swivel in robot.drive.swivels]
    axes = [poses[joint.child][:3, :3] @ joint.axis for joint in joints]
    lean = max((float(np.hypot(*axis[:2])) for axis in axes), default=0.0)
    return 2.0 * lean if lean > UPRIGHT_ROUNDING else SLIDING_TOLERANCE


def _sliding(name: str, found: Slip, note: str, limit: float) -> Check:
    """Return what slides fastest where the ground should hold it."""
    sizes = {key: size if np.isfinite(size) else np.inf for key, size in found.constrained.items()}
    key = max(sizes, key=lambda each: sizes[each])
    return Check(name, SHAPES, sizes[key], limit, entry=_sliding_text(key, sizes[key]), note=note)


def _design_note(found: Slip) -> str:
    """Return what the drive's model lets slide, in words."""
    key = max(found.by_design, key=lambda each: found.by_design[each], default="")
    size = found.by_design.get(key, 0.0)
    return f"by the drive's model {_sliding_text(key, size)}" if size >= MIN_NOTED_SLIDING else ""


def _sliding_text(key: str, size: float) -> str:
    """Return a wheel's slip as text; only its name where the slip is negligible."""
    wheel, _, direction = key.rpartition(", ")
    if size < MIN_NOTED_SLIDING:
        return key
    return f"{wheel} slides {direction} at {100.0 * size:.2g} % of the robot's speed"


def _differences(drive: Drive, measured: Drive) -> dict[str, tuple[float, str]]:
    """Return the numbers that differ: by how much, and, beyond rounding, both in words."""
    found = {}
    for (label, one), (_, other) in zip(quantities(drive), quantities(measured), strict=True):
        gap = np.abs(one - other)
        size = float(np.where(np.isfinite(gap), gap, np.inf).max())
        found[label] = size, ""
        if not size <= PLACEMENT_TOLERANCE:
            texts = (", ".join(f"{value:.6g}" for value in each) for each in (one, other))
            found[label] = size, " in the drive, ".join(texts)
    return found
