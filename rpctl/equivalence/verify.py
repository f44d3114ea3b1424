"""``verify``: independent derivations of a robot's dynamics, compared at random states."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.standing import stand_at_home
from rpctl.equivalence import checks, mujoco_engine
from rpctl.equivalence.certificate import (
    CONTACT_ORACLE,
    EXACT_TOLERANCE,
    Check,
    Skipped,
    worst_cases,
)
from rpctl.equivalence.contact.mujoco_body import mujoco_absence
from rpctl.equivalence.file_drive import FileReading, read
from rpctl.equivalence.gibbs_appell import (
    BREAKDOWNS,
    STATES_AT_ONCE,
    Broken,
    GibbsAppell,
    RollingTerms,
    Terms,
    free_terms,
    rolling_terms,
)
from rpctl.equivalence.leaning_rows import LeaningFileRows, LeaningGibbsAppell
from rpctl.equivalence.rolling_rows import FileRows
from rpctl.equivalence.scope import GRAVITY, STANDS, Condition, Scope, conditions, find_scope
from rpctl.equivalence.shape_checks import DECLARED, SHAPES, Geometry, LeaningGeometry
from rpctl.equivalence.state import State, draw_state, find_rounding_scales, force_state
from rpctl.errors import RpctlError, require_known
from rpctl.files.caps import cap, how_to_raise
from rpctl.libraries import library
from rpctl.robot.idealised import idealisations
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot

if TYPE_CHECKING:
    from rpctl.equivalence.contact.trial import ContactTrial
    from rpctl.equivalence.onset.trial import OnsetTrial

ENGINES = ("mujoco",)


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """The outcome of :func:`rpctl.verify`: all checks of one robot.

    Attributes:
        robot: Name of the robot.
        samples: Number of random states.
        seed: Seed of the states.
        checks: The comparisons, each with its worst state.
        skipped: Comparisons that were not made, with reasons.
        declared: Differences between the user's numbers and the file's shapes; they neither pass
            nor fail.
        scope: What the rows prove, and what they assume about this robot.
        idealised: Sentences on what the model neglects or simplifies; no comparison detects it.
        contact: The trial on the ground, if it was requested and possible.
        onset: The trial of the predicted slipping and tipping, likewise.
        loaded_with: The arguments with which :func:`rpctl.load` loads this robot.
    """

    robot: str
    samples: int
    seed: int
    checks: tuple[Check, ...]
    scope: Scope
    skipped: tuple[Skipped, ...] = ()
    declared: tuple[Check, ...] = ()
    idealised: tuple[str, ...] = ()
    contact: ContactTrial | None = None
    onset: OnsetTrial | None = None
    loaded_with: Mapping[str, Any] = field(default_factory=dict)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return str(
            library("rpctl.view.pages.page").render("notebook_certificate.html", certificate=self)
        )

    @property
    def passed(self) -> bool:
        """Whether all comparisons that were made passed."""
        trials = [trial for trial in (self.contact, self.onset) if trial is not None]
        return all(trial.passed for trial in trials) and all(check.passed for check in self.checks)

    @property
    def comparisons(self) -> tuple[Check, ...]:
        """The checks of the equations, without the conditions under which they hold."""
        return tuple(check for check in self.checks if not isinstance(check, Condition))

    def strict(self) -> Certificate:
        """Return the certificate with the declared numbers among the checks that can fail."""
        return replace(self, checks=(*self.checks, *self.declared), declared=())

    @property
    def notes(self) -> list[tuple[str, str]]:
        """Further sentences, each with the name of the other derivation."""
        remarks = [(c.against, c.note) for c in (*self.checks, *self.declared) if c.note]
        if self.contact is not None:
            remarks += [(CONTACT_ORACLE, note) for note in self.contact.notes]
        return remarks

    @property
    def worst(self) -> Check:
        """The comparison with the largest ratio of residual to limit."""
        return max(self.comparisons, key=lambda check: check.limit_ratio)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values for JSON; an infinite residual is None."""
        return {
            "robot": self.robot,
            "passed": self.passed,
            "samples": self.samples,
            "seed": self.seed,
            "scope": self.scope.to_dict(),
            "checks": [check.to_dict() for check in self.checks],
            "skipped": [asdict(each) for each in self.skipped],
            "declared": [check.to_dict() for check in self.declared],
            "idealised": list(self.idealised),
            "contact": None if self.contact is None else self.contact.to_dict(),
            "onset": None if self.onset is None else self.onset.to_dict(),
            "loaded_with": dict(self.loaded_with),
        }


