"""Which wheels lead, follow, trail or are left without a drive, and what stands on the ground."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import rpctl
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.urdf.reader import read
from rpctl.drive.wheels import find_candidates
from tests import urdf
from tests.drive.drive_cases import TRANSMISSION, Files, axles, body, tricycle, xml
from tests.robots import write
from tests.vehicles import Parts, rear_axle, vehicle


@pytest.mark.parametrize("ahead", [0.003, -0.003, 0.001, -0.001])
def test_wheels_that_share_a_centre_stand_below_their_axes(files: Files, ahead: float) -> None:
    """Up to 2 mm are a file's rounding and left out; more is refused, ahead as behind."""
    text = vehicle("car-like").replace('xyz="0 -0.05 0"', f'xyz="{ahead} -0.05 0"')
    if abs(ahead) > 0.002:
        assert 'wheels of "steer_right" stand 3 mm off its axis' in files.refusal(text)
    else:
        assert [swivel.trail for swivel in files.load(text).drive.swivels] == [0.0, 0.0]


def test_a_size_that_nothing_tells_is_the_height_over_the_ground(files: Files) -> None:
    """Of a root 1.3 m above it: the other wheel ends at −1.3 m, this one turns at −1.2 m."""
    parts = body(-0.9)
    parts.wheel("left", "base", "0 0.3 -1.2")
    parts.link("bare", 1.0)
    parts.joint("right", "continuous", ("base", "bare"), "0 -0.3 -1.2", "0 1 0")
    drive = files.load(parts).drive
    assert [wheel.radius for wheel in drive.wheels] == pytest.approx([0.1, 0.1])
    assert drive.wheels[1].source == "axle height over the other wheels' ground"
    assert drive.ground == pytest.approx(-1.3)


@pytest.mark.parametrize(("off", "pair"), [(0.011, True), (0.013, False)])
def test_two_wheels_are_a_pair_within_a_fiftieth_of_their_distance(
    files: Files, off: float, pair: bool
) -> None:
    """12 mm of 0.6 m."""
    parts = body()
    parts.wheel("left", "base", f"{off} 0.3 0.1")
    parts.wheel("right", "base", "0 -0.3 0.1")
    if pair:
        assert files.load(parts).drive.type == "differential"
    else:
        assert "no two wheels share one axle" in files.refusal(parts)


def test_the_track_is_that_of_the_axle_with_the_most_wheels(files: Files) -> None:
    parts = axles(0.3, -0.3)
    parts.wheel("outer_left", "base", "0.3 0.45 0.1")
    parts.wheel("outer_right", "base", "0.3 -0.45 0.1")
    assert files.load(parts, "skid-steer").drive.track == pytest.approx(0.9)
    assert files.load(axles(0.3, -0.3), "skid-steer").drive.track == pytest.approx(0.6)


def askew() -> Parts:
    """Return a pair of wheels, and three on axles that point elsewhere."""
    parts = body()
    rear_axle(parts)
    for k, (place, axis) in enumerate(
        [("0.4 0.2 0.1", "0.8 0.6 0"), ("0.4 -0.2 0.1", "-0.8 0.6 0"), ("-0.4 0 0.1", "1 0 0")]
    ):
        turn = {"0.8 0.6 0": -0.9272952180016122, "-0.8 0.6 0": 0.9272952180016122}.get(axis)
        parts.wheel(f"side_{k}", "base", place, axis, turn=turn or 1.5707963267948966)
    return parts


@pytest.mark.parametrize(
    ("driven", "kind"),
    [
        ((), "omni"),
        (("rear_left", "rear_right"), "differential"),
        (("rear_left", "rear_right", "side_0"), "omni"),
        (("rear_left", "rear_right", "side_0", "side_1"), "omni"),
    ],
)
def test_wheels_on_askew_axles_drive_unless_only_a_pair_does(
    files: Files, driven: tuple[str, ...], kind: str
) -> None:
    parts = askew()
    parts.xml += [TRANSMISSION.format(name) for name in driven]
    drive = files.load(parts).drive
    assert drive.type == kind
    slides = {wheel.joint for wheel in drive.wheels if wheel.slides}
    assert slides == ({"side_0", "side_1", "side_2"} if kind == "differential" else set())
    every = {wheel.joint for wheel in drive.wheels}
    assert {wheel.joint for wheel in drive.wheels if wheel.driven} == (set(driven) or every)


TILT = 0.3  # rad, about y


