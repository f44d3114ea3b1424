"""Which backend closes a loop: machine code where it can and where that pays, else Pinocchio."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

from rpctl.control.registry import name_of
from rpctl.errors import DiffersError, UnknownNameError
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.loop.closed_loop import Loop, close_loop
from rpctl.simulation.loop.recorder import LoopSample, Recorder
from rpctl.simulation.plants.plant import Plant

BACKENDS = ("auto", "compiled", "pinocchio")
MOST_DOF = 30  # quasi-velocities; to build a loop of more takes longer than most runs in Python
UNCOMPILED = {  # fields of a plant that only Python simulates, and why
    "dropped": "samples are dropped",
    "effort_lag": "efforts lag",
    "backlash": "joints have backlash",
    "encoder_bits": "encoders are quantised",
    "jitter": "the sampling times jitter",
    "wrenches": "the robot is pushed from outside",
}
# s: what a sample takes in Python, and what a loop takes to build, by quasi-velocities. Half of
# the latter counts: the next run finds the code on disk.
SAMPLE_S, BUILD_S, BUILD_EXPONENT = 3e-4, 2e-3, 2.7


def run_loop(loop: Loop, recorder: Recorder, backend: str = "auto") -> None:
    """Close a loop by one backend or the other.

    The numbers of both agree to rounding. What machine code cannot do is done in Python, and said.

    Args:
        loop: What it needs; filled when it ends, early or not.
        recorder: Gets every sample.
        backend: ``"auto"``, ``"compiled"`` or ``"pinocchio"``.

    Raises:
        DivergedError: The motion left the finite numbers.
        UnknownNameError: There is no such backend.
    """
    require_backend(backend)
    robot = loop.dynamics.robot
    if backend == "pinocchio" or (backend == "auto" and not pays(robot, loop.steps)):
        return close_loop(loop, recorder.add)
    reason, recorded = refusal(robot, loop.config, loop.watch is not None), 0
    # That which has no machine code is known to "auto", but for a law of the user's own.
    expected = reason is not None and backend == "auto" and not _own(loop.config, reason)
    if reason is None:
        reason, recorded = _compiled(loop, recorder)
        if reason is None:
            return None
    if not expected:
        loop.remarks = (f"the loop ran in Python, not as machine code: {reason}",)
    numbers = itertools.count()

    def take(sample: LoopSample) -> None:
        if next(numbers) >= recorded:  # the loop begins anew
            recorder.add(sample)

    return close_loop(loop, take)


def _own(config: Config, reason: str) -> bool:
    """Return whether a reason is about a law, and one of them is the user's own."""
    laws = config.kinematic, config.dynamic
    own = [law for law in laws if not type(law).__module__.startswith("rpctl.")]
    return any(name_of(law) in reason for law in own)


def _compiled(loop: Loop, recorder: Recorder) -> tuple[str | None, int]:
    """Close a loop as machine code; return why not to the end, and the samples recorded."""
    from rpctl.simulation.compiled.tracking_loop import NeedsPython, close_compiled_loop

    try:
        close_compiled_loop(loop, recorder)
    except DiffersError as error:
        return str(error), 0
    except NeedsPython as error:
        return error.reason, error.samples
    return None, loop.steps + 1


def require_backend(name: str) -> None:
    """Refuse what is no backend.

    Raises:
        UnknownNameError: Those that there are are named.
    """
    if name not in BACKENDS:
        raise UnknownNameError("backend", name, BACKENDS)


def pays(robot: Robot, steps: int) -> bool:
    """Return whether so many samples are worth the time that building the loop takes.

    Args:
        robot: The robot.
        steps: Number of control periods.
    """
    return SAMPLE_S * steps >= 0.5 * BUILD_S * robot.dof**BUILD_EXPONENT


def refusal(robot: Robot, config: Config, watched: bool = False) -> str | None:
    """Return why machine code cannot close a loop, a clause; None if it can.

    Args:
        robot: The robot.
        config: Laws and plant.
        watched: Whether somebody sees every sample when it is computed.
    """
    from rpctl.control.dynamic import no_machine_code, unsupported

    plant = config.plant
    reasons = {
        "the robot leans": robot.drive.leans,
        "a live page shows every sample": watched,
        "the controller predicts over a delay": bool(config.run.delay),
        "rates are estimated": config.run.rates == "estimated",
        "the robot takes speeds": config.output is not None,
        "the plant is a simulator of the user's": plant.own is not None,
        f"the plant is {plant.kind}": plant.kind != "rolling",
        "computing takes simulated time": bool(plant.computing_time),
        plant_refusal(plant) or "": plant_refusal(plant) is not None,
        "the plant has a lag or a dead time": bool(plant.lags)
        or (plant.lag, plant.dead_time) != (None, None),
        f"it has {robot.dof} quasi-velocities; beyond {MOST_DOF} the loop takes long to compile": (
            robot.dof > MOST_DOF
        ),
    }
    known = next((reason for reason, holds in reasons.items() if holds), None)
    laws = config.kinematic, config.dynamic
    return known or unsupported(*laws) or no_machine_code(laws[0], robot)


def plant_refusal(plant: Plant, scattered: Iterable[str] = ()) -> str | None:
    """Return what of a plant has no machine code, a clause; None if all of it has.

    Args:
        plant: The plant.
        scattered: Paths of settings that differ from run to run, as ``plant.jitter``.
    """
    default = Plant()
    fields = {path.split(".")[1] for path in scattered if path.startswith("plant.")}
    for name, reason in UNCOMPILED.items():
        if name in fields or getattr(plant, name) != getattr(default, name):
            return reason
    return None
