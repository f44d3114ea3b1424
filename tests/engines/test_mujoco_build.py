"""A robot as MuJoCo's model: its bodies, motors, ties and ground."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rpctl
from rpctl import Robot, RpctlError
from rpctl.drive.steering import follower_positions
from rpctl.engines.mujoco.ground import GROUND
from rpctl.engines.mujoco.settings import ContactSettings, read_heights
from rpctl.engines.mujoco.world import Built, build
from rpctl.equivalence.contact.mujoco_body import mujoco_library
from tests import urdf
from tests.robots import SET_A, ball, free_caster, platform, write

pytest.importorskip("mujoco")

MU = 0.7


def load(folder: Path, *parts: str) -> Robot:
    """Return the platform on a ball, with more parts."""
    return rpctl.load(write(folder, platform(SET_A, extra="\n".join((ball(0.5), *parts)))))


def built(robot: Robot, **settings: Any) -> Built:
    return build(robot, ContactSettings(**settings), MU)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"wheel_width": 0.0}, "wheel_width"),
        ({"wheel_shape": "square"}, "give cylinder or crowned"),
        ({"cone": "cube"}, "give elliptic or pyramidal"),
        ({"caster_friction": -0.1}, "caster_friction"),
        ({"timestep": 0.01}, "less than 20 timesteps"),
        ({"time_constant": float("nan")}, "time_constant"),
        ({"extent": (1.0, 0.0)}, "extent"),
        ({"extent": (1.0,)}, "lengths along x and y"),
        ({"relief": 0.0}, "relief"),
    ],
)
def test_settings_that_mujoco_cannot_take_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(RpctlError, match=said):
        ContactSettings(**given)
    ContactSettings(timestep=0.001, time_constant=0.02)  # exactly 20


def test_an_inertia_that_no_body_has_is_mended_and_told(tmp_path: Path) -> None:
    """Moments 1, 1, 5 break the triangle rule; second moments 2.5, 2.5, −1.5 become 2.5, 2.5, 0."""
    arm = urdf.link("arm", urdf.inertial(2, (1, 1, 5)))
    joint = urdf.joint("shoulder", "continuous", ("base", "arm"), "0 0 0.3", "0 0 1")
    found = built(load(tmp_path, arm, joint))
    (said,) = found.repairs
    assert 'link "arm" (line ' in said
    assert "triangle rule (principal moments 1, 1, 5" in said
    assert "moments 2.5, 2.5, 5 kg·m² are used" in said
    np.testing.assert_allclose(sorted(found.compile().body("arm").inertia), [2.5, 2.5, 5.0])


def test_a_link_that_is_unsound_alone_moves_with_what_it_is_fixed_to(tmp_path: Path) -> None:
    plate = urdf.link("plate", urdf.inertial(0.1, (-1e-5, 1e-4, 1e-4)))
    joint = urdf.joint("plate_joint", "fixed", ("base", "plate"), "0.1 0 0.3")
    robot = load(tmp_path, plate, joint)
    found = built(robot)
    (said,) = found.repairs
    assert 'link "plate" (line ' in said
    assert "not positive definite" in said
    assert 'with the links fixed to "base" the inertia is physical' in said
    inertia = robot.model.inertias[1]
    body = found.compile().body("base")
    R = np.zeros(9)
    mujoco_library().mju_quat2Mat(R, body.iquat)
    axes = R.reshape(3, 3)
    np.testing.assert_allclose(axes @ np.diag(body.inertia) @ axes.T, inertia.inertia, atol=1e-9)
    np.testing.assert_allclose(body.ipos, inertia.lever)


def test_what_weighs_nothing_and_moves_gets_a_little_mass(tmp_path: Path) -> None:
    parts = [
        urdf.link("fork"),
        urdf.joint("swing", "continuous", ("base", "fork"), "0 0 0.3", "0 0 1"),
        urdf.link("tip", urdf.inertial(1, (0.1, 0.1, 0.1))),
        urdf.joint("bend", "continuous", ("fork", "tip"), "0.1 0 0", "0 1 0"),
    ]
    found = built(load(tmp_path, *parts))
    assert 'link "fork" (line ' in found.repairs[0]
    assert "a mass of 0 kg; 1e-06 kg is used" in found.repairs[0]
    assert found.compile().body("fork").mass[0] == 1e-6


def test_the_wheels_are_cylinders_of_the_drives_radius_and_a_given_width(paper: Robot) -> None:
    model = built(paper, wheel_width=0.03).compile()
    kinds = mujoco_library().mjtGeom
    for wheel in paper.drive.wheels:
        geom = model.geom(wheel.joint)
        assert geom.type[0] == kinds.mjGEOM_CYLINDER
        np.testing.assert_allclose(geom.size[:2], [wheel.radius, 0.015])
    crowned = built(paper, wheel_shape="crowned").compile().geom(paper.drive.wheels[0].joint)
    assert crowned.type[0] == kinds.mjGEOM_ELLIPSOID
    np.testing.assert_allclose(crowned.size[:2], paper.drive.wheels[0].radius)
    assert model.geom(GROUND).type[0] == kinds.mjGEOM_PLANE
    assert [model.pair(wheel.joint).friction[0] for wheel in paper.drive.wheels] == [MU, MU]


def test_what_slides_is_without_friction_unless_it_is_given(paper: Robot) -> None:
    slides, rubs = built(paper).compile(), built(paper, caster_friction=0.2).compile()
    assert slides.pair("base_link").dim[0] == 1
    assert rubs.pair("base_link").dim[0] == 3
    assert rubs.pair("base_link").friction[0] == 0.2


def save_npy(path: Path, grid: np.ndarray) -> str:
    np.save(path / "grid.npy", grid)
    return str(path / "grid.npy")


def save_csv(path: Path, grid: np.ndarray) -> str:
    np.savetxt(path / "grid.csv", grid, delimiter=",")
    return str(path / "grid.csv")


def save_png(path: Path, grid: np.ndarray) -> str:
    """Save heights from 0 to 1 m; a picture's first line is the farthest along y."""
    Image.fromarray(np.round(255 * grid[::-1]).astype(np.uint8)).save(path / "grid.png")
    return str(path / "grid.png")


