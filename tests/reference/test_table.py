"""A reference as a table: what it says one time after the other, row by row."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReferenceState, Robot
from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference import motion
from rpctl.reference.load import load_reference
from rpctl.reference.motion import (
    NotFiniteError,
    Reference,
    ReferenceTable,
    WrongAnswerError,
    row_reader,
    tabulate,
)
from rpctl.reference.named import reference_by_name
from rpctl.reference.path_reference import PathReference
from rpctl.reference.pose_goal import PoseGoal, to_goal
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle

TIMES = np.concatenate([[-0.1, 0.0], np.linspace(1e-3, 25.0, 83), [60.0]])  # s; also outside
ROUNDING = 1e-15  # of sines of arrays against those of numbers, relative


@pytest.fixture(scope="module")
def omni(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("omni") / "omni.urdf"
    path.write_text(vehicle("omni"))
    return rpctl.load(str(path))


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("car") / "car.urdf"
    path.write_text(vehicle("car-like"))
    return rpctl.load(str(path))


def check(robot: Robot, reference: Reference, monkeypatch: pytest.MonkeyPatch) -> ReferenceTable:
    """Compare a table with the calls one by one; it must not have been made by them."""
    one_by_one = [reference(t) for t in TIMES.tolist()]
    with monkeypatch.context() as patch:
        patch.setattr(motion, "require_state", None)  # a call of it fails
        found = tabulate(robot, reference, TIMES)
    for k, state in enumerate(one_by_one):
        for name, value in state._asdict().items():
            row = getattr(found.state, name)[k]
            scale = max(1.0, float(np.abs(value).max(initial=0.0)))
            np.testing.assert_allclose(row, value, rtol=0.0, atol=ROUNDING * scale, err_msg=name)
    read, rows = row_reader(robot, reference), found.rows
    assert np.array_equal([read(t).copy() for t in TIMES.tolist()], rows)
    assert (
        np.ptp(found.state.pose, axis=0).max() + np.ptp(found.state.joints, axis=0).max(initial=0.0)
        > 0.05
    )
    return found


@pytest.mark.parametrize("name", ["line", "reverse", "spin", "circle", "eight", "waypoints"])
def test_named_references(tiago: Robot, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    check(tiago, load_reference(tiago, name, collisions=False), monkeypatch)


def test_a_fixed_base(monkeypatch: pytest.MonkeyPatch, tiago: Robot) -> None:
    reference = reference_by_name(tiago, "eight", collisions=False)
    arm_only = PathReference(None, 0.0, reference.arm, reference.ramp)
    found = check(tiago, arm_only, monkeypatch)
    np.testing.assert_array_equal(found.rows[:, -9:], 0.0)  # it has no direction, and no twist


@pytest.mark.parametrize(
    ("which", "pose", "joints"),
    [
        ("tiago", (1.5, 0.5, 1.57), {"torso_lift_joint": 0.2}),  # turns, drives and turns
        ("tiago", (-1.0, 0.1, 0.3), {}),  # backwards
        ("tiago", None, {"torso_lift_joint": 0.2}),
        ("omni", (0.4, -0.7, 2.0), {}),
        ("car", (3.0, 1.0, 0.5), {}),
        ("car", (-3.0, 0.5, 0.2), {}),
    ],
)
def test_goals(
    which: str,
    pose: tuple[float, float, float] | None,
    joints: dict[str, float],
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = request.getfixturevalue(which)
    check(robot, to_goal(robot, PoseGoal(pose, joints), np.array([0.3, -0.2, 0.4])), monkeypatch)


@pytest.mark.parametrize(("heading", "retime"), [(True, False), (False, False), (True, True)])
def test_tables_of_rows(
    tiago: Robot, tmp_path: Path, heading: bool, retime: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    t = np.linspace(0.0, 8.0, 81)
    columns = [t, 0.8 * np.sin(0.5 * t), np.sin(0.9 * t) ** 2]  # it begins and ends in motion
    if heading:
        rate = 0.4 * np.cos(0.5 * t), 0.9 * np.sin(1.8 * t)
        columns.append(np.unwrap(np.arctan2(rate[1], rate[0])))
    head = "t,x,y,theta" if heading else "t,x,y"
    rows, path = np.column_stack(columns), tmp_path / "rows.csv"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.12g")
    check(tiago, load_reference(tiago, str(path), retime=retime), monkeypatch)


def turning(t: float) -> Array:
    """Return x, y, a heading that jumps by full turns, and a joint."""
    return np.array([math.sin(t), t, math.remainder(2.0 * t, 2.0 * math.pi), 0.1 * t * t])


@pytest.mark.parametrize("duration", [None, 10.0])
@pytest.mark.parametrize("along", [True, False])
def test_functions(
    paper: Robot, along: bool, duration: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def way(t: float) -> Array:
        return turning(t)[:2] if along else turning(t)[[0, 1, 2, 3, 3]]

    joints = [0.1, 0.4] if along else None
    reference = rpctl.as_reference(way, joints=joints, along_path=along, duration=duration)
    check(paper, reference, monkeypatch)


def plain(robot: Robot, given: list[float]) -> Callable[[float], ReferenceState]:
    """Return a function of the user's that keeps the times that it was called at."""
    n = len(robot.joints)

    def reference(t: float) -> ReferenceState:
        given.append(t)
        place = np.array([t, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.zeros(3)
        direction = np.eye(3) if t > 1.0 else None
        return ReferenceState(*place, np.full(n, t), np.ones(n), np.zeros(n), direction)

    return reference


def test_a_plain_function_is_called_at_each_time(paper: Robot) -> None:
    times = list[float]()
    found = tabulate(paper, plain(paper, times), np.array([0.5, 2.0]))
    assert times == [0.5, 2.0]
    np.testing.assert_array_equal(found.state.pose[:, 0], times)
    rows = found.rows
    assert rows.shape == (2, 9 + 3 * 2 + 9)
    # Without a direction, the twist stands for it.
    np.testing.assert_array_equal(rows[0], [0.5, 0, 0, 1, 0, 0, 0, 0, 0, 0.5, 0.5, 1, 1, 0, 0,
                                            1, 0, 0, 0, 0, 0, 0, 0, 0])  # fmt: skip
    np.testing.assert_array_equal(rows[1, -9:], np.eye(3).ravel())
    for each in (plain(paper, times), rpctl.as_reference(turning_with_two_joints)):
        assert len(tabulate(paper, each, np.empty(0))) == 0


def faults(robot: Robot) -> Iterator[tuple[Reference, type[RpctlError], str]]:
    state = plain(robot, [])

    def late(fault: Callable[[float], object]) -> Reference:
        return lambda t: state(t) if t < 2.0 else fault(t)  # type: ignore[return-value]

    yield late(lambda t: t), WrongAnswerError, "at t = 2 s"
    yield late(lambda t: state(t)._replace(joints=np.zeros(7))), WrongAnswerError, "has 7 joints"
    nan = np.array([0.0, np.nan, 0.0])
    yield late(lambda t: state(t)._replace(twist=nan)), NotFiniteError, "twist of the reference"


def test_faults_are_told_as_of_one_time(paper: Robot) -> None:
    for reference, kind, told in faults(paper):
        with pytest.raises(kind, match=told):
            tabulate(paper, reference, np.array([0.0, 1.0, 2.0, 3.0]))
        read = row_reader(paper, reference)
        assert read(1.0)[0] == 1.0
        with pytest.raises(kind, match=told):
            read(2.0)


def test_a_function_that_fails_is_told_with_its_time(paper: Robot) -> None:
    def stops(t: float) -> list[float]:
        return [min(t, 2.0), 0.0]

    def grows(t: float) -> list[float]:
        return [t, 0.0, 0.0] + [0.0] * (2 if t < 2.0 else 3)

    for reference, told in (
        (
            rpctl.as_reference(stops, joints=[0.0, 0.0], along_path=True),
            "stands still at t = 2.5 s",
        ),
        (rpctl.as_reference(grows), "a varying number of values"),
    ):
        with pytest.raises(RpctlError, match=told):
            tabulate(paper, reference, np.array([0.0, 1.0, 2.0, 2.5, 3.0]))


def test_the_end_effector(tiago: Robot, tmp_path: Path) -> None:
    found = tabulate(tiago, reference_by_name(tiago, "eight", collisions=False), TIMES[:20])
    data = tiago.model.createData()
    for pose, joints, place in zip(*found.state[:4:3], found.end_effector, strict=True):
        wanted = tiago.end_effector_pose(data, tiago.configuration_at(pose, joints)).translation
        np.testing.assert_allclose(place, wanted, rtol=0.0, atol=1e-14)
    bare = rpctl.load(write(tmp_path, platform(SET_A)))
    assert tabulate(bare, reference_by_name(bare, "circle"), TIMES[:2]).end_effector.shape == (2, 0)


def test_references_of_a_function_and_of_a_fixed_base_go_to_other_processes() -> None:
    panda = rpctl.load("panda")
    for robot, reference in (
        (panda, reference_by_name(panda, "eight", collisions=False)),
        (rpctl.load("paper"), rpctl.as_reference(turning_with_two_joints)),
    ):
        before = row_reader(robot, reference)(1.0)
        there = pickle.loads(pickle.dumps(reference))
        np.testing.assert_array_equal(row_reader(robot, there)(1.0), before)


def turning_with_two_joints(t: float) -> Array:
    return turning(t)[[0, 1, 2, 3, 3]]
