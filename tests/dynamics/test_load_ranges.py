"""Loads and grip over all splits: paper and pencil, linear programs, sampled splits, MuJoCo."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import rpctl
from rpctl import ReducedDynamics
from rpctl.arrays import Array
from rpctl.dynamics import grip
from rpctl.dynamics.grip import Ranges, find_ranges
from rpctl.dynamics.ground_reaction import (
    Contacts,
    GroundReaction,
    find_contacts,
    ground_reaction,
)
from tests.robots import SET_A, ball, cargo, platform, write

W, MU = 400.0, 0.5  # N, friction
SQUARE = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
TRIANGULAR = np.array([[-3.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.2, 0.0]])
CART = np.array([[0.0, 1.0], [0.0, -1.0], [2.0, 0.5], [2.0, -0.5]])  # two wheels, two balls
SOLVED = 1e-6  # of the load: HiGHS' tolerance of 1e-7, with some room


def contacts(count: int, axles: Sequence[Sequence[int]], wheels: int) -> Contacts:
    """Return so many contacts, the first of them wheels, as :func:`find_ranges` sees them."""
    found = find_contacts(ReducedDynamics(rpctl.load("paper")), MU)
    assert found is not None
    incidence = np.array([[float(w in axle) for axle in axles] for w in range(wheels)])
    names = tuple(map(str, range(count)))
    return dataclasses.replace(
        found, names=names, incidence=incidence.reshape(wheels, -1), floor=1e-3 * W, stance=None
    )


def reaction(
    points: Array, at: Sequence[float], along: Sequence[float] = (), lateral: Sequence[float] = ()
) -> GroundReaction:
    nothing = np.empty(0)
    return GroundReaction(
        force=np.array([0.0, 0.0, W]),
        longitudinal=np.array(along),
        lateral=np.array(lateral),
        load=nothing,
        zmp=nothing,
        arms=points - np.asarray(at),
        tip_margin=None,
        slip_ratio=nothing,
    )


def together(*reactions: GroundReaction) -> GroundReaction:
    """Return reactions as those of as many instants."""
    names = [item.name for item in dataclasses.fields(GroundReaction) if item.name != "tip_margin"]
    rows = {name: np.array([getattr(one, name) for one in reactions]) for name in names}
    return GroundReaction(tip_margin=None, **rows)


def ranges(
    points: Array,
    at: Sequence[float],
    along: Sequence[float] = (0.0,),
    lateral: Sequence[float] = (),
    axles: Sequence[Sequence[int]] = (),
) -> tuple[Array, Array]:
    """Return the loads' ranges over the load (n, 2), and the worst wheel's (2,)."""
    standing = contacts(len(points), axles, len(along))
    found = find_ranges(standing, together(reaction(points, at, along, lateral)))
    return found.load[0] / W, found.slip[0]


@pytest.mark.parametrize(
    ("points", "at", "expected"),
    [
        (SQUARE, (0.0, 0.0), [(0.0, 0.5)] * 4),
        # N1 + N2 = 3/4, N3 + N4 = 1/4, N1 + N3 = 1/2
        (SQUARE, (0.5, 0.0), [(0.25, 0.5), (0.25, 0.5), (0.0, 0.25), (0.0, 0.25)]),
        (SQUARE, (0.5, 0.5), [(0.5, 0.75), (0.0, 0.25), (0.0, 0.25), (0.0, 0.25)]),
        (SQUARE, (1.0, 0.5), [(0.75, 0.75), (0.25, 0.25), (0.0, 0.0), (0.0, 0.0)]),  # on an edge
        (SQUARE, (-1.0, 1.0), [(0.0, 0.0), (0.0, 0.0), (1.0, 1.0), (0.0, 0.0)]),  # over a leg
        (SQUARE[:3], (0.2, 0.1), [(0.15, 0.15), (0.45, 0.45), (0.4, 0.4)]),  # three: a number
        # the far one bears (3/2 + x)/(3 + x) where the others' middle is at x from 0 to 1/5
        (TRIANGULAR, (-1.5, 0.0), [(0.5, 0.53125), (0.0, 0.25), (0.0, 0.25), (0.0, 0.46875)]),
    ],
)
def test_loads_by_paper_and_pencil(
    points: Array, at: tuple[float, float], expected: list[tuple[float, float]]
) -> None:
    found, _ = ranges(points, at)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("rise", [0.0, 1e-17, 1e-6, 0.01])
def test_contacts_nearly_on_a_line(rise: float) -> None:
    """The second is hardly below the line of the first and third, and p hardly below as well."""
    points = np.array([[-1.0, 0.0], [0.0, -rise], [1.0, 0.0], [0.0, 1.0]])
    found, _ = ranges(points, (0.5, -0.25 * rise))
    last = 0.25 * rise / (1.0 + rise)  # on (1, 0) and (0, y): as much above as below
    middle = (0.25, 0.5 - last)
    first = (0.0, 0.125) if rise > 1e-12 else (0.0, 0.25)
    if rise <= 1e-12:  # on the line the second may bear nothing
        middle = (0.0, 0.5)
    third = 0.5 + first[1]
    np.testing.assert_allclose(found[:3], [first, middle, (0.5, third)], atol=1e-9)


def test_outside_the_polygon_there_is_no_split() -> None:
    for points in (SQUARE, SQUARE[:3], TRIANGULAR):
        found, slip = ranges(points, (1.001, 0.0))
        assert np.isnan(found).all()
        assert np.isnan(slip).all()


def test_where_the_ground_would_have_to_pull_there_is_no_split() -> None:
    falling = dataclasses.replace(reaction(SQUARE, (0.0, 0.0), (1.0,)), force=np.zeros(3))
    standing = reaction(SQUARE, (0.0, 0.0), (1.0,))
    found = find_ranges(contacts(4, (), 1), together(falling, standing, falling))
    np.testing.assert_array_equal(np.isnan(found.load).all(axis=(1, 2)), [True, False, True])
    np.testing.assert_array_equal(np.isnan(found.slip).all(axis=1), [True, False, True])
    assert not (found.load.flags.writeable or found.slip.flags.writeable)


def test_many_contacts_are_taken_instant_by_instant() -> None:
    """26 on a circle have more corners than a block holds; each may bear up to half, as two do."""
    turn = 2.0 * np.pi * np.arange(26) / 26
    points = np.column_stack([np.cos(turn), np.sin(turn)])
    assert 26 * len(list(combinations(range(26), 3))) > grip.BLOCK_LOADS
    found = find_ranges(contacts(26, (), 1), together(*[reaction(points, (0.0, 0.0), (0.0,))] * 2))
    np.testing.assert_allclose(found.load / W, np.broadcast_to([0.0, 0.5], (2, 26, 2)), atol=1e-12)


def test_a_crowd_and_wheels_alone_have_no_ranges() -> None:
    unbalanced = dataclasses.replace(contacts(4, (), 1), balanced=False)
    crowd = contacts(grip.MAX_CONTACTS + 1, (), 1)
    for standing in (unbalanced, crowd):
        found = find_ranges(standing, together(*[reaction(SQUARE, (0.0, 0.0), (1.0,))] * 3))
        assert found.load.shape == found.slip.shape == (3, 0)


def extremes(points: Array, at: Array, cost: Array) -> tuple[float, float]:
    """Return the least and the largest cost · N over all splits of a unit load, by HiGHS."""
    G, m = np.vstack([np.ones(len(points)), points.T]), np.array([1.0, *at])
    least, most = (linprog(sign * cost, A_eq=G, b_eq=m, method="highs") for sign in (1.0, -1.0))
    assert least.success
    assert most.success
    return float(least.fun), float(-most.fun)


def stances(rng: np.random.Generator, count: int) -> list[tuple[Array, Array]]:
    """Return contacts and zero-moment points within: scattered, and on a grid, often in lines."""
    found: list[tuple[Array, Array]] = []
    while len(found) < count:
        n = int(rng.integers(4, 9))
        points: Array = rng.normal(size=(n, 2))
        if len(found) % 2:
            points = 0.3 * rng.integers(-2, 3, size=(n, 2)).astype(np.float64)
        if np.linalg.matrix_rank(points - points.mean(axis=0)) == 2:
            found.append((points, rng.dirichlet(np.full(n, 0.5)) @ points))
    return found


def test_loads_agree_with_a_linear_program(rng: np.random.Generator) -> None:
    for points, at in stances(rng, 6):
        found, _ = ranges(points, at.tolist())
        solved = [extremes(points, at, row) for row in np.eye(len(points))]
        np.testing.assert_allclose(found, solved, atol=SOLVED, err_msg=f"{points} {at}")


def test_instants_do_not_mix(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    standing = contacts(6, ((0, 1),), 3)
    reactions = [
        reaction(points, at.tolist(), rng.normal(size=3).tolist(), (20.0,))
        for points, at in stances(rng, 200)
        if len(points) == 6
    ]
    at_once = find_ranges(standing, together(*reactions))
    alone = [find_ranges(standing, together(one)) for one in reactions]
    monkeypatch.setattr(grip, "BLOCK_LOADS", 3 * 6 * 20)  # three instants at once
    apart = find_ranges(standing, together(*reactions))
    for name in ("load", "slip"):
        expected = np.concatenate([getattr(one, name) for one in alone])
        assert len(expected) == len(reactions) > 20
        np.testing.assert_array_equal(getattr(at_once, name), expected)
        np.testing.assert_array_equal(getattr(apart, name), expected)


def test_grip_of_a_table_by_paper_and_pencil() -> None:
    """Four pushing legs: each bears a quarter at best, and two of them nothing at worst."""
    _, slip = ranges(SQUARE, (0.0, 0.0), (10.0, -10.0, 10.0, 10.0))
    np.testing.assert_allclose(slip, [10.0 / (MU * W / 4), math.inf])
    # Forces like the loads of any one split all need the same: 40 N over the whole weight.
    _, slip = ranges(SQUARE, (0.5, 0.0), (17.0, 13.0, 3.0, 7.0))
    np.testing.assert_allclose(slip[0], 40.0 / (MU * W))
    # The far leg bears .5 to .53125 of the weight, and alone has to push.
    _, slip = ranges(TRIANGULAR, (-1.5, 0.0), (-10.0,))
    np.testing.assert_allclose(slip, [10.0 / (MU * 0.53125 * W), 10.0 / (MU * 0.5 * W)])


def test_grip_of_a_cart_by_paper_and_pencil() -> None:
    """The axle bears 3/4 in every split, its left wheel (3/4 ± 1/8)/2."""
    at, axle, sideways = (0.5, 0.0), ((0, 1),), 30.0 / (0.75 * W)
    _, slip = ranges(CART, at, (0.0, 0.0), (-30.0,), axle)
    np.testing.assert_allclose(slip, [sideways / MU] * 2)
    _, slip = ranges(CART, at, (10.0, 10.0), (30.0,), axle)
    least, most = (math.hypot(10.0 / (part * W), sideways) / MU for part in (0.375, 0.3125))
    np.testing.assert_allclose(slip, [least, most])
    _, slip = ranges(CART, at, (10.0, 0.0), (30.0,), axle)  # the left one alone has to push
    least, most = (math.hypot(10.0 / (part * W), sideways) / MU for part in (0.4375, 0.3125))
    np.testing.assert_allclose(slip, [least, most])
    _, slip = ranges(CART, at, (10.0, 0.0), (24.0, 0.0), ((0,), (1,)))  # a force of its own: 26 N
    np.testing.assert_allclose(slip, [26.0 / (MU * 0.4375 * W), 26.0 / (MU * 0.3125 * W)])


def test_the_least_grip_is_a_linear_program_without_sideways_forces(
    rng: np.random.Generator,
) -> None:
    """Largest t with N ≥ t |F|: the worst wheel needs 1/(t μ) at least, and some split no more."""
    for points, at in stances(rng, 8):
        along = 10.0 * rng.normal(size=4)
        n = len(points)
        G = np.vstack([np.ones(n), points.T])
        pushing = np.column_stack([-np.eye(4, n), np.abs(along)])  # t |F| - N ≤ 0
        solved = linprog(
            [*np.zeros(n), -1.0],
            A_ub=pushing,
            b_ub=np.zeros(4),
            A_eq=np.column_stack([G, np.zeros(3)]),
            b_eq=np.array([1.0, *at]),
            method="highs",
        )
        _, (least, _) = ranges(points, at.tolist(), along.tolist())
        assert 1.0 / (least * MU * W) == pytest.approx(-solved.fun, abs=1e-7), (points, at)


def test_three_contacts_give_what_the_reaction_tells(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=ball(0.6))))
    ground, found = moving(robot, (1.2, 0.7), (0.8, 0.3))
    np.testing.assert_allclose(found.load[0], np.column_stack([ground.load] * 2), rtol=1e-12)
    np.testing.assert_allclose(found.slip[0], [ground.slip_ratio.max()] * 2, rtol=1e-9)


def moving(
    robot: rpctl.Robot, nu: Sequence[float], nu_dot: Sequence[float]
) -> tuple[GroundReaction, Ranges]:
    dynamics = ReducedDynamics(robot)
    standing = find_contacts(dynamics)
    assert standing is not None
    q, speed = robot.configuration(1.0, -2.0, 0.7), np.array(nu)
    tau = dynamics.efforts(q, dynamics.inverse(q, speed, np.array(nu_dot)))
    ground = ground_reaction(dynamics, standing, q, speed, tau)
    return ground, find_ranges(standing, together(ground))


@pytest.mark.parametrize("name", ["skid_steer", "mecanum", "car", "twin_casters"])
def test_robots_of_the_catalogue(name: str) -> None:
    """However they stand and turn, equal springs are one of many splits."""
    robot = rpctl.load(name)
    still = np.zeros(robot.dof)
    ground, found = moving(robot, still.tolist(), (still + 0.05).tolist())
    least, most = found.load[0].T
    assert (least <= ground.load).all()
    assert (ground.load <= most).all()
    assert least.sum() < ground.force[2] - 1.0
    assert most.sum() > ground.force[2] + 1.0
    assert 0.0 < found.slip[0, 0] <= ground.slip_ratio.max() <= found.slip[0, 1]


@pytest.mark.parametrize("stiff", [0, 2, 4])
def test_mujoco_settles_within_the_ranges(tmp_path: Path, stiff: int) -> None:
    """A free body on five frictionless balls, of which one is ten times as stiff as the others."""
    mujoco = pytest.importorskip("mujoco")
    b, r, d, m_c, m_w = (SET_A[key] for key in ("b", "r", "d", "m_c", "m_w"))
    places = [(0.0, b, r), (0.0, -b, r), *((x, y, 0.05) for x, y in ((0.6, 0.3), (0.6, -0.2)))]
    places.append((-0.4, 0.1, 0.05))
    extra = "".join(ball(x, y, name=f"ball{k}") for k, (x, y, _) in enumerate(places[2:]))
    mass, x, y, z = load = (8.0, 0.1, 0.2, 0.5)
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=extra + cargo(*load))))
    ground, found = moving(robot, (0.0, 0.0), (0.0, 0.0))
    geoms = "".join(
        f'<geom type="sphere" size="{z}" pos="{x} {y} {z}" condim="1" mass="{m_w * (k < 2)}" '
        f'priority="1" solref="{-2e6 if k == stiff else -2e5} -2e3" solimp="1 1 .001"/>'
        for k, (x, y, z) in enumerate(places)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 -9.81" timestep="0.0005"/><worldbody>
        <geom type="plane" size="5 5 1" condim="1"/>
        <body><freejoint/>{geoms}
          <geom type="sphere" size=".01" pos="{d} 0 .2" mass="{m_c}" contype="0" conaffinity="0"/>
          <geom type="sphere" size=".01" pos="{x} {y} {z}" mass="{mass}" contype="0"
            conaffinity="0"/>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    for _ in range(6000):
        mujoco.mj_step(model, data)
    felt, wrench = np.zeros(5), np.zeros(6)
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, wrench)
        felt[max(data.contact[i].geom) - 1] += wrench[0]
    least, most = found.load[0].T
    slack = 1e-2 * felt.sum()
    assert felt.sum() == pytest.approx(ground.force[2], rel=1e-3)
    assert (felt >= least - slack).all()
    assert (felt <= most + slack).all()
    assert np.abs(felt - ground.load).max() > 2.0 * slack  # its split is another one
