"""Trajectories of wheels that lean against derivations and publications of others."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rpctl
from rpctl import ReducedDynamics
from rpctl.arrays import Array
from rpctl.dynamics.leaning import LeaningProjector
from rpctl.dynamics.motion import rk4_step
from rpctl.robot.leaning import LeaningRobot
from rpctl.simulation.plants.rolling import advance
from tests.dynamics import kane
from tests.dynamics.whipple import BENCHMARK, GRAVITY, urdf
from tests.grids import cells
from tests.robots import write
from tests.urdf import ROUND, inertial, joint, link, shape

PULSES = {(0.2, 0.3): (30.0, 0.0), (0.5, 0.6): (0.0, 1.5), (1.0, 1.1): (-20.0, -2.0)}  # N m


def leaning(path: Path, text: str) -> LeaningRobot:
    robot = rpctl.load(write(path, text), root="free")
    assert isinstance(robot, LeaningRobot)
    return robot


def torques(time: float) -> Array:
    """Return the torques (2,) at the rear wheel and at the steering, N m."""
    acting = [each for (start, end), each in PULSES.items() if start < time < end]
    return np.array(acting[0] if acting else (0.0, 0.0))


def pushed(time: float) -> Array:
    """Return these as a force (9,) on the coordinates of the bicycle by hand."""
    force = np.zeros(9)
    force[[7, 6]] = torques(time)
    return force


def wheel_angle(robot: LeaningRobot, q: Array, name: str, like: float) -> float:
    """Return a wheel's angle nearest to one, rad."""
    angle = robot.joint_position(q, name)
    return float(angle + 2.0 * np.pi * np.round((like - angle) / (2.0 * np.pi)))


def test_accelerations_of_whipples_bicycle(tmp_path: Path) -> None:
    """Leaning, steering and turning far: equal to rounding to the equations written by hand."""
    mine, robot = kane.whipple(BENCHMARK), leaning(tmp_path, urdf(BENCHMARK))
    dynamics, rng = ReducedDynamics(robot), np.random.default_rng(5)
    for _ in range(8):
        lean, steer = rng.uniform(-0.6, 0.6, 2)
        nu, tau = rng.uniform(-3.0, 3.0, 3), rng.uniform(-20.0, 20.0, 2)
        q = mine.placed([0.0, 0.0, 0.3, 0.4, lean, 0.0, steer, 0.0, 0.0], (2, 5))
        u = mine.rates(q, nu[0], {4: nu[1], 6: nu[2]})
        force = np.zeros(9)
        force[[7, 6]] = tau
        u_dot = mine.acceleration(q, u, force)
        place = np.array([*mine.contact(q)[:2], 0.4])
        here = robot.configuration_at(place, np.empty(0), np.array([steer]), lean)
        assert robot.tilt(here) == pytest.approx(lean, abs=1e-14)
        assert robot.base_pose(here) == pytest.approx(place, abs=1e-14)
        rate = dynamics.basis(here) @ nu
        assert rate[robot.velocity_index("rear_wheel")] == pytest.approx(u[7], rel=1e-12)
        assert dynamics.twist(here, nu)[2] == pytest.approx(u[3], rel=1e-12, abs=1e-13)
        found = dynamics.forward(here, nu, tau)[1:]
        assert found == pytest.approx(u_dot[[4, 6]], rel=1e-11, abs=1e-11)


