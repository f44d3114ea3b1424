"""What a simulated robot feels and measures wrongly: settings of a plant."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field
from typing import Annotated

from rpctl.control.sampling import TIME_ROUNDING
from rpctl.errors import RpctlError, require_within
from rpctl.files.records import POSITIVE, WITHIN, Range, Record, Setting

Vector = tuple[float, float, float]
MAX_BITS = 32  # of an encoder


@dataclass(frozen=True)
class Wrench:
    """An external force and moment on a link.

    Attributes:
        link: Name of the link.
        force: Force at the origin of the link's frame (3,), N, along the world's axes.
        moment: Moment (3,), N·m, along the world's axes.
        start: Time at which they begin, s.
        end: Time at which they end, s; None: at the end of the run.

    Raises:
        RpctlError: A number is not finite, ``start`` is negative, or ``end`` is not after it.
    """

    link: str
    force: Annotated[Vector, Setting("N")] = (0.0, 0.0, 0.0)
    moment: Annotated[Vector, Setting("N·m")] = (0.0, 0.0, 0.0)
    start: Annotated[float, Setting("s")] = field(default=0.0, kw_only=True)
    end: Annotated[float | None, Setting("s")] = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse what is no force, and what ends before it begins."""
        require_within(f"the force on {self.link}", self.force)
        require_within(f"the moment on {self.link}", self.moment)
        require_within(f"the start of the push on {self.link}", [self.start])
        if not 0.0 <= self.start < self.until:
            raise RpctlError(
                f"the push on {self.link} lasts from {self.start:g} to {self.until:g} s; give a "
                "start of 0 or more, and an end after it"
            )

    def acts(self, t: float) -> bool:
        """Return whether force and moment act at a time (s)."""
        return self.start - TIME_ROUNDING <= t < self.until - TIME_ROUNDING

    @property
    def until(self) -> float:
        """Time at which they end, s; infinite if ``end`` is None."""
        return math.inf if self.end is None else self.end


@dataclass(frozen=True, kw_only=True)
class SensorNumbers(Record):
    """A number for each quantity that the controller measures."""

    position: Annotated[
        float, WITHIN, Setting("m", "position, x and y", "Deviation of x and y of the root link.")
    ] = 0.0
    heading: Annotated[
        float, WITHIN, Setting("rad", "heading", "Deviation of the root link's heading.")
    ] = 0.0
    joints: Annotated[
        float,
        WITHIN,
        Setting(
            "rad or m",
            "joints' positions",
            "Deviation of the positions of arm joints and steered joints.",
        ),
    ] = 0.0
    speed: Annotated[float, WITHIN, Setting("m/s", "speed", "Deviation of the base's speeds.")] = (
        0.0
    )
    turn_rate: Annotated[
        float, WITHIN, Setting("rad/s", "turning rate", "Deviation of the base's turning rate.")
    ] = 0.0
    joint_rates: Annotated[
        float,
        WITHIN,
        Setting(
            "rad/s or m/s",
            "joints' rates",
            "Deviation of the rates of arm joints and steered joints.",
        ),
    ] = 0.0

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return any(astuple(self))


@dataclass(frozen=True)
class SensorBias(SensorNumbers):
    """Constant errors of what the controller measures; it measures so much more than there is."""

    of = "sensor_bias of "


@dataclass(frozen=True)
class Noise(SensorNumbers):
    """Standard deviations of the measurement noise, which is normal and independent."""

    of = "noise of "

    def __post_init__(self) -> None:
        """Refuse what is no deviation."""
        super().__post_init__()
        for name, value in vars(self).items():
            if value < 0.0:
                raise RpctlError(f"noise of {name} is {value:g}; give a deviation of 0 or more")


@dataclass(frozen=True)
class Slipping(Record):
    """The tyres of the slipping plant; table [plant.slipping]."""

    slip_stiffness: Annotated[
        float,
        POSITIVE,
        Setting(
            "",
            "",
            "Force of a tyre per load and per slip (slip velocity over rolling speed). A rolling "
            "cylinder with a contact 2a long has 2R/a [J85, Sec. 8.3]: 20 for solid rubber with "
            "a = R/10. Pneumatic tyres have 10 to 20 [P12, Ch. 4]. High values approach rolling "
            "without slipping.",
        ),
    ] = 20.0
    creep_speed: Annotated[
        float,
        POSITIVE,
        Setting(
            "m/s",
            "",
            "Rolling speed below which the slip stiffness stays constant. A tyre at rest under a "
            "force creeps at force/load × this speed / slip stiffness.",
        ),
    ] = 0.01
    rolling_resistance: Annotated[
        float,
        Range(0.0, 1.0, "a ratio of force to load from 0 to less than 1", below=True),
        Setting(
            "",
            "",
            "Moment against a wheel's rolling, per load and radius: 0.01 to 0.02 for solid "
            "rubber on hard floors.",
        ),
    ] = 0.0
