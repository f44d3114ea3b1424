"""An exported package, compiled against the stand-ins of ROS, and driven."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from rpctl import Robot
from rpctl.derive.ros2_control import package_name

HERE = Path(__file__).parent
C = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
STRICT = ["-std=c++17", *C[1:], "-Wshadow", "-Wconversion"]
SANITIZED = ["-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
FAST = ["-O2"]
PLAIN = ["-O0"]  # compiled in two fifths of the time of SANITIZED


def require_compilers() -> None:
    for name in ("cc", "c++"):
        if shutil.which(name) is None:
            pytest.skip(f"no compiler {name} is installed")


def compiled(folder: Path, sources: Sequence[Path | str], flags: list[str], program: str) -> Path:
    """Compile a package's C and some files of C++; return the program."""
    require_compilers()
    laws = ["src/law.c", "src/model.c", "src/estimate.c"]
    subprocess.run(["cc", *C, *flags, "-c", *laws], cwd=folder, check=True)
    command = ["c++", *STRICT, *flags, "-Iinclude", f"-I{HERE}", f"-I{HERE / 'stand_in'}"]
    files = [*map(str, sources), "law.o", "model.o", "estimate.o"]
    subprocess.run([*command, *files, "-o", program, "-lm"], cwd=folder, check=True)
    return folder / program


@dataclass(frozen=True)
class Driven:
    """An exported controller on stand-ins of ROS; see driver.cpp for what it obeys."""

    program: Path
    name: str

    def obey(self, lines: Sequence[str]) -> tuple[list[str], str]:
        """Return the lines that it prints, after those of its start, and its complaints."""
        first = [f"start {self.name} 500", "parameter odometry_topic = ~/odometry"]
        text = "\n".join([*first, *lines]) + "\n"
        done = subprocess.run([self.program], input=text, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        started, *said = done.stdout.splitlines()
        assert started == "1"
        return said, done.stderr


def driven(robot: Robot, folder: Path, flags: list[str], program: str, period: float) -> Driven:
    """Compile the controller of a package with its driver."""
    name = package_name(robot)
    facts = {
        "HEADER": f'"{name}/controller.hpp"',
        "ROOT": f'"{robot.description.root}"',
        "KPERIOD": period,
    }
    defined = [f"-D{word}={value}" for word, value in facts.items()]
    counted = [] if flags == SANITIZED else ["-DCOUNTED"]
    sources: list[Path | str] = [HERE / "driver.cpp", "src/controller.cpp"]
    own = [*flags, *defined, *counted]
    return Driven(compiled(folder, sources, own, program), name)
