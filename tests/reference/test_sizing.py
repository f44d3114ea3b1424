"""Default references: by the robot's size, within half of its limits, links clear, and told why."""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, ReferenceState, Robot
from rpctl.arrays import Array
from rpctl.dynamics.standing import stand_at_home
from rpctl.errors import RpctlError
from rpctl.reference.fitting import too_weak
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference, steering
from rpctl.reference.named import (
    BASE_PATHS,
    clear_waves,
    reference_by_name,
)
from rpctl.reference.path_reference import PathReference, TimedPath, Waves, waves
from rpctl.reference.sizing import Sizing, robot_length
from rpctl.robot import catalog
from rpctl.robot.collision import collision_model
from rpctl.robot.vary import set_limits
from rpctl.simulation.loop.track import default_duration
from tests import urdf
from tests.folding import folding
from tests.grids import cells
from tests.robots import SET_A, ball, cargo, platform, write
from tests.vehicles import KINDS, vehicle

LAP_RATE = 2.0 * math.pi / 18.5  # rad/s: 20 s a lap, of which the soft start of 3 s costs half
MARGIN_M, KEPT_AT_MOST = 0.01, 0.5  # m, and of a pair's distance at home
HALF = 0.5  # of each limit
SAMPLED = 1.02  # limits are kept at samples of a lap, and exceeded by 2 % at most between them
CLOSED = ("circle", "eight")
NAMES = (*BASE_PATHS, "waypoints")
DRIVEN = [*product(CLOSED, KINDS)]
TELLING = {("circle", "steered"), ("circle", "articulated"), ("eight", "trailers")}


def times(reference: Reference, count: int = 600) -> Array:
    return np.linspace(0.0, default_duration(reference), count)


def sizing(reference: Reference) -> Sizing:
    assert isinstance(reference, PathReference | TimedPath)
    assert reference.sizing is not None
    return reference.sizing


def scaled_platform(folder: Path, scale: float, **limits: float) -> Robot:
    """Return the platform of the paper ``scale`` times as large and of as much density."""
    power = {"m_c": 3, "m_w": 3, "I_c": 5, "I_s": 5, "I_d": 5, "d": 1, "b": 1, "r": 1}
    sizes = {key: value * scale ** power[key] for key, value in SET_A.items()}
    text = platform(sizes).replace('z="0.2"', f'z="{0.2 * scale}"')
    robot = rpctl.load(write(folder, text.replace('length="0.04"', f'length="{0.04 * scale}"')))
    return set_limits(
        robot,
        **{key: {"*_joint": value} for key, value in limits.items()},
    )


def wheel_speeds(reference: Reference, scale: float = 1.0) -> Array:
    """Return the rates (K, 2) of the platform's wheels, by hand: (v ± b ω)/r."""
    laps = np.linspace(0.0, 3.0 * default_duration(reference), 900)
    twists = np.array([reference(t).twist for t in laps.tolist()])
    sides = np.array([1.0, -1.0]) * SET_A["b"] * scale
    return (twists[:, :1] + twists[:, 2:] * sides) / (SET_A["r"] * scale)


@pytest.mark.parametrize(("limit", "name"), list(product([0.2, 2.0, 200.0], NAMES[1:]))[::4])
def test_wheels_take_half_of_their_speed(tmp_path: Path, name: str, limit: float) -> None:
    """Wherever the limit binds it is met, else another pace is faster; both wheels count."""
    robot = scaled_platform(tmp_path, 1.0, velocity=limit)
    reference = load_reference(robot, name)
    fastest = float(np.abs(wheel_speeds(reference)).max())
    assert fastest <= HALF * limit * SAMPLED
    bound = "joint's" in sizing(reference).reason
    assert bound == (limit < 200.0)
    if bound:
        assert fastest == pytest.approx(HALF * limit, rel=SAMPLED - 1.0)
        assert f"half of what left_joint's {limit:g} rad/s allow".replace("left_joint", "") in (
            sizing(reference).reason.replace("left_joint", "").replace("right_joint", "")
        )


