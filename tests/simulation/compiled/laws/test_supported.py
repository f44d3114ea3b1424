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
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.law import FunctionLaw
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Call, Program
from rpctl.simulation.compiled.build import _own_formula
from rpctl.simulation.compiled.laws.fragment import LawFragment
from rpctl.simulation.compiled.laws.supported import law_fragment, unsupported
from rpctl.simulation.compiled.laws.tracking import settings_of
from tests.simulation.compiled.laws.law_cases import PERIOD


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
    assert unsupported(OwnLaw(), PaperDynamic(), paper) is None
    why = unsupported(OwnLaw(sharp=True), PaperDynamic(), paper)
    assert why == "the kinematic law OwnLaw has the operation EXP"
    assert _own_formula(OwnLaw(), paper) == _own_formula(OwnLaw(0.7), paper)
    assert _own_formula(OwnLaw(), paper) != _own_formula(OwnLaw(sharp=True), paper)
    assert not _own_formula(UnifiedKinematic(), paper)


class OwnLeash(Leash):
    """A leash of a user's own."""


class OwnApproach(Approach):
    """A stage of a user's own."""


class OwnBounded(BoundedDynamic):
    """A law of a user's own."""


@pytest.mark.parametrize("kinematic", KINEMATIC_LAWS)
@pytest.mark.parametrize("dynamic", DYNAMIC_LAWS)
def test_all_laws_without_a_solver_are_compiled(kinematic: str, dynamic: str, paper: Robot) -> None:
    why = unsupported(KINEMATIC_LAWS[kinematic](), DYNAMIC_LAWS[dynamic](), paper)
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
        (UnifiedKinematic(), IntegralDynamic(inner=OwnBounded()), "OwnBounded within"),
        (UnifiedKinematic(), FunctionLaw(lambda *_: np.zeros(4)), "law <lambda>"),
    ],
)
def test_what_is_not_compiled_is_named(
    kinematic: Any, dynamic: Any, named: str, paper: Robot
) -> None:
    why = unsupported(kinematic, dynamic, paper)
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
        (UnifiedKinematic(), IntegralDynamic()),
        pytest.param((Kanayama(leash=None), BoundedDynamic()), marks=pytest.mark.slow),
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
    names, values = settings_of(*laws, known, PERIOD)
    others, changed_values = settings_of(*other, known, PERIOD)
    assert names == others == first.setting_names
    same = [name for name, a, b in zip(names, values, changed_values, strict=True) if a == b]
    assert all(
        name.split(".")[0] in ("joint_horizon", "time", "root_weight", "gain") for name in same
    )
    assert not any(name.endswith((".v", ".omega")) for name in same if "root" not in name)


def functions(fragment: LawFragment) -> list[str]:
    """Return the functions of a fragment as texts."""
    statements = Program((*fragment.start, *fragment.body, *fragment.remember)).statements()
    return [s.function.serialize() for s in statements if isinstance(s, Call)]
