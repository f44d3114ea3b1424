"""A battery of stressed runs: every level of every stress, and some of two stresses at a time.

A stress is an axis with a ladder of levels around the nominal one. A level is a change of a
configuration that ``rpctl track --config`` takes, so that every cell of a battery is the run of a
file. The controller knows of none of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.control.controller import default_laws
from rpctl.control.registry import (
    DYNAMIC_LAWS,
    KINEMATIC_LAWS,
)
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import require_known
from rpctl.files.records import to_plain
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot
from rpctl.robot.variation import CarriedLoad
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.settings import Noise
from rpctl.study.cells import ROLLING, CellRunner, Figures, References, run_cells
from rpctl.study.compare import PAPER, LawPair
from rpctl.study.executor import Executor
from rpctl.study.experiment import Progress, run_seed
from rpctl.study.scatter import with_values
from rpctl.study.store import Journal, installed, reference_digest

JOURNAL_FILE = "cells.jsonl"
DURATION = 10.0  # s: references start softly, for 3 s; the second half is what is judged
RADIUS = "radius"  # the stress that lifts wheels off the ground, or supports
OTHERS = (PAPER, LawPair("kanayama", "paper"))  # that the robot's own laws are compared with
# A base that localises itself in a map with a lidar, and reads its wheels and joints by encoders.
LOCALISATION = Noise(
    position=0.01, heading=0.005, joints=0.0005, speed=0.01, turn_rate=0.01, joint_rates=0.005
)
Levels = tuple[tuple[str, float], ...]  # names of stresses and their levels


@dataclass(frozen=True)
class Stress:
    """One axis of a battery.

    Attributes:
        name: What it is called on the command line.
        unit: Of its levels, as they are shown.
        levels: From one end to the other, the nominal one among them.
        nominal: The level of a run that nothing stresses.
        summary: What a level is, in words.
        changes: Paths of settings, see :mod:`rpctl.study.scatter`, each with what it is at level 0
            and by how much it grows with the level.
        why_not: Returns why a robot has no such stress, a clause; None where it has.
        drawn: Ends of what combinations draw from; None: those of the levels.
        whole: Whether only whole numbers are drawn.
        needs_slip: Whether it means nothing where wheels cannot slip.
    """

    name: str
    unit: str
    levels: tuple[float, ...]
    nominal: float
    summary: str
    changes: Mapping[str, tuple[float, float]]
    why_not: Callable[[Robot], str | None] = lambda robot: None
    drawn: tuple[float, float] | None = None
    whole: bool = False
    needs_slip: bool = False

    def apply(self, config: Config, level: float) -> Config:
        """Return a configuration with the stress at a level, in its own unit."""
        values = [first + slope * level for first, slope in self.changes.values()]
        return with_values(config, tuple(self.changes), np.array(values))

    def draw(self, share: float) -> float:
        """Return the level at a share (0 to 1) of the way from one end to the other."""
        low, high = self.drawn or (min(self.levels), max(self.levels))
        level = low + share * (high - low)
        return float(round(level)) if self.whole else float(f"{level:.3g}")

    def text(self, level: float) -> str:
        """Return a level as it is shown, without the unit."""
        if self.drawn is not None and level == self.nominal:
            return "none"
        return f"{level:+g}" if min(self.levels) < 0.0 and level else f"{level:g}"

    def extremes(self) -> Stress:
        """Return it with its nominal level and its ends alone."""
        kept = {self.nominal, self.levels[0], self.levels[-1]}
        return replace(self, levels=tuple(level for level in self.levels if level in kept))


def _no_effort_limits(robot: Robot) -> str | None:
    return None if np.isfinite(robot.effort_limits).any() else "its file has no effort limits"


def _no_wheels(robot: Robot) -> str | None:
    return None if robot.drive.base_speeds else "its base is fixed"


def _no_losses(robot: Robot) -> str | None:
    return "its file has no damping or friction of joints" if robot.losses is None else None


STRESSES = {
    each.name: each
    for each in (
        Stress(
            "payload", "kg", (0.0, 0.5, 1.0, 2.0, 5.0), 0.0,
            "a mass at the end effector, or at the root link's origin if there is none",
            {"plant.payload.mass": (0.0, 1.0)},
        ),
        Stress(
            "friction", "", (1.0, 0.7, 0.5, 0.35, 0.2), FRICTION,
            "coefficient between wheels and ground", {"run.friction": (0.0, 1.0)}, _no_wheels,
            needs_slip=True,
        ),
        Stress(
            "delay", "ms", (0.0, 5.0, 10.0, 20.0, 50.0), 0.0,
            "from a measurement to the efforts that answer it",
            {"plant.delay": (0.0, 1e-3)},
        ),
        Stress(
            RADIUS, "%", (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0), 0.0,
            "difference of all wheels' radii from the URDF",
            {"plant.radii.*": (1.0, 0.01)}, _no_wheels,
        ),
        Stress(
            "encoders", "bits", (0.0, 16.0, 14.0, 12.0, 10.0), 0.0,
            "counts per turn of wheels and revolute joints; rates are differences of counts",
            {"plant.encoder_bits": (0.0, 1.0)},
            drawn=(10.0, 16.0), whole=True,
        ),
        Stress(
            "noise", "x", (0.0, 1.0, 2.0, 4.0), 0.0,
            "times 1 cm, 5 mrad, 1 cm/s and 10 mrad/s of the base, 0.5 and 5 mrad(/s) of joints",
            {f"plant.noise.{name}": (0.0, size) for name, size in asdict(LOCALISATION).items()},
        ),
        Stress(
            "effort", "x", (1.0, 0.75, 0.5), 1.0,
            "times the effort limits, at which the actuators saturate",
            {"plant.effort": (0.0, 1.0)}, _no_effort_limits,
        ),
        Stress(
            "slope", "deg", (0.0, 2.0, 5.0, 8.0), 0.0, "up along the reference's x axis",
            {"plant.slope.along_x": (0.0, math.radians(1.0))},
        ),
        Stress(
            "slope-across", "deg", (0.0, 2.0, 5.0, 8.0), 0.0, "up along the reference's y axis",
            {"plant.slope.along_y": (0.0, math.radians(1.0))},
        ),
        Stress(
            "losses", "x", (0.0, 1.0, 2.0, 3.0), 1.0, "times the file's damping and friction",
            {"plant.losses": (0.0, 1.0)}, _no_losses,
        ),
    )
}  # fmt: skip


def stresses_by_name(names: Sequence[str]) -> tuple[Stress, ...]:
    """Return stresses in the order of the names; all of them if there are none.

    Raises:
        UnknownNameError: There is no such stress.
    """
    require_known("stress", names, STRESSES)
    return tuple(STRESSES[name] for name in dict.fromkeys(names or STRESSES))


@dataclass(frozen=True)
class StressCell:
    """One run of a battery.

    Attributes:
        plant: Kind of the plant.
        law: The laws.
        levels: What is not nominal; nothing where nothing is stressed.
        seed: Of the plant.
        run: Reference, duration and all else that is the same in all cells.
    """

    plant: str
    law: LawPair
    levels: Levels
    seed: int
    run: RunSettings

    def __str__(self) -> str:
        """Return ``rolling unified+integral payload 5 kg``."""
        return f"{self.plant} {self.law} {self.words}"

    @property
    def key(self) -> str:
        """What no other cell of a battery is called; it says all but the seed of the battery."""
        levels = ",".join(f"{name}={level!r}" for name, level in self.levels)
        return f"{self.plant} {self.law} {levels} {self.seed}"

    @property
    def words(self) -> str:
        """What is stressed: ``payload 5 kg and delay 20 ms``."""
        stressed = ((STRESSES[name], level) for name, level in self.levels)
        words = (f"{each.name} {each.text(level)} {each.unit}".rstrip() for each, level in stressed)
        return " and ".join(words) or "nothing stressed"

    def config(self, references: References) -> Config:
        """Return the run's configuration, which ``rpctl track --config`` replays."""
        robot = references.robot
        carrier = CarriedLoad("" if robot.end_effector is not None else robot.description.root)
        plant = Plant(kind=self.plant, seed=self.seed, payload=carrier)
        own = Config(*default_laws(robot), self.run, plant=plant)
        config = own.with_laws(self.law.kinematic, self.law.dynamic)
        for name, level in self.levels:
            config = STRESSES[name].apply(config, level)
        return config


