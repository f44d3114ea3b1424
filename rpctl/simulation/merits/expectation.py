"""What to expect of a real robot: the run again, briefly, with a plant that the model is not.

A nominal run shows the model following itself, and its error is that of the numbers. The robot of
this one is heavier than its controller knows, its wheels resist, and its efforts come late.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from rpctl.control.velocity_output import VelocityOutput
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, delay_periods, whole_periods
from rpctl.simulation.loop.track import default_duration, simulate
from rpctl.simulation.merits.outcome import DIVERGING, STUCK, SUCCESSES
from rpctl.simulation.merits.path_error import PathFigures, lag, length
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.plants.plant import Plant
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
        word = "the error does not decay" if self.outcome == STUCK else self.outcome
        tail = "" if self.outcome in SUCCESSES else f"; {word}"
        return f"{head}: path error {errors}, {behind} behind at most{tail}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return {**asdict(self), "sentence": self.sentence}


def expect(robot: Robot, config: Config, reference: Reference | None = None) -> Expectation | None:
    """Return what a run would come to with a heavier robot, wheel friction and a delay.

    It starts on its reference, is a third as long, and ``diverging`` if an error ended it. None:
    a third of the run is too short to tell. The laws compute with the robot as it is given.

    Args:
        robot: The robot, before the configuration's limits.
        config: Of the nominal run; its plant and initial error do not count.
        reference: What the configuration's reference is; None loads it by its name.

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
    brief = replace(
        settings,
        duration=steps * period,
        initial_error=(0.0, 0.0, 0.0),
        log_every=max(1, round(SAMPLE_S / period)),
    )
    output = None if config.output is None else config.output.on(known)
    plant, lag_ratio = _later(perturbed_plant(known), output)
    plant = replace(plant, delay=(settings.delay or 0.0) + plant.delay)  # later than it is told
    config = replace(config, plant=plant, run=brief)
    delay = delay_periods(plant.delay, period) * period
    facts = (MASS_RATIO, plant.joint_friction, delay, steps * period)
    try:
        found = summarize(simulate(known, config, reference, collisions=False))
    except Exception as error:
        return Expectation(*facts, DIVERGING, f"it ended early ({error})", lag_ratio=lag_ratio)
    judged = found.outcome, found.outcome_sentence, found.base_path, found.end_effector_path
    return Expectation(*facts, *judged, lag_ratio)


def _later(plant: Plant, output: VelocityOutput | None) -> tuple[Plant, float | None]:
    """Return a plant that follows speeds later than its controller knows, and the ratio of lags."""
    if output is None or not (output.lag or output.lags):
        return plant, None
    lags = {name: LAG_RATIO * lag for name, lag in output.lags.items()}
    return replace(plant, lag=LAG_RATIO * output.lag, lags=lags), LAG_RATIO
