"""What a run keeps of its links' shapes: how near they came to things, and what they ran into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rpctl.errors import RpctlError
from rpctl.simulation.merits.path_error import length

NEAR_M = 0.1  # m: what a robot that stands is nearer to than this may be what it stands before
TOLD_COLLISIONS = 5  # in sentences; more are counted
NAMED_PAIRS = 6  # in a sentence; more are counted
SELF, GROUND = "itself", "the ground"  # beside obstacles, which are called by their shape
NOT_LOOKED_FOR = "collisions are not checked until a run is complete"


@dataclass(frozen=True)
class LinkClearance:
    """How near the robot came to a thing.

    Attributes:
        to: ``SELF``, ``GROUND``, or an obstacle in words.
        distance: The least distance, m; negative: how deep a link was in it.
        time: When, s.
        link: The link that was nearest.
        other: The other link, of ``SELF``; empty otherwise.
    """

    to: str
    distance: float
    time: float
    link: str
    other: str = ""


@dataclass(frozen=True)
class Collision:
    """Two things that were in each other.

    Attributes:
        to: As of a :class:`LinkClearance`.
        link: The link.
        other: The other link, of ``SELF``; empty otherwise.
        depth: How deep at worst, m.
        first_time: When first, s.
        duration: For how long in all, s.
    """

    to: str
    link: str
    other: str
    depth: float
    first_time: float
    duration: float

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        return (
            f"{self.link} ran into {self.other or self.to} at {self.first_time:.3g} s, "
            f"{length(self.depth)} deep at worst, for {self.duration:.2g} s"
        )


@dataclass(frozen=True)
class CollisionFacts:
    """All that a run keeps of its links' shapes.

    Attributes:
        clearances: One for each thing.
        collisions: The deepest first.
        allowed: Pairs of links that may touch, and why.
        notes: What stands in for what, in sentences.
        resolution: What the least distances may be too large by, m; no deeper collision than this
            and ``TOUCH_M`` is missed.
        times: Instants of ``series``, s.
        series: The distance to each thing at those instants, m.
    """

    clearances: tuple[LinkClearance, ...]
    collisions: tuple[Collision, ...]
    allowed: tuple[tuple[str, str, str], ...]
    notes: tuple[str, ...]
    resolution: float
    times: tuple[float, ...]
    series: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Refuse what does not belong together."""
        lengths = [len(self.times)] * len(self.clearances)
        if [len(each) for each in self.series] != lengths:
            raise RpctlError("series must hold one distance per time, for each thing")

    @property
    def ahead(self) -> tuple[str, ...]:
        """The ground and the obstacles that the robot is near to in the end, in words."""
        ends = ((clearance.to, series[-1]) for clearance, series in
                zip(self.clearances, self.series, strict=True))  # fmt: skip
        return tuple(f"{to} is {length(distance)} away" for to, distance in ends
                     if to != SELF and distance < NEAR_M)  # fmt: skip

    @property
    def remarks(self) -> tuple[str, ...]:
        """What may touch and what stands in for what, in sentences."""
        if not self.allowed:
            return self.notes
        pairs = [f"{first} and {second} ({why})" for first, second, why in self.allowed]
        more = f" and {len(pairs) - NAMED_PAIRS} more" if len(pairs) > NAMED_PAIRS else ""
        listed = ", ".join(pairs[:NAMED_PAIRS])
        return (f"links that touch by design may touch: {listed}{more}", *self.notes)


NO_COLLISIONS = CollisionFacts((), (), (), (), 0.0, (), ())


def collision_texts(collisions: Sequence[Collision]) -> list[str]:
    """Return the deepest collisions in sentences, and how many more there were.

    Args:
        collisions: The deepest first.
    """
    found = [each.sentence for each in collisions[:TOLD_COLLISIONS]]
    rest = len(collisions) - len(found)
    return [*found, f"{rest} more links collided, less deep"] if rest > 0 else found


def clearance_text(clearance: LinkClearance) -> str:
    """Return a clearance in words, without a verb."""
    pair = f"{clearance.link} and {clearance.other}" if clearance.other else clearance.link
    return f"{clearance.to} {length(clearance.distance)} ({pair}, {clearance.time:.3g} s)"
