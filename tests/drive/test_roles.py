"""Which wheels lead, follow, trail or are left without a drive."""

from __future__ import annotations

import pytest

from tests.drive.drive_cases import TRANSMISSION, Files, axles, body
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
