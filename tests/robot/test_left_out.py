"""What a file says and the model does not have is told at its line."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.robot.idealised import idealisations
from tests import urdf
from tests.robots import SET_A, platform, wheel, write

BODY = urdf.inertial(1, (0.1, 0.1, 0.1))
TURNS = "0 1 0", urdf.limit(-1, 1, 9, 2)
ROD = [
    part
    for name, parent in (("crank", "base"), ("rocker", "crank"))
    for part in (
        urdf.link(name, BODY),
        urdf.joint(
            f"{name}_joint", "revolute", (parent, name), "0 0 .5", "0 1 0", urdf.limit(-1, 1, 9, 2)
        ),
    )
]
ARM = "\n".join(ROD)
SPRINGS = (
    '<gazebo reference="crank_joint"><springReference>0</springReference>'
    "<springStiffness>40</springStiffness></gazebo>",
    '<gazebo reference="crank_joint"><axis><dynamics><spring_stiffness>40</spring_stiffness>'
    "</dynamics></axis></gazebo>",
    '<gazebo reference="crank_joint"><stiffness>40</stiffness></gazebo>',
)
LOOPS = (
    '<gazebo><joint name="closure" type="revolute"><parent>base</parent><child>arm::rocker</child>'
    "</joint></gazebo>",
    '<loop_joint name="closure"><link1 link="base"/><link2 link="rocker"/></loop_joint>',
    '<mujoco><equality><connect name="pin" body1="base" body2="rocker" anchor="0 0 0"/></equality>'
    "</mujoco>",
    "<!-- the four-bar's coupler was left out -->",
)


def told(folder: Path, text: str, **settings: object) -> list[tuple[str | None, str]]:
    """Return the warnings of a robot, each with the text of its line."""
    path = write(folder, text)
    lines = text.splitlines()
    found = rpctl.load(path, **settings).findings  # type: ignore[arg-type]
    return [
        (lines[f.line - 1] if f.line else None, f.message) for f in found if f.severity == "warning"
    ]


@pytest.mark.parametrize("spring", SPRINGS)
def test_a_spring_is_told_unless_its_joint_is_held(tmp_path: Path, spring: str) -> None:
    text = platform(SET_A, extra=f"{ARM}\n{spring}")
    ((line, message),) = told(tmp_path, text)
    assert line == spring and 'joint "crank_joint" has a spring, which the model ignores' in message
    assert told(tmp_path, text, lock=["crank_joint"]) == []
    assert told(tmp_path, text.replace("40", "0")) == []


def test_a_spring_of_a_joints_own_dynamics_is_told(tmp_path: Path) -> None:
    sprung = '<dynamics springStiffness="3"/></joint>'
    text = platform(SET_A, extra=ARM.replace("</joint>", sprung, 1))
    ((_, message),) = told(tmp_path, text)
    assert 'joint "crank_joint" has a spring' in message


@pytest.mark.parametrize("loop", LOOPS)
def test_a_loop_that_was_cut_open_is_told_unless_it_is_held(tmp_path: Path, loop: str) -> None:
    text = platform(SET_A, extra=f"{ARM}\n{loop}")
    ((line, message),) = told(tmp_path, text)
    assert line == loop and "the model cuts the loop open" in message
    assert told(tmp_path, text, lock=["crank_joint", "rocker_joint"]) == []


def test_a_joint_to_the_world_or_a_remark_on_control_is_no_loop(tmp_path: Path) -> None:
    world = LOOPS[0].replace(">base<", ">world<")
    extra = f"{ARM}\n{world}\n<!-- closed-loop control of the four wheels, 3 bar -->"
    assert told(tmp_path, platform(SET_A, extra=extra)) == []


def two_on(root: str) -> str:
    """Return two platforms, one behind the other, fixed to one root link."""
    parts = [urdf.link(root)]
    for name, x in (("a", 0.0), ("b", -3.0)):
        ends = [f'"{end}"' for end in ("base", "left_wheel", "right_wheel")]
        body = urdf.link("base", urdf.inertial(30, (9, 9, 9), xyz="0 0 .2"))
        pair = *wheel("left", (0, 0.75), 1, SET_A), *wheel("right", (0, -0.75), 1, SET_A)
        text = "\n".join([body, *pair, urdf.joint("mount", "fixed", (root, "base"), (x, 0, 0))])
        for end in (*ends, '"left_joint"', '"right_joint"', '"mount"'):
            text = text.replace(end, f'"{name}_{end[1:]}')
        parts.append(text)
    return urdf.robot("two", *parts)


def test_two_robots_on_one_world_are_told(tmp_path: Path) -> None:
    ((line, message),) = told(tmp_path, two_on("world"), drive="skid-steer")
    assert line is not None and 'name="b_mount"' in line
    assert 'link "world" holds 2 bases with wheels ("a_base", "b_base")' in message
    assert told(tmp_path, two_on("chassis"), drive="skid-steer") == []


@pytest.mark.parametrize(("name", "height", "expected"), [
    ("left_track", 0.05, 1), ("left_track", 0.3, 0), ("tracker", 0.05, 0),
])  # fmt: skip
def test_a_track_that_is_fixed_on_the_ground_is_told(
    tmp_path: Path, name: str, height: float, expected: int
) -> None:
    track = urdf.link(name, urdf.shape('box size="1 .1 .1"'))
    fixed = urdf.joint("holds", "fixed", ("base", name), (0, 0.9, height))
    found = told(tmp_path, platform(SET_A, extra=f"{track}\n{fixed}"))
    assert len(found) == expected
    assert all(f'link "{name}" is fixed and stands on the ground' in text for _, text in found)


@pytest.mark.parametrize(("beside", "expected"), [("0 .3 0", [300.0]), (".1 0 0", [100.0]),
                                                  ("0 .03 0", [])])  # fmt: skip
def test_a_wheel_drawn_beside_where_it_rolls_is_told(
    tmp_path: Path, beside: str, expected: list[float]
) -> None:
    drawn = urdf.shape('cylinder radius="0.15" length="0.04"', "visual", beside, urdf.ROUND)
    text = platform(SET_A).replace("</link>", f"{drawn}</link>", 2)
    first, rest = text.split("</link>", 1)
    text = first.replace(drawn, "") + "</link>" + rest
    found = idealisations(rpctl.load(write(tmp_path, text)))
    told_here = [each for each in found if each.what == "drawn beside"]
    assert [each.value for each in told_here] == pytest.approx(expected)
    assert all('"left_joint" (line' in each.sentence for each in told_here)
