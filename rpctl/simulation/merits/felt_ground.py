"""What the ground did to a robot whose wheels can slip and lift: figures, and one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.run import Run

TOLD_TILT = math.radians(1.0)  # rad: soft contacts let a robot lean by a hundredth of it
LIFTED = 1e-3  # of the weight: a contact that bears less has lifted
X, Y = 3, 4  # of a pose's quaternion x, y, z, w


@dataclass(frozen=True)
class FeltGround:
    """What the plant says of the ground; None is what it does not know.

    Attributes:
        max_wheel_slip: Largest velocity of a wheel's contact point over the ground, m/s; that of a
            wheel in the air does not count.
        slipping_wheel: The wheel.
        slip_time: When, s.
        min_load: Least load of a contact, N.
        lifted: Contacts that bore nothing for a while.
        max_tilt: Largest angle between the root link and the level, rad.
        hanging: Those of them that bore nothing where the robot stood, before it moved.
    """

    max_wheel_slip: float | None
    slipping_wheel: str | None
    slip_time: float | None
    min_load: float | None
    lifted: tuple[str, ...]
    max_tilt: float
    hanging: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        said = []
        if self.max_wheel_slip:
            said.append(
                f"{self.slipping_wheel} slipped most, {1e3 * self.max_wheel_slip:.3g} mm/s at "
                f"{self.slip_time:.3g} s"
            )
        if self.hanging:
            said.append(
                f"{', '.join(self.hanging)} bore nothing from the start: the others carry the robot"
            )
        if later := [name for name in self.lifted if name not in self.hanging]:
            said.append(f"{', '.join(later)} lifted")
        if not self.lifted and self.min_load is not None:
            said.append(f"the least load of a contact was {self.min_load:.3g} N")
        if self.max_tilt > TOLD_TILT:
            said.append(f"it leant {math.degrees(self.max_tilt):.2g}° at most")
        return "; ".join(said)


def felt_ground(run: Run) -> FeltGround | None:
    """Return what the plant of a run says of the ground; None of one whose wheels roll."""
    log = run.log
    if not log.root_pose.size:
        return None
    load, lifted, hanging = None, tuple[str, ...](), tuple[str, ...]()
    touches: NDArray[np.bool_] = np.ones(log.wheel_slip.shape[:2], dtype=bool)
    if log.ground_load.size:
        load = float(log.ground_load.min())
        floor = LIFTED * float(log.ground_load[0].sum())
        lifted = _named(run, log.ground_load.min(axis=0) < floor)
        hanging = _named(run, log.ground_load[0] < floor)
        wheels_load = log.ground_load[:, : touches.shape[1]]  # they come first among the contacts
        touches = np.asarray(wheels_load >= floor)
    slip, wheel, time = None, None, None
    if log.wheel_slip.size:
        speed = np.where(touches, np.linalg.norm(log.wheel_slip, axis=2), 0.0)
        row, column = np.unravel_index(int(speed.argmax()), speed.shape)
        slip, time = float(speed[row, column]), float(run.t[row])
        wheel = run.robot.drive.wheels[int(column)].joint
    return FeltGround(slip, wheel, time, load, lifted, float(tilts(log).max()), hanging)


def _named(run: Run, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the names of the contacts that are chosen (n_contacts,)."""
    return tuple(name for name, yes in zip(run.ground.contacts, chosen, strict=True) if yes)


def tilts(log: Log) -> Array:
    """Return the angle between the root link and the level (K,), rad."""
    lean = np.hypot(log.root_pose[:, X], log.root_pose[:, Y])
    return np.asarray(2.0 * np.arcsin(np.minimum(lean, 1.0)))
