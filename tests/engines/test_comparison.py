"""Every gap that the referee knows is found where it is planted, with its sign and its words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import rpctl
from rpctl.dynamics.ground_reaction import Contacts, find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.comparison import EngineGap, compare
from rpctl.engines.recording import EngineRecording, referee_course
from rpctl.robot.model import Robot

T = np.linspace(0.0, 2.0, 21)


@cache
def known() -> tuple[Robot, Contacts]:
    robot = rpctl.load("paper")
    contacts = find_contacts(ReducedDynamics(robot))
    assert contacts is not None
    return robot, contacts


@cache
def arc() -> EngineRecording:
    """A robot that drives 1 m of a bend by 0.5 rad."""
    robot, contacts = known()
    turn, radius = 0.25 * T, 2.0
    pose = np.column_stack([radius * np.sin(turn), radius * (1.0 - np.cos(turn)), turn])
    root = np.zeros((len(T), 7))
    root[:, :2], root[:, 2], root[:, 6] = pose[:, :2], -robot.drive.ground, 1.0
    return EngineRecording(
        t=T,
        pose=pose,
        root=root,
        tilt=np.zeros_like(T),
        joints={name: np.zeros_like(T) for name in robot.moving_joint_names},
        load=np.full((len(T), len(contacts.names)), 100.0),
        slip=np.zeros((len(T), len(robot.drive.wheels), 2)),
        energy=10.0 * T,
        work=10.0 * T,
    )


def found(engine: EngineRecording, slack: dict[str, float] | None = None) -> EngineGap:
    """Return the worst gap from the arc."""
    return compare(*known(), arc(), engine, slack or {})[0]


def test_what_is_the_same_agrees() -> None:
    assert all(gap.gap == 0.0 and gap.agrees for gap in compare(*known(), arc(), arc(), {}))


def longer(ratio: float) -> EngineRecording:
    pose = arc().pose.copy()
    pose[:, :2] *= ratio
    root = arc().root.copy()
    root[:, :2] = pose[:, :2]
    return replace(arc(), pose=pose, root=root)


def turned(ratio: float) -> EngineRecording:
    pose = arc().pose.copy()
    pose[:, 2] *= ratio
    return replace(arc(), pose=pose)


def changed(name: str, change: Callable[[np.ndarray], None]) -> EngineRecording:
    values = getattr(arc(), name).copy()
    change(values)
    return replace(arc(), **{name: values})


def aside(left: float = -0.1) -> EngineRecording:
    pose = arc().pose.copy()
    pose[:, 1] += left * T / T[-1]
    return replace(arc(), pose=pose)


def veered(turn: float) -> EngineRecording:
    """Return a recording that is off its heading half-way, and back in the end."""
    pose = arc().pose.copy()
    pose[:, 2] += turn * np.sin(0.5 * np.pi * T)
    return replace(arc(), pose=pose)


def heading(recording: EngineRecording, turn: float) -> EngineRecording:
    """Return a recording whose pose is turned about the start."""
    x, y, angle = recording.pose.T
    cos, sin = np.cos(turn), np.sin(turn)
    return replace(
        recording, pose=np.column_stack([cos * x - sin * y, sin * x + cos * y, angle + turn])
    )


PLANTED: dict[str, tuple[Callable[[], EngineRecording], str, float, str]] = {
    "too far": (lambda: longer(1.2), "path", 0.2, "drives 20 % too far"),
    "too short": (lambda: longer(0.9), "path", 0.1, "drives 10 % too short"),
    "stuck": (lambda: longer(0.0), "path", 1.0, "does not move"),
    "aside": (aside, "path", 0.1, "leaves the path by 100 mm, to the right"),
    "aside, to the left": (lambda: aside(0.1), "path", 0.1, "the path by 100 mm, to the left"),
    "veers left": (lambda: veered(0.2), "heading", 0.2, "veers 11° to the left"),
    "veers right": (lambda: veered(-0.2), "heading", -0.2, "veers 11° to the right"),
    "turns little": (lambda: turned(0.7), "heading", -0.15, "turns 30 % too little"),
    "turns much": (lambda: turned(1.3), "heading", 0.15, "turns 30 % too much"),
    "no turn": (lambda: turned(0.0), "heading", -0.5, "does not turn"),
    "other way": (lambda: turned(-0.5), "heading", -0.75, "turns the other way"),
    "leans": (lambda: changed("tilt", lambda tilt: tilt.__setitem__(3, 0.1)), "tilt", 0.1, "5.7°"),
    "sinks": (lambda: replace(arc(), sunk=0.02), "height", 0.02, "sinks 20 mm"),
    "high": (lambda: replace(arc(), sunk=-0.02), "height", -0.02, "stands high by 20 mm"),
    "creeps": (lambda: replace(arc(), crept=0.03), "creep", 0.03, "before anything drives it"),
    "hops": (
        lambda: changed("root", lambda root: root.__setitem__((4, 2), root[4, 2] + 0.03)),
        "hop",
        0.03,
        "30 mm as it goes",
    ),
    "spins": (
        lambda: changed("slip", lambda slip: slip.__setitem__((5, 1, 0), 0.4)),
        "slip",
        0.4,
        "wheel_right_joint spins or drags at 0.4 m/s",
    ),
    "slides": (
        lambda: changed("slip", lambda slip: slip.__setitem__((5, 0, 1), -0.4)),
        "slip",
        -0.4,
        "wheel_left_joint slides sideways at 0.4 m/s",
    ),
    "creates": (lambda: replace(arc(), energy=12.0 * T), "energy", 4.0, "creates 4 J"),
    "loses": (lambda: replace(arc(), energy=7.0 * T), "energy", -6.0, "loses 6 J"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_the_worst_gap(name: str) -> None:
    make, kind, size, words = PLANTED[name]
    gap = found(make())
    assert (gap.name, gap.agrees) == (kind, False)
    assert gap.gap == pytest.approx(size, rel=0.02)
    assert words in gap.words


@pytest.mark.parametrize("turn", [0.0, 1.5, 3.0, -1.5])
@pytest.mark.parametrize("left", [0.1, -0.1])
def test_a_side_is_the_robots_own(turn: float, left: float) -> None:
    """Both ways turned by the same angle about the start: left stays left."""
    model, engine = (heading(each, turn) for each in (arc(), aside(left)))
    gap = compare(*known(), model, engine, {})[0]
    assert gap.words.endswith("to the left" if left > 0.0 else "to the right")


@pytest.mark.parametrize("ratio, agrees", [(1.019, True), (1.021, False), (0.979, False)])
def test_the_band_of_the_heading(ratio: float, agrees: bool) -> None:
    """A hundredth of the 0.5 rad that it turns, and 5 mrad: 10 mrad, a fiftieth."""
    gap = next(g for g in compare(*known(), arc(), turned(ratio), {}) if g.name == "heading")
    assert gap.band == pytest.approx(0.01) and gap.agrees == agrees


def test_what_is_no_number_disagrees_before_all_else() -> None:
    """Of the joints, too, whichever comes first."""
    robot, _ = known()
    for name in robot.joint_names:
        joints = {each: values + 0.2 for each, values in arc().joints.items()}
        gap = found(replace(arc(), joints={**joints, name: np.full_like(T, np.nan)}))
        assert (gap.name, gap.agrees) == ("joint", False) and gap.words.startswith(name)


def test_a_load_is_named_with_its_contact() -> None:
    _, contacts = known()
    assert contacts.determinate
    gap = found(changed("load", lambda load: load.__setitem__((7, 0), 60.0)))
    assert (gap.name, gap.gap) == ("load", -40.0)
    assert gap.words == f"{contacts.names[0]} bears 40 N too little"


def test_joints_that_follow_or_are_held_are_compared_wheels_are_not() -> None:
    robot, _ = known()
    arm = robot.joint_names[0]
    off = {name: values + 0.2 for name, values in arc().joints.items()}
    gap = found(replace(arc(), joints=off))
    assert gap.name == "joint" and gap.words.startswith(tuple(robot.joint_names))
    wheels = {wheel.joint: off[wheel.joint] for wheel in robot.drive.wheels}
    assert found(replace(arc(), joints={**arc().joints, **wheels})).agrees
    held = {**arc().joints, arm: off[arm]}
    assert not found(replace(arc(), joints=held)).agrees
    assert found(replace(arc(), joints=held), {arm: 0.3}).agrees  # dry friction may hold it there


def test_an_engine_that_could_not_go_on_disagrees_whatever_it_did_before() -> None:
    gap = found(replace(arc(), fault="it diverges at 1 s"))
    assert not gap.agrees and gap.words == "it diverges at 1 s"


def test_the_course_ends_where_its_speeds_say() -> None:
    """Speeds rise to 1 and fall to .3, so their mean is 1/6 + 1/3 + .65/3; a stroke is 1."""
    course, rising = referee_course(3.0), np.array([True, False])
    t = (np.arange(3000) + 0.5) * 1e-3
    nu, nu_dot = zip(*(course.speeds(at, np.ones(2), rising) for at in t.tolist()), strict=True)
    way = np.sum(nu, axis=0) * 1e-3
    np.testing.assert_allclose(way, [3.0 * (0.5 + 1.0 + 0.65) / 3.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(np.max(nu, axis=0), [1.0, course.peak], rtol=1e-5)
    np.testing.assert_allclose(np.gradient(np.array(nu), 1e-3, axis=0), nu_dot, atol=1e-2)


def test_what_is_no_number_agrees_with_nothing() -> None:
    assert not EngineGap("path", np.nan, 1.0, "m", "").agrees
    assert not EngineGap("path", 0.0, 0.0, "m", "").agrees
    gaps = compare(*known(), arc(), changed("pose", lambda pose: pose.fill(np.nan)), {})
    assert {gap.name for gap in gaps if not gap.agrees} >= {"path", "heading"}


@pytest.mark.parametrize(("off", "agrees"), [(0.0099, True), (0.0101, False), (-0.0101, False)])
def test_headings_agree_within_a_hundredth_of_the_turn_and_5_mrad(off: float, agrees: bool) -> None:
    """The arc turns by 0.5 rad, so by 0.01 × 0.5 + 0.005 = 0.01 rad."""
    veered = changed("pose", lambda pose: pose.__setitem__((7, 2), pose[7, 2] + off))
    (heading,) = (gap for gap in compare(*known(), arc(), veered, {}) if gap.name == "heading")
    assert heading.agrees is agrees
    assert heading.words.endswith("to the left" if off > 0.0 else "to the right")
