"""The Gibbs-Appell equations at many states at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from rpctl.equivalence.gibbs_appell import GibbsAppell, Terms
from rpctl.equivalence.state import State
from rpctl.errors import RpctlError

BREAKDOWNS = (RpctlError, np.linalg.LinAlgError)
STATES_AT_ONCE = 128  # more gain nothing, and take memory

Result = TypeVar("Result")


@dataclass(frozen=True)
class Broken:
    """What stands in place of a result at a state where a derivation broke down."""

    reason: Exception


@dataclass(frozen=True)
class RollingTerms:
    """The equations in ν at one state, and what G itself says there.

    Attributes:
        terms: The equations.
        rise: G(ν̇ + ν) − G(ν̇ − ν), half of it the power of ∂G/∂ν̇ at ν; W.
    """

    terms: Terms
    rise: float


def free_terms(oracle: GibbsAppell, states: Sequence[State]) -> list[Terms | Broken]:
    """Return the free tree's equations at each state."""

    def computed(states: Sequence[State]) -> list[Terms]:
        terms = oracle.full(np.array([s.q for s in states]), np.array([s.v for s in states]))
        return [terms.of(k) for k in range(len(states))]

    return _at_each(computed, states)


def rolling_terms(oracle: GibbsAppell, states: Sequence[State]) -> list[RollingTerms | Broken]:
    """Return the equations in ν at each state, wheels rolling."""

    def computed(states: Sequence[State]) -> list[RollingTerms]:
        q, nu = np.array([s.q for s in states]), np.array([s.nu for s in states])
        nu_dot, terms = np.array([s.nu_dot for s in states]), oracle.reduced(q, nu)
        # G is quadratic in ν̇, so this difference over a whole step is its derivative, not near it.
        after, before = oracle.gibbs(q, nu, np.array([nu_dot + nu, nu_dot - nu]))
        rise = after - before
        return [RollingTerms(terms.of(k), float(rise[k])) for k in range(len(states))]

    return _at_each(computed, states)


def _at_each(
    compute: Callable[[Sequence[State]], list[Result]], states: Sequence[State]
) -> list[Result | Broken]:
    """Compute something at all states together; where that breaks down, at each alone."""
    try:
        return [*compute(states)]
    except BREAKDOWNS as reason:
        if len(states) == 1:
            return [Broken(reason)]
        return [found for state in states for found in _at_each(compute, [state])]
