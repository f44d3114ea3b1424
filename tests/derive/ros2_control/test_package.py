"""A law as a ROS 2 package: what is written, and that its own test passes, and can fail."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

import rpctl
from rpctl import Robot, UnifiedKinematic
from rpctl.cli.app import app
from rpctl.derive.ros2_control import Ros2Package, export_ros2_control
from rpctl.errors import RpctlError
from tests.derive.ros2_control.builds import PLAIN, compiled
from tests.robots import SET_A, platform, write


@pytest.fixture(scope="module")
def package(paper: Robot, tmp_path_factory: pytest.TempPathFactory) -> Ros2Package:
    return export_ros2_control(paper, tmp_path_factory.mktemp("ros") / "package", delay=0.05)


def test_its_own_test_passes_and_can_fail(package: Ros2Package) -> None:
    """Warnings are errors; a pose that is 1 µm off is noticed. Sanitizers: test_controller.py."""
    source = Path("test/test_samples.cpp")
    test = compiled(package.folder, [source], PLAIN, "test_samples")
    samples = package.folder / "test/samples.txt"
    done = subprocess.run([test, samples], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert float(re.findall(r"difference (\S+) of", done.stdout)[0]) < 1e-11
    x, rest = samples.read_text().split(" ", 1)
    other = package.folder / "other.txt"
    other.write_text(f"{float(x) + 1e-6} {rest}")
    assert subprocess.run([test, other], capture_output=True).returncode == 1
    other.write_text("".join(samples.read_text().splitlines(keepends=True)[1:]))
    assert subprocess.run([test, other], capture_output=True).returncode == 1


def test_names_agree_between_its_files(package: Ros2Package, paper: Robot) -> None:
    """One name for package, plugin and controller; YAML with the robot's limits by joint."""
    folder, name = package.folder, "paper_controller"
    manifest = ET.parse(folder / "package.xml").getroot()
    assert (package.name, manifest.findtext("name")) == (name, name)
    plugin = ET.parse(folder / "plugin.xml").find("class")
    assert plugin is not None
    assert plugin.get("name") == f"{name}/Controller"
    source = (folder / "src/controller.cpp").read_text()
    assert (
        f"PLUGINLIB_EXPORT_CLASS({plugin.get('type')}, {plugin.get('base_class_type')})" in source
    )
    parameters = yaml.safe_load((folder / "config/controller.yaml").read_text())
    assert parameters["controller_manager"]["ros__parameters"]["update_rate"] == 500
    own = parameters[name]["ros__parameters"]
    assert own["type"] == plugin.get("name")
    assert own["limits"] == [40.0, 40.0, 60.0, 120.0]
    declared = set(re.findall(r'auto_declare<.*>\("(\w+)"', source))
    assert declared == set(own) - {"type"}
    cmake = (folder / "CMakeLists.txt").read_text()
    needed = re.findall(r"  (\w+)\n?", re.findall(r"set\(DEPENDENCIES\n(.*?)\)", cmake, re.S)[0])
    assert set(needed) == {each.text for each in manifest.findall("depend")}
    included = set(re.findall(r'#include "(\w+)/', source + read(folder, "controller.hpp")))
    assert included - {name} <= set(needed)
    ast.parse((folder / "launch/controller.launch.py").read_text())


def read(folder: Path, header: str) -> str:
    return (folder / "include/paper_controller" / header).read_text()


def test_its_readme_says_what_was_not_run(package: Ros2Package, paper: Robot) -> None:
    text = (package.folder / "README.md").read_text()
    assert "## What was not run" in text
    assert all(name in text for name in (*paper.actuators, *paper.joint_names))


def test_joints_whose_names_are_no_identifiers_are_quoted(tmp_path: Path) -> None:
    text = platform(SET_A).replace('"left_joint"', '"left &quot;joint&quot; é"')
    robot = rpctl.load(write(tmp_path, text))
    made = export_ros2_control(robot, tmp_path / "package")
    header = (made.folder / f"include/{made.name}/robot.hpp").read_text()
    assert robot.actuators[0] == 'left "joint" é'
    assert r'"left \"joint\" \u00e9"' in header


