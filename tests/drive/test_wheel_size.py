"""The size of a wheel: which of its shapes tell radius and offset, both from the same one."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.drive.drive_cases import Files, body
from tests.vehicles import Parts

LYING = f'rpy="{pi / 2} 0 0"'  # a cylinder along y


def cylinder(r: float, y: float = 0.0, x: float = 0.0, role: str = "collision") -> str:
    """Return a shape about the y axis: radius and place, m."""
    origin = f'<origin xyz="{x} {y} 0" {LYING}/>'
    return f'<{role}>{origin}<geometry><cylinder radius="{r}" length="0.04"/></geometry></{role}>'


def sphere(r: float, role: str) -> str:
    return f'<{role}><geometry><sphere radius="{r}"/></geometry></{role}>'


def mesh(name: str, y: float = 0.0, x: float = 0.0, role: str = "visual") -> str:
    geometry = f'<geometry><mesh filename="{name}"/></geometry>'
    return f'<{role}><origin xyz="{x} {y} 0"/>{geometry}</{role}>'


def disc(folder: Path, name: str, r: float) -> None:
    """Write a mesh of a disc about y; its 32 corners reach the radius along x and z."""
    turned = np.eye(4)[[0, 2, 1, 3]] * [[1.0], [-1.0], [1.0], [1.0]]  # z becomes −y
    trimesh.creation.cylinder(radius=r, height=0.04, sections=32, transform=turned).export(
        folder / name
    )


def cart(left: str, right: str, below: str = "", kind: str = "fixed") -> Parts:
    """Return a cart with wheels at y = ±0.2 m, z = 0.1 m, axles to the left.

    ``below`` is the shape of a link 0.06 m outside each wheel's link, on a joint of a kind.
    """
    parts = body()
    for name, side, shape in (("left", 1, left), ("right", -1, right)):
        parts.link(f"{name}_hub", 1.0, shape)
        parts.joint(name, "continuous", ("base", f"{name}_hub"), f"0 {0.2 * side} 0.1", "0 1 0")
        if below:
            parts.link(f"{name}_tyre", 0.5, below)
            place = f"0 {0.06 * side} 0"
            parts.joint(f"{name}_rim", kind, (f"{name}_hub", f"{name}_tyre"), place, "0 1 0")
    return parts


def sizes(files: Files, parts: Parts) -> tuple[float, float, float]:
    """Return the left wheel's radius and offset, and the track, m; nothing is doubted."""
    drive = files.load(parts).drive
    left = next(wheel for wheel in drive.wheels if wheel.joint == "left")
    assert drive.doubts == ()
    return left.radius, left.offset, drive.track


def test_radius_and_offset_are_both_the_tyres(files: Files) -> None:
    """A hub of 0.05 m in the joint, a tyre of 0.1 m that lies 0.06 m outside: 2 · 0.26 m apart."""
    hub = cylinder(0.05)
    for left, right in (
        (hub + cylinder(0.1, 0.06), hub + cylinder(0.1, -0.06)),
        (cylinder(0.1, 0.06) + hub, cylinder(0.1, -0.06) + hub),
    ):
        assert sizes(files, cart(left, right)) == pytest.approx((0.1, 0.06, 0.52))


def test_it_rolls_on_its_collision(files: Files) -> None:
    """A wider visual cylinder, elsewhere on the axle, is what one sees."""
    shapes = cylinder(0.11, 0.03, role="visual") + cylinder(0.1, 0.01)
    robot = files.load(cart(shapes, shapes))
    left, right = robot.drive.wheels
    assert (left.radius, left.offset, left.source) == (0.1, 0.01, "collision cylinder, line 1")
    assert right.radius == 0.1
    assert robot.drive.ground == pytest.approx(0.0)


def test_a_tyre_on_a_link_fixed_to_the_hub(files: Files) -> None:
    hub, tyre = cylinder(0.05), cylinder(0.1)
    assert sizes(files, cart(hub, hub, tyre)) == pytest.approx((0.1, 0.06, 0.52))
    assert sizes(files, cart("", "", tyre)) == pytest.approx((0.1, 0.06, 0.52))
    seen = sizes(files, cart(cylinder(0.1), cylinder(0.1), cylinder(0.12, role="visual")))
    assert seen == pytest.approx((0.1, 0.0, 0.4))


