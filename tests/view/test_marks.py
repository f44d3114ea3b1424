"""Which run a file is made of: each keeps the digest, wherever its format has room."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from rpctl import Run
from rpctl.errors import RpctlError
from rpctl.view import film
from rpctl.view.labels import ENDS, comment, digest, mark_of
from rpctl.view.plots.figures import to_pdf, to_png, tracking_figure

RUN = "0123456789abcdef" * 4
PICTURES = [Image.fromarray(np.full((64, 64, 3), 60 * k, np.uint8)) for k in range(3)]


def content(suffix: str, figure: Figure, run: str | None) -> bytes:
    """Return a file of a kind that is made from a run."""
    if suffix in (".png", ".pdf"):
        return to_png(figure, 50, run) if suffix == ".png" else to_pdf(figure, run)
    if suffix == ".mp4":
        pytest.importorskip("av")
    return film.FORMATS[suffix].encode(PICTURES.__getitem__, 3, 10, comment(run))


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".gif", ".mp4"])
def test_a_mark_is_found(suffix: str, golden: Run, tmp_path: Path) -> None:
    path, figure = tmp_path / f"a{suffix}", tracking_figure(golden, panels=["tip"])
    for run in (None, RUN):
        path.write_bytes(content(suffix, figure, run))
        assert mark_of(path) == run


def test_a_mark_is_found_at_either_end_of_a_long_file(tmp_path: Path) -> None:
    path, filling = tmp_path / "a.pdf", b" " * (2 * ENDS)
    for data in (comment(RUN).encode() + filling, filling + comment(RUN).encode()):
        path.write_bytes(data)
        assert mark_of(path) == RUN


@pytest.mark.parametrize(
    "text", ["rpctl-run:0123", f"rpctl-run {RUN}", f"rpctl-runs:{RUN}", RUN, ""]
)  # fmt: skip
def test_what_is_no_mark_is_none(text: str, tmp_path: Path) -> None:
    (tmp_path / "a").write_text(text)
    assert mark_of(tmp_path / "a") is None


def test_only_files_that_end_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    for read in (mark_of, digest):
        for path in (tmp_path / "a.png", tmp_path, Path("/dev/zero")):
            with pytest.raises(RpctlError, match=r"regular file|directory"):
                read(path)
