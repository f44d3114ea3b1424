"""Where robots touch the ground: balls, rollers and casters are found, arms and hulls are not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
from rpctl.dynamics.stance import find_supports
from tests import urdf
from tests.robots import SET_A, ball, free_caster, platform, write

ROLLING_CASTER = free_caster(urdf.shape('sphere radius="0.05"'))

MESH_CASTER = free_caster(urdf.shape('mesh filename="roller.stl"', "visual"))


def names(folder: Path, extra: str, lock: tuple[str, ...] = ()) -> list[str]:
    robot = rpctl.load(write(folder, platform(SET_A, extra=extra)), lock=lock)
    return [part.name for part in find_supports(robot).parts]


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("paper", [(0.78, 0.0)]),
        ("mixed_chain", [(0.26, 0.15), (0.26, -0.09)]),
        ("tiago", [(0.1535, -0.102), (0.1535, 0.102), (-0.1895, -0.102), (-0.1895, 0.102)]),
    ],
)
def test_robots_of_the_catalogue(name: str, points: list[tuple[float, float]]) -> None:
    robot = rpctl.load(name)
    supports = find_supports(robot)
    assert supports.unknown == ()
    np.testing.assert_allclose([part.point[:2] for part in supports.parts], points, atol=1e-4)
    heights = [part.point[2] for part in supports.parts]
    np.testing.assert_allclose(heights, robot.drive.ground, atol=1e-9)
    assert len({part.name for part in supports.parts}) == len(points)


@pytest.mark.parametrize(
    ("extra", "found"),
    [
        (ball(0.5), ["ball"]),
        (ball(0.5, role="visual"), ["ball"]),
        (ball(0.5, z=0.054), ["ball"]),
        (ball(0.5, z=0.046), ["ball"]),
        (ball(0.5, z=0.056), []),
        (ball(0.5, z=0.044), []),
        (ball(0.5) + ball(-0.5, name="second"), ["ball", "second"]),
        (ball(0.0, z=-0.1, parent="left_wheel"), []),  # it turns with the wheel
    ],
)
def test_balls(extra: str, found: list[str], tmp_path: Path) -> None:
    assert names(tmp_path, extra) == found


@pytest.mark.parametrize(
    ("shape", "origin", "point"),
    [
        ('<box size="0.1 0.06 0.04"/>', "0 0 -0.03", (0.5, 0.0)),
        ('<box size="0.9 0.6 0.1"/>', "0 0 0", None),  # a hull
        ('<box size="0.001 0.001 0.001"/>', "0 0 -0.05", None),  # a frame's mark
        ('<cylinder radius="0.05" length="0.03"/>', "0 0 0.0", None),  # 35 mm above the ground
        ('<cylinder radius="0.05" length="0.1"/>', "0 0 0", (0.5, 0.0)),  # upright
        ('<cylinder radius="0.4" length="0.1"/>', "0 0 0", None),  # a round hull
        ('<mesh filename="a.stl"/>', "0 0 0", None),
    ],
)
def test_shapes(shape: str, origin: str, point: tuple[float, float] | None, tmp_path: Path) -> None:
    extra = ball(0.5).replace('<sphere radius="0.05"/>', shape)
    extra = extra.replace("<collision>", f'<collision><origin xyz="{origin}"/>')
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=extra)))
    parts = find_supports(robot).parts
    assert [part.point[:2] for part in parts] == ([] if point is None else [point])


@pytest.mark.parametrize("over", [0.0, math.pi])
def test_lowest_points_of_slanted_shapes(tmp_path: Path, over: float) -> None:
    """A cylinder stands on its rim, a capsule on its end, a box on its corner or edge.

    Turned over they are the same shapes.
    """
    tilt, r, half = 0.3, 0.04, 0.03
    shapes = {
        f'<cylinder radius="{r}" length="{2 * half}"/>': (
            -half * math.sin(tilt) + r * math.cos(tilt),
            half * math.cos(tilt) + r * math.sin(tilt),
        ),
        f'<capsule radius="{r}" length="{2 * half}"/>': (
            -half * math.sin(tilt),
            half * math.cos(tilt) + r,
        ),
        f'<box size="{2 * r} 0.05 {2 * half}"/>': (
            -half * math.sin(tilt) + r * math.cos(tilt),
            half * math.cos(tilt) + r * math.sin(tilt),
        ),
    }
    for shape, (ahead, height) in shapes.items():
        extra = ball(0.5, z=height).replace('<sphere radius="0.05"/>', shape)
        extra = extra.replace("<collision>", f'<collision><origin rpy="0 {tilt + over} 0"/>')
        robot = rpctl.load(write(tmp_path, platform(SET_A, extra=extra)))
        (part,) = find_supports(robot).parts
        np.testing.assert_allclose(part.point, [0.5 + ahead, 0.0, 0.0], atol=1e-12, err_msg=shape)


def test_arms_are_no_supports(tmp_path: Path) -> None:
    """A gripper that hangs to the ground at rest moves away from it; a caster does not."""
    arm = """
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="arm_joint" type="KIND">
    <parent link="base"/><child link="arm"/><origin xyz="0.5 0 0.3"/><axis xyz="AXIS"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>""" + ball(0.1, z=-0.25, name="hand", parent="arm")
    for kind, axis, found in (
        ("revolute", "0 1 0", []),
        ("continuous", "0 1 0", []),
        ("prismatic", "1 0 0", []),
        ("prismatic", "0 0 1", []),
        ("revolute", "0 0 1", ["hand"]),
    ):
        extra = arm.replace("KIND", kind).replace("AXIS", axis)
        assert names(tmp_path, extra, ("arm_joint",)) == ["hand"]
        if kind != "continuous":
            assert names(tmp_path, extra) == found


def test_a_free_caster_swivels_its_contact(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=ROLLING_CASTER)))
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    assert contacts.names == ("left_joint", "right_joint", "roller_joint")
    np.testing.assert_allclose(contacts.points[2], [0.44, 0.02], atol=1e-12)
    still = np.zeros(robot.dof)
    for swivel in (0.0, 1.0, -2.0):
        q = robot.configuration(1.0, 2.0, 0.7, joints={"swivel": swivel, "roller_joint": 0.4})
        tau = dynamics.efforts(q, dynamics.bias(q, still))
        ground = ground_reaction(dynamics, contacts, q, still, tau)
        cos, sin = math.cos(swivel), math.sin(swivel)
        point = np.array([0.5 - 0.06 * cos, 0.02 - 0.06 * sin])
        fork = np.array([0.5 - 0.03 * cos, 0.02 - 0.03 * sin])
        moment = 30.0 * np.array([0.3, 0.0]) + 0.4 * fork + 0.3 * point
        assert ground.load[2] == pytest.approx(9.81 * moment[0] / point[0], rel=1e-12)
        across = 0.75 * (ground.load[0] - ground.load[1]) + ground.load[2] * point[1]
        assert across == pytest.approx(9.81 * moment[1], rel=1e-12)


def test_a_support_turns_with_its_carrier(tmp_path: Path) -> None:
    arm = """
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="arm_joint" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0.5 0 0.3" rpy="0 0 0.8"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>""" + ball(0.1, z=-0.25, parent="arm")
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=arm)))
    contacts = find_contacts(ReducedDynamics(robot))
    assert contacts is not None
    place = [0.5 + 0.1 * math.cos(0.8), 0.1 * math.sin(0.8)]
    np.testing.assert_allclose(contacts.points[2], place, rtol=1e-12)


