"""What a run tells besides its figures: how it differs from what was asked for, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

from rpctl.control.velocity_output import VelocityOutput
from rpctl.simulation.config import Config, delay_periods, is_whole, whole_periods

MOVED_BY = {  # by the plant's kind
    "slipping": "the robot moved on tyres that slip",
    "contact": "MuJoCo moved the robot: its wheels meet the ground in contacts",
}


def run_notes(config: Config, whole: bool = True) -> tuple[str, ...]:
    """Return what a configuration makes of what was asked for.

    Args:
        config: What was asked for, and how many samples are logged.
        whole: Whether the run was not ended early.
    """
    return tuple(_notes(config, whole))


def _notes(config: Config, whole: bool) -> Iterator[str]:
    run, plant, delay, period = config.run, config.plant, config.delay, config.run.control_period
    if whole and run.duration is not None:
        periods = whole_periods(run.duration, period)
        if not is_whole(run.duration, period, periods):
            yield (
                f"a duration of {run.duration:g} s is not a whole number of control periods of "
                f"{period:g} s: the run ends at {periods * period:g} s"
            )
    periods = delay_periods(delay, period)
    if not is_whole(delay, period, periods):
        yield (
            f"a delay of {delay:g} s is not a whole number of control periods of {period:g} s: "
            f"the plant delays by {periods * period:g} s"
        )
    if config.output is not None:
        truth = plant.velocity_interface(config.output)
        yield _speeds_note(config.output, truth, plant.kind == "contact")
    every = run.log_every or 1
    if every > 1:
        yield (
            f"one sample of {every} is logged, each {every * period:g} s: figures and curves miss "
            "what happens in between"
        )
    if plant.own is not None:
        yield f"a simulator of the user's, {type(plant.own).__name__}, moved the robot"
    elif plant.kind in MOVED_BY:
        yield f"{MOVED_BY[plant.kind]}, friction {run.friction:g}"


def _speeds_note(known: VelocityOutput, truth: VelocityOutput, contact: bool) -> str:
    """Return the note that a robot takes speeds, and how it follows them."""
    forms = " and ".join(f"{group.kind} to {name}" for name, group in known.groups.items())
    note = (
        f"the controller sends {forms or 'speeds'}, which the robot follows "
        f"{_lateness(truth)}{'' if contact else '; the efforts are those that this motion needs'}"
    )
    if truth == known:
        return note
    return f"{note}; the controller assumes that the robot follows them {_lateness(known)}"


def _lateness(output: VelocityOutput) -> str:
    """Return how late speeds are followed, in words: most of them, and those named otherwise."""
    default, lags, dead = (output.lag, output.dead_time), output.lags, output.dead_times
    late = {n: (lags.get(n, default[0]), dead.get(n, default[1])) for n in {**lags, **dead}}
    return "; ".join(
        " and ".join(name for name in late if late[name] == times != default)
        + f" with a lag of {times[0]:g} s and a dead time of {times[1]:g} s"
        for times in dict.fromkeys((default, *late.values()))
    ).lstrip()


def end_note(error: BaseException, t: float, duration: float) -> str:
    """Return the sentence that says when (s) and why a run ended early."""
    reason = "interrupted" if isinstance(error, KeyboardInterrupt) else str(error)
    reason = reason or type(error).__name__
    return f"ended at {t:.4g} of {duration:.4g} s ({reason}); the samples until then are kept"
