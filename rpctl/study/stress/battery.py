"""The cells of a battery: every level of every stress, and some of two stresses at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rpctl.control.defaults import default_laws
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.registry import (
    DYNAMIC_LAWS,
    KINEMATIC_LAWS,
    dynamic_by_name,
    kinematic_by_name,
)
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plant import Plant
from rpctl.study.experiment import run_seed
from rpctl.study.scenarios import PAPER, LawPair
from rpctl.study.stress.ladders import STRESSES, Stress, left_out

DURATION = 10.0  # s: references start softly, for 3 s; the second half is what is judged
OTHERS = (PAPER, LawPair("kanayama", "paper"))  # that the robot's own laws are compared with
Levels = tuple[tuple[str, float], ...]  # names of stresses and their levels


@dataclass(frozen=True)
class StressCell:
    """One run of a battery.

    Attributes:
        plant: Kind of the plant.
        law: The laws.
        levels: What is not nominal; nothing where nothing is stressed.
        seed: Of the plant.
    """

    plant: str
    law: LawPair
    levels: Levels = ()
    seed: int = 0

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
        return " and ".join(level_words(*each) for each in self.levels) or "nothing stressed"


def level_words(name: str, level: float) -> str:
    """Return a stress and its level: ``payload 5 kg``."""
    stress = STRESSES[name]
    return f"{name} {stress.text(level)} {stress.unit}".rstrip()


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
        found = {
            (plant, stress.name): left_out(self.robot, plant, stress)
            for plant in self.plants
            for stress in self.stresses
        }
        return {key: reason for key, reason in found.items() if reason is not None}

    def stresses_on(self, plant: str) -> tuple[Stress, ...]:
        """Return the stresses that mean something on a plant."""
        return tuple(s for s in self.stresses if (plant, s.name) not in self.left_out)

    @cached_property
    def cells(self) -> tuple[StressCell, ...]:
        """All runs, each once: plant by plant, law by law."""
        return tuple(
            StressCell(plant, law, levels, seed)
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

    def config_of(self, cell: StressCell) -> Config:
        """Return the configuration of a cell, which ``rpctl track --config`` replays.

        Args:
            cell: Of this battery.
        """
        kinematic, dynamic = laws_of(self.robot, cell.law)
        plant = Plant(kind=cell.plant, seed=cell.seed)
        config = Config(kinematic=kinematic, dynamic=dynamic, run=self.run, plant=plant)
        for name, level in cell.levels:
            config = STRESSES[name].apply(config, self.robot, level)
        return config


def default_pair(robot: Robot) -> LawPair:
    """Return the names of the laws that a robot gets if nobody names others."""
    kinematic, dynamic = default_laws(robot)
    names = {law: name for name, law in (*KINEMATIC_LAWS.items(), *DYNAMIC_LAWS.items())}
    return LawPair(names[type(kinematic)], names[type(dynamic)])


def default_pairs(robot: Robot) -> tuple[LawPair, ...]:
    """Return the pairs of laws that are stressed if nobody names others: the robot's own first."""
    return tuple(dict.fromkeys((default_pair(robot), *OTHERS)))


def laws_of(robot: Robot, pair: LawPair) -> tuple[KinematicLaw, DynamicLaw]:
    """Return the laws of a pair: the robot's own where these are meant, else with their defaults.

    Args:
        robot: The robot.
        pair: Their names.
    """
    if pair == default_pair(robot):
        return default_laws(robot)
    return kinematic_by_name(pair.kinematic), dynamic_by_name(pair.dynamic)


def extremes(stress: Stress) -> Stress:
    """Return a stress with its nominal level and its ends alone."""
    kept = {stress.nominal, stress.levels[0], stress.levels[-1]}
    return replace(stress, levels=tuple(level for level in stress.levels if level in kept))
