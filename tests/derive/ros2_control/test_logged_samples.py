"""The exported controller on logged samples: Controller.step's commands, nothing allocated."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rpctl
from rpctl import Controller, PaperDynamic, ReducedDynamics, Robot, UnifiedKinematic
from rpctl.arrays import Array
from rpctl.control.bandwidth import knowing_delay
from rpctl.control.safeguards import Guards
from rpctl.derive.law_program import law_program, law_sheet
from rpctl.derive.ros2_control import expected_commands, export_ros2_control, numbers_of
from tests.control.simulated import Simulated
from tests.control.test_estimation import Late
from tests.derive.ros2_control.builds import FAST, PLAIN, SANITIZED, Driven, driven
from tests.grids import cells

COUNT = 100_000
SHORT = 1_000
BINARY = 2.0**-9  # s, a period whose multiples and their differences are exact, in nanoseconds, too
DELAY = 25 * BINARY
PERIOD = 0.002
EXACT = 1e-12  # relative to the largest entry
LAW = UnifiedKinematic(approach=None)  # the package has no stage for far starts
STARTS = (0.05, -0.05, 0.1)


Measured = Callable[[float, Array, Array], tuple[float, Array, Array]]


class Told(NamedTuple):
    """What controllers are told of a robot, and how it is measured."""

    delay: float
    rates: str | None
    measure: Measured = lambda t, q, nu: (t, q, nu)
    period: float = BINARY  # s
    effort_rate: float | None = None  # 1/s


class Logged(NamedTuple):
    """Samples as the driver reads them, and the commands that belong to them."""

    lines: Path
    commands: Array  # (K, n_act)


def logged(robot: Robot, output: str, folder: Path, count: int) -> Logged:
    """Return a run round and round the eight, and what Controller.step sends at its samples.

    Speeds that limits bind are left out: Controller bounds accelerations too.
    """
    laws = {"kinematic": LAW, "dynamic": PaperDynamic()}
    given = {"duration": count * PERIOD, "initial_error": STARTS, "log_every": 1}
    run = rpctl.track(robot, "eight", **laws, **given)  # type: ignore[arg-type]
    controller = Controller(
        robot, "eight", kinematic=LAW, dynamic=PaperDynamic(), period=PERIOD, output=output
    )
    dynamics = ReducedDynamics(robot)
    made = law_program(law_sheet(robot, LAW, PaperDynamic(), PERIOD))
    commands, path = [], folder / "samples.txt"
    with path.open("w") as file:
        for t, q, nu in zip(run.t.tolist(), run.q, run.nu, strict=True):
            sent = controller.step(t, q, nu)
            assert sent.status == "ok"
            if output == "velocity" and sent.limits:
                continue
            numbers = numbers_of(dynamics, made, q, nu, controller.reference(t))
            file.write(" ".join(map(repr, [t, *numbers.tolist()])) + "\n")
            if output == "velocity":
                commands.append(dynamics.actuation(q).T @ sent.speeds)
            else:
                commands.append(expected_commands(dynamics, PERIOD, output, q, sent))
    return Logged(path, np.array(commands))


BIT12 = 2.0 * np.pi / 4096  # rad


class Counted:
    """Measures joints by encoders: places in steps, and rates by differences of them."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._last = robot, np.full(len(robot.joints), np.nan)

    def __call__(self, t: float, q: Array, nu: Array) -> tuple[float, Array, Array]:
        robot, q, nu = self._robot, q.copy(), nu.copy()
        at = BIT12 * np.round(robot.joint_positions(q) / BIT12)
        for joint, position in zip(robot.joint_names, at, strict=True):
            robot.set_joint(q, joint, position)
        nu[robot.dof - len(at) :] = np.nan_to_num(at - self._last) / BINARY
        self._last = at
        return t, q, nu


def failing(t: float, q: Array, nu: Array) -> tuple[float, Array, Array]:
    """Lack the base's rates for a while, then a joint's."""
    nu = nu.copy()
    nu[:2] = np.nan if 0.2 < t < 0.4 else nu[:2]
    nu[-1] = np.nan if 0.3 < t < 0.6 else nu[-1]
    return t, q, nu


def hidden(t: float, q: Array, nu: Array) -> tuple[float, Array, Array]:
    return t, q, np.full_like(nu, np.nan)


