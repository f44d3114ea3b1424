"""What the links of a moving robot ran into, against all distances at all samples."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Disc, HalfPlane, Robot, Run
from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.pose_goal import goal_of_words
from rpctl.robot.collision import Distances
from rpctl.robot.pair_motion import approach_rates, ball_gaps, joint_motion, joint_travel
from rpctl.simulation.merits.collision_facts import GROUND, SELF
from rpctl.simulation.merits.collisions import (
    RESOLUTION_M,
    Surroundings,
    find_collisions,
    require_clear_start,
    surroundings,
)
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle
from tests import urdf
from tests.folding import folding

GJK_M = 1e-5  # m: what coal's iterations leave
EPA_M = 3e-4  # m: likewise, where shapes are in each other
LIGHT = urdf.inertial(0.2, (1e-3, 1e-3, 1e-3))
PILLAR, WALL = Disc(0.8, 0.3, 0.1), HalfPlane(-1.0, 0.0, -1.2)
OBSTACLES = (AvoidedObstacle(BASE, PILLAR, 0.3), AvoidedObstacle(TIP, WALL, 0.05))


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    slide = urdf.limit(0.0, 0.3, 30, 1)
    hand = [
        urdf.link(
            "hand", urdf.inertial(0.2, (1e-3, 1e-3, 1e-3)), urdf.shape('box size="0.1 0.2 0.1"')
        ),
        urdf.joint("slide", "prismatic", ("forearm", "hand"), (0.45, 0, 0), "1 0 0", slide),
    ]
    return folding(tmp_path_factory.mktemp("folding"), *hand)


def motion(robot: Robot, seed: int, count: int = 600, pace: float = 1.0) -> tuple[Array, Array]:
    """Return a smooth motion all over the joints' ranges, base and wheels too."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 6.0, count)
    names = robot.moving_joint_names
    waves = rng.uniform(0.7, 1.2, (len(names) + 3, 2)) * (1.0, pace)
    ways = [a * np.sin(b * t + c) for (a, b), c in zip(waves, rng.uniform(0, 6, 99), strict=False)]
    q = []
    for k in range(count):
        joints = {n: 2.5 * ways[3 + i][k] for i, n in enumerate(names)}
        joints["slide"] = abs(joints["slide"]) / 10.0
        q.append(robot.configuration(ways[0][k], 0.5 * ways[1][k], ways[2][k], joints=joints))
    return t, np.array(q)


def every_distance(around: Surroundings, q: Array) -> Array:
    """Return the distance of each pair at each sample (K, n), m."""
    distances, pairs = around.model.distances(), range(len(around.thing))
    found = np.empty((len(q), len(pairs)))
    for row, each in zip(found, q, strict=True):
        distances.place(each)
        row[:] = [distances.distance(pair) for pair in pairs]
    return found


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_is_missed(robot: Robot, seed: int) -> None:
    """Least distances, collisions and series are those of all pairs at all samples."""
    around, (t, q) = surroundings(robot, OBSTACLES), motion(robot, seed)
    every, found = every_distance(around, q), find_collisions(around, t, q)
    names = [shape.link for shape in around.model.shapes]
    assert [each.to for each in found.clearances] == list(around.things)
    for thing, clearance in enumerate(found.clearances):
        ours = every[:, around.thing == thing]
        assert clearance.distance == pytest.approx(ours.min(), abs=EPA_M)
        k = int(np.argmin(np.abs(t - clearance.time)))
        assert ours[k].min() == pytest.approx(clearance.distance, abs=EPA_M)
        shown = np.searchsorted(t, found.times)
        np.testing.assert_allclose(found.series[thing], ours[shown].min(axis=1), atol=EPA_M)
    told = {(each.to, each.link, each.other): each for each in found.collisions}
    deep = np.flatnonzero(every.min(axis=0) < -1e-3 - EPA_M)
    assert len(deep) > 2  # or the motion shows nothing
    for pair in deep.tolist():
        first, second = around.model.pairs[pair]
        thing = around.things[around.thing[pair]]
        one = told[thing, names[first], names[second] if thing == SELF else ""]
        touches = every[:, pair] < -1e-3
        assert one.depth == pytest.approx(-every[:, pair].min(), abs=EPA_M)
        assert one.first_time >= t[np.argmax(touches)] - 1e-9
        assert one.first_time <= t[np.argmax(every[:, pair] < -1e-3 - EPA_M)]
        assert one.duration == pytest.approx(touches[:-1].sum() * (t[1] - t[0]), abs=0.03)
    assert len(told) <= (every.min(axis=0) < -1e-3).sum()
    depths = [each.depth for each in found.collisions]
    assert depths == sorted(depths, reverse=True)


@pytest.mark.parametrize("seed", range(4))
def test_clearances_are_the_least_of_all_samples(robot: Robot, seed: int) -> None:
    """Where nothing touches; the time is that of a sample at which the pair is so near."""
    around = surroundings(robot, OBSTACLES)
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 9.0, 900)
    middle = {"shoulder": 0.5, "elbow": -1.5, "slide": 0.1}
    sines = np.sin(rng.uniform(0.5, 4.0, (3, 1)) * t + rng.uniform(0.0, 6.0, (3, 1)))
    q = np.array(
        [
            robot.configuration(
                0.02 * row[0],
                0.0,
                0.05 * row[1],
                joints=dict(zip(middle, list(middle.values()) + 0.1 * row, strict=True)),
            )
            for row in sines.T
        ]
    )
    every, found = every_distance(around, q), find_collisions(around, t, q)
    assert every.min() > 0.0
    assert not found.collisions
    for thing, clearance in enumerate(found.clearances):
        ours = every[:, around.thing == thing].min(axis=1)
        assert clearance.distance == pytest.approx(ours.min(), abs=GJK_M)
        assert clearance.distance == pytest.approx(ours[int(np.argmin(abs(t - clearance.time)))])