def test_a_trajectory_of_whipples_bicycle(tmp_path: Path) -> None:
    """Two seconds at 4.6 m/s from a roll of .1 rad, under pulses of torque, by order 4."""
    mine, robot = kane.whipple(BENCHMARK), leaning(tmp_path, urdf(BENCHMARK))
    dynamics, times = ReducedDynamics(robot), np.arange(0.0, 2.05, 0.1)
    q = mine.placed([0.0, 0.0, 0.3, 0.0, 0.1, 0.0, 0.05, 0.0, 0.0], (2, 5))
    wanted = mine.motion(q, mine.rates(q, 4.6, {4: 0.0, 6: 0.0}), times, pushed)[-1]
    x, y, _ = mine.contact(q)
    start = robot.configuration_at(np.array([x, y, 0.0]), np.empty(0), np.array([0.05]), 0.1)

    def off(longest: float) -> float:
        q, nu = start, np.array([4.6, 0.0, 0.0])
        for a, b in itertools.pairwise(times):
            q, nu, *_ = advance(dynamics, q, nu, torques(0.5 * (a + b)), b - a, longest)
        assert np.abs(LeaningProjector(robot).heights(q)).max() < 1e-12
        x, y, heading = robot.base_pose(q)
        steer = robot.joint_position(q, "steering")
        spun = [wheel_angle(robot, q, f"{k}_wheel", wanted[7 + i])
                for i, k in enumerate(("rear", "front"))]  # fmt: skip
        found = [x, y, heading, robot.tilt(q), steer, *spun, *nu[1:]]
        x, y, _ = mine.contact(wanted[:9])
        exact = [x, y, *wanted[[3, 4, 6, 7, 8, 13, 15]]]
        return float(np.abs(np.array(found) - exact).max())

    assert off(0.005) < 1e-8
    assert off(0.01) < 32.0 * 1e-8  # of order 4: with steps twice as long 16 times as far off


UNIFORM = (2.0, 0.3, 0.09, 0.045)  # kg, m, kg m²: of a disc, C = m r²/2 and A = C/2
MODELICA = (2.0, 0.3, 0.06, 0.12)  # Modelica.Mechanics.MultiBody.Examples.Elementary.RollingWheel
DUST = 1e-11  # kg, kg m²
AHEAD, TRAIL = 0.6, 0.3  # m: of the caster's contact from the disc's, and of its steering axis


def disc_urdf(mass: float, radius: float, axial: float, across: float) -> str:
    """Return a disc that a frame of dust follows, with a caster of dust ahead.

    The caster trails, so nothing acts on it, neither across it (its steering axis is free) nor
    along it (its wheel is free) nor upwards (the frame pitches freely about the disc's axle): the
    disc rolls as if it were alone, and the caster's angle tells how it turns.
    """
    none = dict.fromkeys(("xB", "zB", "xH", "zH", "lam", "IBxz", "IHxz"), 0.0)
    dust = "mB mH mF IBxx IByy IBzz IHxx IHyy IHzz IFxx IFyy"
    none |= dict.fromkeys(dust.split(), DUST)
    wheel = {"rR": radius, "mR": mass, "IRxx": across, "IRyy": axial}
    return urdf({**none, **wheel, "w": AHEAD, "c": TRAIL, "rF": 0.3})


def kept_turn(robot: LeaningRobot, lean: float, steer: float) -> tuple[Array, float]:
    """Return q (nq,) of a disc that leans, and by how much it turns per metre, 1/m."""
    q = robot.configuration_at(np.zeros(3), np.empty(0), np.array([steer]), lean)
    return q, float(ReducedDynamics(robot).twist(q, np.array([1.0, 0.0, 0.0]))[2])


@pytest.mark.parametrize("numbers", [UNIFORM, MODELICA])
def test_steady_turns_of_a_disc(tmp_path: Path, numbers: tuple[float, ...]) -> None:
    """On a circle m g r sin φ = Ω cos φ (A Ω sin φ + (C/r + m r) v_c), v = v_c + Ω r sin φ.

    φ is its lean into the circle, v the speed of its contact and v_c that of its centre.
    """
    robot, (m, r, C, A) = leaning(tmp_path, disc_urdf(*numbers)), numbers
    dynamics = ReducedDynamics(robot)
    for lean, steer in ((-0.1, -0.1), (-0.5, -0.3), (0.4, 0.6)):
        q, curvature = kept_turn(robot, lean, steer)
        sine, cosine = np.sin(-lean), np.cos(lean)  # to the left, as a turn to the left is
        own = 1.0 - curvature * r * sine
        pull = curvature * cosine * (A * curvature * sine + (C / r + m * r) * own)
        speed = float(np.sqrt(m * GRAVITY * r * sine / pull))
        nu = np.array([speed, 0.0, 0.0])
        assert np.abs(dynamics.forward(q, nu, np.zeros(2))).max() < 1e-6
        assert np.abs(dynamics.forward(q, 1.01 * nu, np.zeros(2))).max() > 1e-3