def test_a_caster_of_meshes_leaves_the_polygon_open(tmp_path: Path) -> None:
    path = write(tmp_path, platform(SET_A, extra=MESH_CASTER + ball(-0.5)))
    locked = rpctl.load(path, lock=("swivel", "roller_joint"))
    assert find_supports(locked).unknown == ("roller",)
    contacts = find_contacts(ReducedDynamics(locked))
    assert contacts is not None
    assert not contacts.balanced
    (note,) = contacts.notes
    assert note.startswith("the support polygon is incomplete: roller")
    # Free to roll it is a wheel, as large as its axle is high.
    (roller,) = (wheel for wheel in rpctl.load(path).drive.wheels if wheel.swivel)
    assert roller.radius == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("shape", "turn", "found"),
    [
        ('<sphere radius="0.05"/>', "0 0 0", ["roll"]),
        ('<cylinder radius="0.05" length="0.03"/>', "1.5707963267948966 0 0", ["roll"]),
        ('<cylinder radius="0.03" length="0.1"/>', "0 0 0", []),  # it stands, and would fall over
        ('<box size="0.06 0.04 0.1"/>', "0 0 0", []),
        ('<box size="0.06 0.1 0.04"/>', "1.5707963267948966 0 0", []),  # along, but not round
    ],
)
def test_what_turns_about_its_centre_is_round(
    tmp_path: Path, shape: str, turn: str, found: list[str]
) -> None:
    """A part on a joint with limits that is level: only what is round about it stays down."""
    text = f"""<link name="roll"><inertial><mass value="0.1"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
      <collision><origin rpy="{turn}"/><geometry>{shape}</geometry></collision></link>
      <joint name="roll_joint" type="revolute"><parent link="base"/><child link="roll"/>
      <origin xyz="0.5 0 0.05"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
    assert names(tmp_path, text) == found


@pytest.mark.parametrize(("shape", "unknown"), [("", ("roller",)), ("sphere", ())])
def test_only_casters_of_nothing_but_meshes_leave_it_open(
    tmp_path: Path, shape: str, unknown: tuple[str, ...]
) -> None:
    """One with a sphere besides its mesh, here off the ground, is known not to touch it."""
    more = '<collision><geometry><sphere radius="0.02"/></geometry></collision></link>'
    text = platform(SET_A, extra=MESH_CASTER + ball(-0.5))
    if shape:
        head, _, tail = text.partition('<link name="roller">')
        text = head + '<link name="roller">' + tail.replace("</link>", more, 1)
    robot = rpctl.load(write(tmp_path, text), lock=("swivel", "roller_joint"))
    assert find_supports(robot).unknown == unknown
