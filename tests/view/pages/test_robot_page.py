"""The page of a robot in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot
from rpctl.dynamics.rolling import constraint, find_rolling
from rpctl.view.pages.robot_page import robot_page
from tests.robots import four_wheels
from tests.view.chromium import changed, covering, opened, picture, wait
from tests.view.samples import BOX, mesh_visual, write_cart, write_gripper

VIEWER = "rpctl.scene.viewer"
EVIL = "&lt;/script>&lt;script>alert(1)&lt;/script>&lt;img src=x onerror=alert(2)>"


def write(robot: Robot, folder: Path) -> str:
    path = folder / "page.html"
    path.write_text(robot_page(robot), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def gripper(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return rpctl.load(write_gripper(tmp_path_factory.mktemp("gripper")), free="*")


@pytest.fixture
def page(browser: Any, gripper: Robot, tmp_path: Path) -> Iterator[Any]:
    with opened(browser, write(gripper, tmp_path)) as page:
        yield page


def drag(page: Any, name: str, value: float) -> None:
    """Move a slider as a hand does: its value changes, and it says so."""
    page.get_by_label(name, exact=True).evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }",
        value,
    )


def world(page: Any, node: str) -> np.ndarray[Any, Any]:
    """Return the pose (4, 4) of a node in our world, z up."""
    elements = page.evaluate(
        "(name) => { const node = rpctl.scene.node(name); node.updateWorldMatrix(true, false);"
        " return node.matrixWorld.elements; }",
        node,
    )
    y_up = np.array(elements).reshape(4, 4).T
    return np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]) @ y_up


def positions(page: Any, robot: Robot) -> dict[str, float]:
    return dict(zip(robot.model.names[2:], page.evaluate("rpctl.values"), strict=True))


@pytest.mark.slow
@pytest.mark.quick
def test_all_joints_stand_where_pinocchio_places_them(page: Any, gripper: Robot) -> None:
    values = {"lift_joint": 0.3, "left_finger_joint": -0.7, "left_wheel_joint": 2.0}
    for name, value in {"x": 0.4, "y": -0.3, "heading": 1.2, **values}.items():
        drag(page, name, value)
    shown = positions(page, gripper)
    assert {name: shown[name] for name in values} == pytest.approx(values)
    q = gripper.configuration(0.4, -0.3, 1.2, joints=shown)
    data = gripper.model.createData()
    pin.forwardKinematics(gripper.model, data, q)
    for j in range(1, gripper.model.njoints):
        assert world(page, f"robot-{j}") == pytest.approx(data.oMi[j].homogeneous, abs=1e-6)


def rolled(robot: Robot, poses: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return by how much the wheels turn as the base goes through poses (n, 3), after A v = 0."""
    rolling = find_rolling(robot)
    rows = list(rolling.along)
    columns = [robot.velocity_index(wheel.joint) for wheel in robot.drive.wheels]
    angles = np.zeros(len(columns))
    for (x, y, theta), step in zip(poses[:-1], np.diff(poses, axis=0), strict=True):
        middle = theta + 0.5 * step[2]
        cos, sin = np.cos(middle), np.sin(middle)
        A = constraint(rolling, robot.configuration(x, y, middle))[rows]
        base = [cos * step[0] + sin * step[1], -sin * step[0] + cos * step[1], step[2]]
        angles += np.linalg.solve(A[:, columns], -A[:, :3] @ base)
    return angles


def turned_cart(folder: Path) -> Robot:
    """Return a cart that drives askew to the axes of its root link."""
    path = write_cart(folder)
    text = path.read_text()
    for old, new in (("0 0.2 0.1", "0.12 0.16 0.1"), ("0 -0.2 0.1", "-0.12 -0.16 0.1")):
        text = text.replace(f'xyz="{old}"', f'xyz="{new}"')
    path.write_text(text.replace('axis xyz="0 1 0"', 'axis xyz="0.6 0.8 0"'))
    return rpctl.load(path)


