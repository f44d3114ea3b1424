"""Dragging the hand, and a goal, on the page of a robot; in a real browser, by its pointer."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpctl import Robot
from rpctl.reference.pose_goal import PoseGoal, goal_of_words, read_goal
from rpctl.view.pages.robot_page import robot_page
from tests.view.chromium import opened
from tests.view.readers import embedded

VIEWER = "rpctl.scene.viewer"
TOLERANCE_PX = 1.0


def write(robot: Robot, folder: Path) -> str:
    path = folder / "page.html"
    path.write_text(robot_page(robot), encoding="utf-8")
    return path.as_uri()


@pytest.fixture
def page(browser: Any, tiago: Robot, tmp_path: Path) -> Iterator[Any]:
    with opened(browser, write(tiago, tmp_path)) as page:
        page.get_by_label("Names").uncheck()
        yield page


def where(page: Any, grip: int) -> tuple[float, float]:
    """Return where a handle is in the window, px."""
    x, y = page.evaluate(
        "(k) => { const box = document.getElementById('scene').getBoundingClientRect();"
        " const [x, y] = rpctl.goal.handles.pixel(rpctl.goal.grips()[k].at());"
        " return [x + box.left, y + box.top]; }",
        grip,
    )
    return x, y


def drag(page: Any, grip: int, dx: float, dy: float) -> tuple[float, float]:
    """Drag a handle by a way in the window; returns where the pointer let it go, px."""
    x, y = where(page, grip)
    page.mouse.move(x, y)
    page.mouse.down()
    for part in np.linspace(0.0, 1.0, 9)[1:]:
        page.mouse.move(x + part * dx, y + part * dy)
    page.mouse.up()
    return x + dx, y + dy


def goal(page: Any) -> Any:
    return page.evaluate("rpctl.goal.state()")


def test_hand_follows_the_pointer(page: Any, tiago: Robot) -> None:
    """Far beyond its reach no limit is broken; a drag elsewhere turns the camera, as ever."""
    page.get_by_role("button", name="Top").click()
    before, eye = page.evaluate("rpctl.values"), page.evaluate(f"{VIEWER}.camera.position.x")
    end = drag(page, 0, -20.0, 15.0)
    assert where(page, 0) == pytest.approx(end, abs=TOLERANCE_PX)
    after = page.evaluate("rpctl.values")
    moved = {
        name for name, a, b in zip(tiago.moving_joint_names, before, after, strict=True) if a != b
    }
    assert moved
    assert moved <= set(tiago.joint_names)
    assert page.evaluate(f"{VIEWER}.camera.position.x") == eye
    drag(page, 0, 900.0, -500.0)
    values = dict(zip(tiago.moving_joint_names, page.evaluate("rpctl.values"), strict=True))
    for joint in tiago.joints:
        assert joint.lower <= values[joint.name] <= joint.upper, joint.name
    shown = page.get_by_label("arm_1_joint", exact=True).evaluate("(slider) => slider.value")
    assert float(shown) == pytest.approx(values["arm_1_joint"])
    page.get_by_role("button", name="Robot").click()
    page.mouse.move(120, 400)
    page.mouse.down()
    page.mouse.move(220, 420, steps=4)
    page.mouse.up()
    assert abs(page.evaluate(f"{VIEWER}.camera.position.x") - eye) > 0.01
    assert page.evaluate("rpctl.values") == [*values.values()]


def told(page: Any) -> list[str]:
    return shlex.split(page.locator("#goal-command").inner_text())


@pytest.mark.slow
def test_command_goes_from_where_the_robot_stands(page: Any, tiago: Robot) -> None:
    """A static page has no Go; its command is read back here, the goal seen from P at the start."""
    page.evaluate(
        "() => { rpctl.set('x', 1.0); rpctl.set('heading', Math.PI / 2);"
        " rpctl.set('torso_lift_joint', 0.125); }"
    )
    page.get_by_role("button", name="Set a goal").click()
    assert page.get_by_role("button", name="Go", exact=True).count() == 0
    page.get_by_label("x, m").fill("0.5")
    page.get_by_label("y, m").fill("2")
    page.get_by_label("heading, °").fill("0")
    page.evaluate("rpctl.goal.drag('hand', [0.9, 2.2, 0.9])")
    words = told(page)
    assert words[:3] == ["rpctl", "track", "tiago"]
    assert words[words.index("--home") + 1] == "torso_lift_joint=0.125"
    pose = words[words.index("--goal") + 1]
    assert [float(value) for value in pose.split(",")] == pytest.approx(
        [2.0, 0.5, -np.pi / 2], abs=1e-4
    )
    arm = [words[k + 1] for k, word in enumerate(words) if word == "--arm-goal"]
    read = read_goal(goal_of_words(pose, arm))
    values = dict(zip(tiago.moving_joint_names, goal(page)["values"], strict=True))
    assert len(read.joints) > 2
    for name, position in read.joints.items():
        assert position == pytest.approx(values[name], abs=1e-4)
        assert (
            tiago.description.joint[name].lower <= position <= tiago.description.joint[name].upper
        )


def test_page_has_all_of_the_goal_but_no_server(paper: Robot) -> None:
    data = embedded(robot_page(paper, command="rpctl track 'my robot'"))
    assert data["goal"]["command"] == "rpctl track 'my robot'"
    assert data["goal"]["hand"]["link"] == paper.end_effector
    assert data["goal"]["moves"] is True
    assert data["live"] is None
    assert data["goal"]["laws"] == []
    assert str(PoseGoal((1.0, 0.0, 0.0))) == "goal 1,0,0"