def test_what_is_fixed_beside_the_axle_is_no_tyre(files: Files) -> None:
    """A weight of 0.12 m, 13 mm off the axle, where a tyre of it may be 12 mm off; and a motor."""
    hub = cylinder(0.1)
    assert sizes(files, cart(hub, hub, cylinder(0.12, x=0.013)))[0] == 0.1
    assert sizes(files, cart(hub, hub, cylinder(0.12, x=0.011)))[0] == 0.12
    lies = '<collision><geometry><cylinder radius="0.2" length="0.1"/></geometry></collision>'
    assert sizes(files, cart(hub, hub, lies))[0] == 0.1


def test_of_meshes_the_widest_that_turns_with_the_wheel(files: Files) -> None:
    disc(files.folder, "hub.stl", 0.05)
    disc(files.folder, "tyre.stl", 0.1)
    disc(files.folder, "weight.stl", 0.12)
    left = mesh("hub.stl") + mesh("tyre.stl", 0.06)
    right = mesh("tyre.stl", -0.06) + mesh("hub.stl")
    expected = pytest.approx((0.1, 0.06, 0.52), rel=1e-6)
    assert sizes(files, cart(left, right)) == expected
    assert sizes(files, cart(mesh("hub.stl"), mesh("hub.stl"), mesh("tyre.stl"))) == expected
    aside = mesh("weight.stl", x=0.013)
    assert sizes(files, cart(mesh("tyre.stl"), mesh("tyre.stl"), aside))[0] == pytest.approx(0.1)
    both = mesh("weight.stl") + mesh("tyre.stl", role="collision")
    assert sizes(files, cart(both, both))[0] == pytest.approx(0.1)


def test_a_tyre_that_cannot_be_read_is_a_doubt(files: Files) -> None:
    """The hub's radius is not the wheel's: told, and --strict refuses it."""
    disc(files.folder, "hub.stl", 0.1)
    drive = files.load(cart(mesh("hub.stl") + mesh("tyre.stl", 0.06), mesh("hub.stl"))).drive
    (doubt,) = drive.doubts
    assert doubt.startswith('wheel "left": mesh "tyre.stl"')
    assert "so its radius, 0.1 m, is that of its other meshes" in doubt


def test_a_mesh_in_millimetres(files: Files) -> None:
    disc(files.folder, "disc.stl", 100.0)
    shape = mesh("disc.stl", 0.03).replace("<mesh", '<mesh scale="0.001 0.001 0.001"')
    assert sizes(files, cart(shape, shape)) == pytest.approx((0.1, 0.03, 0.4), rel=1e-6)


@pytest.mark.parametrize("scale", ["0.9 1 1", "1 1 0.9"])
def test_a_tread_reaches_as_far_as_its_lugs(files: Files, scale: str) -> None:
    """A mesh of 0.18 m by 0.2 m across its axle: half of the larger one, whichever it is."""
    disc(files.folder, "disc.stl", 0.1)
    shape = mesh("disc.stl").replace("<mesh", f'<mesh scale="{scale}"')
    assert sizes(files, cart(shape, shape)) == pytest.approx((0.1, 0.0, 0.4), rel=1e-6)


def test_a_tyre_keeps_its_turn_about_the_hub(files: Files) -> None:
    """A rim's frame that is turned: its cylinder's own z axis lies along the axle then."""
    parts = body()
    for name, y in (("left", 0.2), ("right", -0.2)):
        parts.link(f"{name}_hub", 1.0)
        parts.joint(name, "continuous", ("base", f"{name}_hub"), f"0 {y} 0.1", "0 1 0")
        upright = '<origin xyz="0 0 0.03"/><geometry><cylinder radius="0.1" length="0.04"/>'
        parts.link(f"{name}_tyre", 0.5, f"<collision>{upright}</geometry></collision>")
        parts.xml.append(
            f'<joint name="{name}_rim" type="fixed"><parent link="{name}_hub"/>'
            f'<child link="{name}_tyre"/><origin xyz="0 0.01 0" rpy="{-pi / 2} 0 0"/></joint>'
        )
    radius, offset, track = sizes(files, parts)
    # A quarter turn back about x takes z to y: 0.01 m + 0.03 m along the axle.
    np.testing.assert_allclose((radius, offset, track), (0.1, 0.04, 0.4), rtol=1e-12)
