"""What the ground did to a robot whose wheels can slip and lift: figures, and one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.log import Log
from rpctl.simulation.run import Run

TOLD_TILT = math.radians(1.0)  # rad: soft contacts let a robot lean by a hundredth of it
LIFTED = 1e-3  # of the weight: a contact that bears less has lifted
X, Y = 3, 4  # of a pose's quaternion x, y, z, w


@dataclass(frozen=True)
class FeltGround:
    """What the plant says of the ground; None is what it does not know.

    Attributes:
        max_wheel_slip: Largest velocity of a wheel's contact point over the ground, m/s.
        slipping_wheel: The wheel.
        slip_time: When, s.
        min_load: Least load of a contact, N.
        lifted: Contacts that bore nothing for a while.
        max_tilt: Largest angle between the root link and the level, rad.
    """

    max_wheel_slip: float | None
    slipping_wheel: str | None
    slip_time: float | None
    min_load: float | None
    lifted: tuple[str, ...]
    max_tilt: float

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        said = []
        if self.max_wheel_slip is not None:
            said.append(
                f"{self.slipping_wheel} slipped most, {1e3 * self.max_wheel_slip:.3g} mm/s at "
                f"{self.slip_time:.3g} s"
            )
        if self.lifted:
            said.append(f"{', '.join(self.lifted)} lifted")
        elif self.min_load is not None:
            said.append(f"the least load of a contact was {self.min_load:.3g} N")
        if self.max_tilt > TOLD_TILT:
            said.append(f"it leant {math.degrees(self.max_tilt):.2g}° at most")
        return "; ".join(said)


def felt_ground(run: Run) -> FeltGround | None:
    """Return what the plant of a run says of the ground; None of one whose wheels roll."""
    log = run.log
    if not log.root_pose.size:
        return None
    slip, wheel, time = None, None, None
    if log.wheel_slip.size:
        speed = np.linalg.norm(log.wheel_slip, axis=2)
        row, column = np.unravel_index(int(speed.argmax()), speed.shape)
        slip, time = float(speed[row, column]), float(run.t[row])
        wheel = run.robot.drive.wheels[int(column)].joint
    load, lifted = None, tuple[str, ...]()
    if log.ground_load.size:
        load = float(log.ground_load.min())
        floor = LIFTED * float(log.ground_load[0].sum())
        names = zip(run.ground.contacts, log.ground_load.min(axis=0), strict=True)
        lifted = tuple(name for name, least in names if least < floor)
    return FeltGround(slip, wheel, time, load, lifted, float(tilts(log).max()))


def tilts(log: Log) -> Array:
    """Return the angle between the root link and the level (K,), rad."""
    lean = np.hypot(log.root_pose[:, X], log.root_pose[:, Y])
    return np.asarray(2.0 * np.arcsin(np.minimum(lean, 1.0)))
