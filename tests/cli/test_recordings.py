"""Recorded references on the command line: told before the run, refused if that is wanted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.description.test_shell import rpctl


@pytest.mark.slow
def test_what_a_table_asks_too_much_is_refused_if_that_is_wanted(tmp_path: Path) -> None:
    t = np.arange(0.0, 4.0, 0.1)
    rows = np.column_stack([t, 0.1 * t, 0.01 * np.random.default_rng(0).normal(size=len(t))])
    path, out = tmp_path / "a.csv", tmp_path / "out"
    np.savetxt(path, rows, delimiter=",", header="t,x,y", comments="")
    words = ("track", "paper", "--reference", str(path), "--samples", "0", "--out", str(out))
    code, said, err = rpctl(*words, "--strict")
    told = " ".join(err.split())
    assert (code, "tracking error" in said) == (2, False)
    assert "the reference asks too much: wheel_" in told
    assert "times that, at" in told
    assert "--smooth auto" in told
    assert not out.exists() or not list(out.iterdir())
    code, said, err = rpctl(*words, "--smooth", "much")
    assert (code, "--smooth much: give metres, as 0.01, or auto" in err) == (2, True)