def test_the_critical_speed_of_a_disc(tmp_path: Path) -> None:
    """Upright, λ² = (m g r − C (C + m r²) v²/(A r²)) / (A + m r²): stable from v² = g r/3 on."""
    robot, (m, r, C, A) = leaning(tmp_path, disc_urdf(*UNIFORM)), UNIFORM
    critical = np.sqrt(GRAVITY * r / 3.0)
    for speed in (0.3, critical - 1e-3, critical + 1e-3, 2.0):
        model = rpctl.linearize(robot, robot.configuration(), np.array([speed, 0, 0]), np.zeros(2))
        square = (m * GRAVITY * r - C * (C + m * r**2) * speed**2 / (A * r**2)) / (A + m * r**2)
        values, root = np.linalg.eigvals(model.A), np.sqrt(complex(square))
        assert (np.real(root) > 0.0) == (speed < critical)
        for wanted in (root, -root):
            assert np.abs(values - wanted).min() < 1e-6


# Of the reference results of Modelica's library 4.0 (Dymola, Dassl, tolerance 1e-6), at the end:
# https://github.com/modelica/MAP-LIB_ReferenceResults, Modelica.Mechanics.MultiBody.Examples.
STANDARD = 9.80665  # m/s², of that library
ROLLING_WHEEL = (  # x, y of the centre, angles about z, then y, then x
    (0.162546780387087, -2.23778480700844),
    (0.668754946703454, -0.965464984971638, 2.09168313935774),
)
WHEEL_SET = {  # heading, angles of the left and the right wheel, x, y between them
    "driven": (10.5731906475514, -57.4851408978485, -4.61918766009148, -0.612715307657269,
               -0.386803612176626),
    "pulled": (1.77078952928951, 9.08694675264976, 17.9408943990973, 1.05214181123268,
               0.708332425819997),
}  # fmt: skip


def test_modelicas_rolling_wheel(tmp_path: Path) -> None:
    """A wheel too slow to stay upright wobbles for 4 s: published, by hand, and by rpctl."""
    mine, robot = kane.disc(*MODELICA), leaning(tmp_path, disc_urdf(*MODELICA))
    q, u = np.array([0.2, 0.2, 0.3, 0.0, 0.0, 0.0]), np.array([1.5, -0.3, 0.0, 0.0, 1.0, 5.0])
    times = np.linspace(0.0, 4.0, 5)
    theirs = mine._replace(gravity=STANDARD).motion(q, u, times, lambda _: np.zeros(6))[-1]
    place, (a, b, c) = ROLLING_WHEEL
    turned = kane.turn(2, a) @ kane.turn(1, b) @ kane.turn(0, c)
    own = kane.turn(2, theirs[3]) @ kane.turn(0, theirs[4]) @ kane.turn(1, theirs[5])
    assert theirs[:2] == pytest.approx(place, abs=6e-4)  # 9.81 m/s² would be 2 mm off
    assert np.abs(own - turned).max() < 5e-4

    wanted = mine.motion(q, u, np.array([0.0, 1.4]), lambda _: np.zeros(6))[-1]
    start = robot.configuration_at(np.array([0.2, 0.2, 0.0]), np.empty(0), np.zeros(1))
    dynamics = ReducedDynamics(robot)
    q, *_ = advance(dynamics, start, np.array([1.5, 1.0, 0.0]), np.zeros(2), 1.4, 0.002)
    x, y, heading = robot.base_pose(q)
    assert [x, y] == pytest.approx(mine.contact(wanted[:6])[:2], abs=1e-6)
    assert np.sin(heading - wanted[3]) == pytest.approx(0.0, abs=1e-6)
    assert robot.tilt(q) == pytest.approx(wanted[4], abs=1e-6)


def wheel_set(tmp_path: Path, root: str) -> rpctl.Robot:
    """Return Modelica's two wheels of 0.1 m, 0.5 m apart, and a body of 10 g 0.2 m ahead."""
    parts = [link("axle", inertial(0.01, (1e-3, 1e-3, 1e-3), xyz="0.2 0 0"))]
    for name, side in (("left", 0.25), ("right", -0.25)):
        tyre = shape('cylinder radius="0.1" length="0.02"', rpy=ROUND)
        parts += [
            link(f"{name}_wheel", inertial(0.5, (0.02, 0.01, 0.02)), tyre),
            joint(name, "continuous", ("axle", f"{name}_wheel"), (0, side, 0), "0 1 0"),
        ]
    return rpctl.load(write(tmp_path, f'<robot name="set">{"".join(parts)}</robot>'), root=root)


