"""The exported controller on 10⁵ logged samples: Controller.step's commands, nothing allocated."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rpctl
from rpctl import Controller, PaperDynamic, ReducedDynamics, Robot, UnifiedKinematic
from rpctl.arrays import Array
from rpctl.derive.law_program import law_program, law_sheet
from rpctl.derive.ros2_control import expected_commands, export_ros2_control, numbers_of
from tests.derive.ros2_control.builds import FAST, SANITIZED, Driven, driven

COUNT = 100_000
PERIOD = 0.002
EXACT = 1e-12  # relative to the largest entry
LAW = UnifiedKinematic(approach=None)  # the package has no stage for far starts
STARTS = (0.05, -0.05, 0.1)


class Logged(NamedTuple):
    """Samples as the driver reads them, and the commands that belong to them."""

    lines: Path
    commands: Array  # (K, n_act)


def logged(robot: Robot, output: str, folder: Path) -> Logged:
    """Return a run round and round the eight, and what Controller.step sends at its samples.

    Speeds that limits bind are left out: Controller bounds accelerations too.
    """
    laws = {"kinematic": LAW, "dynamic": PaperDynamic()}
    given = {"duration": COUNT * PERIOD, "initial_error": STARTS, "log_every": 1}
    run = rpctl.track(robot, "eight", **laws, **given)  # type: ignore[arg-type]
    controller = Controller(robot, "eight", LAW, PaperDynamic(), PERIOD, output)
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


def driven_along(controller: Driven, samples: Logged) -> tuple[Array, list[float]]:
    """Return what an exported controller sends at samples, and its costs."""
    count = len(samples.commands)
    words = [f"start {controller.name} 500", "chained 1", "configure", "activate"]
    before = "\n".join([*words, f"samples {count}"])
    with tempfile.TemporaryFile("w+") as given:
        given.write(f"{before}\n{samples.lines.read_text()}costs\n")
        given.seek(0)
        done = subprocess.run([controller.program], stdin=given, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *rows, costs = done.stdout.splitlines()[3:]
    found = np.array([row.split() for row in rows], dtype=float)
    assert found[:, 0].all()
    return found[:, 1:], [float(word) for word in costs.split()]


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    for big in tmp_path.glob("*.txt"):
        big.unlink()


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("name", "output"),
    [
        pytest.param("paper", "effort", marks=pytest.mark.slow),
        pytest.param("tiago", "effort", marks=pytest.mark.thorough),
        pytest.param("mecanum", "effort", marks=pytest.mark.thorough),
        pytest.param("mecanum", "velocity", marks=pytest.mark.thorough),
        pytest.param("car", "effort", marks=pytest.mark.thorough),
        pytest.param("bicycle", "velocity", marks=pytest.mark.thorough),  # no joint of an arm
    ],
)
def test_it_sends_what_the_controller_sends(name: str, output: str, folder: Path) -> None:
    robot = rpctl.load(name)
    package = folder / "package"
    export_ros2_control(robot, package, LAW, period=PERIOD, output=output)
    samples = logged(robot, output, folder)
    assert len(samples.commands) > 0.9 * COUNT
    largest = np.abs(samples.commands).max()
    for flags in (SANITIZED, FAST):
        controller = driven(robot, package, flags, "driver", PERIOD)
        found, costs = driven_along(controller, samples)
        assert np.abs(found - samples.commands).max() <= EXACT * largest
    *nanoseconds, allocations = costs
    assert allocations == 0
    times = ", ".join(f"{each / 1e3:.2f}" for each in nanoseconds)
    print(f"{name} {output}: update() takes {times} µs at 50, 99, 99.9, 100 %")