@pytest.mark.parametrize(("scale", "name"), list(product([1 / 30, 20.0], NAMES))[::3])
def test_sizes_follow_the_robot(tmp_path: Path, name: str, scale: float) -> None:
    """The paper's robot and others of its shape, 5 cm and 30 m wide, take like paths."""
    small, paper = scaled_platform(tmp_path, scale), scaled_platform(tmp_path, 1.0)
    ours, usual = (sizing(load_reference(each, name)) for each in (small, paper))
    factor = float(f"{scale:.1g}")
    if usual.size is not None:
        assert ours.size == pytest.approx(usual.size * factor)
    assert ours.speed is not None
    assert usual.speed is not None
    pace = factor ** (-0.5 if name == "spin" else 0.5)
    assert ours.speed == pytest.approx(usual.speed * pace, rel=0.02)
    # A time law's knots do not scale: what they smooth is more of a small robot's waypoints.
    lasts = min(usual.duration * math.sqrt(factor), 120.0)
    assert ours.duration == pytest.approx(lasts, rel=0.2 if name == "waypoints" else 0.02)


def test_the_papers_robot_is_a_metre_long(paper: Robot, tiago: Robot) -> None:
    assert robot_length(paper) == robot_length(tiago) == 1.0
    circle = sizing(load_reference(paper, "circle"))
    assert (circle.size, circle.laps) == (1.0, 1.0)
    assert circle.duration == pytest.approx(20.0)
    assert circle.speed == pytest.approx(LAP_RATE)
    eight = sizing(load_reference(tiago, "eight"))
    assert eight.size == 1.5
    assert eight.speed == pytest.approx(0.5, rel=0.01)  # wheels: 10.15 rad/s, 98.5 mm
    assert eight.sentence.startswith("eight of 1.5 m at 0.5 m/s, 1 lap in 28.")
    assert "_joint's 10.2 rad/s allow; arm: 80 % of its swing for arm_5_joint" in eight.sentence


def test_a_slow_robot_drives_a_smaller_path_in_time(tmp_path: Path) -> None:
    robot = scaled_platform(tmp_path, 1.0, velocity=0.5)
    circle = sizing(load_reference(robot, "circle"))
    assert circle.size is not None
    assert circle.size < 1.0
    line = sizing(load_reference(robot, "line"))
    assert line.size == 1.5
    assert line.duration == pytest.approx(1.5 / (0.25 * 0.15) + 0.75, rel=0.01)


def arm_on_wheels(
    folder: Path,
    scale: float,
    reach: float = 0.5,
    effort: float = 100.0,
    speed: float = 2.0,
    upright: bool = False,
) -> Robot:
    """Return a platform with an arm of 2 kg on one joint across it, level or upright at home."""
    place = (0, 0, 0.5) if upright else (0.5, 0, 0)
    ends, limit = ("base", "arm"), urdf.limit(-2.0, 2.0, effort, speed)
    parts = [
        urdf.link("arm", urdf.inertial(2.0, (0.01, 0.01, 0.01), xyz=place)),
        urdf.joint("arm_joint", "revolute", ends, "0 0 0.5", "0 1 0", limit),
        urdf.link("tip"),
        urdf.joint("tip_joint", "fixed", ("arm", "tip"), (reach, 0, 0)),
    ]
    sizes = {key: v * (scale if key in "dbr" else 1.0) for key, v in SET_A.items()}
    text = platform(sizes, extra="\n".join(parts))
    return rpctl.load(write(folder, text, "arm.urdf"), end_effector="tip")


def test_an_arm_swings_at_half_its_speed(tmp_path: Path) -> None:
    reference = reference_by_name(arm_on_wheels(tmp_path, 1.0, speed=0.1), "circle")
    rates = [abs(reference(float(t)).joint_rates[0]) for t in times(reference)]
    assert max(rates) == pytest.approx(HALF * 0.1, rel=0.01)


