"""The file of a run: plain arrays and one header; each entry is checked before it is believed."""

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

import rpctl
from rpctl import Robot, RpctlError, Run, track
from rpctl.arrays import Array
from rpctl.errors import RunFileError, UnknownNameError
from rpctl.files.records import to_plain
from rpctl.simulation.run import file
from rpctl.simulation.run.file import MAX_NUMBER
from rpctl.simulation.run.log import COLUMNS, KEPT, SINGLE
from tests.run_files import CENTRAL, END, Parts, nested, npy, parts_of, with_header, zipped
from tests.runs import vary

NAN, INF = float("nan"), float("inf")


def assert_equal(first: Run, second: Run, arrays: tuple[str, ...] = KEPT) -> None:
    """Assert that two runs hold the same, bit by bit where a file keeps every bit."""
    here, there = (json.dumps(to_plain(each.header)) for each in (first, second))
    assert here == there
    for name in arrays:
        one, other = getattr(first.log, name), getattr(second.log, name)
        assert one.shape == other.shape, name
        rtol = 2e-7 if COLUMNS[name].kept == SINGLE else 0.0
        np.testing.assert_allclose(other, one, rtol=rtol, atol=1e-44 * (rtol > 0.0), err_msg=name)


def refusal(data: bytes, path: Path) -> str:
    """Return why a file is no run, which its one line says behind its name."""
    path.write_bytes(data)
    with pytest.raises(RunFileError) as caught:
        Run.load(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def changed(parts: Parts, place: str, value: Any) -> bytes:
    """Return a file whose header has a value at a place: ``robot.drive.wheels.0.radius``."""
    header = json.loads(parts.text())
    holder: Any = header
    *path, last = [int(key) if key.isdigit() else key for key in place.split(".")]
    for key in path:
        holder = holder[key]
    if value is KeyError:
        del holder[last]
    else:
        holder[last] = value
    return replace(parts, header=header).whole()


def test_it_comes_back(run: Run, parts: Parts, tmp_path: Path) -> None:
    path = run.save(tmp_path / "run.npz")
    assert list(tmp_path.iterdir()) == [path]
    back = Run.load(path)
    assert_equal(back, run)
    for name in COLUMNS:
        np.testing.assert_allclose(
            getattr(back.log, name), getattr(run.log, name), rtol=1e-6, atol=1e-5, err_msg=name
        )
        with pytest.raises(ValueError, match="read-only"):
            getattr(back.log, name)[...] = 0.0
    figures = ("outcome", "rms_base_error", "settled_base_error", "base_path", "limits_violated")
    here, there = rpctl.summarize(run), rpctl.summarize(back)
    assert all(getattr(here, name) == getattr(there, name) for name in figures)
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
        path.write_bytes(zipped(parts.members(), method))
        assert_equal(Run.load(path), run)


def test_large_arrays_come_back(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More than one read may ask for."""
    monkeypatch.setattr(file, "MAX_READ", 2**19)
    rows = np.random.default_rng(0).normal(size=(30_000, *run.q.shape[1:]))
    arrays = {name: np.repeat(a[:1], len(rows), axis=0) for name, a in run.log.arrays().items()}
    times = np.arange(float(len(rows)))
    long = replace(run, log=run.log.changed({**arrays, "q": rows, "t": times}))
    np.testing.assert_array_equal(Run.load(long.save(tmp_path / "run.npz")).q, rows)


def test_numpy_alone_reads_it(run: Run, tmp_path: Path) -> None:
    with np.load(run.save(tmp_path / "run.npz"), allow_pickle=False) as stored:
        assert set(stored) == {"header", "energy", *KEPT}
        header = json.loads(bytes(stored["header"]))
        np.testing.assert_array_equal(stored["q"], run.q)
        assert stored["tau"].dtype == np.float32
    assert header["robot"]["name"] == "paper"
    assert header["config"]["run"]["reference"] == "eight"


def test_no_effort_exceeds_its_limit_by_rounding(run: Run, tmp_path: Path) -> None:
    tau = np.where(run.tau >= 0.0, 0.3, -0.7)
    back = Run.load(vary(run, tau=tau).save(tmp_path / "run.npz"))
    assert (np.abs(back.tau) <= np.abs(tau)).all()
    np.testing.assert_allclose(back.tau, tau, rtol=2e-7)


def test_single_precision_has_seven_digits_of_all_but_the_time(run: Run, tmp_path: Path) -> None:
    double = run.save(tmp_path / "double.npz")
    single = run.save(tmp_path / "single.npz", "single")
    back = Run.load(single)
    np.testing.assert_array_equal(back.t, run.t)
    for name in (*KEPT, "e", "energy"):
        here = getattr(run.log, name)
        np.testing.assert_allclose(getattr(back.log, name), here, rtol=2e-7, atol=1e-44)
    assert single.stat().st_size < 0.95 * double.stat().st_size
    large = vary(run, work=np.full(len(run.t), 1e39))
    with pytest.raises(RpctlError, match='"work" is too large for single precision'):
        large.save(tmp_path / "large.npz", "single")
    with pytest.raises(UnknownNameError, match="precision 'half' is not known"):
        run.save(tmp_path / "half.npz", "half")
    assert len(list(tmp_path.iterdir())) == 2


def test_what_no_header_brings_back_stands_in_the_file(paper: Robot, tmp_path: Path) -> None:
    """A robot that was changed in Python: its forces are not those of its file."""
    heavy = track(rpctl.scale_masses(paper, "arm_*", 3.0), "eight", duration=0.05)
    assert not heavy.robot.rebuilds
    back = Run.load(heavy.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(back.log.contact_load, heavy.log.contact_load)
    np.testing.assert_array_equal(back.log.energy, heavy.log.energy)


@pytest.mark.slow
def test_a_run_takes_little_room(tiago: Robot, tmp_path: Path) -> None:
    """At most 4 MB for 20 s of TIAGo, as 400 bytes a sample and 40 kB of header."""
    run = track(tiago, "eight", duration=1.0, initial_error=(0.1, -0.1, 0.1))
    assert run.save(tmp_path / "run.npz").stat().st_size < 395 * len(run.t) + 40_000


def test_every_member_and_array_is_checked(parts: Parts, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    for name in parts.header.keys() - {"schema"}:
        text = refusal(changed(parts, name, [[True]]), path)
        assert f"header.{name}" in text
    for name, array in parts.arrays.items():
        flat = array.reshape(len(array), -1)
        wider = np.hstack([flat, np.zeros((len(flat), 1))])
        text = refusal(parts.changed(**{name: wider}).whole(), path)
        assert f'entry "{name}" does not fit its names' in text
        if name in KEPT:
            text = refusal(parts.changed(**{name: None}).whole(), path)
            assert f"missing or not known: {name};" in text
    for name in ("robot", "config", "wall_time"):
        assert f"missing: {name}" in refusal(changed(parts, name, KeyError), path)


WRONG: tuple[tuple[str, Any, str], ...] = (
    ("schema", 99, "schema 99, this rpctl reads 7"),
    ("schema", None, "schema None, this rpctl reads 7"),
    ("colour", "red", "header.colour: setting 'colour' is not known"),
    ("robot.drive.type", "hovercraft", "give differential"),
    ("robot.drive.wheels.0.radius", 0.0, "positive numbers"),
    ("robot.drive.wheels.0.axis", [0.0, 1.0], "wheels[1].axis"),
    ("robot.drive.wheels.0.axis.1", NAN, "must be a finite number"),
    ("robot.drive.wheels.0.driven", 1, "true or false"),
    ("robot.drive.wheels.0.colour", "red", "setting 'colour' is not known"),
    ("robot.drive.wheels.0", {"joint": "a"}, "missing: radius, source, axis"),
    ("robot.drive.swivels", [{"joint": "a", "role": "x", "pivot": [0, 0]}], "none of steered"),
    ("robot.urdf_sha256", "0" * 63, "64 hexadecimal digits"),
    ("robot.urdf", "\ud800", "must be a text"),
    ("robot.name", "\udcff", "must be a text"),
    ("robot.source", "a\0b", "must be a text"),
    ("robot.name", "a" * 100_001, "a text of at most"),
    ("robot.locked", {"a": INF}, "must be a finite number"),
    ("robot.density", 0.0, "positive numbers"),
    ("robot.quasi_velocities", ["v"] * 4, "a list of distinct names"),
    ("robot.units.0", "deg", "give one of rad, m"),
    ("robot.units", ["rad"], "as long as joint_names"),
    ("robot.effort_limits.0", NAN, "must be a finite number"),
    ("robot.effort_limits", [1.0], "as long as actuators"),
    ("robot.other_limits.0", [0.0, 1.0], "robot.other_limits"),
    ("robot.payloads", [["link", 1.0, [0, 0, 0], [[1, 0, 0], [0, 1, 0]]]], "inertias (3, 3)"),
    ("robot.payloads", [["link", -1.0, [0, 0, 0], [[0, 0, 0]] * 3]], "positive numbers"),
    ("robot.nq", 9, '"q" does not fit its names'),
    ("ground.points.0", [0.0], "ground.points"),
    ("ground.axles", [[2]], "of the 2 wheels"),
    ("ground.axles", [[-1]], "of the 2 wheels"),
    ("ground.axles", [[0.5]], "a whole number"),
    ("ground.friction", None, "a number"),
    ("ground.friction", True, "a number"),
    ("wall_time", 0.0, "no positive number"),
    ("certificate", "yes", "header.certificate"),
    ("perturbed", {}, "has no sentence"),
    ("config", {"engine": {}}, "engine"),
    ("config.run.control_period", 0.0, "a positive number"),
    ("config.run.initial_error", [0.0, 0.0], "config.run.initial_error"),
    ("config.kinematic", "x", "config.kinematic"),
    ("notes", nested("deep", 30), "nested deeper than 24"),
    ("notes", nested("deep", 900), "nested deeper than 24"),
)


@pytest.mark.parametrize(("place", "value", "wanted"), WRONG)
def test_what_is_wrong_is_named(
    parts: Parts, tmp_path: Path, place: str, value: Any, wanted: str
) -> None:
    assert wanted in refusal(changed(parts, place, value), tmp_path / "run.npz")


def test_right_values_near_wrong_ones_are_right(parts: Parts, tmp_path: Path) -> None:
    """So that no check refuses what a run may hold."""
    for place, value in (
        ("robot.effort_limits.0", INF), ("robot.density", 1e-300), ("sizing", None),
        ("robot.source", "\udcff.urdf"), ("certificate", None), ("notes", ["a\nb"]),
        ("kinematic_report", {"lag": NAN}), ("robot.locked", {"a": -1}), ("robot.urdf", "a\udcff"),
        ("robot.payloads", [["link", 1.0, [0, 0, 0], [[0, 0, 0]] * 3]]),
    ):  # fmt: skip
        (tmp_path / "run.npz").write_bytes(changed(parts, place, value))
        assert Run.load(tmp_path / "run.npz").robot.actuators


def test_json_is_strict(parts: Parts, tmp_path: Path) -> None:
    for old, new, wanted in (
        ('"robot": ', '"robot": "x", "robot": ', '"robot" occurs twice'),
        ('"wall_time": ', f'"wall_time": {"9" * 19}, "x": ', "a whole number of 19 digits"),
        ('"wall_time": ', f'"wall_time": {"1" * 5000}, "x": ', "a whole number of 5000 digits"),
        ('"wall_time": ', '"wall_time": 1e999, "x": ', "must be a finite number"),
        ("{", "[{", "not JSON of a run"),
        ('{"schema"', "[" * 100_000 + '{"schema"', "nested deeper than 24"),
    ):
        text = parts.text().replace(old, new, 1)
        assert wanted in refusal(parts.whole(text), tmp_path / "run.npz")


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda t: t[::-1], '"t" does not increase'),
        (lambda t: t * 0.0, '"t" does not increase'),
        (lambda t: np.where(t == t[3], t[4], t), '"t" does not increase'),
        (lambda t: np.where(t == t[3], NAN, t), '"t" has numbers that are not finite'),
        (lambda t: np.where(t == t[-1], 2 * MAX_NUMBER, t), '"t" has numbers that are not finite'),
    ],
)
def test_time_runs(
    parts: Parts, tmp_path: Path, change: Callable[[Array], Array], wanted: str
) -> None:
    data = parts.changed(t=change(parts.arrays["t"])).whole()
    assert wanted in refusal(data, tmp_path / "run.npz")


def test_a_run_has_two_samples_or_more(parts: Parts, tmp_path: Path) -> None:
    for rows in (0, 1):
        short = parts.changed(**{name: array[:rows] for name, array in parts.arrays.items()})
        wanted = f'"t" has {rows} samples; a run has 2 or more'
        assert wanted in refusal(short.whole(), tmp_path / "run.npz")
    short = parts.changed(nu=parts.arrays["nu"][:5])
    assert "differing lengths" in refusal(short.whole(), tmp_path / "run.npz")


def test_samples_that_others_need_are_there(paper: Robot, tmp_path: Path) -> None:
    parts = parts_of(
        track(rpctl.scale_masses(paper, "arm_*", 3.0), "eight", duration=0.02), tmp_path
    )
    nothing = np.empty((len(parts.arrays["t"]), 0))
    for name, other in (("zmp", "tip_margin"), ("contact_load", "tip_margin"), ("ee", "ee_ref")):
        text = refusal(parts.changed(**{name: nothing}).whole(), tmp_path / "run.npz")
        assert f'entry "{name}" has no samples, but "{other}" has' in text


def test_a_robot_that_is_not_the_one_that_was_simulated_is_told(
    parts: Parts, tmp_path: Path
) -> None:
    names = [*parts.header["robot"]["quasi_velocities"][:-1], "another"]
    (tmp_path / "run.npz").write_bytes(changed(parts, "robot.quasi_velocities", names))
    run = Run.load(tmp_path / "run.npz")
    assert run.q.size
    with pytest.raises(RunFileError, match="its samples are not those of its robot"):
        rpctl.summarize(run)


def test_entries_are_those_of_a_run(parts: Parts, tmp_path: Path) -> None:
    header, t, q, *rest = parts.members()
    objects = io.BytesIO()
    np.save(objects, np.array([{}], dtype=object), allow_pickle=True)
    evil = "__import__('os').system('true')"
    taller = "{'descr': '<f8', 'fortran_order': False, 'shape': (80, 27), }"
    cases: tuple[tuple[list[tuple[str, bytes]], str], ...] = (
        ([header, t, q], "missing or not known: active_limits, base_ref"),
        ([t, q, *rest], "not a run of rpctl"),
        ([header, t, q, q, *rest], 'entry "q" occurs twice'),
        ([header, header, t, q, *rest], 'entry "header" occurs twice'),
        ([header, t, q, *rest, ("x.npy", npy(np.zeros(26)))], "missing or not known: x"),
        ([header, t, q, ("../x.npy", b"")], 'entry "../x.npy" is not an array'),
        ([header, t, q, ("x.txt", b"")], 'entry "x.txt" is not an array'),
        ([header, t, ("q.npy", objects.getvalue())], '"q" is not an array of numbers'),
        ([header, t, ("q.npy", with_header(q[1], evil))], '"q" is not an array of numbers'),
        ([header, t, ("q.npy", with_header(q[1], taller))], "its size is not that of its"),
        ([header, t, ("q.npy", q[1] + b"\0")], "its size is not that of its"),
        ([header, t, ("q.npy", q[1][:-1])], "its size is not that of its"),
        ([header, t, ("q.npy", b"\x93NUMPY\x01\x00\xff\xff")], "not an array of numbers"),
        ([("header.npy", npy(np.zeros(3))), t, q, *rest], 'entry "header" is not an array'),
        ([("header.npy", npy(np.array("{}"))), t, q, *rest], 'entry "header" is not an array'),
        ([("header.npy", npy(np.frombuffer(b"[]", np.uint8))), t, q], "not JSON of a run"),
    )
    for members, wanted in cases:
        assert wanted in refusal(zipped(members), tmp_path / "run.npz")
    many = [header, t, q, *((f"x{k}.npy", b"") for k in range(198))]
    assert "201 entries, over 200" in refusal(zipped(many), tmp_path / "run.npz")
    squeezed = zipped(parts.members(), zipfile.ZIP_LZMA)
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
    header, t, _, *rest = parts.members()
    path, zeros = tmp_path / "run.npz", npy(np.zeros((80, 40_000)))
    large = zipped([header, t, ("q.npy", zeros), *rest])
    assert len(large) < 90_000
    long = zipped([("header.npy", npy(np.zeros(1_000_000, np.uint8))), t, *rest])
    monkeypatch.setattr(file, "MAX_HEADER", 900_000)
    for data, most, wanted in (
        (large, 1_000_000, "bytes, over 1000000; to allow it, set RPCTL_MAX_RUN_BYTES"),
        (long, 10_000_000, 'entry "header": over 900000 bytes'),
        (directory_of(50_000), 10_000_000, "a table of contents that is not that of an array file"),
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