@dataclass(frozen=True)
class _Derivations:
    """What is compared: the dynamics, the oracle, the file's shapes, MuJoCo where it takes part.

    ``rolling`` are the rows of the multipliers' path, the file's as it was measured.
    """

    dynamics: ReducedDynamics
    rolling: FileRows | LeaningFileRows
    oracle: GibbsAppell
    geometry: Geometry | LeaningGeometry
    mujoco: mujoco_engine.ReducedEngine | None


def verify(
    robot: Robot,
    samples: int = 100,
    *,
    seed: int = 0,
    engines: Sequence[str] = ENGINES,
    progress: Callable[[int], object] | None = None,
    trials: Collection[str] = (),
) -> Certificate:
    """Compare the reduced dynamics with independent derivations at random states.

    Each derivation reads the user's file itself; the certificate lists what they share. The main
    one is Gibbs-Appell's ([MS21, Eq. 1-5]).

    Args:
        robot: The robot.
        samples: Number of random states.
        seed: Seed of the states; sample k is ``draw_state(robot, seed, k)``.
        engines: Physics engines to compare with (``"mujoco"``). If one is not installed or refuses
            the robot, a row says so.
        progress: Called with the number of finished states.
        trials: Trials of the robot as a free body on a plane in MuJoCo: ``"contact"`` (rolling) and
            ``"onset"`` (the predicted onsets of slipping and tipping). A trial that cannot be made
            fails.

    Returns:
        The certificate; a comparison that is not finite fails.

    Raises:
        RpctlError: ``samples`` is not positive or exceeds its cap.
        UnknownNameError: An engine is not known.
    """
    _require_samples(samples)
    reading, dynamics = read(robot), ReducedDynamics(robot)
    mujoco, absent = _engine(robot, reading, engines)
    oracle, rows, geometry = _oracles(dynamics, reading)
    derivations = _Derivations(dynamics, rows, oracle, geometry, mujoco)
    standing = stand_at_home(dynamics)
    found = (*geometry.record(), *worst_cases(_compare_each(derivations, samples, seed, progress)))
    skipped = (*geometry.skipped(), *absent)
    if standing is not None and standing.unknown:
        skipped += (Skipped(STANDS, GRAVITY, standing.unknown),)
    made = Certificate(
        robot=robot.name,
        samples=samples,
        seed=seed,
        checks=(*(row for row in found if row.name != DECLARED), *conditions(dynamics, standing)),
        scope=find_scope(robot, reading, standing),
        skipped=skipped,
        declared=tuple(row for row in found if row.name == DECLARED),
        idealised=tuple(each.sentence for each in idealisations(robot)),
        loaded_with={"source": robot.source, **robot.loaded_with.arguments()},
    )
    return _with_trials(robot, made, trials) if trials else made


def _oracles(
    dynamics: ReducedDynamics, reading: FileReading
) -> tuple[GibbsAppell, FileRows | LeaningFileRows, Geometry | LeaningGeometry]:
    """Return the walk of the Gibbs function, the rows of the multipliers' path, and the shapes'."""
    robot = dynamics.robot
    if not isinstance(robot, LeaningRobot):
        oracle = GibbsAppell(robot, reading=reading)
        return oracle, FileRows(robot, oracle.tree), Geometry(dynamics, reading)
    leaning = LeaningGibbsAppell(robot, reading=reading)
    rows = LeaningFileRows(robot, leaning.tree)
    return leaning, rows, LeaningGeometry(dynamics, reading, rows)


def _require_samples(samples: int) -> None:
    """Refuse none, or too many."""
    if samples < 1:
        raise RpctlError(f"{samples} samples prove nothing; give at least 1")
    if samples > cap("MAX_STATES"):
        most = f"{cap('MAX_STATES'):,}"
        raise RpctlError(f"{samples:,} samples, over {most}; {how_to_raise('MAX_STATES')}")


def _compare_each(
    derivations: _Derivations,
    samples: int,
    seed: int,
    progress: Callable[[int], object] | None,
) -> Iterator[tuple[int, Iterator[Check]]]:
    """Yield each sample with its comparisons; the oracle's walk is made for many at once."""
    oracle, robot = derivations.oracle, derivations.dynamics.robot
    for start in range(0, samples, STATES_AT_ONCE):
        batch = range(start, min(samples, start + STATES_AT_ONCE))
        states = [draw_state(robot, seed, sample) for sample in batch]
        terms = free_terms(oracle, states), rolling_terms(oracle, states)
        for sample, state, of_tree, in_nu in zip(batch, states, *terms, strict=True):
            yield sample, _compare(derivations, state, of_tree, in_nu)
            if progress is not None:
                progress(sample + 1)