def test_most_distances_need_not_be_computed(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    around, (t, q) = surroundings(robot, OBSTACLES), motion(robot, 1, 3000, 0.2)
    looks: list[int] = []
    distance = Distances.distance

    def counted(self: Distances, pair: int) -> float:
        looks.append(pair)
        return distance(self, pair)

    monkeypatch.setattr(Distances, "distance", counted)
    find_collisions(around, t, q)
    assert len(looks) < 0.1 * len(t) * len(around.thing)


def test_a_long_run_takes_a_bounded_time(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the budget the resolution doubles, and the facts say it."""
    monkeypatch.setattr("rpctl.simulation.merits.collisions.BUDGET", 500)
    around, (t, q) = surroundings(robot, OBSTACLES), motion(robot, 2)
    found = find_collisions(around, t, q)
    assert found.resolution >= 16.0 * RESOLUTION_M
    least = every_distance(around, q)[:, around.thing == 1].min()
    assert found.clearances[1].distance <= least + found.resolution + EPA_M


def test_no_pair_approaches_faster_than_its_bound(robot: Robot) -> None:
    around = surroundings(robot, OBSTACLES)
    worst = 0.0
    for seed in range(4):
        _, q = motion(robot, seed, 40, 8.0)
        rates = approach_rates(around.model, joint_travel(robot, q))
        bound = joint_motion(robot, q) @ rates.T
        change = np.abs(np.diff(every_distance(around, q), axis=0))
        outside = np.minimum(*[every_distance(around, q)[k : k + 39] for k in (0, 1)]) > 0.0
        assert (change <= bound + GJK_M)[outside].all()
        worst = max(worst, float((change / np.maximum(bound, 1e-9))[outside].max()))
    assert worst > 0.5  # the bound is near where it must be
    own = rates[around.thing == 0]
    assert not own[:, :2].any()  # how far links are from each other the base does not change
    assert not rates[around.thing == 1][:, :2].any()  # nor how far the ground is
    assert (rates[around.thing == 2][:, 0] == 1.0).all()


def test_no_pair_is_nearer_than_its_balls(robot: Robot) -> None:
    around, (_, q) = surroundings(robot, OBSTACLES), motion(robot, 5, 60)
    gaps, every = ball_gaps(around.model, q).T, every_distance(around, q)
    assert (gaps <= every + EPA_M).all()
    ground = gaps[:, around.thing == 1]  # a ball about a box touches the ground before its corner
    assert (every[:, around.thing == 1] - ground).min() < 0.02


def test_a_start_inside_an_obstacle_is_refused(robot: Robot) -> None:
    """The base is 0.5 m long: its front is at 0.25 m."""
    q = robot.configuration_at(np.zeros(3), robot.home)
    wall = AvoidedObstacle(BASE, HalfPlane(-1.0, 0.0, -0.24), 0.3)
    with pytest.raises(RpctlError, match="the robot starts inside an obstacle: ") as error:
        require_clear_start(surroundings(robot, (wall,)), q)
    assert "in the half-plane, free where x ≤ 0.24 m; start elsewhere (--initial-error)" in str(
        error.value
    )
    beside = AvoidedObstacle(BASE, Disc(-0.36, 0.0, 0.1), 0.3)
    require_clear_start(surroundings(robot, (beside,)), q)
    inside = AvoidedObstacle(BASE, Disc(-0.34, 0.0, 0.1), 0.3)
    with pytest.raises(RpctlError, match="base is 10 mm deep in the disc at"):
        require_clear_start(surroundings(robot, (inside,)), q)
    require_clear_start(surroundings(robot, ()), q)


def reach(robot: Robot, shoulder: float, elbow: float, duration: float = 2.0) -> Run:
    goal = goal_of_words(None, (f"shoulder={shoulder}", f"elbow={elbow}"))
    return rpctl.track(robot, goal, duration=duration, control_period=0.01, plant_step=0.01)


def test_an_arm_that_reaches_into_the_ground_collides(robot: Robot, tmp_path: Path) -> None:
    run = reach(robot, 0.6, 0.9)
    summary = rpctl.summarize(run)
    assert summary.outcome == "collided"
    assert not summary.succeeded
    first = summary.collisions[0]
    assert (first.to, first.other) == (GROUND, "")
    assert summary.outcome_sentence.startswith(f"{first.link} ran into the ground at ")
    back = Run.load(run.save(tmp_path / "run.npz"))
    assert back.collisions == run.collisions
    again = json.loads(json.dumps(rpctl.summarize(back).to_dict()))
    assert again["collisions"][0]["sentence"] == first.sentence
    assert again["clearances"][1]["to"] == GROUND
    assert again["outcome"] == "collided"


def test_facts_that_are_none_are_refused(robot: Robot) -> None:
    around, (t, q) = surroundings(robot, OBSTACLES), motion(robot, 1, 20)
    facts = find_collisions(around, t, q)
    for wrong in ({"times": facts.times[1:]}, {"series": facts.series[1:]}):
        with pytest.raises(RpctlError, match="one distance per time, for each thing"):
            dataclasses.replace(facts, **wrong)


def test_a_robot_without_an_arm_and_obstacles_is_not_looked_at() -> None:
    """There is nothing that it can run into."""
    assert rpctl.track(rpctl.load("bicycle"), "line", duration=0.02).collisions is None
