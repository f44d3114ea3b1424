"""The robot of a run that somebody else may have written: from the run, and nothing evaluated."""

from __future__ import annotations

import subprocess
from hashlib import sha256
from pathlib import Path

import pytest

import rpctl
from rpctl import Robot, Run
from rpctl.description.xacro import expansion
from rpctl.errors import RunFileError
from rpctl.robot.model import BASE_NV
from rpctl.simulation.run.run import NOWHERE, has_surroundings, load_robot
from rpctl.view.scene.robot_meshes import build_bodies
from tests.robots import SET_A, platform, write
from tests.runs import vary
from tests.view.samples import mesh_visual, write_cart

CART = "cart.urdf"


def stl(path: Path) -> None:
    """Write a mesh of one triangle."""
    import numpy as np
    import trimesh

    triangle = trimesh.Trimesh(np.eye(3), [[0, 1, 2]], process=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    triangle.export(path)


def saved(robot: Robot, folder: Path) -> Run:
    """Return a short run as it comes back from its file."""
    run = rpctl.track(robot, "circle", duration=0.01)
    return Run.load(run.save(folder / "run.npz"))


def drawn(run: Run, *folders: Path) -> str:
    """Return the notes on what is not drawn of a run's robot."""
    return " ".join(build_bodies(run.load_robot(folders)).notes)


@pytest.fixture
def cart_with_mesh(tmp_path: Path) -> Run:
    """Return the run of a cart whose mesh lies beside its file, in ``tmp_path/home``."""
    home = tmp_path / "home"
    stl(home / "a.stl")
    return saved(rpctl.load(write_cart(home, mesh_visual("a.stl"))), tmp_path)


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return the run of a cart whose file nobody changes."""
    folder = tmp_path_factory.mktemp("sent")
    stl(folder / "a.stl")
    return saved(rpctl.load(write_cart(folder, mesh_visual("a.stl"))), folder)


def test_the_robot_needs_no_file(tmp_path: Path) -> None:
    path = write(tmp_path, platform(SET_A))
    robot = rpctl.load(path, lock={}, home={})
    run = saved(robot, tmp_path)
    path.unlink()
    back = run.load_robot()
    assert back.description.raw == robot.description.raw
    assert (back.name, back.source) == (robot.name, robot.source)
    assert (back.mass, back.actuators, back.nv) == (robot.mass, robot.actuators, robot.nv)
    assert back.nv > BASE_NV


def test_a_changed_file_does_not_change_the_robot_of_a_run(cart_with_mesh: Run) -> None:
    file = Path(cart_with_mesh.robot.source)
    assert drawn(cart_with_mesh) == ""
    file.write_text(file.read_text().replace('mass value="10"', 'mass value="11"'))
    back = cart_with_mesh.load_robot()
    assert back.description.sha256 == cart_with_mesh.robot.urdf_sha256
    assert back.mass == rpctl.load(file).mass - 1.0
    assert not has_surroundings(back)


def test_meshes_are_those_around_the_file_of_the_run_or_where_the_user_says(
    cart_with_mesh: Run, tmp_path: Path
) -> None:
    """Not around whatever file stands at the path that the run names."""
    assert drawn(cart_with_mesh) == ""
    (tmp_path / "home" / CART).write_text("<robot/>")
    assert "a.stl" in drawn(cart_with_mesh)
    assert drawn(cart_with_mesh, tmp_path / "home") == ""
    (tmp_path / "home" / CART).unlink()
    assert "a.stl" in drawn(cart_with_mesh)
    assert drawn(cart_with_mesh, tmp_path / "home") == ""


def test_a_moved_file_is_found_in_a_folder_that_is_declared(
    cart_with_mesh: Run, tmp_path: Path
) -> None:
    moved = (tmp_path / "home").rename(tmp_path / "moved")
    assert "a.stl" in drawn(cart_with_mesh)
    assert drawn(cart_with_mesh, tmp_path, moved) == ""


def test_folders_that_a_run_names_are_not_used(tmp_path: Path) -> None:
    stl(tmp_path / "far" / "parts" / "a.stl")
    (tmp_path / "far" / "parts" / "package.xml").write_text("<name>parts</name>")
    (tmp_path / "home").mkdir()
    path = write_cart(tmp_path / "home", mesh_visual("package://parts/a.stl"))
    run = saved(rpctl.load(path, package_dirs=[tmp_path / "far"]), tmp_path)
    assert run.robot.package_dirs == (str(tmp_path / "far"),)
    assert '"parts" was not found' in drawn(run)
    assert drawn(run, tmp_path / "far") == ""


def test_the_robot_that_was_simulated_here_keeps_its_folders(tmp_path: Path) -> None:
    stl(tmp_path / "far" / "parts" / "a.stl")
    path = write_cart(tmp_path, mesh_visual("package://parts/a.stl"))
    robot = rpctl.load(path, package_dirs=[tmp_path / "far"])
    run = rpctl.track(robot, "circle", duration=0.01)
    assert drawn(run) == ""
    assert run.load_robot() is run.simulated
    assert Run.load(run.save(tmp_path / "run.npz")).simulated is None


@pytest.mark.parametrize(
    "source",
    ["/", "/etc", "/dev/zero", "..", "../cart.urdf", "~/cart.urdf", "cart", "no/such", "/dev/stdin",
     "", "a\0b", "/proc/self/mem", "x" * 5000],
)  # fmt: skip
def test_no_path_in_a_run_is_an_attack(sent: Run, source: str) -> None:
    """The robot is drawn without what no file proves to be its own, whatever the path."""
    back = load_robot(vary(sent, source=source).robot)
    assert back.description.path.parent == NOWHERE
    assert back.source == source
    assert back.mass == sent.load_robot().mass


def test_a_pipe_at_the_path_is_not_waited_for(sent: Run, tmp_path: Path) -> None:
    import os

    os.mkfifo(tmp_path / "pipe.urdf")
    run = vary(sent, source=str(tmp_path / "pipe.urdf"))
    assert not has_surroundings(run.load_robot())


def test_a_run_cannot_claim_another_urdf(sent: Run) -> None:
    urdf = str(sent.robot.urdf)
    with pytest.raises(RunFileError, match="does not match the hash in the run"):
        vary(sent, urdf=urdf.replace('"10"', '"11"')).load_robot()


def test_bytes_of_any_encoding_come_back(tmp_path: Path) -> None:
    """Latin-1, which UTF-8 cannot say: the digest is of the bytes."""
    text = '<?xml version="1.0" encoding="latin-1"?>\n' + platform(SET_A).replace(
        "<robot ", "<!-- Höhe --><robot ", 1
    )
    path = tmp_path / "r.urdf"
    path.write_bytes(text.encode("latin-1"))
    run = saved(rpctl.load(path), tmp_path)
    path.unlink()
    assert run.load_robot().description.raw == text.encode("latin-1")


@pytest.fixture
def refuse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where a process would be started: xacro is expanded in one."""

    def no_process(*words: object, **options: object) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(subprocess, "run", no_process)
    monkeypatch.setattr(subprocess, "Popen", no_process)
    monkeypatch.setattr(expansion, "_ask", no_process)


NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
XACRO = f'<robot name="e" {NAMESPACE}><xacro:include filename="${{1/0}}"/></robot>'


@pytest.mark.usefixtures("refuse")
@pytest.mark.parametrize("name", ["evil.urdf.xacro", "evil.urdf"])
def test_opening_a_run_expands_nothing(sent: Run, tmp_path: Path, name: str) -> None:
    """Neither by its name nor by what it holds."""
    path = tmp_path / name
    path.write_text(XACRO)
    for digest in (sent.robot.urdf_sha256, sha256(XACRO.encode()).hexdigest()):
        hostile = vary(sent, source=str(path), file_sha256=digest)
        assert hostile.load_robot().mass == sent.load_robot().mass


def test_meshes_of_a_xacro_are_found_by_the_digest_of_its_file(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    home = tmp_path / "home"
    stl(home / "a.stl")
    text = write_cart(home, mesh_visual("${'a'}.stl")).read_text()
    path = home / "cart.urdf.xacro"
    path.write_text(text.replace("<robot ", f"<robot {NAMESPACE} "))
    run = saved(rpctl.load(path), tmp_path)
    assert run.robot.file_sha256 == sha256(path.read_bytes()).hexdigest() != run.robot.urdf_sha256
    assert run.load_robot().description.expanded
    assert drawn(run) == ""
    path.write_text(path.read_text() + "<!-- changed -->")
    assert "a.stl" in drawn(run)