@pytest.mark.parametrize("tilt", [TILT, -TILT])
@pytest.mark.parametrize(
    ("shape", "reach"),
    [
        ('<sphere radius="0.07"/>', 0.07),
        ('<box size="0.2 0.3 0.1"/>', 0.5 * (0.2 * math.sin(TILT) + 0.1 * math.cos(TILT))),
        ('<cylinder radius="0.05" length="0.4"/>', 0.05 * math.sin(TILT) + 0.2 * math.cos(TILT)),
        ('<capsule radius="0.05" length="0.4"/>', 0.05 + 0.2 * math.cos(TILT)),
    ],
)
def test_the_lowest_point_of_a_tilted_shape(
    tmp_path: Path, shape: str, reach: float, tilt: float
) -> None:
    """Two of them are drawn; the lower one counts, wherever its link is."""
    drawn = "".join(
        f'<collision><origin xyz="0.1 0.2 {z}" rpy="0 {tilt} 0"/><geometry>{shape}</geometry>'
        "</collision>"
        for z in (0.9, 0.5)
    )
    parts = Parts([])
    parts.link("base", 1.0)
    parts.link("part", 1.0, drawn)
    parts.joint("held", "fixed", ("base", "part"), "0 0 2", "0 0 1")
    tree = FrozenTree(read(write(tmp_path, xml(parts))))
    assert tree.lowest("part") == pytest.approx(2.5 - reach)
    assert tree.lowest("base") == math.inf


def slab(parts: Parts, top: float) -> Parts:
    """Put a robot into a world whose ground is drawn."""
    shape = f'<collision><origin xyz="0 0 {top - 0.5}"/><geometry><box size="90 90 1"/></geometry>'
    parts.xml.insert(0, f'<link name="world">{shape}</collision></link>')
    parts.joint("anchor", "fixed", ("world", "base"), "0 0 0", "0 0 1")
    return parts


def test_the_ground_is_what_the_lowest_wheel_stands_on(files: Files) -> None:
    """Not what a fan on the roof would."""
    parts = body()
    rear_axle(parts)
    parts.wheel("fan", "base", "0.2 0 1.1")
    robot = files.load(slab(parts, 0.0))
    assert robot.drive.type == "differential"
    assert [wheel.joint for wheel in robot.drive.wheels] == ["rear_left", "rear_right"]


@pytest.mark.parametrize(("gap", "stands"), [(0.008, True), (0.012, False)])
def test_a_wheel_may_end_a_tenth_of_its_radius_above_the_ground(
    files: Files, gap: float, stands: bool
) -> None:
    """The wheels of R = 0.1 m are on the ground; the third may be 10 mm higher, not more."""
    parts = body()
    rear_axle(parts)
    parts.wheel("third", "base", f"0.5 0 {0.1 + gap}")
    if not stands:
        assert '"third" ends 12 mm above the ground' in files.refusal(parts)
    names = [wheel.joint for wheel in files.load(parts, free=["third"]).drive.wheels]
    assert names == ["rear_left", "rear_right", *["third"] * stands]


@pytest.mark.parametrize(("trail", "role"), [(0.004, "steered"), (0.008, "steered"),
                                             (0.012, "caster"), (-0.012, "caster")])  # fmt: skip
def test_a_contact_a_tenth_of_the_radius_off_trails(files: Files, trail: float, role: str) -> None:
    """Wheels of 0.1 m: 10 mm is the limit."""
    parts = body()
    rear_axle(parts)
    parts.swivel("pivot", "0.6 0 0.3", "continuous")
    parts.wheel("front", "pivot_fork", f"{trail} 0 -0.2")
    drive = files.load(parts).drive
    assert drive.type == ("tricycle" if role == "steered" else "differential")
    assert drive.swivels[0].role == role
    assert abs(drive.swivels[0].trail) == pytest.approx(abs(trail))
    assert (drive.swivels[0].trail < 0.0) == (role == "caster")  # a caster's contact is behind


@pytest.mark.parametrize(
    ("shapes", "ball"),
    [("s", True), ("ss", True), ("sc", False), ("cs", False), ("c", False), ("", False)],
)
def test_a_ball_is_drawn_as_nothing_but_spheres(tmp_path: Path, shapes: str, ball: bool) -> None:
    drawn = {
        "s": '<collision><geometry><sphere radius="0.1"/></geometry></collision>',
        "c": '<collision><origin rpy="1.5707963267948966 0 0"/><geometry>'
        '<cylinder radius="0.1" length="0.04"/></geometry></collision>',
    }
    parts = body()
    parts.link("roll", 1.0, "".join(drawn[shape] for shape in shapes))
    parts.joint("roll_joint", "continuous", ("base", "roll"), "0 0.3 0.1", "0 1 0")
    (candidate,) = find_candidates(FrozenTree(read(write(tmp_path, xml(parts)))), {})
    assert candidate.ball is ball


def two_wheels() -> Parts:
    parts = body()
    rear_axle(parts)
    return parts