@pytest.mark.parametrize("save", [save_npy, save_csv, save_png])
def test_heights_lie_where_the_file_has_them(
    tmp_path: Path, paper: Robot, save: Callable[[Path, np.ndarray], str]
) -> None:
    grid = np.array([[0.0, 0.2, 0.4], [0.0, 0.2, 1.0]])  # x from −3 to 3, y from −1 to 1
    settings = ContactSettings(heights=save(tmp_path, grid), extent=(6.0, 2.0), relief=0.5)
    heights = read_heights(settings)
    assert heights is not None
    assert heights.highest(3.0, 1.0, 0.1) == pytest.approx(0.5)
    assert heights.highest(-3.0, 1.0, 0.1) == pytest.approx(0.1, abs=1e-3)  # of the next point
    assert heights.highest(40.0, 0.0, 0.1) == 0.0
    model = build(paper, settings, MU).compile()
    mujoco = mujoco_library()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for x, y, height in ((2.99, 0.99, 0.5), (2.99, -0.99, 0.2), (-2.99, 0.5, 0.0)):
        start, down = np.array([x, y, 9.0]), np.array([0.0, 0.0, -1.0])
        distance = mujoco.mj_rayHfield(model, data, model.geom(GROUND).id, start, down)
        distance = distance[0] if isinstance(distance, tuple) else distance
        assert 9.0 - distance == pytest.approx(height, abs=0.01)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.txt", b"1,2", "an unknown kind of file"),
        ("a.csv", b"1,2\n3", "heights of a ground"),
        ("a.csv", b"1,2\n3,nan", "a height is not a number"),
        ("a.csv", b"1,2", "its shape is"),
        ("a.csv", b"1,2\n3,2000", "a height is not a number"),
        ("a.npy", b"nothing", "heights of a ground"),
        ("a.png", b"\x89PNG nothing", "heights of a ground"),
    ],
)
def test_a_file_without_heights_is_refused(
    tmp_path: Path, name: str, data: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(RpctlError, match=said):
        read_heights(ContactSettings(heights=str(tmp_path / name)))


def test_a_missing_mujoco_is_told_with_what_installs_it(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RpctlError, match="run pip install 'mujoco<"):
        built(paper)


def mass_matrix(model: Any) -> np.ndarray:
    """Return M (nv, nv) where all joints are at 0."""
    mujoco = mujoco_library()
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    return M


def test_rollers_leave_the_robots_inertia_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = rpctl.load("mecanum")
    rolling = built(robot).compile()
    monkeypatch.setattr("rpctl.engines.mujoco.ground.has_rollers", lambda robot: False)
    plain = built(robot).compile()
    assert rolling.nv == plain.nv + 4 * 12
    names = [plain.joint(k).name for k in range(1, plain.njnt)]
    there = [*range(6), *(int(rolling.joint(name).dofadr[0]) for name in names)]
    here = [*range(6), *(int(plain.joint(name).dofadr[0]) for name in names)]
    M, whole = mass_matrix(plain)[np.ix_(here, here)], mass_matrix(rolling)[np.ix_(there, there)]
    np.testing.assert_allclose(whole, M, atol=1e-9 * np.abs(M).max())


def test_a_tie_rods_polynomial_holds_over_the_whole_range() -> None:
    robot = rpctl.load("car")
    model = built(robot).compile()
    (leader,), (follower,) = robot.drive.steered, robot.drive.followers
    assert model.neq == 1
    joint = robot.description.joint[leader.joint]
    for angle in np.linspace(joint.lower, joint.upper, 21):
        place = follower_positions(robot.drive, {leader.joint: float(angle)})[follower.joint]
        held = np.polynomial.polynomial.polyval(angle, model.eq_data[0, :5])
        assert held == pytest.approx(place, abs=2e-3)


def test_props_stand_around_p(paper: Robot) -> None:
    model = built(paper, props=True).compile()
    reach, (x, y) = 0.5 * paper.drive.track, paper.drive.point
    places = {tuple(model.geom(f"prop{k}").pos.round(9)) for k in range(4)}
    height = round(paper.drive.ground + 0.02, 9)
    signs = [(a, b) for a in (1, -1) for b in (1, -1)]
    assert places == {(round(x + a * reach, 9), round(y + b * reach, 9), height) for a, b in signs}


def test_a_caster_that_meshes_draw_is_a_ball(tmp_path: Path) -> None:
    """Its axle lies 5 cm above the ground; locked, it slides."""
    roller = free_caster(urdf.shape('mesh filename="roller.stl"', "visual"))
    path = write(tmp_path, platform(SET_A, extra=roller))
    found = built(rpctl.load(path, lock=("swivel", "roller_joint")))
    assert 'caster "roller" has only mesh shapes; a ball of radius 0.05 m is used' in found.notes
    model = found.compile()
    assert model.pair("roller").dim[0] == 1
    np.testing.assert_allclose(model.geom("roller").pos, [0.44, 0.02, 0.05])
