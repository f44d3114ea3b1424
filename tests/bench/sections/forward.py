"""Forward dynamics: a step of every drive beside its floor, a first draft and other engines."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.equivalence.mujoco_engine import MujocoModel
from rpctl.robot import catalog
from tests.bench.machine_step import step_time
from tests.bench.rows import Row, Section, cpu_seconds

COMMAND = "python -m tests.bench.table --only forward"
State = tuple[ReducedDynamics, Array, Array, Array]
DRIVES = (
    *(entry.name for entry in catalog.ENTRIES if entry.own and not entry.leans),
    "tiago",
    "tiago_pro",
)
QUICK = ("tiago",)


def section(quick: bool) -> Section:
    """Return a step of every drive, beside MuJoCo."""
    rows: list[Row] = []
    for name in QUICK if quick else DRIVES:
        rows += _steps(rpctl.load(name), quick)
    note = (
        "The floor is Pinocchio's crba and rnea of the tree alone. The first draft projects with "
        "NumPy, S and B given. MuJoCo's `mj_forward` is of the free tree, without "
        "wheels that roll. A step of 8 lanes is an eighth of the time that 8 take side by side."
    )
    return Section("Forward step", tuple(rows), note)


def _steps(robot: Robot, quick: bool) -> Iterator[Row]:
    """Yield the rows of a robot, µs."""
    number, rounds = (100, 3) if quick else (1000, 10)

    def least(call: Callable[[], object]) -> float:
        return 1e6 * cpu_seconds(call, number, rounds)

    def row(what: str, figure: float, peer: str = "", its: float = np.nan) -> Row:
        return Row(f"{robot.name}: {what}", figure, "µs", COMMAND, peer, its)

    state = state_of(robot)
    lowest, python, draft = (least(make(state)) for make in (floor, projected, naive))
    one, eight = step_time(robot, 1), step_time(robot, 8) / 8
    yield row("floor", lowest)
    yield row("first draft in NumPy", draft)
    yield row("`ReducedDynamics.forward`", python, "first draft in NumPy", draft)
    yield row("machine code, 1 lane", one, "`ReducedDynamics.forward`", python)
    yield row("machine code, 8 lanes", eight, "`ReducedDynamics.forward`", python)
    other = least(_mujoco(robot))
    yield row("MuJoCo `mj_forward`", other)
    yield row("machine code, 1 lane, beside MuJoCo", one, "MuJoCo `mj_forward`", other)


def _mujoco(robot: Robot) -> Callable[[], object]:
    """Return MuJoCo's forward dynamics of the free tree, where it was not before."""
    import mujoco

    model = MujocoModel(robot).mjm
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    places = itertools.cycle(0.1 * rng.normal(size=(2, model.nq)))
    data.qvel[:] = rng.normal(size=model.nv)

    def run() -> None:
        data.qpos[:] = next(places)
        mujoco.mj_forward(model, data)

    return run


def state_of(robot: Robot) -> State:
    rng = np.random.default_rng(20210601)
    q = robot.random_configuration(rng)
    tau = rng.normal(size=len(robot.actuators))
    return ReducedDynamics(robot), q, rng.normal(size=robot.dof), tau


def floor(state: State) -> Callable[[], object]:
    """Pinocchio's two algorithms alone: what no projection can undercut."""
    dynamics, q, nu, _ = state
    model, v = dynamics.robot.model, dynamics.basis(q) @ nu
    data, still = model.createData(), np.zeros(model.nv)

    def run() -> object:
        return pin.crba(model, data, q), pin.rnea(model, data, q, v, still)

    return run


def naive(state: State) -> Callable[[], object]:
    """The same projection as a first draft would write it."""
    dynamics, q, nu, tau = state
    model, S, B = dynamics.robot.model, dynamics.basis(q), dynamics.actuation(q)

    data = model.createData()

    def run() -> Array:
        M = S.T @ pin.crba(model, data, q) @ S
        h = S.T @ pin.nonLinearEffects(model, data, q, S @ nu)
        return np.asarray(np.linalg.solve(M, B @ tau - h))

    return run


def projected(state: State) -> Callable[[], object]:
    """Forward dynamics where the robot was not before: nothing of the last call serves again."""
    dynamics, q, nu, tau = state
    places = itertools.cycle((q, dynamics.robot.configuration()))
    return lambda: dynamics.forward(next(places), nu, tau)
