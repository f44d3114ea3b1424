"""Damaged files in TOML and CSV: what they ask for, in finite numbers, or messages that name them.

Every case is drawn from a seed; ``make thorough`` draws a hundred times as many.
"""

from __future__ import annotations

import math
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.drive.drive import read_drive
from rpctl.errors import DescriptionError, RpctlError
from rpctl.files import toml
from rpctl.files.records import to_plain
from rpctl.reference.load import load_reference
from rpctl.reference.path_reference import TimedPath
from rpctl.simulation.config import Config, read_config, write_config
from tests.files.mutations import damaged_rows, damaged_table
from tests.grids import cells

PATIENCE = 20  # s; a hang, however slow the machine
ROUND_TRIPS = 9  # one of so many accepted configurations is written and read again
DRIVE = {
    "type": "differential",
    "wheel": [{"joint": "wheel_left_joint", "radius": 0.15}, {"joint": "wheel_right_joint"}],
    "swivel": [{"joint": "caster_joint", "role": "caster", "driven": False}],
}
PATH = {
    "waypoints": [[0.0, 0.0, 0.0], [1.0, 0.2], [2.0, -0.3], [3.0, 0.0]],
    "limits": {"speed": 0.4, "turning_radius": 0.1},
}
ROWS = [["t", "x", "y", "theta"]] + [
    [f"{0.2 * k:.1f}", f"{0.1 * k:.2f}", "0.0", "0.0"] for k in range(9)
]


class Hang(Exception):
    pass


@contextmanager
def patience() -> Iterator[None]:
    def give_up(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcomes(path: Path, count: int, draw: Callable[[Random], bytes], read: Any) -> Counter[str]:
    """Return how many files were read, and how many refused with messages of the right form.

    Args:
        path: Where to write them.
        count: How many.
        draw: Returns a damaged file's bytes.
        read: Reads a file, and asserts what holds of what it gives.
    """
    found: Counter[str] = Counter()
    for seed in range(count):
        path.write_bytes(draw(Random(seed)))
        try:
            with patience():
                read(path)
            found["read"] += 1
        except DescriptionError as error:
            found["refused"] += 1
            for line in str(error).splitlines():
                assert line.startswith(f"{path}"), (seed, line)
                assert line.isprintable(), (seed, line)
        except Exception as error:  # the seed says which file it was
            raise AssertionError(f"seed {seed}: {path.read_bytes()[:2000]!r}") from error
    return found


def laws() -> list[dict[str, Any]]:
    """Return a complete configuration of every law."""
    kinematic = [Config().with_laws(name, None) for name in KINEMATIC_LAWS]
    dynamic = [Config().with_laws(None, name) for name in DYNAMIC_LAWS]
    return [to_plain(config) for config in (*kinematic, *dynamic)]


def read_and_rewrite(path: Path) -> None:
    config = read_config(path)
    for name in ("control_period", "plant_step", "friction", "size", "speed", "laps", "duration"):
        value = getattr(config.run, name)
        assert value is None or math.isfinite(value), name
    if len(path.read_bytes()) % ROUND_TRIPS == 0:
        again = write_config(config, path.with_name("again.toml"))
        assert read_config(again) == config


@pytest.mark.parametrize("count", cells([40, 20_000], [40]))
def test_configurations(count: int, tmp_path: Path) -> None:
    tables = laws()

    def draw(random: Random) -> bytes:
        return damaged_table(random.choice(tables), random)

    found = outcomes(tmp_path / "config.toml", count, draw, read_and_rewrite)
    assert found["read"] and found["refused"], found


@pytest.mark.parametrize("count", cells([40, 20_000], [40]))
def test_drive_files(count: int, tmp_path: Path) -> None:
    def draw(random: Random) -> bytes:
        return damaged_table(DRIVE, random)

    found = outcomes(tmp_path / "drive.toml", count, draw, read_drive)
    assert found["read"] and found["refused"], found


@pytest.mark.parametrize("count", cells([12, 3000], [12]))
def test_paths(count: int, tmp_path: Path, paper: Robot) -> None:
    def draw(random: Random) -> bytes:
        return damaged_table(PATH, random)

    found = outcomes(tmp_path / "path.toml", count, draw, lambda path: follow(paper, path))
    assert found["read"] and found["refused"], found


@pytest.mark.parametrize("count", cells([40, 10_000], [40]))
def test_tables_of_poses(count: int, tmp_path: Path, paper: Robot) -> None:
    def draw(random: Random) -> bytes:
        return damaged_rows(ROWS, random)

    found = outcomes(tmp_path / "poses.csv", count, draw, lambda path: follow(paper, path))
    assert found["read"] and found["refused"], found


def follow(robot: Robot, path: Path) -> None:
    """Read a reference, and assert that it is finite wherever it is asked for."""
    reference = load_reference(robot, str(path))
    assert isinstance(reference, TimedPath)
    assert 0.0 < reference.duration < math.inf
    for t in np.linspace(0.0, reference.duration, 7):
        assert all(np.isfinite(part).all() for part in reference(float(t)) if part is not None)


@pytest.mark.thorough
def test_drives_of_a_robot(tmp_path: Path) -> None:
    def read(path: Path) -> None:
        try:
            robot = rpctl.load("paper", path)
        except DescriptionError:
            raise
        except RpctlError:  # the file is one, but of another robot
            return
        assert all(wheel.radius > 0.0 for wheel in robot.drive.wheels)

    found = outcomes(tmp_path / "drive.toml", 1000, lambda r: damaged_table(DRIVE, r), read)
    assert found["refused"] > 50, found


def test_a_fault_that_is_planted_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the limits before the reader of TOML, the fuzzer finds what they are there for."""
    monkeypatch.setattr(toml, "too_deep_or_long", lambda text: None)
    with pytest.raises(AssertionError, match="seed"):
        outcomes(tmp_path / "a.toml", 200, lambda r: damaged_table(DRIVE, r), read_drive)