@dataclass(frozen=True)
class Battery:
    """What is stressed, and how.

    Attributes:
        robot: The robot.
        laws: Pairs of laws; the first is the one that is judged.
        plants: Kinds of plants.
        stresses: The ladders.
        run: Reference, duration and all else that no cell changes.
        seed: Of all that is random.
        combinations: How many cells with two stresses each law gets on each plant.
    """

    robot: Robot
    laws: tuple[LawPair, ...]
    plants: tuple[str, ...]
    stresses: tuple[Stress, ...]
    run: RunSettings = field(default_factory=lambda: RunSettings(duration=DURATION))
    seed: int = 0
    combinations: int = 0

    @cached_property
    def left_out(self) -> Mapping[tuple[str, str], str]:
        """Why a stress means nothing on a plant, by plant and stress."""
        reasons = {
            (plant, stress.name): "its wheels cannot slip"
            if stress.needs_slip and plant == ROLLING
            else stress.why_not(self.robot)
            for plant in self.plants
            for stress in self.stresses
        }
        return {where: reason for where, reason in reasons.items() if reason is not None}

    def stresses_on(self, plant: str) -> tuple[Stress, ...]:
        """Return the stresses that mean something on a plant."""
        return tuple(s for s in self.stresses if (plant, s.name) not in self.left_out)

    @cached_property
    def cells(self) -> tuple[StressCell, ...]:
        """All runs, each once: plant by plant, law by law."""
        return tuple(
            StressCell(plant, law, levels, seed, self.run)
            for plant in self.plants
            for law in self.laws
            for levels, seed in self._levels(plant)
        )

    def _levels(self, plant: str) -> Iterator[tuple[Levels, int]]:
        """Yield what is stressed on a plant, and its seed: nothing, ladders, combinations."""
        yield (), self.seed
        stresses = self.stresses_on(plant)
        for stress in stresses:
            for level in stress.levels:
                if level != stress.nominal:
                    yield ((stress.name, level),), self.seed
        if len(stresses) > 1:
            yield from (self._combination(stresses, k) for k in range(self.combinations))

    def _combination(self, stresses: tuple[Stress, ...], number: int) -> tuple[Levels, int]:
        """Return two stresses at levels within their ranges, drawn at random, and their seed."""
        seed = run_seed(self.seed, number)
        generator = np.random.default_rng(seed)
        pair = np.sort(generator.choice(len(stresses), 2, replace=False))
        shares = generator.random(2)
        chosen = ((stresses[k], float(share)) for k, share in zip(pair, shares, strict=True))
        return tuple((stress.name, stress.draw(share)) for stress, share in chosen), seed