def test_a_weak_arm_swings_less(tmp_path: Path) -> None:
    """Upright at home nothing holds it; swung, τ = I θ̈ − m g c sin θ, half of 2 N m at most."""
    strong, weak = (
        reference_by_name(arm_on_wheels(tmp_path, 1.0, effort=effort, upright=True), "circle")
        for effort in (100.0, 2.0)
    )
    angle, bend = (
        np.array([getattr(weak(float(t)), name)[0] for t in np.linspace(0.0, 60.0, 900)])
        for name in ("joints", "joint_accelerations")
    )
    most = np.abs((0.01 + 2.0 * 0.5**2) * bend - 2.0 * 9.81 * 0.5 * np.sin(angle)).max()
    assert 0.8 * HALF * 2.0 < most <= HALF * 2.0 * SAMPLED  # swings are reduced by factors of 0.8
    assert weak.arm.amplitude[0] < strong.arm.amplitude[0] == 0.4
    assert sizing(weak).arm == "21 % of its swing for arm_joint's 2 N m"
    assert sizing(strong).arm == ""


def test_what_is_too_weak_to_hold_still_is_told_and_stops_nothing(tmp_path: Path) -> None:
    reference = reference_by_name(arm_on_wheels(tmp_path, 1.0, effort=5.0), "circle")
    told = (
        "gravity at home exceeds the effort limit of arm_joint: 9.81 of 5 N m; give another posture"
    )
    assert told in sizing(reference).sentence
    assert reference.arm.amplitude[0] > 0.3
    assert sizing(reference).speed == pytest.approx(LAP_RATE)


def test_what_is_too_weak_where_a_function_starts_is_told(tmp_path: Path) -> None:
    """Of a function of the user's, which takes one time and no array of them."""
    robot = arm_on_wheels(tmp_path, 1.0, effort=5.0)

    def start(t: float) -> ReferenceState:
        assert isinstance(t, float)
        return ReferenceState(*[*np.zeros((3, 3)), np.array([math.pi / 3.0]), *np.zeros((2, 1))])

    assert too_weak(ReducedDynamics(robot), start) == ""  # half of what it takes held out level
    told = too_weak(ReducedDynamics(set_limits(robot, effort={"arm_joint": 4.0})), start)
    assert told.startswith("gravity where the reference starts exceeds the effort limit of arm_")
    assert "arm_joint: 4.91 of 4 N m" in told


@pytest.mark.parametrize(("name", "kind"), cells(DRIVEN, TELLING))
def test_every_drive_keeps_half_of_every_limit(tmp_path: Path, kind: str, name: str) -> None:
    """Steering rates by differences of angles, wheels by the speed of the ground below them."""
    fastest = 0.8
    robot = rpctl.load(write(tmp_path, vehicle(kind)))
    robot = set_limits(robot, velocity={"*": fastest})
    reference = reference_by_name(robot, name)
    at, step = times(reference, 150), 1e-5
    rates = [
        (steering(robot, reference(t + step))[0] - steering(robot, reference(t - step))[0])
        / (2.0 * step)
        for t in at[1:].tolist()
    ]
    turned = np.abs(np.array(rates)).max(initial=0.0)
    assert turned <= HALF * fastest * SAMPLED
    speeds = []
    for t in at.tolist():
        v, left, omega = robot.root_velocity @ reference(t).twist
        for swivel in robot.drive.swivels:
            (x, y) = swivel.pivot
            place = math.hypot(v - omega * y, left + omega * x)
            wheels = [robot.drive.wheels[i] for i in robot.drive.carried(swivel)]
            if swivel.role != "trailer" and swivel.parent is None:  # what is pulled is slower
                speeds += [place / wheel.radius for wheel in wheels if not wheel.lateral]
        speeds.append(0.0 if kind == "omni" else abs(reference(t).twist[0]) / 0.12)
    assert max(speeds) <= HALF * fastest * SAMPLED
    assert "0.8 rad/s allow" in sizing(reference).reason


SWERVES = [(kind, name) for kind in ("steered", "twin") for name in ("circle", "waypoints")]


@pytest.mark.parametrize(("kind", "name"), cells(SWERVES, SWERVES[1:3]))
def test_no_wheel_of_a_swerve_turns_past_a_right_angle(
    tmp_path: Path, kind: str, name: str
) -> None:
    """Where a bend is tighter than the base is wide, its inner wheels would flip."""
    robot = rpctl.load(write(tmp_path, vehicle(kind)))
    reference = load_reference(robot, name)
    angles = np.array([steering(robot, reference(float(t)))[0] for t in times(reference, 200)])
    assert np.abs(angles).max() < 1.3
    assert np.abs(np.diff(angles, axis=0)).max() < 0.3


