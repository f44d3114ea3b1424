"""The size of a report, and what is taken for a run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh

import rpctl
from rpctl import Run
from rpctl.view.run_folder import BYTES_PER_MB, is_run, report_source, write_folder
from tests.view.samples import mesh_visual, short_run, write_cart

SIZES = (0.3, 0.5)  # m; no two meshes are alike, so each is sent


@pytest.fixture(scope="module")
def fine_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run of a cart with more triangles than anybody can see."""
    folder = tmp_path_factory.mktemp("fine")
    for size in SIZES:
        trimesh.creation.icosphere(6, size).export(folder / f"{size}.stl")
    path = write_cart(folder, "".join(mesh_visual(f"{size}.stl") for size in SIZES))
    return short_run(rpctl.load(path), 0.3)


@pytest.mark.slow
def test_meshes_are_simplified_until_the_report_keeps_its_size(
    fine_run: Run, tmp_path: Path
) -> None:
    free = write_folder(fine_run, tmp_path / "free")
    assert free.report_bytes == (tmp_path / "free/report.html").stat().st_size
    budget = free.report_bytes - 600_000
    written = write_folder(fine_run, tmp_path / "small", budget / BYTES_PER_MB)
    assert written.notes == free.notes == ()
    assert 0.8 * budget < written.report_bytes <= budget
    assert json.loads((tmp_path / "small/summary.json").read_text())["report_bytes"] == (
        written.report_bytes
    )


def test_size_that_cannot_be_kept_is_told(fine_run: Run, tmp_path: Path) -> None:
    written = write_folder(fine_run, tmp_path / "tiny", 0.5)
    (note,) = written.notes
    assert f"{written.report_bytes / BYTES_PER_MB:.2f} MB" in note


def test_a_run_is_told_from_a_robot(paper_run: Run, tmp_path: Path) -> None:
    (tmp_path / "tiago").mkdir()
    assert not is_run(str(tmp_path / "tiago"))
    paper_run.save(tmp_path / "tiago/run.npz")
    assert is_run(str(tmp_path / "tiago"))
    assert is_run(str(tmp_path / "tiago/run.npz"))
    assert is_run("typed/wrongly.npz")
    for robot in ("tiago", "paper", str(tmp_path / "robot.urdf")):
        assert not is_run(robot)


def test_report_is_written_where_there_is_none(paper_run: Run, tmp_path: Path) -> None:
    paper_run.save(tmp_path / "run.npz")
    page = report_source([tmp_path])
    assert page() == (tmp_path / "report.html").read_bytes()
    (tmp_path / "report.html").write_text("kept")
    assert report_source([tmp_path / "run.npz"])() == b"kept"


@pytest.mark.slow
def test_report_of_tiago_is_under_its_size(tmp_path: Path) -> None:
    run = rpctl.track(rpctl.load("tiago"), "eight", duration=20.0)
    assert write_folder(run, tmp_path).report_bytes < 6e6
