"""What a run's file may hold: entries have kinds, and one message names the one at fault."""

from __future__ import annotations

import io
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpctl import Run
from rpctl.arrays import Array
from rpctl.errors import RunFileError
from rpctl.simulation import columns as log_columns
from rpctl.simulation import run_file
from rpctl.simulation.config import config_tables
from rpctl.simulation.older_laws import tables_up_to_5
from rpctl.simulation.recorded import config_of
from rpctl.simulation.run import entries_of
from rpctl.simulation.run_schema import ARRAYS, MAX_NUMBER, META
from tests.run_files import (
    CENTRAL,
    END,
    Parts,
    nested,
    npy,
    with_header,
    with_samples,
    zipped,
)
from tests.simulation.test_run_file import assert_equal

NAN, INF = float("nan"), float("inf")


def refusal(data: bytes, path: Path) -> str:
    """Return why a file is no run, which its one line says behind its name."""
    path.write_bytes(data)
    with pytest.raises(RunFileError) as caught:
        Run.load(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def changed(parts: Parts, change: Callable[[dict[str, Any]], object]) -> bytes:
    """Return a file of which JSON says something else."""
    meta = json.loads(parts.text())
    change(meta)
    return zipped(replace(parts, meta=meta).members())


def put(place: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Return what puts a value at a place: ``drive.wheels.0.radius``."""

    def change(meta: dict[str, Any]) -> None:
        holder: Any = meta
        *path, last = [int(key) if key.isdigit() else key for key in place.split(".")]
        for key in path:
            holder = holder[key]
        holder[last] = value

    return change


def test_parts_put_together_are_the_run(run: Run, parts: Parts, tmp_path: Path) -> None:
    """What follows damages a file that is sound."""
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
        (tmp_path / "run.npz").write_bytes(zipped(parts.members(), method))
        assert_equal(Run.load(tmp_path / "run.npz"), run)


def test_every_entry_of_json_is_of_its_kind(parts: Parts, tmp_path: Path) -> None:
    for name in META:
        text = refusal(changed(parts, put(name, [[True]])), tmp_path / "run.npz")
        assert f'entry "{name}' in text


def test_every_array_has_its_shape(parts: Parts, tmp_path: Path) -> None:
    for name in ARRAYS:
        layout = parts.meta["columns"][name]
        wider = {
            "shape": [len(layout["columns"]) + 2, 1],
            "columns": [[0], [0], *layout["columns"]],
        }
        text = refusal(changed(parts, put(f"columns.{name}", wider)), tmp_path / "run.npz")
        assert f'entry "{name}" does not fit its names' in text


def test_no_entry_is_missing(parts: Parts, tmp_path: Path) -> None:
    for name in ("robot", "bound_limits", "perturbed"):
        text = refusal(changed(parts, lambda meta: meta.pop(name)), tmp_path / "run.npz")  # noqa: B023
        assert f"missing or not known: {name};" in text
    for name in ("t", "slip_range"):
        data = changed(parts, lambda meta: meta["columns"].pop(name))  # noqa: B023
        assert f"missing or not known: {name};" in refusal(data, tmp_path / "run.npz")


WRONG: tuple[tuple[str, Any, str], ...] = (
    ("drive.type", "hovercraft", "one of differential"),
    ("drive.wheels.0.radius", 0.0, "a positive number"),
    ("drive.wheels.0.radius", -0.1, "a positive number"),
    ("drive.wheels.0.axis", [0.0, 1.0], "a list of 3"),
    ("drive.wheels.0.axis.1", NAN, "a finite number"),
    ("drive.wheels.0.driven", 1, "true or false"),
    ("drive.wheels.0.colour", "red", 'has "colour", not known'),
    ("drive.wheels.0", {"joint": "a"}, "lacks axis, radius, source"),
    ("drive.swivels", [{"joint": "a", "role": "x", "pivot": [0, 0]}], "one of steered, follower"),
    ("urdf_sha256", "0" * 63, "64 hexadecimal digits"),
    ("urdf_sha256", "G" * 64, "64 hexadecimal digits"),
    ("urdf", "\ud800", "a text"),
    ("robot", "\udcff", "a text"),
    ("source", "a\0b", "a text of at most"),
    ("robot", "a" * 100_001, "a text of at most"),
    ("locked", {"a": INF}, "a finite number"),
    ("density", 0.0, "a positive number"),
    ("quasi_velocities", ["v"] * 4, "none of them twice"),
    ("units.0", "deg", "one of rad, m"),
    ("units", ["rad"], 'as long as "joint_names": 2'),
    ("effort_limits.0", NAN, "a finite number"),
    ("effort_limits", [1.0], 'as long as "actuators": 4'),
    ("other_limits.0", [0.0, 1.0], "a list of 3"),
    ("contact_points.0", [0.0], "a list of 2"),
    ("axles", [[2]], "of the 2 wheels"),
    ("axles", [[-1]], "a whole number"),
    ("axles", [[0.0]], "a whole number"),
    ("payloads", [["link", 1.0, [0, 0, 0], [[1, 0, 0], [0, 1, 0]]]], "a list of 3"),
    ("payloads", [["link", -1.0, [0, 0, 0], [[0, 0, 0]] * 3]], "a positive number"),
    ("wall_time", 0.0, "a positive number"),
    ("friction", None, "a finite number"),
    ("friction", True, "a finite number"),
    ("certificate.checks.0.residual", "0", "a finite number"),
    ("certificate.checks.0", {"name": "a"}, "lacks against, limit, passed, residual"),
    ("certificate.passed", "yes", "true or false"),
    ("perturbed", {}, "lacks sentence"),
    ("sizing.size", "large", "a finite number"),
    ("config", {"engine": {}}, "is no table of a configuration"),
    ("config.run.control_period", 0.0, "a positive number"),
    ("config.run.control_period", INF, "a finite number"),
    ("config.run.initial_error", [0.0, 0.0], "a list of 3"),
    ("config.kinematic", "x", "is no configuration"),
    ("precision", "half", "must be one of double, single"),
    ("columns", [], 'entry "columns" is []'),
    ("columns.t.columns", [[81]], "one or two of 81 columns"),
    ("columns.t.columns", [[]], "one or two of 81 columns"),
    ("columns.t.columns", [[0, 1, 2]], "one or two of 81 columns"),
    ("columns.q.shape", [9], "the shape of 10 columns"),
    ("notes", nested("deep", 30), "nested deeper than 24"),
    ("notes", nested("deep", 900), "nested deeper than 24"),
)


@pytest.mark.parametrize(("place", "value", "wanted"), WRONG)
def test_what_is_wrong_is_named(
    parts: Parts, tmp_path: Path, place: str, value: Any, wanted: str
) -> None:
    text = refusal(changed(parts, put(place, value)), tmp_path / "run.npz")
    assert wanted in text
    if "nested" not in wanted:
        assert f'entry "{place.split(".")[0]}' in text


def test_right_values_near_wrong_ones_are_right(parts: Parts, tmp_path: Path) -> None:
    """So that no kind refuses what a run may hold."""
    for place, value in (
        ("effort_limits.0", INF), ("density", 1e-300), ("source", "\udcff.urdf"), ("sizing", None),
        ("certificate", None), ("certificate.checks.0.residual", None), ("notes", ["a\nb"]),
        ("kinematic_report", {"lag": NAN}), ("locked", {"a": -1}), ("urdf", "a\udcff"),
        ("payloads", [["link", 1.0, [0, 0, 0], [[0, 0, 0]] * 3]]),
    ):  # fmt: skip
        (tmp_path / "run.npz").write_bytes(changed(parts, put(place, value)))
        found = Run.load(tmp_path / "run.npz")
        assert_equal(Run.load(found.save(tmp_path / "again.npz")), found)


def test_json_is_strict(parts: Parts, tmp_path: Path) -> None:
    columns = parts.members()[1]
    for old, new, wanted in (
        ('"robot": ', '"robot": "x", "robot": ', '"robot" is there twice'),
        ('"wall_time": ', f'"wall_time": {"9" * 19}, "x": ', "a whole number of 19 digits"),
        ('"wall_time": ', f'"wall_time": {"1" * 5000}, "x": ', "a whole number of 5000 digits"),
        ('"wall_time": ', '"wall_time": 1e999, "x": ', "missing or not known: x"),
        ("{", "[{", "is no JSON of a run"),
        ('{"schema"', "[" * 100_000 + '{"schema"', "nested deeper than 24"),
    ):
        text = parts.text().replace(old, new, 1)
        data = zipped([("meta.npy", npy(np.array(text))), columns])
        assert wanted in refusal(data, tmp_path / "run.npz")


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda t: t[:, ::-1], '"t" does not run'),
        (lambda t: t * 0.0, '"t" does not run'),
        (lambda t: np.where(t == t[:, 3], t[:, 4], t), '"t" does not run'),
        (lambda t: np.where(t == t[:, 3], NAN, t), '"t" holds other than finite numbers'),
        (lambda t: np.where(t == t[:, -1], INF, t), '"t" holds other than finite numbers'),
        (lambda t: np.where(t == t[:, -1], 2 * MAX_NUMBER, t), '"t" holds other than finite'),
    ],
)
def test_time_runs(
    parts: Parts, tmp_path: Path, change: Callable[[Array], Array], wanted: str
) -> None:
    assert wanted in refusal(with_samples(parts, "t", change), tmp_path / "run.npz")


def test_time_runs_across_blocks_too(
    parts: Parts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_columns, "BLOCK_BYTES", 4 * 8)
    twice = with_samples(parts, "t", lambda t: np.where(t == t[:, 3], t[:, 4], t))
    assert '"t" does not run' in refusal(twice, tmp_path / "run.npz")


def test_a_run_has_two_samples_or_more(parts: Parts, tmp_path: Path) -> None:
    for rows in (0, 1):
        short = replace(parts, planes=parts.planes[:, :, :rows])
        wanted = f'"t" has {rows} samples; a run has 2 or more'
        assert wanted in refusal(zipped(short.members()), tmp_path / "run.npz")


def test_samples_that_others_need_are_there(parts: Parts, tmp_path: Path) -> None:
    nothing = {"shape": [0], "columns": []}
    for name, other in (("zmp", "tip_margin"), ("contact_load", "tip_margin"), ("ee", "ee_ref")):
        text = refusal(changed(parts, put(f"columns.{name}", nothing)), tmp_path / "run.npz")
        assert f'entry "{name}" has no samples, but "{other}" has' in text


def test_entries_are_those_of_a_run(parts: Parts, tmp_path: Path) -> None:
    meta, columns = parts.members()
    objects = io.BytesIO()
    np.save(objects, np.array([{}], dtype=object), allow_pickle=True)
    header = "{'descr': '|u1', 'fortran_order': False, 'shape': (80, 8, 27), }"
    evil = "__import__('os').system('true')"
    cases: tuple[tuple[list[tuple[str, bytes]], str], ...] = (
        ([meta], "missing or not known: columns"),
        ([columns], "not a run of rpctl"),
        ([meta, columns, columns], 'entry "columns" is there twice'),
        ([meta, meta, columns], 'entry "meta" is there twice'),
        ([meta, columns, ("x.npy", npy(np.zeros(2)))], "missing or not known: x"),
        ([meta, columns, ("../x.npy", b"")], 'entry "../x.npy" is no array'),
        ([meta, columns, ("x.txt", b"")], 'entry "x.txt" is no array'),
        ([meta, ("columns.npy", objects.getvalue())], '"columns": no array of doubles'),
        ([meta, ("columns.npy", with_header(columns[1], evil))], '"columns": no array of doubles'),
        ([meta, ("columns.npy", with_header(columns[1], header))], "its size is not that of its"),
        ([meta, ("columns.npy", columns[1] + b"\0")], "its size is not that of its"),
        ([meta, ("columns.npy", columns[1][:-1])], "its size is not that of its"),
        ([meta, ("columns.npy", b"\x93NUMPY\x01\x00\xff\xff")], "a header of 65535 bytes"),
        ([meta, ("columns.npy", npy(np.zeros(640)))], 'entry "columns": <f8 (640,), not bytes'),
        ([("meta.npy", npy(np.array(["{}"]))), columns], 'entry "meta": no text'),
        ([("meta.npy", npy(np.array("[]"))), columns], '"meta" is no JSON of a run'),
    )
    for members, wanted in cases:
        assert wanted in refusal(zipped(members), tmp_path / "run.npz")
    many = [meta, columns, *((f"x{k}.npy", b"") for k in range(199))]
    assert "201 entries, over 200" in refusal(zipped(many), tmp_path / "run.npz")
    squeezed = zipped([meta, columns], zipfile.ZIP_LZMA)
    assert "encrypted or not deflated" in refusal(squeezed, tmp_path / "run.npz")


def directory_of(count: int) -> bytes:
    """Return a file that is nothing but a directory of as many entries."""
    whole = zipped([("x.npy", b"")])
    start, end = whole.index(CENTRAL), whole.index(END)
    entries = whole[start:end] * count
    sizes = struct.pack("<4s4H2LH", END, 0, 0, count, count, len(entries), start, 0)
    return whole[:start] + entries + sizes


def test_a_file_takes_no_more_memory_than_a_run(
    parts: Parts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sizes are compared before anything is read: zeros deflate to a thousandth."""
    meta, columns = parts.members()
    path, zeros = tmp_path / "run.npz", npy(np.zeros((80, 8, 40_000), np.uint8))
    large = zipped([meta, ("columns.npy", zeros)])
    assert len(large) < 60_000
    wide = {"shape": [3000], "columns": [[0]] * 3000}
    amplified = changed(parts, lambda meta: meta["columns"].update(q=wide, q_ref=wide))
    long = zipped([("meta.npy", npy(np.array("x" * 1_000_000))), columns])
    monkeypatch.setattr(run_file, "MAX_META", 900_000)
    for data, most, wanted in (
        (large, 1_000_000, "bytes, over 1000000; if it is meant, set RPCTL_MAX_RUN_BYTES"),
        (amplified, 1_000_000, "bytes, over 1000000; if it is meant, set RPCTL_MAX_RUN_BYTES"),
        (long, 10_000_000, 'entry "meta": over 900000 characters'),
        (directory_of(50_000), 10_000_000, "a directory of entries that no array file has"),
    ):
        monkeypatch.setenv("RPCTL_MAX_RUN_BYTES", str(most))
        tracemalloc.start()
        try:
            text = refusal(data, path)
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert wanted in text
        assert peak < 3_500_000


def test_older_arrays_of_any_order_come_back(run: Run, tmp_path: Path) -> None:
    said = tables_up_to_5(config_tables(run.config))  # all that its laws stand for in such a file
    run = replace(run, config=config_of(said))
    meta, arrays = entries_of(run)
    text = json.dumps({"schema": 4, **meta}, default=lambda number: number.tolist())
    turned = {name: np.asfortranarray(array) for name, array in arrays.items()}
    np.savez(tmp_path / "run.npz", meta=np.array(text), **turned)  # type: ignore[arg-type]
    assert_equal(Run.load(tmp_path / "run.npz"), run)
