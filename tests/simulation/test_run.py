"""The result file: it comes back as it was, and refuses what it does not understand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import (
    BoundedDynamic,
    Disc,
    EndEffector,
    HalfPlane,
    Horizon,
    IntegralDynamic,
    Plant,
    ReducedDynamics,
    Robot,
    RpctlError,
    Run,
    UnifiedKinematic,
    track,
    verify,
)
from rpctl.arrays import Array
from rpctl.control.law import Command, KinematicFunction
from rpctl.control.unregistered import Unregistered
from rpctl.errors import RunFileError
from rpctl.reference.motion import Reference
from rpctl.simulation.config import Config, RunSettings, config_tables, write_config
from rpctl.simulation.recorded import config_of, recorded, tables_of_settings
from rpctl.simulation.run import ENTRIES, entries_of
from rpctl.simulation.run_file import META_ENTRY
from tests.robot import arms
from tests.robot.test_grippers import SLIDES
from tests.robots import SET_A, platform, write
from tests.runs import vary


@pytest.fixture(scope="module")
def run(paper: Robot) -> Run:
    return track(paper, "eight", 0.2, (0.1, 0.0, 0.0), certificate=verify(paper, samples=1))


def test_it_comes_back_as_it_was(run: Run, tmp_path: Path) -> None:
    back = Run.load(run.save(tmp_path / "run.npz"))
    for entry, (record, name) in ENTRIES.items():
        here, there = (
            getattr(r if record is None else getattr(r, record), name) for r in (run, back)
        )
        if isinstance(here, np.ndarray):
            np.testing.assert_array_equal(here, there)
            with pytest.raises(ValueError, match="read-only"):
                there[...] = 0.0
        else:
            assert here == there, entry
    assert back.certificate is not None
    assert back.certificate["passed"]
    assert list(tmp_path.iterdir()) == [tmp_path / "run.npz"]


def test_limits_that_bound_come_back(paper: Robot, tmp_path: Path) -> None:
    hard = rpctl.scale_limits(paper, effort=0.1)
    run = track(hard, "eight", 0.1, (0.5, 0.3, 0.5), dynamic=rpctl.IntegralDynamic())
    back = Run.load(run.save(tmp_path / "run.npz"))
    assert back.log.bound_limits == run.log.bound_limits
    assert ("wheel_right_joint", "effort") in back.log.bound_limits
    assert back.log.active_limits.any()
    np.testing.assert_array_equal(back.log.active_limits, run.log.active_limits)
    assert back.config.dynamic == rpctl.IntegralDynamic()


@dataclass(frozen=True)
class _Own:
    inner: KinematicFunction
    gains: Any
    least: Any
    around: tuple[Disc, ...]
    odd: object

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        return self.inner(dynamics, reference, t, q, nu)


def test_settings_within_settings_come_back(paper: Robot, tmp_path: Path) -> None:
    """Obstacles, and what a law of one's own may have: NumPy's numbers, a function."""
    inner = UnifiedKinematic(leash=None, approach=None)
    law = _Own(inner, np.array([1, 2]), np.float64(0.5), (Disc(1.0, 2.0, 0.3),), len)
    run = track(paper, "line", 0.1, kinematic=law)
    assert run.config.kinematic == Unregistered(
        "_Own",
        {
            "inner": Unregistered("UnifiedKinematic", vars(inner)),
            "gains": (1, 2),
            "least": 0.5,
            "around": (Disc(1.0, 2.0, 0.3),),
            "odd": Unregistered("len"),
        },
    )
    assert Run.load(run.save(tmp_path / "run.npz")).config == run.config


def test_what_has_no_name_within_a_law_comes_back(paper: Robot, tmp_path: Path) -> None:
    """The rest of the law keeps its types; a plain function is a law."""
    disc, odd = Disc(1.0, 2.0, 0.3), _Blob(2.0)
    base = Horizon(base_obstacles=(disc, odd), fallback=_function)  # type: ignore[arg-type]
    law = EndEffector(base, horizon=0.3)
    plant = Plant({"wheel_left_joint": 1.0}, 0.01, paper)
    config = Config(law, _function, plant=plant)  # type: ignore[arg-type]
    kept = recorded(config, 100)
    blob, function = Unregistered("_Blob", {"size": 2.0}), Unregistered("_function")
    inner = Horizon(base_obstacles=(disc, blob), fallback=function)  # type: ignore[arg-type]
    assert kept.kinematic == EndEffector(inner, horizon=0.3)
    assert kept.dynamic == function
    assert kept.run.duration == pytest.approx(0.2)
    assert kept.plant == Plant({"wheel_left_joint": 1.0}, 0.01)
    assert config_of(json.loads(json.dumps(config_tables(kept)))) == kept
    with pytest.raises(RpctlError, match=r"dynamic.law: dynamic law '_function' is not known"):
        write_config(kept, tmp_path / "config.toml")


@dataclass(frozen=True)
class _Blob:
    size: float


def _function(*_: object) -> Command:
    raise NotImplementedError


def test_a_law_with_a_setting_that_no_file_can_say_is_kept_by_its_class() -> None:
    odd = Config(Horizon(steps=np.int64(10)))  # type: ignore[arg-type]
    kept = recorded(odd, 10)
    assert isinstance(kept.kinematic, Unregistered)
    assert (kept.kinematic.name, kept.kinematic.settings["steps"]) == ("Horizon", 10)
    assert config_of(json.loads(json.dumps(config_tables(kept)))) == kept


def test_a_run_of_the_version_before_comes_back() -> None:
    """Its settings are mappings by class names; the file was written by that version."""
    back = Run.load(Path(__file__).with_name("run_schema_3.npz"))
    horizon = Horizon(
        steps=10,
        base_obstacles=(Disc(2.0, 2.0, 0.3), HalfPlane(0.0, 1.0, -5.0)),
        end_effector_obstacles=(Disc(3.0, 3.0, 0.1),),
        base_radius=0.4,
        fallback=UnifiedKinematic(bend=0.4, joint_horizon=0.65, leash=None, approach=None),
        approach=None,
    )
    bounded = BoundedDynamic(weights={"v": 2.0}, joint_horizon_dyn=0.15, midpoint=False)
    assert back.config == Config(
        horizon,
        IntegralDynamic(gain=8.0, inner=bounded, joint_gain=8.0),
        RunSettings("line", 0.02, (0.1, 0.0, 0.0), 0.005, 0.005, 0.6),
        plant=Plant({"wheel_left_joint": 0.5}, 0.01),
    )
    assert back.controller_model == "paper"
    assert back.kinematic_report == {"solves": 2, "fallbacks": 0, "softened": 0, "largest_lag": 0.0}
    assert back.robot.drive.type == "differential"
    assert back.ground.friction == 0.6
    assert rpctl.summarize(back).limits_violated == ()


def test_older_settings_of_somebodys_own_are_kept_by_name() -> None:
    blob, disc = {"law": "Blob", "mass": 1.0}, {"law": "Disc", "x": 1.0, "y": 2.0, "radius": 0.3}
    base = {"law": "Horizon", "base_obstacles": [disc, blob], "base_radius": None}
    settings = {
        "reference": "eight",
        "kinematic": {"law": "Mine", "base": {"law": "len"}, "around": [disc]},
        "dynamic": {"law": "PaperDynamic", "of_a_version_to_come": 1.0},
    }
    config = config_of(tables_of_settings(settings, 0.5))
    mine = {"base": Unregistered("len"), "around": (Disc(1.0, 2.0, 0.3),)}
    assert config.kinematic == Unregistered("Mine", mine)
    assert config.dynamic == Unregistered("PaperDynamic", {"of_a_version_to_come": 1.0})
    law = config_of(tables_of_settings({"kinematic": base}, 0.5)).kinematic
    obstacles = (Disc(1.0, 2.0, 0.3), Unregistered("Blob", {"mass": 1.0}))
    assert law == Horizon(base_obstacles=obstacles)  # type: ignore[arg-type]


def test_no_arm_comes_back_too(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    back = Run.load(track(robot, "circle", 0.1).save(tmp_path / "run.npz"))
    assert back.log.ee.shape == (len(back.t), 0)
    assert np.isinf(back.robot.effort_limits).all()
    assert back.log.tip_margin.shape == back.log.slip_ratio.shape == (len(back.t), 0)
    assert back.log.zmp.shape == (len(back.t), 2)
    fixed = Run.load(track(rpctl.load("panda"), "eight", 0.1).save(tmp_path / "fixed.npz"))
    assert not (fixed.ground.contacts or fixed.ground.axles or fixed.ground.notes)
    assert fixed.log.zmp.shape == fixed.log.wheel_force.shape == (len(fixed.t), 0)


def altered(run: Run | Path, path: Path, meta: Mapping[str, object], **arrays: Any) -> Path:
    """Write a run as a file of schema 4 with some entries changed; None leaves an entry out."""
    if isinstance(run, Run):
        head, samples = entries_of(run)
        text = json.dumps({"schema": 4, **head}, default=lambda number: number.tolist())
        entries: dict[str, Any] = {META_ENTRY: np.array(text), **samples}
    else:
        with np.load(run, allow_pickle=False) as stored:
            entries = {name: stored[name] for name in stored}
    message = json.loads(str(entries[META_ENTRY])) | meta
    left_out = {name for name, value in meta.items() if value is None}
    entries[META_ENTRY] = np.array(
        json.dumps({k: v for k, v in message.items() if k not in left_out})
    )
    entries.update(arrays)
    np.savez(path, **{name: value for name, value in entries.items() if value is not None})
    return path


def test_what_it_does_not_understand_is_refused_with_the_reason(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    wrong = run.nu.copy()
    wrong[3, 1] = np.nan
    cases: tuple[tuple[dict[str, object], dict[str, Any], str], ...] = (
        ({"schema": 99}, {}, "schema 99, this rpctl reads 2, 3, 4, 5 and 6"),
        ({"schema": 1}, {}, "schema 1, this rpctl reads 2, 3, 4, 5 and 6"),
        ({"notes": None}, {}, "missing or not known: notes"),
        ({}, {"others": run.log.others[:, :1]}, '"others" does not fit its names'),
        ({}, {"other_rates": run.log.others[:, :1]}, '"other_rates" does not fit its names'),
        ({"robot": None}, {}, "missing or not known: robot"),
        ({"colour": "red"}, {}, "missing or not known: colour"),
        ({}, {"tau": None}, "missing or not known: tau"),
        ({}, {"nu": wrong}, '"nu" holds other than finite numbers'),
        ({}, {"nu": run.nu[:5]}, "differing lengths"),
        ({}, {"nu": run.nu[:, :2]}, '"nu" does not fit its names'),
        (
            {},
            {"contact_load": run.log.contact_load[:, :2]},
            '"contact_load" does not fit its names',
        ),
        ({}, {"nu": run.nu.astype(np.float32)}, '"nu": no array of doubles'),
    )
    for meta, arrays, message in cases:
        with pytest.raises(RunFileError, match=message):
            Run.load(altered(run, path, meta, **arrays))


def test_older_runs_come_back_without_what_they_lack(tmp_path: Path) -> None:
    old = Path(__file__).with_name("run_schema_3.npz")
    gone: dict[str, object] = dict.fromkeys(("other_names", "other_limits", "notes"))
    arrays = {"others": None, "other_rates": None}
    path = tmp_path / "run.npz"
    back = Run.load(altered(old, path, {"schema": 2, **gone}, **arrays))
    assert back.log.others.shape == back.log.other_rates.shape == (len(back.t), 0)
    assert (back.robot.other_names, back.robot.other_limits, back.notes) == ((), (), ())
    assert rpctl.summarize(back).limits_violated == ()
    for schema in (2, 3):
        with pytest.raises(RunFileError, match="missing or not known: robot"):
            Run.load(altered(old, path, {"schema": schema, "robot": None}))
        with pytest.raises(RunFileError, match="missing or not known: config"):
            Run.load(altered(old, path, {"schema": schema, "settings": None}))
        with pytest.raises(RunFileError, match=r"initial_error.* is 'far'"):
            Run.load(altered(old, path, {"schema": schema, "settings": {"initial_error": "far"}}))


def test_other_files_are_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="No such file"):
        Run.load(tmp_path / "none.npz")
    text = tmp_path / "text.npz"
    text.write_text("not a run")
    with pytest.raises(RunFileError, match="damaged or not a run"):
        Run.load(text)
    np.savez(tmp_path / "other.npz", x=np.ones(3))
    with pytest.raises(RunFileError, match="not a run of rpctl"):
        Run.load(tmp_path / "other.npz")
    np.save(tmp_path / "array.npy", np.ones(3))
    with pytest.raises(RunFileError, match="not a run of rpctl"):
        Run.load(tmp_path / "array.npy")
    whole = run.save(tmp_path / "run.npz").read_bytes()
    for size in (10, len(whole) // 2, len(whole) - 10):
        (tmp_path / "cut.npz").write_bytes(whole[:size])
        with pytest.raises(RunFileError, match="damaged or not a run"):
            Run.load(tmp_path / "cut.npz")
    objects = np.empty(2, dtype=object)
    np.savez(tmp_path / "pickle.npz", allow_pickle=True, meta=objects)
    with pytest.raises(RunFileError, match="damaged or not a run"):
        Run.load(tmp_path / "pickle.npz")


def test_ranges_come_back_and_older_files_lack_them(run: Run, tmp_path: Path) -> None:
    split = track(rpctl.load("skid_steer"), "eight", 0.2)
    assert split.log.load_range.shape == (len(split.t), 4, 2)
    assert split.log.slip_range.shape == (len(split.t), 2)
    slips = split.log.slip_range.copy()
    slips[3], slips[4] = np.nan, (0.1, np.inf)  # it tips, and a wheel may bear nothing
    path = vary(split, slip_range=slips).save(tmp_path / "run.npz")
    np.testing.assert_array_equal(Run.load(path).log.slip_range, slips)
    np.testing.assert_array_equal(Run.load(path).log.load_range, split.log.load_range)
    old = Run.load(altered(split, path, {}, load_range=None, slip_range=None))
    assert old.log.load_range.shape == old.log.slip_range.shape == (len(old.t), 0)
    np.testing.assert_array_equal(old.log.contact_load, split.log.contact_load)
    for name in ("load_range", "slip_range"):
        wrong: dict[str, Any] = {name: getattr(split.log, name)[:, :1]}
        with pytest.raises(RunFileError, match=f'"{name}" does not fit its names'):
            Run.load(altered(split, path, {}, **wrong))
    assert run.log.load_range.shape == run.log.slip_range.shape == (len(run.t), 0)  # three contacts


def test_a_run_takes_little_room(tiago: Robot, tmp_path: Path) -> None:
    """At most 150 bytes a sample, as 1.5 MB for 20 s, and 50 kB of JSON; ranges 12 % of them."""
    run = track(tiago, "eight", 2.0, (0.1, -0.1, 0.1))
    nothing = np.empty((len(run.t), 0))
    bare = vary(run, load_range=nothing, slip_range=nothing)
    sizes = [each.save(tmp_path / "run.npz").stat().st_size for each in (bare, run)]
    assert sizes[0] < sizes[1] < 1.12 * sizes[0]
    assert sizes[1] < 155 * len(run.t) + 50_000
    single = run.save(tmp_path / "run.npz", "single").stat().st_size
    assert single < 80 * len(run.t) + 50_000


def test_saving_fails_whole(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An older file survives a failed save, and no temporary one stays."""
    path = tmp_path / "run.npz"
    path.write_bytes(b"older")

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(RpctlError, match="No space left on device"):
        run.save(path)
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]
    assert path.read_bytes() == b"older"


