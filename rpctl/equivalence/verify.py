"""``verify``: independent derivations of a robot's dynamics, compared at random states."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence import checks
from rpctl.equivalence.certificate import Certificate, Check, Skipped
from rpctl.equivalence.checks import State, draw_state
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.robot.idealised import idealisations
from rpctl.robot.model import Robot

if TYPE_CHECKING:
    from rpctl.equivalence.mujoco_engine import MujocoEngine

ENGINES = ("mujoco",)


@dataclass(frozen=True)
class _Derivations:
    """What is compared: the reduced dynamics, the oracle, and MuJoCo where it takes part."""

    dynamics: ReducedDynamics
    oracle: GibbsAppell
    mujoco: MujocoEngine | None


def verify(
    robot: Robot,
    samples: int = 100,
    seed: int = 0,
    engines: Sequence[str] = ENGINES,
    progress: Callable[[int], object] | None = None,
) -> Certificate:
    """Compare the reduced dynamics with independent derivations at random states.

    Args:
        robot: The robot.
        samples: Number of random states.
        seed: Seed of the states; sample k is ``draw_state(robot, seed, k)``.
        engines: Other physics engines that take part (``"mujoco"``). One that is not installed, or
            that refuses the robot, has a row that says so.
        progress: Called with the number of states done.

    Returns:
        The certificate; a comparison that is not finite fails.

    Raises:
        RpctlError: ``samples`` is not positive, or an engine is not known.
    """
    if samples < 1:
        raise RpctlError(f"{samples} samples prove nothing; give at least 1")
    mujoco, absent = _engine(robot, engines)
    derivations = _Derivations(ReducedDynamics(robot), GibbsAppell(robot), mujoco)
    found: dict[tuple[str, str], Check] = {}
    for sample in range(samples):
        for check in _compare(derivations, draw_state(robot, seed, sample)):
            known = found.get((check.name, check.against))
            if known is None or check.share > known.share:
                found[check.name, check.against] = replace(check, sample=sample)
        if progress is not None:
            progress(sample + 1)
    estimated = robot.description.estimated_links
    idealised = tuple(each.sentence for each in idealisations(robot))
    return Certificate(
        robot.name, samples, seed, tuple(found.values()), absent, estimated, idealised
    )


def _compare(derivations: _Derivations, state: State) -> Iterator[Check]:
    dynamics, oracle = derivations.dynamics, derivations.oracle
    try:
        yield from checks.full_tree(dynamics.robot, oracle, state)
        terms = oracle.reduced(state.q, state.nu)
        yield from checks.reduced(dynamics, oracle, terms, state)
        yield from checks.multipliers(dynamics, state)
        yield from checks.consistent(dynamics, state)
        if derivations.mujoco is not None:
            yield from checks.engine(dynamics, terms, derivations.mujoco, state)
    except (RpctlError, np.linalg.LinAlgError) as error:
        yield Check("computed", "finite numbers", np.inf, checks.EXACT, entry=str(error))


def _engine(
    robot: Robot, engines: Sequence[str]
) -> tuple[MujocoEngine | None, tuple[Skipped, ...]]:
    """Return MuJoCo's view of the robot, or the row that says why there is none."""
    for name in engines:
        if name not in ENGINES:
            raise UnknownNameError("engine", name, ENGINES)
    if "mujoco" not in engines:
        return None, ()
    from rpctl.equivalence.mujoco_engine import EngineRefused, MujocoEngine, installed

    note = "not installed: pip install 'rpctl[mujoco]', with Python 3.11 or later"
    if installed():
        try:
            return MujocoEngine(robot), ()
        except EngineRefused as refusal:
            note = f"refused: {refusal}"
    return None, (Skipped("reduced dynamics", checks.MUJOCO, note),)
