"""What an engine does with a robot by default, and what mends it: one switch a cause."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from rpctl.errors import UnknownNameError

DEFAULT = "default"  # as the engine takes the URDF of a user who sets nothing
MENDED = "mended"  # as the reduced model means it


@dataclass(frozen=True)
class Switches:
    """One state, :data:`DEFAULT` or :data:`MENDED`, for each thing that engines do differently.

    Attributes:
        wheel: Shape of the wheels where they meet the ground: as drawn, or crowned, so that they
            touch at one point and, of a mecanum or omni wheel, hold along the roller only.
        caster: Supports and balls: as drawn and with friction, or sliding without any; those that
            the engine does not see are added.
        cone: Friction pyramid, or cone.
        friction: The engine's own coefficients, torsional and rolling ones too; or the referee's.
        inertia: As the engine's loader leaves it (dropped, balanced, guessed from shapes, rotors
            left out), or the robot's.
        softness: Compliance of contacts, and how well the solver converges.
        timestep: The engine's own, or one short enough.
        mimic: Mimic joints and tie rods left free, or tied.
        losses: Damping and friction of joints and of free bodies as the loader takes them, or the
            robot's.
        collisions: Whether links of the robot collide with each other and, but for wheels and
            supports, with the ground.
    """

    wheel: str = DEFAULT
    caster: str = DEFAULT
    cone: str = DEFAULT
    friction: str = DEFAULT
    inertia: str = DEFAULT
    softness: str = DEFAULT
    timestep: str = DEFAULT
    mimic: str = DEFAULT
    losses: str = DEFAULT
    collisions: str = DEFAULT

    def mended(self, name: str) -> bool:
        """Return whether a switch is mended."""
        return str(getattr(self, name)) == MENDED

    def turned(self, names: Iterable[str], state: str) -> Switches:
        """Return the same with some switches in a state.

        Raises:
            UnknownNameError: There is no such switch.
        """
        names = tuple(names)
        for name in names:
            if name not in SWITCH_NAMES:
                raise UnknownNameError("switch", name, SWITCH_NAMES)
        return replace(self, **dict.fromkeys(names, state))


SWITCH_NAMES = tuple(field.name for field in fields(Switches))
ALL_DEFAULT = Switches()
ALL_MENDED = Switches(**dict.fromkeys(SWITCH_NAMES, MENDED))


@dataclass(frozen=True)
class Switch:
    """A switch that means something in an engine, for a robot, in that engine's own words.

    Attributes:
        name: One of :data:`SWITCH_NAMES`.
        fault: What the engine does by default, a clause: ``"its wheels are 8 cm wide and scrub"``.
        setting: What mends it, an imperative with attribute or option: ``'set <option
            cone="elliptic"/>'``.
    """

    name: str
    fault: str
    setting: str

    def __post_init__(self) -> None:
        """Refuse a name that :class:`Switches` does not have."""
        if self.name not in SWITCH_NAMES:
            raise UnknownNameError("switch", self.name, SWITCH_NAMES)