def driven_along(
    controller: Driven, samples: Logged, *parameters: str
) -> tuple[Array, list[float]]:
    """Return what an exported controller with parameters sends at samples, and its costs."""
    count = len(samples.commands)
    words = [f"start {controller.name} 500", *(f"parameter {each}" for each in parameters)]
    before = "\n".join([*words, "chained 1", "configure", "activate", f"samples {count}"])
    with tempfile.TemporaryFile("w+") as given:
        given.write(f"{before}\n{samples.lines.read_text()}costs\n")
        given.seek(0)
        done = subprocess.run([controller.program], stdin=given, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *rows, costs = done.stdout.splitlines()[3:]
    found = np.array([row.split() for row in rows], dtype=float)
    assert found[:, 0].all()
    return found[:, 1:], [float(word) for word in costs.split()]


def closed_loop(robot: Robot, folder: Path, count: int, told: Told) -> Logged:
    """Return samples of a robot whose efforts arrive as late as told, and what it is sent.

    A package that estimates all rates reads none of them.
    """
    laws, lines = (LAW, PaperDynamic()), list[str]()
    controller = Controller(
        robot, "eight", kinematic=LAW, dynamic=PaperDynamic(), period=told.period,
        rates=told.rates, delay=told.delay, guards=Guards(effort_rate=told.effort_rate),
    )  # fmt: skip
    law, dynamic = (knowing_delay(each, told.period, told.delay) for each in laws)
    made = law_program(law_sheet(robot, law, dynamic, told.period))
    dynamics, loop = ReducedDynamics(robot), Simulated(controller, STARTS)
    rated, n, m = told.rates != "estimated", len(made.positions), len(robot.actuators)

    def measure(t: float, q: Array, nu: Array) -> tuple[float, Array, Array]:
        t, q, nu = told.measure(t, q, nu)
        state = controller.reference(t + told.delay)
        numbers = numbers_of(dynamics, made, q, np.nan_to_num(nu), state)
        place, rates, reference = np.split(numbers, [3 + n, 3 + n + m])
        base = robot.dof - len(robot.joints)
        missing = [np.isnan(nu[:base]).any()] * (m - len(robot.joints)), np.isnan(nu[base:])
        rates[np.concatenate(missing)] = np.nan
        row = [t, *place, *(rates if rated else ()), *reference]
        lines.append(" ".join(repr(float(number)) for number in row) + "\n")
        return t, q, nu

    arriving = Late(round(told.delay / told.period), np.zeros(m))
    loop.run(count * told.period, measure, lambda: told.period, arriving)
    assert {output.status for output in loop.outputs} == {"ok"}
    assert bool(controller.report()["estimated"]) == (told.rates != "measured")
    commands = np.array([output.efforts for output in loop.outputs])
    assert (np.abs(commands) < robot.effort_limits).all()  # what is sent is what was asked for
    if told.effort_rate is not None:
        most = told.effort_rate * told.period
        changes = np.abs(np.diff(commands, axis=0, prepend=0.0) / robot.effort_limits)
        assert changes[0].max() == pytest.approx(most)
        assert changes.max() == pytest.approx(most)
    path = folder / "samples.txt"
    path.write_text("".join(lines))
    return Logged(path, commands)


def compared(controller: Driven, samples: Logged, *parameters: str) -> list[float]:
    """Drive a package along samples: it sends what was sent. Return what an update takes."""
    found, costs = driven_along(controller, samples, *parameters)
    largest = np.abs(samples.commands).max()
    assert np.abs(found - samples.commands).max() <= EXACT * largest
    return costs


def say(what: str, costs: list[float]) -> None:
    """Print what an update takes; it allocates nothing."""
    *nanoseconds, allocations = costs
    assert allocations == 0
    times = ", ".join(f"{each / 1e3:.2f}" for each in nanoseconds)
    print(f"{what}: update() takes {times} µs at 50, 99, 99.9, 100 %")


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    for big in tmp_path.glob("*.txt"):
        big.unlink()


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("name", "output", "count"),
    cells(
        [
            ("paper", "effort", SHORT),
            ("paper", "effort", COUNT),
            ("tiago", "effort", COUNT),
            ("mecanum", "effort", COUNT),
            ("mecanum", "velocity", COUNT),
            ("car", "effort", COUNT),
            ("bicycle", "velocity", COUNT),  # no joint of an arm
        ],
        slow=[("paper", "effort", SHORT)],
    ),
)
def test_it_sends_what_the_controller_sends(
    name: str, output: str, count: int, folder: Path
) -> None:
    robot = rpctl.load(name)
    package = folder / "package"
    export_ros2_control(robot, package, LAW, period=PERIOD, output=output)
    samples = logged(robot, output, folder, count)
    assert len(samples.commands) > 0.9 * count
    for flags in [FAST] if count == SHORT else [SANITIZED, FAST]:
        costs = compared(driven(robot, package, flags, "driver", PERIOD), samples)
    say(f"{name} {output}", costs)


KINDS = {
    "late": Told(DELAY, "measured"),
    "unrated": Told(0.0, "estimated", hidden),
    "slow-and-late": Told(DELAY, "measured", period=8 * BINARY),
    "late-and-unrated": Told(DELAY, "estimated", hidden),
    "failing": Told(0.0, None, failing),
    "counted": Told(0.0, None),
    "gentle": Told(0.0, "measured", effort_rate=1.0),
}


TOLD_IN_CI = [
    ("paper", "slow-and-late", SHORT),
    ("paper", "unrated", SHORT),
    ("car", "late-and-unrated", SHORT),
    ("paper", "failing", SHORT),
    ("paper", "counted", SHORT),
    ("paper", "gentle", SHORT),
]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Driven]:
    """Return packages as programs; what a parameter tells is no other package."""

    @cache
    def build(name: str, period: float, delay: float, plain: bool) -> Driven:
        robot, package = rpctl.load(name), tmp_path_factory.mktemp("ros") / "package"
        export_ros2_control(robot, package, LAW, period=period, delay=delay)
        return driven(robot, package, PLAIN if plain else SANITIZED, "driver", period)

    return build


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("name", "kind", "count"),
    cells(
        [
            *TOLD_IN_CI,
            ("paper", "late", SHORT),
            ("tiago", "late", COUNT),
            ("tiago", "late-and-unrated", COUNT),
            ("mecanum", "late-and-unrated", COUNT),
        ],
        slow=TOLD_IN_CI,
    ),
)
def test_it_knows_lateness_and_rates_as_the_controller(
    name: str, kind: str, count: int, folder: Path, built: Callable[..., Driven]
) -> None:
    robot, told = rpctl.load(name), KINDS[kind]
    if kind == "counted":
        told = told._replace(measure=Counted(robot))
    samples = closed_loop(robot, folder, count, told)
    parameters = [f"rates = {told.rates or 'automatic'}"]
    if told.effort_rate is not None:
        parameters.append(f"effort_rate {told.effort_rate}")
    for plain in [True] if count == SHORT else [False, True]:
        controller = built(name, told.period, told.delay, plain)
        costs = compared(controller, samples, *parameters)
    say(f"{name}, {kind}", costs)
