"""Damaged files: a robot whose dynamics are finite, or one message that names the file."""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli import app
from rpctl.errors import RpctlError
from rpctl.robot import catalog
from tests.description.mutations import damage

PATIENCE = 5  # s, for one file
QUICK = {"paper": 200, "mixed_chain": 60, "tiago": 40}
LONG = {"paper": 5000, "mixed_chain": 3500, "tiago": 1500}
SEED = 4


class Hang(Exception):
    pass


@contextmanager
def patience(seconds: int) -> Iterator[None]:
    def give_up(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcome(path: Path) -> str:
    """Return ``"robot"`` or the class of the error; raise where there is anything else."""
    try:
        with patience(PATIENCE):
            robot = rpctl.load(path)
    except RpctlError as error:
        told = str(error)
        assert error.exit_code == 2
        assert str(path) in told
        assert told.isprintable() or "\n" in told
        assert len(told) < 100_000
        assert "Traceback" not in told
        return type(error).__name__
    model, rng = robot.model, np.random.default_rng(0)
    data, q = model.createData(), robot.random_configuration(rng)
    assert np.isfinite(pin.crba(model, data, q)).all()
    v, tau = rng.normal(size=model.nv), rng.normal(size=model.nv)
    assert np.isfinite(pin.aba(model, data, q, v, tau)).all()
    assert np.isfinite(robot.mass)
    return "robot"


def fuzz(name: str, count: int, folder: Path, seed: int) -> Counter[str]:
    original = catalog.find(name).path.read_bytes()
    path, outcomes = folder / f"{name}.urdf", Counter[str]()
    for case in range(count):
        done, data = damage(original, Random(f"{seed} {name} {case}"))
        path.write_bytes(data)
        begin = time.perf_counter()
        try:
            outcomes[outcome(path)] += 1
        except Exception as error:
            raise AssertionError(f"{name}, seed {seed}, case {case}: {done}") from error
        assert time.perf_counter() - begin < PATIENCE, f"{name}, case {case}: {done}"
    return outcomes


@pytest.mark.parametrize("name", QUICK)
def test_damage_is_survived(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    outcomes = fuzz(name, QUICK[name], tmp_path, SEED)
    assert outcomes["robot"] > 0
    assert outcomes["DescriptionError"] > 0
    assert capfd.readouterr() == ("", "")  # nothing leaks from C either


def test_damage_is_told_on_the_command_line(tmp_path: Path) -> None:
    original, path = catalog.find("paper").path.read_bytes(), tmp_path / "paper.urdf"
    codes = Counter[int]()
    for case in range(60):
        done, data = damage(original, Random(f"{SEED} inspect {case}"))
        path.write_bytes(data)
        words = ["inspect", str(path), *["--json", "--strict"][case % 3 : 2]]
        told = CliRunner().invoke(app, words)
        assert told.exception is None or isinstance(told.exception, SystemExit), done
        assert bool(told.stderr) == (told.exit_code == 2), done
        assert bool(told.stdout) == (told.exit_code == 0), done
        codes[told.exit_code] += 1
    assert set(codes) == {0, 2}


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_much_damage_is_survived(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    outcomes = fuzz(name, LONG[name], tmp_path, SEED + 1)
    assert sum(outcomes.values()) == LONG[name]
    assert capfd.readouterr() == ("", "")
