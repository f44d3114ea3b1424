"""Damaged and made-up run files: each is answered by a run that can be used, or by one message."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from rpctl import RpctlError, Run
from rpctl.errors import RunFileError
from rpctl.simulation.merits.summary import summarize
from tests.run_files import Parts, damaged, rewritten
from tests.simulation.run.test_file import assert_equal

SEED = 20_261_122


def opened(path: Path) -> Run | None:
    """Return the run, or None where one line says which file it is that is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return Run.load(path)
    except RunFileError as error:
        text = str(error)
        assert text.startswith(f"{path}: ")
        assert len(text.splitlines()) == 1
        assert len(text) < 1000
        return None


def check_damaged(run: Run, parts: Parts, path: Path, seeds: range) -> int:
    refused = 0
    for seed in seeds:
        path.write_bytes(damaged(parts, random.Random(SEED + seed)))
        try:
            found = opened(path)
        except Exception as error:
            raise AssertionError(f"seed {seed}") from error
        if found is not None:
            assert_equal(found, run)
        refused += found is None
    return refused


def check_rewritten(make: Callable[[random.Random], bytes], path: Path, seeds: range) -> int:
    refused = 0
    for seed in seeds:
        path.write_bytes(make(random.Random(SEED + seed)))
        try:
            found = opened(path)
            if found is not None:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # of numbers near the largest
                    with suppress(RpctlError):  # its robot, or its motion, is none
                        summarize(found)
                        found.to_csv(path.with_suffix(".csv"))
                        assert_equal(Run.load(found.save(path)), found)
        except Exception as error:
            raise AssertionError(f"seed {seed}") from error
        refused += found is None
    return refused


def test_damaged_files_are_the_same_run_or_refused(run: Run, parts: Parts, tmp_path: Path) -> None:
    assert check_damaged(run, parts, tmp_path / "run.npz", range(30)) > 10


def test_made_up_files_are_a_run_or_refused(parts: Parts, tmp_path: Path) -> None:
    assert check_rewritten(partial(rewritten, parts), tmp_path / "run.npz", range(25)) > 10


@pytest.mark.thorough
def test_many_more(run: Run, parts: Parts, tmp_path: Path) -> None:
    check_damaged(run, parts, tmp_path / "run.npz", range(30, 3000))
    check_rewritten(partial(rewritten, parts), tmp_path / "run.npz", range(25, 3000))