@pytest.mark.parametrize("name", cells(NAMES, [*NAMES][::2]))
def test_what_is_given_is_kept(tmp_path: Path, name: str) -> None:
    """It is told how much of the limits that takes."""
    robot, size = scaled_platform(tmp_path, 1.0, velocity=12.0), None if name == "spin" else 3.0
    speed = 0.4 if name == "waypoints" else 2.5
    reference = load_reference(robot, name, size=size, speed=speed)
    found = sizing(reference)
    assert found.size == size
    assert found.speed == pytest.approx(speed, rel=0.1 if name == "waypoints" else 1e-9)
    fastest = float(np.abs(wheel_speeds(reference)).max())
    told = float(found.reason.removeprefix("as given, ").split(" %")[0])
    assert told == pytest.approx(100.0 * fastest / 12.0, rel=0.03, abs=1.0)
    if name == "circle":
        assert isinstance(reference, PathReference)
        middle = 0.5 * (default_duration(reference) + 0.5 * reference.ramp)
        assert reference(middle).pose[:2] == pytest.approx([0.0, 6.0], abs=1e-6)


def test_a_robot_without_limits_is_told_what_was_assumed(tmp_path: Path, paper: Robot) -> None:
    bare = sizing(load_reference(scaled_platform(tmp_path, 1.0), "eight"))
    assert bare.assumed == (
        "the URDF has no velocity limit of left_joint, right_joint and no effort limit of "
        "left_joint, right_joint; there, size alone sets the pace"
    )
    assert bare.reason == "a speed for a robot of its size"
    assert sizing(load_reference(paper, "eight")).assumed == ""


@pytest.mark.parametrize(
    ("name", "wish", "why"),
    [
        ("spin", {"size": 1.0}, "size = 1: a spin has no size"),
        ("line", {"laps": 2.0}, "laps = 2: a line is not a closed path"),
        ("waypoints", {"laps": 2.0}, "laps = 2: waypoints do not form a closed path"),
        ("ee-square", {"laps": 2.0}, "laps = 2: ee-square"),
        ("circle", {"size": -1.0}, "size is -1; give a positive number"),
        ("circle", {"speed": math.nan}, "speed is nan; give a positive number"),
        ("some.csv", {"speed": 1.0}, r"speed = 1: some\.csv has its own"),
    ],
)
def test_wishes_without_sense_are_refused(
    paper: Robot, name: str, wish: dict[str, Any], why: str
) -> None:
    with pytest.raises(RpctlError, match=why):
        load_reference(paper, name, **wish)


def test_a_fixed_base_has_no_path_to_size() -> None:
    panda = rpctl.load("panda")
    for wish in ("size", "speed", "laps"):
        asked: dict[str, Any] = {wish: 2.0}
        with pytest.raises(RpctlError, match=f"{wish} = 2: panda has a fixed base"):
            load_reference(panda, "circle", **asked)
    told = sizing(load_reference(panda, "circle"))
    assert (told.size, told.speed) == (None, None)
    assert told.sentence == "the arm's motion alone: its base is fixed"


LOW = (0.2, 0.6)  # rad: the tip hangs 4 cm above the ground
LOWER = (0.2, 0.748)  # some millimetres
FOLDED = (-0.9, 2.6)  # the forearm swings past the column
BETWEEN = 0.9  # of a distance that samples keep: what is left of it between them


def posed(folder: Path, home: tuple[float, float]) -> Robot:
    """Return the small robot whose shoulder and elbow are so at home, rad."""
    return folding(folder, shoulder=home[0], elbow=home[1])


def nearest(robot: Robot, arm: Waves, count: int = 600) -> float:
    """Return the least distance (m) of all pairs over random instants of a motion.

    Args:
        robot: The robot.
        arm: The motion.
        count: Of the instants.
    """
    model, rng = collision_model(robot), np.random.default_rng(0)
    distances, least = model.distances(), np.inf
    for s in rng.uniform(0.0, 200.0, count).tolist():
        joints = arm.centre + arm.amplitude * np.sin(arm.rate * s)
        distances.place(robot.configuration_at(np.zeros(3), joints))
        least = min(least, *map(distances.distance, range(len(model.pairs))))
    return least