def test_a_changed_urdf_is_noticed(tmp_path: Path) -> None:
    path = write(tmp_path, platform(SET_A))
    run = track(rpctl.load(path), "circle", 0.1)
    assert run.load_robot().dof == 2
    path.write_text(path.read_text().replace("30.0", "31.0"))
    older = vary(run, urdf=None, file_sha256=None)
    with pytest.raises(RunFileError, match="the URDF has changed since the run"):
        replace(older, simulated=None).load_robot()


def test_locks_and_the_end_effector_come_back(tmp_path: Path) -> None:
    robot = rpctl.load("tiago", lock={"torso_lift_joint": 0.2}, end_effector="arm_4_link")
    back = replace(track(robot, "eight", 0.05), simulated=None).load_robot()
    assert dict(back.locked) == dict(robot.locked)
    assert back.end_effector == "arm_4_link"


def test_the_robot_of_a_run_has_its_home_and_its_free_joints(tmp_path: Path) -> None:
    path = arms.write(tmp_path, arms.arm(), *SLIDES)
    home = {"rod_2_joint": 0.6}
    robot = rpctl.load(path, "fixed", home=home, free=["l_*"], end_effector="rod_3")
    run = Run.load(track(robot, "eight", 0.01).save(tmp_path / "run.npz"))
    back = run.load_robot()
    assert back.home.tolist() == robot.home.tolist()
    assert back.joint_names == robot.joint_names == run.robot.joint_names
    assert dict(back.locked) == {"r_joint": 0.0}
    assert back.end_effector == "rod_3"


def test_older_runs_have_the_home_and_the_joints_of_their_time(tmp_path: Path) -> None:
    """At zero, stretched as it is there, and with all joints that were not locked."""
    path = arms.write(tmp_path, arms.arm("", arms.AXES), *SLIDES)
    robot = rpctl.load(path, "fixed", home="zero", free="*")
    older = vary(track(robot, "eight", 0.01), home={}, free=())
    back = replace(older, simulated=None).load_robot()
    assert back.joint_names == robot.joint_names
    assert back.home.tolist() == robot.home.tolist()
    assert rpctl.load(path, "fixed").home.tolist() != robot.home.tolist()[:6]
