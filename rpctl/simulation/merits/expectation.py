"""What to expect of a real robot: the run again, briefly, with a plant that the model is not.

A nominal run shows the model following itself, and its error is that of the numbers. The robot of
this one is heavier than its controller knows, its wheels resist, and its efforts come late.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.constraints import contact_radius
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference, end_effector_reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.loop.closed_loop import LoopRecord, close_loop
from rpctl.simulation.loop.periods import delay_periods, whole_periods
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.loop.track import default_duration
from rpctl.simulation.merits.obstacles import BASE, TIP, find_obstacles
from rpctl.simulation.merits.outcome import DIVERGING, STUCK, SUCCESSES, outcome, trace_points
from rpctl.simulation.merits.path_error import PathFigures, path_figures
from rpctl.simulation.merits.texts import lag, length
from rpctl.simulation.plants.starting import MASS_RATIO, perturbed_plant

LAG_RATIO = 1.25  # of the lag that the controller takes a velocity interface to have
DURATION_RATIO = 1.0 / 3.0  # of the nominal run's: what keeps this one cheap
MIN_DURATION_S = 4.0  # s: named references start softly, for 3 s; a shorter run tells too little
MAX_DURATION_S = 10.0  # s: by then it has settled
SAMPLE_S = 0.01  # s: of what is kept of the motion


@dataclass(frozen=True)
class Expectation:
    """What became of the run with the perturbed plant.

    Attributes:
        mass_ratio: All masses, relative to those that the controller takes them for.
        wheel_friction: Dry friction of each driven wheel, N·m.
        delay: Time from a measurement to the efforts it leads to, s: whole control periods.
        duration: Time simulated, s.
        outcome: As of a summary.
        outcome_sentence: Why, in words.
        base_path: How far P was from its reference's path, and how far behind on it; None if the
            motion diverged.
        end_effector_path: Likewise; None without an end effector, too.
        lag_ratio: The lag with which speeds are followed, relative to what the controller takes it
            for; None where efforts are sent, or speeds that are followed at once.
    """

    mass_ratio: float
    wheel_friction: Mapping[str, float]
    delay: float
    duration: float
    outcome: str
    outcome_sentence: str
    base_path: PathFigures | None = None
    end_effector_path: PathFigures | None = None
    lag_ratio: float | None = None

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        causes = [f"{100.0 * (self.mass_ratio - 1.0):.0f} % more mass"]
        causes += ["wheel friction"] if self.wheel_friction else []
        if self.lag_ratio is not None:
            causes.append(f"{100.0 * (self.lag_ratio - 1.0):.0f} % more lag")
        causes += [f"{1e3 * self.delay:.3g} ms delay"] if self.delay else []
        listed = ", ".join(causes[:-1])
        head = f"with {listed} and {causes[-1]}" if listed else f"with {causes[-1]}"
        if self.base_path is None:
            return f"{head}: {self.outcome}, {self.outcome_sentence}"
        tip = self.end_effector_path
        errors, main = f"{length(self.base_path.rms)} rms", self.base_path
        if tip is not None and self.base_path.length > 0.0:
            errors += f" (end effector {length(tip.rms)})"
        elif tip is not None:  # of a base that stands, or turns on the spot
            errors, main = f"{length(tip.rms)} rms at the end effector", tip
        behind = lag(main.largest_lag, main.largest_lag_distance)
        word = "the error stays" if self.outcome == STUCK else self.outcome
        tail = "" if self.outcome in SUCCESSES else f"; {word}"
        return f"{head}: path error {errors}, {behind} behind at most{tail}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return {**asdict(self), "sentence": self.sentence}


class _Poses:
    """Keeps poses of base and end effector, ``SAMPLE_S`` apart."""

    def __init__(self, robot: Robot, period: float) -> None:
        self._robot, self._data = robot, robot.model.createData()
        self._every, self._count = max(1, round(SAMPLE_S / period)), 0
        self._rows: dict[str, list[Array]] = {}

    def __call__(self, sample: LoopSample) -> None:
        self._count += 1
        if (self._count - 1) % self._every:
            return
        robot, state = self._robot, sample.state
        row = {"t": np.array(sample.t), "base": robot.base_pose(sample.q), "base_ref": state.pose}
        row["ee"] = row["ee_ref"] = np.empty(0)
        if robot.end_effector is not None:
            row["ee"] = robot.end_effector_pose(self._data, sample.q).translation.copy()
            wanted = end_effector_reference(robot, self._data, state)
            row["ee_ref"] = wanted.translation.copy()
        for key, value in row.items():
            self._rows.setdefault(key, []).append(value)

    def arrays(self) -> dict[str, Array]:
        """Return what was kept, samples first; headings without jumps."""
        arrays = {key: np.array(rows) for key, rows in self._rows.items()}
        for poses in (arrays["base"], arrays["base_ref"]):
            poses[:, 2] = np.unwrap(poses[:, 2])
        return arrays


def expect(robot: Robot, config: Config, reference: Reference | None = None) -> Expectation | None:
    """Return what a run would come to with a heavier robot, wheel friction and a delay.

    The run starts on its reference, and is a third as long. It keeps its laws, which compute with
    the robot as it is given; their limits are those of the configuration.

    Args:
        robot: The robot, before the configuration's limits.
        config: Of the nominal run; its plant and initial error do not count.
        reference: What the configuration's reference is; None loads it by its name.

    Returns:
        What became of it, ``diverging`` if an error ended it; None where a third of the run is too
        short to tell.

    Raises:
        RpctlError: The robot cannot have the configuration's limits or follow its reference.
    """
    settings, period = config.run, config.run.control_period
    known = config.limits.apply(robot)
    reference = settings.load_reference(known) if reference is None else reference
    nominal = default_duration(reference) if settings.duration is None else settings.duration
    steps = whole_periods(min(DURATION_RATIO * nominal, MAX_DURATION_S), period)
    if steps * period < MIN_DURATION_S:
        return None
    plant, output = perturbed_plant(known), config.output
    late = output is not None and bool(output.lag or output.lags)
    if output is not None and late:
        lags = {name: LAG_RATIO * lag for name, lag in output.lags.items()}
        plant = replace(plant, lag=LAG_RATIO * output.lag, lags=lags)
    facts = Expectation(
        MASS_RATIO,
        plant.joint_friction,
        delay_periods(plant.delay, period) * period,
        steps * period,
        DIVERGING,
        "",
        lag_ratio=LAG_RATIO if late else None,
    )
    changed = replace(config, plant=plant, run=replace(settings, initial_error=(0.0, 0.0, 0.0)))
    dynamics = ReducedDynamics(known)
    poses = _Poses(dynamics.robot, period)
    try:
        close_loop(dynamics, changed, reference, steps, None, LoopRecord(), watch=poses)
    except Exception as error:
        return replace(facts, outcome_sentence=f"it ended early ({error})")
    return _judged(facts, poses.arrays(), config, dynamics)


def _judged(
    facts: Expectation, kept: Mapping[str, Array], config: Config, dynamics: ReducedDynamics
) -> Expectation:
    """Return what became of the motion that was kept."""
    points = trace_points(**kept)
    radius = contact_radius(dynamics.robot, find_contacts(dynamics, config.run.friction))
    name, sentence = outcome(kept["t"], points, find_obstacles(config, radius))
    paths = {key: path_figures(point.trace, key == BASE) for key, point in points.items()}
    return replace(
        facts,
        outcome=name,
        outcome_sentence=sentence,
        base_path=paths[BASE],
        end_effector_path=paths.get(TIP),
    )