@pytest.mark.parametrize("kind", [pytest.param("turned", marks=pytest.mark.slow), "mecanum"])
def test_wheels_follow_the_base(browser: Any, kind: str, tmp_path: Path) -> None:
    robot = turned_cart(tmp_path) if kind == "turned" else four_wheels(tmp_path, kind)
    turn = -robot.drive.heading  # the page starts with the robot facing along x
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.6, 0.0, 0.5], [0.6, -0.4, 0.5]])
    corners += [0.0, 0.0, turn]
    poses = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(corners)])
    with opened(browser, write(robot, tmp_path)) as page:
        x, y, heading = page.evaluate("rpctl.base")
        for name, value in (("heading", heading + 0.5), ("x", x + 0.6), ("y", y - 0.4)):
            drag(page, name, value)
        shown = positions(page, robot)
    turns = np.array([shown[wheel.joint] for wheel in robot.drive.wheels]) - rolled(robot, poses)
    assert np.abs(turns - 2 * np.pi * np.round(turns / (2 * np.pi))).max() < 1e-3


@pytest.mark.parametrize(("label", "shown"), [("Masses", 1), ("Wheel contacts", 0)])
def test_layers_show_and_hide(page: Any, label: str, shown: int) -> None:
    page.get_by_label("Names").uncheck()
    before = picture(page, VIEWER)
    box = page.get_by_label(label)
    box.click()
    assert box.is_checked() == bool(shown)
    other = picture(page, VIEWER)
    assert changed(other, before) > 100
    box.click()
    assert changed(picture(page, VIEWER), before) == 0


@pytest.mark.parametrize("width", [1280, 320])
def test_page_fits_its_window_and_nothing_lies_over_the_robot(
    browser: Any, gripper: Robot, tmp_path: Path, width: int
) -> None:
    view = {"width": width, "height": 800}
    with opened(browser, write(gripper, tmp_path), viewport=view) as page:
        for label in ("Frames", "Masses"):
            page.get_by_label(label).check()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert covering(page, "#scene") == []
        scene = page.locator("#scene canvas").bounding_box()
        assert scene is not None
        assert min(scene["width"], scene["height"]) > 250


@pytest.mark.slow
def test_buttons_and_reload(page: Any, gripper: Robot) -> None:
    home = page.evaluate("rpctl.values")
    drag(page, "lift_joint", 0.4)
    drag(page, "heading", 1.0)
    page.reload()
    wait(page, "window.rpctl && window.rpctl.ready")
    assert page.evaluate("rpctl.base[2]") == pytest.approx(1.0)
    assert positions(page, gripper)["lift_joint"] == pytest.approx(0.4)
    page.get_by_role("button", name="All at 0").click()
    assert positions(page, gripper) == pytest.approx(
        {name: 0.1 if name == "right_finger_joint" else 0.0 for name in gripper.model.names[2:]}
    )
    page.get_by_role("button", name="Home").click()
    assert page.evaluate("rpctl.values") == pytest.approx(home)


@pytest.mark.slow
def test_names_from_files_cannot_become_markup(browser: Any, tmp_path: Path) -> None:
    path = write_cart(tmp_path, BOX + mesh_visual(f"{EVIL.replace('/', '')}.stl"), name=EVIL)
    path.write_text(path.read_text().replace("left_wheel", EVIL))
    with opened(browser, write(rpctl.load(path), tmp_path)) as page:
        assert "<img" in page.locator("#sliders").inner_text()
        assert page.locator("img").count() == 0
        assert "onerror" in page.locator("h1").inner_text()


def test_page_holds_no_path_of_the_machine(tmp_path: Path) -> None:
    path = write_cart(tmp_path, BOX + mesh_visual(str(tmp_path / "gone.stl")))
    html = robot_page(rpctl.load(path))
    assert "gone.stl" in html
    assert str(tmp_path) not in html