def test_it_is_written_whole_or_not_at_all(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Path, *_: object, **__: object) -> int:
        raise OSError(28, "No space left on device")

    folder = tmp_path / "package"
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", full)
        with pytest.raises(RpctlError, match="package: cannot be written: No space left"):
            export_ros2_control(paper, folder)
    assert not list(tmp_path.iterdir())
    folder.mkdir()
    with pytest.raises(RpctlError, match="package: is there already; remove it"):
        export_ros2_control(paper, folder)
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    ("robot", "given", "message"),
    [
        ("panda", {}, "panda: its base is fixed; joint_trajectory_controller moves arms"),
        ("paper", {"kinematic": "horizon"}, "Horizon solves a quadratic program"),
        ("paper", {"dynamic": "integral"}, "IntegralDynamic remembers its integral"),
        ("paper", {"output": "twist"}, "output 'twist' is not known; one of: effort, velocity"),
        ("paper", {"period": 0.0}, "period"),
        ("paper", {"delay": -0.01}, "delay is -0.01 s; give a time from 0 to 2 s"),
        (
            "paper",
            {"delay": 0.05, "output": "velocity"},
            "delay is 0.05 s; give a time from 0 to 0",
        ),
        ("paper", {"rates": "guessed"}, "kind of rates 'guessed' is not known"),
    ],
)
def test_what_no_package_is_of_is_refused(
    robot: str, given: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises(RpctlError, match=re.escape(message)):
        export_ros2_control(rpctl.load(robot), tmp_path / "package", **given)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_laws_and_periods_are_the_users(paper: Robot, tmp_path: Path) -> None:
    law = UnifiedKinematic(beta=1.5)
    made = export_ros2_control(paper, tmp_path / "package", law, period=0.01, output="velocity")
    source = (made.folder / "src/law.c").read_text()
    assert "beta = 1.5;" in source
    assert "For a control period of 0.01 s." in source
    parameters = yaml.safe_load((made.folder / "config/controller.yaml").read_text())
    assert parameters["controller_manager"]["ros__parameters"]["update_rate"] == 100
    limits = parameters["paper_controller"]["ros__parameters"]["limits"]
    assert limits == paper.velocity_limits.tolist()


def test_a_told_delay_is_the_parameter_and_leaves_quicker_joints(
    package: Ros2Package, paper: Robot, tmp_path: Path
) -> None:
    """Joints have Ω = .8/(T/2 + 16 ms + .3 δ), h = 11/Ω, h1 = 11/4Ω; the base what it had."""
    horizons, told = {}, {}
    usual_package = export_ros2_control(paper, tmp_path / "package", rates="estimated")
    for delay, folder in ((None, usual_package.folder), (0.05, package.folder)):
        text = (folder / "src/law.c").read_text()
        horizons[delay] = [float(x) for x in re.findall(r" h\w* = ([\d.e-]+);", text)]
        parameters = yaml.safe_load((folder / "config/controller.yaml").read_text())
        own = parameters["paper_controller"]["ros__parameters"]
        told[delay] = own["delay"], own["rates"]
    assert told == {None: (0.0, "estimated"), 0.05: (0.05, "automatic")}
    usual, quick = 11 * 0.051 / 0.8, 11 * 0.032 / 0.8
    assert horizons[None] == pytest.approx([usual, usual, usual, 0.15])
    assert horizons[0.05] == pytest.approx([usual, quick, quick, 0.15, quick / 4])


def test_the_command_refuses_options_of_the_other_format() -> None:
    for words, message in (
        (["--law", "unified"], "--format mjcf has no --law; leave it out"),
        (["--delay", "0"], "--format mjcf has no --delay; leave it out"),
        (["--format", "ros2_control", "--no-meshes"], "--format ros2_control has no --no-meshes"),
    ):
        done = CliRunner().invoke(app, ["export", "paper", *words])
        assert done.exit_code == 2
        assert message in done.stderr


def test_the_command_writes_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["export", "paper", "--format", "ros2_control", "--law", "paper"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    assert "wrote the package paper_controller into paper_controller" in done.stdout
    assert "What was not run" in done.stdout
    assert "the law PaperKinematic" in (tmp_path / "paper_controller/README.md").read_text()
    late = ["--delay", "0.03", "--rates", "measured"]
    told = json.loads(CliRunner().invoke(app, [*words, *late, "--json", "--out", "other"]).stdout)
    parameters = (tmp_path / "other/config/controller.yaml").read_text()
    assert "delay: 0.03 " in parameters
    assert "rates: measured " in parameters
    assert (told["name"], told["folder"]) == ("paper_controller", "other")
    assert told["operations"]["roots"] > 0