def at_home(robot: Robot) -> float:
    """Return the least distance (m) at home."""
    arm = waves(robot)
    return nearest(robot, Waves(arm.centre, 0.0 * arm.amplitude, arm.rate), count=1)


def test_a_swing_that_is_clear_stays_as_it_is(tmp_path: Path) -> None:
    robot = folding(tmp_path)
    arm = waves(robot)
    assert nearest(robot, arm) > MARGIN_M
    found, note = clear_waves(arm, robot)
    assert found is arm
    assert note == ""


@pytest.mark.parametrize(
    ("home", "pair"), [(LOW, "forearm clear of ground"), (FOLDED, "column clear of forearm")]
)
def test_a_swing_shrinks_until_links_keep_their_distance(
    tmp_path: Path, home: tuple[float, float], pair: str
) -> None:
    robot = posed(tmp_path, home)
    arm = waves(robot)
    assert nearest(robot, arm) < 0.0 < MARGIN_M < at_home(robot)
    found, note = clear_waves(arm, robot)
    share = found.amplitude / arm.amplitude
    assert share == pytest.approx(share[0])  # all joints in proportion
    assert note == f"swing reduced to {100.0 * share[0]:.0f} % to keep {pair}"
    assert nearest(robot, found) > BETWEEN * MARGIN_M
    wider = Waves(arm.centre, found.amplitude / 0.8, arm.rate)
    assert nearest(robot, wider) < MARGIN_M / BETWEEN  # no more than it must


def test_links_near_at_home_keep_half_of_their_distance(tmp_path: Path) -> None:
    robot = posed(tmp_path, LOWER)
    home = at_home(robot)
    assert 0.002 < home < MARGIN_M
    found, _ = clear_waves(waves(robot), robot)
    assert found.amplitude.min() > 0.0
    assert BETWEEN * KEPT_AT_MOST * home < nearest(robot, found) < home


def test_a_named_reference_says_what_its_arm_keeps_clear_of(tmp_path: Path) -> None:
    robot = posed(tmp_path, LOW)
    reference, blind = (reference_by_name(robot, "line", collisions=each) for each in (True, False))
    assert reference.sizing is not None
    assert "to keep forearm clear of ground" in reference.sizing.sentence
    assert nearest(robot, reference.arm) > 0.0
    assert nearest(robot, blind.arm) < -0.1
    assert blind.sizing is not None
    assert "clear of" not in blind.sizing.sentence


@pytest.mark.thorough
@pytest.mark.parametrize("name", catalog.names())
def test_no_robot_of_the_catalogue_swings_its_links_into_each_other(name: str) -> None:
    robot = rpctl.load(name)
    if robot.joints and len(collision_model(robot).pairs):
        assert nearest(robot, reference_by_name(robot, "line").arm, count=200) > 0.0


def test_a_default_pace_leaves_half_of_grip_and_of_the_margin_to_tipping(tmp_path: Path) -> None:
    """40 kg on a mast of 9 m, on wheels that could drive faster."""
    parts = "\n".join([cargo(40.0, -0.2, 0.0, 9.0), ball(-0.6)])
    path = write(tmp_path, platform(SET_A | {"d": -0.2}, extra=parts))
    robot = rpctl.load(path)
    found = sizing(reference_by_name(robot, "eight"))
    assert found.reason.endswith("m to tipping") and found.reason.startswith("half of its")
    run = rpctl.track(robot, "eight", duration=found.duration)
    margin = stand_at_home(ReducedDynamics(robot))
    assert margin is not None and margin.margin is not None
    tipping = 1.0 - run.log.tip_margin.min() / margin.margin
    assert tipping <= HALF and run.log.slip_ratio.max() < HALF
    speeding = np.gradient(run.nu[:, 0], run.t).max()  # h a / g moves the zero-moment point
    height = (40.0 * 9.0 + 30.0 * 0.2 + 2.0 * 0.15) / 72.0
    shift = height * speeding / 9.81
    assert 0.9 * HALF < shift / margin.margin <= 1.1 * HALF
    low = rpctl.load(write(tmp_path, platform(SET_A | {"d": -0.2}, extra=ball(-0.6)), "low.urdf"))
    assert sizing(reference_by_name(low, "eight")).speed > 1.2 * found.speed  # type: ignore[operator]