def _compare(
    derivations: _Derivations, state: State, free: Terms | Broken, rolling: RollingTerms | Broken
) -> Iterator[Check]:
    """Make every comparison that can be made at a state.

    Where a group of them breaks down, the rows that follow in the group are not there; one that
    fails is there in their place, with the reason.
    """
    dynamics, oracle, mujoco = derivations.dynamics, derivations.oracle, derivations.mujoco
    if isinstance(free, Broken):
        yield _broken_down("full tree", free.reason)
    else:
        yield from _computed("full tree", checks.full_tree, dynamics.robot, free, state)
    scales = trial = h_size = None
    if isinstance(rolling, Broken):
        yield _broken_down("Gibbs-Appell equations", rolling.reason)
    else:
        h_size = rolling.terms.h_size
    try:
        scales = find_rounding_scales(dynamics, state, h_size)
        trial = force_state(dynamics, state, scales)
    except BREAKDOWNS as error:
        yield _broken_down("reduced dynamics", error)
    if scales is not None:
        if isinstance(rolling, RollingTerms):
            compared = dynamics, oracle, rolling, scales, state
            yield from _computed("comparison", checks.reduced, *compared)
        yield from _computed("Coriolis terms", checks.coriolis, dynamics, scales, state)
    yield from _computed("M", checks.definite, dynamics, state)
    if trial is not None:
        yield from _computed(
            "multipliers", checks.multipliers, dynamics, derivations.rolling, oracle, trial
        )
        yield from _computed("consistency", checks.consistent, dynamics, trial)
        yield from _computed("motion", checks.motion, dynamics, state)
    yield from _computed(SHAPES, derivations.geometry.at, state)
    if mujoco is not None and scales is not None:
        yield from _computed(checks.MUJOCO, checks.engine, dynamics, mujoco, scales, state)


def _computed(
    group: str, compare: Callable[..., Iterator[Check]], *arguments: object
) -> Iterator[Check]:
    """Yield the rows of a group as far as they can be computed."""
    try:
        yield from compare(*arguments)
    except BREAKDOWNS as error:
        yield _broken_down(group, error)


def _broken_down(group: str, error: Exception) -> Check:
    """Return the row that says why a group of comparisons broke down; it fails."""
    return Check("computed", group, np.inf, EXACT_TOLERANCE, entry=str(error))


def _engine(
    robot: Robot, reading: FileReading, engines: Sequence[str]
) -> tuple[mujoco_engine.ReducedEngine | None, tuple[Skipped, ...]]:
    """Return MuJoCo's view of the robot, or the row that says why there is none."""
    require_known("engine", engines, ENGINES)
    if "mujoco" not in engines:
        return None, ()
    note = mujoco_absence()
    if mujoco_engine.installed():
        try:
            return mujoco_engine.engine_of(robot, reading), ()
        except mujoco_engine.EngineRefused as refusal:
            note = f"refused: {refusal}"
    return None, (Skipped("reduced dynamics", checks.MUJOCO, note),)


def _with_trials(robot: Robot, certificate: Certificate, trials: Collection[str]) -> Certificate:
    """Return a certificate with trials in MuJoCo; what was asked for and cannot be made fails."""
    from rpctl.equivalence.contact import trial as contact_trial
    from rpctl.equivalence.contact.leaning_trial import leaning_trial
    from rpctl.equivalence.onset import trial as onset_trial

    rolls: Callable[[Any], Any] = (
        leaning_trial if robot.drive.leans else contact_trial.contact_trial
    )
    known: dict[str, tuple[str, Callable[[Robot], Any]]] = {
        "contact": (contact_trial.CHECK_NAME, rolls),
        "onset": (onset_trial.TRIAL_NAME, onset_trial.onset_trial),
    }
    made: dict[str, Any] = {}
    undone: list[Check] = []
    for kind in trials:
        name, run = known[kind]
        trial = (
            run(robot)
            if mujoco_engine.installed()
            else Skipped(name, CONTACT_ORACLE, mujoco_absence())
        )
        if isinstance(trial, Skipped):
            undone.append(Check(name, CONTACT_ORACLE, math.inf, 1.0, entry=trial.note))
        else:
            made[kind] = trial
    return replace(certificate, checks=(*certificate.checks, *undone), **made)
