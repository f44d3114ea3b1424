"""The CMakeLists.txt of an exported package, with stand-ins of ament: builds, links, tests."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from rpctl import Robot
from rpctl.derive.ros2_control import export_ros2_control
from tests.derive.ros2_control.builds import HERE, require_compilers


@pytest.mark.slow
def test_cmake_builds_the_plugin_whole_and_runs_the_packages_test(
    paper: Robot, tmp_path: Path
) -> None:
    require_compilers()
    if shutil.which("cmake") is None:
        pytest.skip("no CMake is installed")
    package, stand_ins, build = (tmp_path / name for name in ("package", "ament", "build"))
    export_ros2_control(paper, package)
    stand_ins.mkdir()
    text = (package / "CMakeLists.txt").read_text()
    listed = re.findall(r"set\(DEPENDENCIES\n(.*?)\)", text, re.DOTALL)[0].split()
    for name in (*listed, "ament_cmake", "ament_cmake_test"):
        lines = f"set(NAME {name})", f"set(HEADERS {HERE / 'stand_in'})"
        include = f"include({HERE / 'ament_stand_in.cmake'})"
        (stand_ins / f"{name}-config.cmake").write_text("\n".join((*lines, include)) + "\n")
    flags = ["-DCMAKE_SHARED_LINKER_FLAGS=-Wl,--no-undefined", "-DBUILD_TESTING=ON"]
    flags += ["-DCMAKE_C_FLAGS=-Werror", "-DCMAKE_CXX_FLAGS=-Werror"]
    dirs = [f"-D{name}_DIR={stand_ins}" for name in (*listed, "ament_cmake", "ament_cmake_test")]
    for command in (
        ["cmake", "-S", str(package), "-B", str(build), *flags, *dirs],
        ["cmake", "--build", str(build)],
        ["cmake", "--install", str(build), "--prefix", str(tmp_path / "installed")],
        ["ctest", "--test-dir", str(build), "--no-tests=error"],
    ):
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    installed = {each.name for each in (tmp_path / "installed").rglob("*") if each.is_file()}
    plugin = "libpaper_controller.so"
    assert {plugin, "controller.yaml", "controller.launch.py", "controller.hpp"} <= installed
