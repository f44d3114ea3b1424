"""What a table asks beyond its robot's limits, and where: planted, and found there alone."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, set_limits
from rpctl.arrays import Array
from rpctl.reference.fitting import effort_usage, sample
from rpctl.reference.load import load_reference
from rpctl.reference.recorded.recording import RecordedPath, Recording
from rpctl.robot.losses import Losses
from tests.reference.test_noisy_tables import soft

FIRST = 4  # line of the first row: comments and the header stand above


def recording_of(robot: Robot, path: Path, columns: str, *values: Array) -> Recording:
    """Return what is told of a table, whose times are the first values."""
    head = f"# recorded\n\n{columns}"
    rows = np.column_stack(values)
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.12g")
    found = load_reference(robot, str(path))
    assert isinstance(found, RecordedPath)
    assert found.recording is not None
    return found.recording


def line(t: Array, share: float, distance: float) -> Array:
    """Return x (K,) of a base that goes a distance in the given share of the time, its middle."""
    return distance * soft((t / t[-1] - 0.5) / share + 0.5)


TIMES = np.linspace(0.0, 10.0, 201)


def test_a_speed_beyond_the_wheels_is_told_by_row(paper: Robot, tmp_path: Path) -> None:
    """The largest slope of the polynomial is 35/16 of the mean: 3 m in 2.5 s are 2.625 m/s."""
    robot = set_limits(paper, {"*": 1e9})
    x = line(TIMES, 0.25, 3.0)
    found = recording_of(robot, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    assert [each.joint for each in found.demands] == ["wheel_left_joint", "wheel_right_joint"]
    for each in found.demands:
        assert (each.quantity, each.unit, each.limit) == ("velocity", "rad/s", 12.0)
        assert each.value == pytest.approx(35.0 / 16.0 * 3.0 / 2.5 / 0.15, rel=1e-4)
        assert each.ratio == pytest.approx(each.value / 12.0)
        assert each.time == pytest.approx(5.0, abs=0.02)
        assert each.line in (FIRST + 99, FIRST + 100)
        (beyond,) = each.stretches
        speed = np.gradient(x, TIMES)
        rows = np.flatnonzero(speed > 1.8)
        assert beyond.start == pytest.approx(TIMES[rows[0]], abs=0.06)
        assert beyond.end == pytest.approx(TIMES[rows[-1]], abs=0.06)
        assert abs(beyond.first_line - FIRST - rows[0]) <= 1
        assert abs(beyond.last_line - FIRST - rows[-1]) <= 1


def test_an_effort_is_that_of_the_inverse_dynamics(paper: Robot, tmp_path: Path) -> None:
    """On a line two wheels share M ẍ: τ = M r ẍ/2."""
    weak = set_limits(paper, {"wheel_right_joint": 0.5})
    x = line(TIMES, 1.0, 4.0)
    found = recording_of(weak, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    home = weak.configuration(joints=dict(zip(weak.joint_names, weak.home, strict=True)))
    mass = ReducedDynamics(weak).inertia(home)[0, 0]
    (demand,) = [each for each in found.demands if each.quantity == "effort"]
    bend = np.abs(np.diff(soft(np.linspace(0.0, 1.0, 100001)), 2)).max() * 1e10
    assert demand.joint == "wheel_right_joint"
    assert abs(demand.value) == pytest.approx(0.5 * mass * 0.15 * 4.0 * bend / 100.0, rel=1e-2)
    assert len(demand.stretches) == 2  # it speeds up, and it brakes
    assert "in 2 stretches" in demand.sentence
    assert f"(line {demand.line})" in demand.sentence


def test_within_the_limits_nothing_is_told(paper: Robot, tmp_path: Path) -> None:
    x = line(TIMES, 1.0, 2.0)
    found = recording_of(paper, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    assert (found.demands, found.jumps, found.changes, found.warnings) == ((), (), (), ())


def test_a_jump_is_told_by_its_row(paper: Robot, tmp_path: Path) -> None:
    x = line(TIMES, 1.0, 2.0)
    x[120:] += 0.4
    found = recording_of(paper, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    (jump,) = found.jumps
    assert (jump.columns, jump.line, jump.unit) == ("x, y move", FIRST + 120, "m/s")
    assert jump.time == pytest.approx(6.0)
    assert jump.speed == pytest.approx((x[120] - x[119]) / 0.05)
    assert jump.pace == pytest.approx(np.diff(x)[130] / 0.05, rel=0.3)
    assert found.warnings[0] == jump.sentence
    assert f"line {FIRST + 120}: x, y move at" in jump.sentence


def test_json_says_all_of_it(paper: Robot, tmp_path: Path) -> None:
    x = line(TIMES, 0.25, 3.0)
    x[20:] += 0.4
    found = recording_of(paper, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    told = json.loads(json.dumps(found.to_dict()))
    assert told["smooth"] is None
    assert told["retimed"] is None
    assert told["smoothed"] == []
    assert [each["joint"] for each in told["demands"]] == [each.joint for each in found.demands]
    first = told["demands"][0]
    assert first["ratio"] == pytest.approx(found.demands[0].ratio)
    assert first["stretches"][0]["first_line"] == found.demands[0].stretches[0].first_line
    assert told["jumps"][0]["line"] == FIRST + 20
    assert math.isfinite(told["jumps"][0]["speed"])
    assert told["sentence"] == "; ".join(found.warnings)


def test_dry_friction_takes_of_a_limit_and_not_of_a_motion(tmp_path: Path) -> None:
    """A limit of 30 N m of which friction takes 10: what motion alone takes is of 20."""
    robot = rpctl.load("paper")
    first = robot.model.getJointId("wheel_left_joint")
    entry = robot.model.joints[first].idx_v
    assert robot.losses is None
    bare = set_limits(robot, {"wheel_left_joint": 20.0})
    friction = np.zeros(robot.nv)
    friction[entry] = 10.0
    losses = Losses(np.zeros(robot.nv), friction, np.full(robot.nv, 1e-6))
    dry = replace(set_limits(robot, {"wheel_left_joint": 30.0}), losses=losses)
    shares = []
    for each in (bare, dry):
        dynamics = ReducedDynamics(each)
        samples = sample(each, load_reference(each, "circle"), np.linspace(1.0, 5.0, 9))
        usages = effort_usage(dynamics, samples, np.zeros(len(each.actuators)))
        shares.append(next(u.ratio for u in usages if u.joint == "wheel_left_joint"))
    assert shares[0] == pytest.approx(shares[1], rel=1e-6)
    assert shares[0] > 0.01
