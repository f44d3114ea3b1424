"""Lag and dead time from logs: found where they can be, refused where they cannot."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from rpctl import Robot, RpctlError, SpeedLog, VelocityOutput, lag_from, track
from rpctl.arrays import Array
from rpctl.cli.app import app
from rpctl.errors import DescriptionError, UnknownNameError
from rpctl.study.lag import response
from tests.grids import every

T: Array = np.linspace(0.0, 3.98, 200)
STEP: Array = np.where((T > 0.5) & (T < 2.5), 0.4, 0.0)


def answer(t: Array, command: Array, lag: float, dead_time: float) -> Array:
    """Return ν (K,) from rest, sample by sample in closed form: another way than the package's."""
    nu, found = 0.0, [0.0]
    for start, end in pairwise(t):
        now = start
        while now < end - 1e-12:
            changes = t + dead_time
            later = changes[changes > now + 1e-12]
            stop = min(end, later[0]) if len(later) else end
            index = int(np.searchsorted(changes, now + 1e-12, side="right")) - 1
            c = command[index] if index >= 0 else 0.0
            nu = c + (nu - c) * np.exp(-(stop - now) / lag) if lag else c
            now = stop
        found.append(nu)
    return np.array(found)


def test_the_model_is_the_differential_equation() -> None:
    """Against an integrator, where the command is smooth enough for one; and in closed form."""
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.01, 0.03, 60))
    command = rng.normal(size=60)
    found = response(t, command[:, None], np.zeros(1), 0.07, 0.043)[:, 0]
    np.testing.assert_allclose(found[1:], answer(t, command, 0.07, 0.043)[1:], atol=1e-12)
    ramp = np.arange(0.0, 1.0, 0.001)
    smooth = response(ramp, np.sin(3.0 * ramp)[:, None], np.zeros(1), 0.1, 0.0)[:, 0]
    exact = solve_ivp(
        lambda t, x: (np.sin(3.0 * t) - x) / 0.1, (0.0, 0.999), [0.0], t_eval=ramp, rtol=1e-9
    )
    np.testing.assert_allclose(smooth, exact.y[0], atol=2e-3)


@pytest.mark.parametrize("lag, dead_time", every(3, [(0.1, 0.053), (0.3, 0.0), (0.03, 0.2)]))
def test_a_step_tells_both(lag: float, dead_time: float) -> None:
    found = lag_from(SpeedLog(T, STEP, answer(T, STEP, lag, dead_time)))
    assert found.lag == pytest.approx(lag, abs=1e-6)
    assert found.dead_time == pytest.approx(dead_time, abs=1e-6)
    assert found.residual < 1e-6
    assert found.output() == VelocityOutput(found.lag, found.dead_time)
    assert found.channel("channel 1").lag == found.lag


def test_noise_and_odd_times_cost_little() -> None:
    rng = np.random.default_rng(5)
    t: Array = T + rng.uniform(-0.006, 0.006, len(T))
    noisy = answer(t, STEP, 0.12, 0.07) + 0.005 * rng.normal(size=len(T))
    found = lag_from(SpeedLog(t, STEP, noisy, names=("v",)))
    assert found.lag == pytest.approx(0.12, abs=0.01)
    assert found.dead_time == pytest.approx(0.07, abs=0.01)
    assert found.channel("v").residual == pytest.approx(0.005, rel=0.2)


def test_channels_stand_beside_one_another() -> None:
    rng = np.random.default_rng(7)
    turning = np.repeat(rng.choice([-0.5, 0.5], 20), 10)
    commands = np.column_stack([STEP, turning, np.zeros(200)])
    answers = np.column_stack(
        [answer(T, STEP, 0.1, 0.05), answer(T, turning, 0.2, 0.05), 0.001 * rng.normal(size=200)]
    )
    found = lag_from(SpeedLog(T, commands, answers, names=("v", "omega", "lift")))
    assert [each.name for each in found.channels] == ["v", "omega"]
    assert found.channel("v").lag == pytest.approx(0.1, abs=1e-5)
    assert found.channel("omega").lag == pytest.approx(0.2, abs=1e-5)
    assert 0.1 < found.lag < 0.2
    assert found.left_out == {
        "lift": "its command does not change; send a step, such as from rest to half of its speed"
    }
    with pytest.raises(UnknownNameError, match="did you mean omega"):
        found.channel("omga")


def with_noise(command: Array) -> Array:
    return answer(T, command, 0.1, 0.05) + 0.01 * np.random.default_rng(1).normal(size=len(T))