def default_pair(robot: Robot) -> LawPair:
    """Return the names of the laws that a robot gets if nobody names others."""
    kinematic, dynamic = default_laws(robot)
    names = {law: name for name, law in (*KINEMATIC_LAWS.items(), *DYNAMIC_LAWS.items())}
    return LawPair(names[type(kinematic)], names[type(dynamic)])


def default_pairs(robot: Robot) -> tuple[LawPair, ...]:
    """Return the pairs of laws that are stressed if nobody names others: the robot's own first."""
    others = () if robot.drive.leans else OTHERS  # which balance no robot
    return tuple(dict.fromkeys((default_pair(robot), *others)))


def run_battery(
    battery: Battery,
    out: Path,
    executor: Executor | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> dict[str, Figures]:
    """Run a battery, and keep each run on disk as it ends; return the figures by cells' keys.

    They depend neither on the executor, nor on what ended it before. A battery with more laws,
    plants, stresses or combinations may go on with the runs of a smaller one, which the folder
    ``out`` holds. ``progress`` is called with the runs done and their number.

    Raises:
        RpctlError: The folder holds something else.
    """
    identity = {
        "robot": robot_identity(battery.robot),
        "run": to_plain(battery.run),
        "reference": reference_digest(battery.run.reference),
        "versions": dict(installed()),
    }
    notify = progress or (lambda done, total: None)
    journal = Journal(out / JOURNAL_FILE, identity, "a battery's runs", "them")
    done = {record["cell"]: _read(record["figures"]) for record in journal.begin(resume)}
    missing = [cell for cell in battery.cells if cell.key not in done]
    total, before = len(battery.cells), len(battery.cells) - len(missing)

    def keep(cell: StressCell, figures: Figures) -> None:
        journal.add({"cell": cell.key, "figures": asdict(figures)})
        done[cell.key] = figures

    notify(before, total)
    runner = CellRunner(References(battery.robot))
    run_cells(runner, missing, executor or Executor(), lambda n, _: notify(before + n, total), keep)
    ordered = {**{cell.key: done[cell.key] for cell in battery.cells}, **done}
    journal.rewrite({"cell": key, "figures": asdict(each)} for key, each in ordered.items())
    return ordered


def _read(figures: Mapping[str, Any]) -> Figures:
    """Return the figures that a journal holds, whose lists are tuples."""
    lists = {name: tuple(each) for name, each in figures.items() if isinstance(each, list)}
    return Figures(**{**figures, **lists})
