"""The causes of a disagreement: switches turned one at a time between default and mended."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from rpctl.engines.comparison import EngineGap
from rpctl.engines.recording import EngineRecording
from rpctl.engines.switches import ALL_MENDED, DEFAULT, MENDED, Switch, Switches

RunWith = Callable[[Switches], EngineRecording]
Compare = Callable[[EngineRecording, EngineRecording], tuple[EngineGap, ...]]


@dataclass(frozen=True)
class Cause:
    """What makes an engine disagree.

    Attributes:
        switches: One that suffices alone, or two of which neither does.
        gaps: What its default alone does to the mended engine, beyond the bands.
    """

    switches: tuple[Switch, ...]
    gaps: tuple[EngineGap, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the switches."""
        return tuple(switch.name for switch in self.switches)


@dataclass(frozen=True, eq=False)
class Trace:
    """How an engine's disagreement was traced.

    Attributes:
        causes: The largest first.
        mended: What the engine does with all switches mended.
        remaining: Gaps beyond the bands of the mended engine and the model.
        cured: Gaps beyond the bands of the engine with the causes mended and nothing else, from
            the mended engine: none where the causes explain all.
    """

    causes: tuple[Cause, ...]
    mended: EngineRecording
    remaining: tuple[EngineGap, ...]
    cured: tuple[EngineGap, ...]

    @property
    def complete(self) -> bool:
        """Whether the causes explain all that the model and the engine disagree in."""
        return not (self.remaining or self.cured)


def trace(
    switches: Sequence[Switch], run: RunWith, compare: Compare, model: EngineRecording
) -> Trace:
    """Return the causes why an engine, by default, disagrees with the model.

    From the engine with all mended, each switch alone is set back to default: it is a cause where
    the motion then leaves the bands. Where none is, pairs are. With the causes mended, the default
    engine must do what the mended one does; a switch that it then still takes is added.

    Args:
        switches: Those that mean something.
        run: Lets the engine move with switches.
        compare: Returns the gaps of an engine (second) from what it should do (first).
        model: What the model did.
    """
    mended = run(ALL_MENDED)
    remaining = beyond(compare(model, mended))
    if mended.fault:
        return Trace((), mended, remaining, ())

    def alone(chosen: tuple[Switch, ...]) -> tuple[EngineGap, ...]:
        names = tuple(switch.name for switch in chosen)
        return beyond(compare(mended, run(ALL_MENDED.turned(names, DEFAULT))))

    def left(causes: Sequence[Cause]) -> tuple[EngineGap, ...]:
        known = {switch.name for switch in switches}  # others mean nothing: as the mended engine
        start = ALL_MENDED.turned(known, DEFAULT)
        return beyond(compare(mended, run(start.turned(_names(causes), MENDED))))

    causes = list(_causes(combinations(switches, 1), alone))
    causes = causes or list(_causes(combinations(switches, 2), alone))
    cured = left(causes)
    while cured and len(_names(causes)) < len(switches):
        others = [switch for switch in switches if switch.name not in _names(causes)]
        tried = {switch: left([*causes, Cause((switch,), ())]) for switch in others}
        best = min(others, key=lambda switch: _worst(tried[switch]))
        if _worst(tried[best]) >= _worst(cured):
            break
        causes.append(Cause((best,), alone((best,))))
        cured = tried[best]
    if not cured:
        causes = _needed(causes, left)
    causes.sort(key=lambda cause: -_worst(cause.gaps))
    return Trace(tuple(causes), mended, remaining, cured)


def _needed(
    causes: Sequence[Cause], left: Callable[[Sequence[Cause]], tuple[EngineGap, ...]]
) -> list[Cause]:
    """Return the causes without those that may stay at default once the others are mended.

    A step that is too long for hard contacts, say, is not for the engine's own soft ones.
    """
    kept = list(causes)
    for cause in sorted(causes, key=lambda cause: _worst(cause.gaps)):
        others = [one for one in kept if one is not cause]
        if others and not left(others):
            kept = others
    return kept


def beyond(gaps: Sequence[EngineGap]) -> tuple[EngineGap, ...]:
    """Return the gaps that leave their bands."""
    return tuple(gap for gap in gaps if not gap.agrees)


def _causes(
    groups: Iterator[tuple[Switch, ...]],
    alone: Callable[[tuple[Switch, ...]], tuple[EngineGap, ...]],
) -> Iterator[Cause]:
    for group in groups:
        gaps = alone(group)
        if gaps:
            yield Cause(group, gaps)


def _names(causes: Sequence[Cause]) -> tuple[str, ...]:
    return tuple(name for cause in causes for name in cause.names)


def _worst(gaps: Sequence[EngineGap]) -> float:
    return max((gap.ratio for gap in gaps), default=0.0)
