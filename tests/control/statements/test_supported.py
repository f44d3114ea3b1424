"""Which laws are compiled, and that their numbers are inputs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from rpctl import (
    BoundedDynamic,
    EndEffector,
    Horizon,
    IntegralDynamic,
    Leash,
    PaperDynamic,
    ReducedDynamics,
    Robot,
    Tracking,
    UnifiedKinematic,
    math,
)
from rpctl.control.approach import Approach
from rpctl.control.baselines import Kanayama
from rpctl.control.dynamic import no_machine_code, unsupported
from rpctl.control.fragment import LawFragment, law_fragment, settings_of
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import FunctionLaw
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Call, Program
from tests.control.statements.law_cases import PERIOD


@dataclasses.dataclass(frozen=True)
class OwnLaw(BaseLaw):
    """A law of a user's own that goes straight."""

    horizon: float = 0.5
    sharp: bool = False

    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the reference's speed, slower with the distance; no turn."""
        slower = math.exp(-at.e[0]) if self.sharp else self.horizon * at.e[0]
        return at.twist[0] - slower, at.twist[2]


def test_a_law_of_ones_own_is_compiled_if_its_operations_are(paper: Robot) -> None:
    assert unsupported(OwnLaw(sharp=True), PaperDynamic()) is None
    assert no_machine_code(OwnLaw(), paper) is None
    assert (
        no_machine_code(OwnLaw(sharp=True), paper)
        == "the kinematic law OwnLaw has the operation EXP"
    )
    assert OwnLaw().structure(paper) == OwnLaw(0.7).structure(paper)
    assert OwnLaw().structure(paper) != OwnLaw(sharp=True).structure(paper)


class OwnLeash(Leash):
    """A leash of a user's own."""


class OwnApproach(Approach):
    """A stage of a user's own."""


class OwnBounded(BoundedDynamic):
    """A law of a user's own that starts itself."""

    def start(self, *given: Any, **named: Any) -> Any:
        """Return what starts."""
        return super().start(*given, **named)


@pytest.mark.parametrize("kinematic", KINEMATIC_LAWS)
@pytest.mark.parametrize("dynamic", sorted({*DYNAMIC_LAWS} - {"balance"}))
def test_all_laws_without_a_solver_are_compiled(kinematic: str, dynamic: str) -> None:
    why = unsupported(KINEMATIC_LAWS[kinematic](), DYNAMIC_LAWS[dynamic]())
    assert (why is None) == (kinematic not in ("horizon", "end-effector"))


@pytest.mark.parametrize(
    ("kinematic", "dynamic", "named"),
    [
        (Horizon(), PaperDynamic(), "law Horizon"),
        (EndEffector(), PaperDynamic(), "law EndEffector"),
        (UnifiedKinematic(leash=OwnLeash()), PaperDynamic(), "leash OwnLeash"),
        (UnifiedKinematic(approach=OwnApproach()), PaperDynamic(), "approach OwnApproach"),
        (FunctionLaw(lambda *_: np.zeros(4)), PaperDynamic(), "law <lambda>"),
        (UnifiedKinematic(), OwnBounded(), "law OwnBounded"),
        (UnifiedKinematic(), IntegralDynamic(inner=OwnBounded()), "law OwnBounded"),
        (UnifiedKinematic(), FunctionLaw(lambda *_: np.zeros(4)), "law <lambda>"),
    ],
)
def test_what_is_not_compiled_is_named(kinematic: Any, dynamic: Any, named: str) -> None:
    why = unsupported(kinematic, dynamic)
    assert why is not None
    assert named in why


def changed(law: Any) -> Any:
    """Return a law with other numbers, and those within it."""
    changes: dict[str, Any] = {}
    for item in dataclasses.fields(law):
        value = getattr(law, item.name)
        if isinstance(value, float):
            changes[item.name] = 1.5 * value
        elif isinstance(value, Leash | BoundedDynamic):
            changes[item.name] = changed(value)
    return dataclasses.replace(law, **changes)


@pytest.mark.parametrize(
    "laws",
    [
        (UnifiedKinematic(0.65), IntegralDynamic(15.0)),
        pytest.param(
            (Kanayama(horizon=0.65, leash=None), BoundedDynamic(0.15)), marks=pytest.mark.slow
        ),
        (PaperKinematic(smoothing=0.1), PaperDynamic()),
    ],
)
def test_numbers_are_inputs(laws: tuple[Any, Any], paper: Robot) -> None:
    """Laws with other numbers have the same functions, entry by entry, and other settings."""
    dynamics, other = SymbolicDynamics(paper), (changed(laws[0]), changed(laws[1]))
    first, second = (law_fragment(*pair, dynamics, PERIOD) for pair in (laws, other))
    for a, b in zip(functions(first), functions(second), strict=True):
        assert a == b
    known = ReducedDynamics(paper)
    values, others = (settings_of(*each, known, PERIOD) for each in (laws, other))
    assert values.shape == others.shape == (first.settings.size,)
    numbers = [value for value in laws[0].numbers().values() if value]
    moved = np.flatnonzero(values != others)
    assert len(moved) > len(numbers)
    assert set(numbers) <= set(values[moved])


def functions(fragment: LawFragment) -> list[str]:
    """Return the functions of a fragment as texts."""
    statements = Program(
        (*fragment.start, *fragment.command, *fragment.answer, *fragment.remember)
    ).statements()
    return [s.function.serialize() for s in statements if isinstance(s, Call)]