@pytest.mark.parametrize(
    "command, measured, reason",
    [
        (0.0 * T, lambda c: c, "its command does not change"),
        (STEP, lambda c: 0.0 * c, "it does not move when commanded"),
        (0.05 * T, with_noise, "changes too slowly to tell a lag from a dead time"),
        (STEP, lambda c: -c, "does not follow its command as a lag of first order"),
        (STEP, lambda c: np.roll(c, 42), "dead time is longer than the 0.8 s"),
    ],
)
def test_a_log_that_tells_nothing_is_refused(
    command: Array, measured: Callable[[Array], Array], reason: str
) -> None:
    with pytest.raises(RpctlError, match=reason):
        lag_from(SpeedLog(T, command, measured(command)), max_dead_time=0.8)


@pytest.mark.slow
def test_of_a_long_log_the_exciting_part_counts() -> None:
    t: Array = np.linspace(0.0, 17.998, 9000)
    command = np.where((t > 15.0) & (t < 16.0), 0.4, 0.0)
    measured = response(t, command[:, None], np.zeros(1), 0.1, 0.05)
    found = lag_from(SpeedLog(t, command, measured))
    assert found.lag == pytest.approx(0.1, abs=1e-4)
    assert found.dead_time == pytest.approx(0.05, abs=1e-4)


@pytest.mark.parametrize("kind", ["run", pytest.param("file", marks=pytest.mark.slow)])
def test_a_run_tells_its_plant(paper: Robot, tmp_path: Path, kind: str) -> None:
    output = VelocityOutput(0.12, 0.06)
    run = track(
        paper,
        "eight",
        duration=1.6,
        initial_error=(0.2, 0.1, 0.3),
        output=output,
        control_period=0.02,
        collisions=False,
    )
    files = run.save(tmp_path / "run.npz"), run.to_csv(tmp_path / "run.csv")
    for log in (run,) if kind == "run" else files:
        found = lag_from(log)
        assert found.channel("v").lag == pytest.approx(0.12, abs=1e-6)
        assert found.channel("omega").dead_time == pytest.approx(0.06, abs=1e-6)
    efforts = track(paper, "eight", duration=0.1, collisions=False)
    assert efforts.log.nu_cmd.shape == (len(efforts.t), 0)
    with pytest.raises(RpctlError, match="its output was efforts; track with --output velocity"):
        lag_from(efforts)


@pytest.mark.slow
def test_the_command_line_prints_what_to_set(tmp_path: Path) -> None:
    path, rows = tmp_path / "step.csv", np.column_stack([T, STEP, answer(T, STEP, 0.1, 0.05)])
    head = "t,v_commanded,v_measured\n"
    path.write_text(head + "\n".join(",".join(map(repr, row)) for row in rows.tolist()))
    said = CliRunner().invoke(app, ["lag", str(path)])
    assert said.exit_code == 0, said.output
    assert "--output velocity --actuator-lag 0.1 --dead-time 0.05" in said.output
    found: dict[str, Any] = json.loads(CliRunner().invoke(app, ["lag", str(path), "--json"]).stdout)
    assert found["channels"][0]["name"] == "v"
    assert found["lag"] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    "text, fault",
    [
        ("", "empty; give a header such as t,commanded,measured"),
        ("a,commanded,measured\n", ":1: error: no column t"),
        ("t,commanded,v\n", ":1: error: no commanded speed has a measured one beside it"),
        ("t,commanded,measured\n0,1\n", ":2: error: 2 entries, but the header has 3"),
        ("t,commanded,measured\n0,x,1\n", ':2: error: commanded "x" is not a number'),
        ("t,commanded,measured\n0,1,nan\n", ':2: error: measured "nan" is not finite'),
        ("t;commanded;measured\n", "separated by semicolons"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(tmp_path: Path, text: str, fault: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(DescriptionError) as caught:
        lag_from(path)
    assert fault in str(caught.value)


@pytest.mark.parametrize(
    "t, commanded, measured, fault",
    [
        (T, STEP, STEP[:-1], "give as many commanded and measured speeds as times"),
        (T[:5], STEP[:5], STEP[:5], "5 samples; give 10 or more"),
        (T[::-1], STEP, STEP, "times do not increase"),
        (T, STEP, STEP * np.nan, "numbers that are not finite"),
        (
            T,
            np.column_stack([STEP, STEP]),
            STEP[:, None],
            "2 channels are commanded and 1 measured",
        ),
    ],
)
def test_arrays_that_are_no_log_are_refused(
    t: Array, commanded: Array, measured: Array, fault: str
) -> None:
    with pytest.raises(RpctlError, match=fault):
        SpeedLog(t, commanded, measured)


@pytest.mark.parametrize(
    ("step", "told"), [(1e6, "every 1e\\+06 s is too coarse"), (1e-9, "lasts 1.99e-07 s")]
)
def test_absurd_steps_are_no_log(step: float, told: str) -> None:
    t, speed = step * np.arange(200.0), np.sin(np.arange(200.0))
    with pytest.raises(RpctlError, match=told):
        SpeedLog(t, speed, speed)
