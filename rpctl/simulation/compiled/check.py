"""A compiled loop beside Python's: one sample from random states, laws and plant."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.law import Rest, as_efforts, as_law
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.reference.table import tabulate
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.laws.law_settings import settings_of
from rpctl.simulation.compiled.loop import CompiledLoop
from rpctl.simulation.compiled.machine.program import Buffer, Rows
from rpctl.simulation.compiled.starting import prepared
from rpctl.simulation.config import Config
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.rolling import advance

EQUAL = 1e-10  # of a quantity's largest entry, or of 1; rounding leaves 1e-13
STATES, SEED = 3, 20210601
SPREAD = 0.05  # of positions about home and of speeds, m, rad and their rates


class DiffersError(RpctlError):
    """A compiled loop does not compute what Python's does."""


def require_equal(
    compiled: CompiledLoop, known: ReducedDynamics, simulated: ReducedDynamics, config: Config
) -> None:
    """Refuse a loop whose efforts or steps are not those of the laws and of Pinocchio's plant.

    Args:
        compiled: The loop.
        known: The robot's dynamics as the controller knows them.
        simulated: Those of the simulated robot.
        config: Laws and circumstances.

    Raises:
        DiffersError: They differ; the quantity is named.
    """
    rng = np.random.default_rng(SEED)
    for _ in range(STATES):
        rest, nu, state = _random_sample(known.robot, simulated, rng)
        expected = _by_python(known, simulated, config, rest, nu, state)
        found = _by_machine(compiled, known, config, rest, nu, state)
        if found is None:  # the laws' own business: Python is asked there
            continue
        for name, value in expected.items():
            residual = np.abs(found[name] - value).max(initial=0.0)
            if not residual <= EQUAL * np.abs(value).max(initial=1.0):
                raise DiffersError(
                    f"machine code of {known.robot.name} gives other {name} than Pinocchio, "
                    f"by {residual:.2g}"
                )


def _random_sample(
    robot: Robot, simulated: ReducedDynamics, rng: np.random.Generator
) -> tuple[Rest, Array, ReferenceState]:
    """Return a robot at rest, speeds that it then has, and a reference near it."""
    n = len(robot.joints)

    def near(center: Array) -> Array:
        return center + SPREAD * rng.normal(size=len(center))

    pose = rng.normal(size=3)
    q = robot.configuration_at(
        pose, near(robot.home), SPREAD * rng.normal(size=len(robot.drive.steered))
    )
    still = np.zeros(robot.dof)
    rest = Rest(q, np.asarray(simulated.efforts(q, simulated.bias(q, still))))
    twist, rates = near(np.array([0.3, 0.0, 0.2])), near(np.zeros(3))
    state = ReferenceState(
        near(pose), twist, rates, near(robot.home), near(np.zeros(n)), near(np.zeros(n))
    )
    return rest, near(still), state


def _by_python(
    known: ReducedDynamics,
    simulated: ReducedDynamics,
    config: Config,
    rest: Rest,
    nu: Array,
    state: ReferenceState,
) -> dict[str, Array]:
    """Return what the laws ask for, and where the robot is a period later."""
    period = config.run.control_period
    kinematic: Any = as_law(config.kinematic)
    if getattr(kinematic, "approach", None) is not None:
        kinematic = replace(kinematic, approach=None)
    command = kinematic.start(known, period, rest)(known, lambda t: state, 0.0, rest.q, nu)
    dynamic = as_law(config.dynamic).start(known, period, rest)
    tau = as_efforts(dynamic(known, rest.q, nu, command)).tau
    step = advance(simulated, rest.q, nu, tau, period, config.run.plant_step)
    found = {"desired speeds": command.nu_d, "efforts": tau}
    return {**found, "positions": step.q, "speeds": step.nu}


def _by_machine(
    compiled: CompiledLoop,
    known: ReducedDynamics,
    config: Config,
    rest: Rest,
    nu: Array,
    state: ReferenceState,
) -> dict[str, Array] | None:
    """Return the same of the compiled loop; None where its laws have no answer."""
    period, loop = config.run.control_period, compiled.program
    kinematic: Any = as_law(config.kinematic)
    dynamic: Any = as_law(config.dynamic)
    undisturbed = replace(config, plant=Plant())
    settings = settings_of(kinematic, dynamic, known, period)[1]
    workspace, ring = prepared(compiled, undisturbed, rest, settings)
    workspace[loop.plant.nu][:] = nu[:, None]
    row = tabulate(known.robot, lambda t: state, np.zeros(1)).rows()
    rows = {
        loop.reference: Rows(row),
        loop.followed: Rows(np.repeat(row[:, :, None], compiled.sample.lanes, axis=2)),
        loop.noise: Rows(np.zeros((1, loop.noise.width, compiled.sample.lanes))),
        loop.ring: ring,
    }
    if loop.fold is not None and loop.fold.tip is not None:
        rows[loop.fold.tip] = Rows(np.zeros((1, loop.fold.tip.width)))
    log = {s: Rows(np.empty((1, s.width, compiled.sample.lanes))) for s in loop.log.values()}
    compiled.sample.run(0, 1, workspace, {s: {**rows, **log}[s] for s in loop.sample.streams})
    if workspace[loop.law.failed].any():
        return None
    taken: dict[str, Buffer] = {
        "desired speeds": loop.law.nu_d,
        "efforts": loop.law.tau,
        "positions": loop.plant.q,
        "speeds": loop.plant.nu,
    }
    return {name: workspace[buffer][:, 0] for name, buffer in taken.items()}
