"""What is wrong with sensors: constant errors, and encoders that know whole steps only."""

from __future__ import annotations

from dataclasses import astuple, dataclass

from rpctl.errors import RpctlError, require_within

MAX_BITS = 32  # of an encoder


@dataclass(frozen=True)
class SensorNumbers:
    """A number for each quantity that the controller measures.

    Attributes:
        position: Of x and of y of the root link, m.
        heading: Of the root link, rad.
        joints: Of the positions of the arm's joints and of those that are steered, rad or m.
        speed: Of the base's speeds, m/s.
        turn_rate: Of the base's turning rate, rad/s.
        joint_rates: Of the rates of the same joints, rad/s or m/s.
    """

    position: float = 0.0
    heading: float = 0.0
    joints: float = 0.0
    speed: float = 0.0
    turn_rate: float = 0.0
    joint_rates: float = 0.0

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return any(astuple(self))


@dataclass(frozen=True)
class SensorBias(SensorNumbers):
    """Constant errors of what the controller measures; it measures so much more than there is."""

    def __post_init__(self) -> None:
        """Refuse what is no number."""
        for name, value in vars(self).items():
            require_within(f"sensor_bias of {name}", [value])


def require_bits(bits: int) -> None:
    """Refuse what is no number of an encoder's bits.

    Raises:
        RpctlError: It is not from 0 to :data:`MAX_BITS`.
    """
    if not (type(bits) is int and 0 <= bits <= MAX_BITS):
        raise RpctlError(f"encoder_bits is {bits}; give a whole number from 0 to {MAX_BITS}")