REFUSED: dict[str, list[Parts | str]] = {
    "differential": [axles(0.3, -0.3), tricycle(), vehicle("omni")],
    "skid-steer": [two_wheels(), vehicle("omni"), vehicle("steered")],
    "mecanum": [two_wheels(), axles(0.3, 0.0, -0.3), vehicle("omni"), vehicle("car-like")],
    "omni": [two_wheels(), vehicle("car-like"), vehicle("steered")],
    "bicycle": [two_wheels(), vehicle("car-like"), vehicle("steered")],
    "tricycle": [two_wheels(), vehicle("bicycle"), vehicle("car-like")],
    "car-like": [two_wheels(), tricycle(), vehicle("bicycle"), vehicle("steered")],
    "steered": [two_wheels(), tricycle(), vehicle("car-like")],
    "powered-casters": [two_wheels(), vehicle("casters"), vehicle("steered"), vehicle("twin")],
}


@pytest.mark.parametrize("axis", ["0 0 -1", "0 0 1"])
def test_a_follower_without_limits_stops_short_of_a_right_angle(tmp_path: Path, axis: str) -> None:
    """In a right turn the right wheel comes to one at cot δ_L = −w/L; beyond, it heads back."""
    text = vehicle("car-like").replace('lower="-1.2" upper="1.2"', 'lower="-1.3" upper="1.25"')
    head, _, tail = text.partition('<joint name="steer_right" type="revolute">')
    tail = tail.replace("0 0 -1", axis, 1)
    text = f'{head}<joint name="steer_right" type="continuous">{tail}'
    robot = rpctl.load(write(tmp_path, text))
    limits = robot.steering_limits
    end = -math.atan2(0.7, 0.5)
    assert end <= limits.lower[0] < end + 1.3 / 250 + 1e-9
    assert limits.upper[0] == 1.25


def hitched(*efforts: float) -> Parts:
    """Return a body with an axle, and one behind another on hitches of these effort limits, N m."""
    parts, puller, place = body(), "base", "-0.5 0 0.3"
    rear_axle(parts)
    for k, effort in enumerate(efforts):
        parts.link(f"body_{k}", 8.0)
        limit, ends = urdf.limit(-1.2, 1.2, effort, 6), (puller, f"body_{k}")
        parts.xml.append(urdf.joint(f"waist_{k}", "revolute", ends, place, "0 0 1", limit))
        parts.wheel(f"left_{k}", f"body_{k}", "-0.45 0.3 -0.2")
        parts.wheel(f"right_{k}", f"body_{k}", "-0.45 -0.3 -0.2", "0 -1 0")
        puller, place = f"body_{k}", "-0.9 0 0"
    return parts


def steered_on_a_steered_one(kind: str) -> Parts:
    parts = tricycle() if kind == "axle" else body()
    if kind != "axle":
        parts.swivel("steer", "0.6 0 0.3", "revolute")
        parts.wheel("front", "steer_fork", "0 0 -0.2")
    parts.link("dolly", 0.6)
    parts.joint("waist_1", "revolute", ("steer_fork", "dolly"), "-0.9 0 0", "0 0 1")
    parts.wheel("middle", "dolly", "0 0 -0.2")
    return parts


@pytest.mark.parametrize(
    ("parts", "carrier"),
    [
        (hitched(0, 40), "waist_0"),
        (hitched(40, 40), "waist_0"),
        (steered_on_a_steered_one("axle"), "steer"),
        (steered_on_a_steered_one(""), "steer"),
    ],
)
def test_what_another_swivel_carries_does_not_steer(
    files: Files, parts: Parts, carrier: str
) -> None:
    """The rates of what steers are chosen freely, so none may hang on an angle that follows."""
    refusal = files.refusal(parts)
    assert f':1: "waist_1" steers on "{carrier}", which also turns' in refusal
    assert "--lock waist_1" in refusal
    assert 'joint = "waist_1"\nrole = "steered"' in refusal  # of the drive file to start from


def test_a_trailer_behind_a_driven_hitch_is_pulled(files: Files) -> None:
    """So is one whose hitch is held, or said to have no motor."""
    robot = files.load(hitched(40, 0))
    assert robot.quasi_velocities == ("v", "waist_0")
    assert [swivel.role for swivel in robot.drive.swivels] == ["steered", "trailer"]
    assert rpctl.verify(robot, samples=2).passed
    assert files.load(hitched(0, 40), lock=["waist_1"]).drive.type == "differential"
    told = 'type = "articulated"\n[[swivel]]\njoint = "waist_1"\nrole = "trailer"\n'
    roles = [swivel.role for swivel in files.load(hitched(40, 40), told).drive.swivels]
    assert roles == ["steered", "trailer"]