def act(kind: str, time: float, heading: float) -> tuple[Array, Array]:
    """Return torques at both wheels (2,), and the force ahead and moment of a pull (2,)."""
    if kind == "driven":
        return -2.0 * np.array([np.sin(2.0 * np.pi * time), np.cos(2.0 * np.pi * time)]), np.zeros(
            2
        )
    fx, fy = np.interp(time, [1.0, 2.0], [1.0, 0.0]), np.interp(time, [1.0, 2.0], [0.0, 2.0])
    cos, sin = np.cos(heading), np.sin(heading)
    return np.zeros(2), np.array([cos * fx + sin * fy, 0.2 * (cos * fy - sin * fx)])


@pytest.mark.parametrize("root", ["planar", "free"])
@pytest.mark.parametrize("kind", WHEEL_SET)
def test_modelicas_wheel_sets(tmp_path: Path, kind: str, root: str) -> None:
    """Three seconds of two wheels on an axle: what leans is held level, as Modelica's is."""
    robot = wheel_set(tmp_path, root)
    dynamics = ReducedDynamics(robot)
    wheels = [robot.velocity_index(name) for name in ("left", "right")]

    def rate(time: float, state: Array) -> Array:
        x, y, heading, _, _, *speeds = state
        q, nu = robot.configuration(x, y, heading), np.array([*speeds, 0.0][: robot.dof])
        torque, pull = act(kind, time, heading)
        push = (dynamics.actuation(q) @ torque - dynamics.bias(q, nu))[:2] + pull
        v, _, omega = dynamics.twist(q, nu)
        change = np.linalg.solve(dynamics.inertia(q)[:2, :2], push)
        ahead = [v * np.cos(heading), v * np.sin(heading), omega]
        return np.array([*ahead, *(dynamics.basis(q) @ nu)[wheels], *change])

    start = [0.1, 0.1, *np.zeros(5)]
    done = solve_ivp(rate, (0.0, 3.0), start, "DOP853", rtol=1e-9, atol=1e-9, max_step=0.1)
    x, y, heading, *angles = done.y[:5, -1]
    heading, *angles, wanted_x, wanted_y = np.subtract([heading, *angles, x, y], WHEEL_SET[kind])
    assert np.abs([heading, *angles, wanted_x, wanted_y]).max() < 1e-3


@pytest.mark.parametrize("minutes", cells([3, 60], slow=[3]))
@pytest.mark.parametrize(
    ("name", "tilt", "nu", "lost"),
    [("whipple", 0.02, [5.0, 0.0, 0.0], 2e-11), ("balancer", np.pi - 0.4, [0.5, 0.6, 1.0], 1e-5)],
)
def test_an_hour_stays_on_the_ground(
    name: str, tilt: float, nu: list[float], lost: float, minutes: int
) -> None:
    """Or a few minutes of it, with as much less of its loss.

    A bicycle rights itself and rolls on; a body that hangs from its axle swings all the time.

    In steps of 10 ms both wheels stay on the ground, and energy drifts by so much a minute of
    its kinetic part at the start: what the method of order 4 loses of a swing, and rounding of
    what rolls.
    """
    lock = {"shoulder_joint": 0.0} if name == "balancer" else {}
    robot = rpctl.load(name, lock=lock)
    assert isinstance(robot, LeaningRobot)
    dynamics, projector = ReducedDynamics(robot), LeaningProjector(robot)
    q, speeds, still = robot.configuration(tilt=tilt), np.array(nu), np.zeros(len(robot.actuators))
    before = dynamics.energy(q, speeds)
    kinetic = 0.5 * speeds @ dynamics.inertia(q) @ speeds
    for _ in range(60 * minutes):
        for _ in range(100):
            q, speeds, _, _ = rk4_step(dynamics, q, speeds, still, 0.01)
        assert np.abs(projector.heights(q)).max() <= 1e-12
    assert abs(dynamics.energy(q, speeds) - before) <= lost * minutes * kinetic
