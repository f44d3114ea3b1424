"""One run of a battery, as any process does it."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.felt_ground import FeltGround
from rpctl.simulation.loop import simulate
from rpctl.simulation.merits import measures
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize
from rpctl.study.stress.ladders import CONTACT, ROLLING
from rpctl.study.stress.verdict import ENDED, REFUSED, StressFigures


@dataclass(frozen=True)
class StressChunk:
    """A cell for a process: its key, and the configuration that replays it."""

    key: str
    config: Config

    def __str__(self) -> str:
        """Return the cell's key."""
        return self.key


@dataclass(frozen=True)
class StressTask:
    """Runs cells on one robot; it can be sent to another process.

    Attributes:
        robot: The robot.
    """

    robot: Robot
    _references: dict[Any, Reference] = field(default_factory=dict, init=False, repr=False)

    def __call__(self, chunk: StressChunk) -> StressFigures:
        """Return what became of a cell; a run that was refused, or ended early, says why."""
        ended: list[Run] = []
        try:
            reference = self._reference(chunk.config)
            run = simulate(self.robot, chunk.config, reference, ended=ended.append)
        except RpctlError as error:
            if not ended and not isinstance(error, DivergedError):
                return StressFigures(REFUSED, str(error))
            return StressFigures(ENDED, str(error), float(ended[0].t[-1]) if ended else 0.0)
        return figures_of(run)

    def __getstate__(self) -> Mapping[str, Any]:
        """Return what another process needs; it makes its own reference."""
        return {**vars(self), "_references": {}}

    def _reference(self, config: Config) -> Reference:
        """Return the reference, made once: it takes as long as a run."""
        settings = config.run
        key = (settings.reference, settings.size, settings.speed, settings.laps)
        if key not in self._references:
            self._references[key] = settings.load_reference(self.robot)
        return self._references[key]


def figures_of(run: Run) -> StressFigures:
    """Return the figures of a run that came to its end."""
    summary, found = summarize(run), measures(run)
    late = slice(len(run.t) // 2, None)
    ground, kind = summary.ground, run.config.plant.kind
    tip = None if run.robot.end_effector is None else _rms(found.tip[late])
    return StressFigures(
        outcome=summary.outcome,
        sentence=summary.outcome_sentence,
        time=float(run.t[-1]),
        base_error=_rms(found.base[late]),
        end_effector_error=tip,
        violations=tuple(f"{each.joint} {each.limit}" for each in summary.limits_violated),
        would_slip=kind == ROLLING and bool(ground.would_slip),
        would_tip=kind != CONTACT and bool(ground.would_tip),
        tilt=largest_tilt(run.log.root_pose),
        **_felt(summary.felt_ground, {wheel.joint for wheel in run.robot.drive.wheels}),
    )


def _felt(ground: FeltGround | None, wheels: Set[str]) -> dict[str, Any]:
    """Return the figures that say what the plant felt of the ground.

    Args:
        ground: It; None where wheels roll.
        wheels: Joints of the wheels; other contacts are supports.
    """
    if ground is None:
        return {}
    return {
        "felt_ground": ground.sentence,
        "lifted_wheels": tuple(name for name in ground.lifted if name in wheels),
        "hanging_wheels": tuple(name for name in ground.hanging if name in wheels),
    }


def largest_tilt(poses: Array) -> float:
    """Return the largest angle (rad) by which a body leant over from where it stood.

    Args:
        poses: Its poses (K, 7): x, y, z, quaternion x, y, z, w; none (K, 0): it stays upright.
    """
    if not poses.size:
        return 0.0
    x, y, z, w = poses[:, 3:].T
    up = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    return float(np.arccos(np.clip(up @ up[0], -1.0, 1.0)).max())


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
