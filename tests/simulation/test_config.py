"""The configuration file: what is written comes back, and what is wrong is told, all of it."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl import (
    BoundedDynamic,
    Disc,
    EndEffector,
    Guards,
    HalfPlane,
    Horizon,
    IntegralDynamic,
    Kanayama,
    PaperDynamic,
    PaperKinematic,
    Plant,
    Robot,
    RpctlError,
    Run,
    VelocityOutput,
)
from rpctl.cli.app import app
from rpctl.control.law import KinematicLaw
from rpctl.control.output_groups import OutputGroup
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.errors import DescriptionError, UnknownNameError
from rpctl.files.records import read_record, to_plain
from rpctl.simulation.config import Config, LimitOverrides, RunSettings, read_config, write_config

FULL = Config(
    Kanayama(kx=2.0, ky=9.0),
    IntegralDynamic(gain=4.0, inner=BoundedDynamic(along=0.1, weights={"omega": 3.0})),
    RunSettings(
        "circle", 3.0, (0.1, -0.2, 0.3), control_period=0.004, plant_step=0.001, friction=0.5
    ),
    limits=LimitOverrides(
        effort={"wheel_*": 5.0, "arm_revolute_joint": 7.0}, velocity={"arm_*": 0.5}
    ),
    plant=Plant(
        tau_bias={"wheel_left_joint": 0.5},
        delay=0.008,
        joint_friction={"wheel_right_joint": 0.25},
        lag=0.2,
        lags={"v": 0.3},
        dead_time=0.1,
    ),
    output=VelocityOutput(
        0.1, 0.05, lags={"omega": 0.2}, accelerations={"v": 1.5}, effort_ratio=0.9
    ),
)


TOLD = """
kinematic = {law = "kanayama", kx = 2.0, joint_horizon = 0.3}
dynamic = {law = "paper", horizon_dyn = 0.2}
run = {reference = "circle", size = 0.5, control_period = 0.01, delay = 0.02, duration = 0.2}
limits = {effort = {"wheel_*" = 5.0}}
guards = {effort_rate = 7.0}
"""


@pytest.fixture
def told(tmp_path: Path) -> Path:
    path = tmp_path / "told.toml"
    path.write_text(TOLD)
    return path


def test_a_controller_does_what_the_config_of_a_file_says(paper: Robot, told: Path) -> None:
    by_file = rpctl.Controller(paper, config=told, compiled=False)
    limited = rpctl.set_limits(paper, effort={"wheel_*": 5.0})
    by_hand = rpctl.Controller(
        limited,
        rpctl.load_reference(limited, "circle", size=0.5),
        kinematic=Kanayama(kx=2.0, joint_horizon=0.3),
        dynamic=PaperDynamic(horizon_dyn=0.2),
        period=0.01,
        guards=Guards(effort_rate=7.0),
        delay=0.02,
        compiled=False,
    )
    q, nu = paper.configuration(-0.1, 0.2, 0.3), np.full(paper.dof, 0.05)
    for k in range(3):
        one, other = (each.step(0.01 * k, q, nu) for each in (by_file, by_hand))
        np.testing.assert_array_equal(one.efforts, other.efforts)
    assert by_file.period == 0.01
    assert by_file.robot.effort_limits[0] == 5.0


def test_what_is_given_beside_a_config_wins(paper: Robot, told: Path) -> None:
    given = rpctl.Controller(paper, "line", config=str(told), period=0.005, guards=Guards())
    assert given.period == 0.005
    assert given.guards == Guards()
    run = rpctl.track(paper, "line", told, kinematic="unified", control_period=0.02)
    assert run.config.run.reference == "line"
    assert run.config.run.control_period == 0.02
    assert isinstance(run.config.kinematic, rpctl.UnifiedKinematic)
    assert isinstance(run.config.dynamic, PaperDynamic)
    kept = rpctl.rollout(paper, config=told, kinematic="kanayama", count=1).config(0)
    assert kept.kinematic == Kanayama(kx=2.0, joint_horizon=0.3)  # its name again: its settings


def test_all_that_takes_laws_takes_the_path_of_a_config(paper: Robot, told: Path) -> None:
    runs = rpctl.rollout(paper, config=told, count=2)
    assert runs.config(0).kinematic == Kanayama(kx=2.0, joint_horizon=0.3)
    law = rpctl.derive_law(paper, config=told, kinematic="unified")
    by_hand = rpctl.derive_law(paper, dynamic=PaperDynamic(horizon_dyn=0.2), period=0.01)
    assert law == by_hand != rpctl.derive_law(paper)
    with pytest.raises(RpctlError, match=r"give a rpctl\.Config, or the path of its TOML"):
        rpctl.track(paper, config={"run": {}})  # type: ignore[arg-type]


def test_a_plant_is_what_the_config_says(paper: Robot) -> None:
    config = Config(output=VelocityOutput(lag=0.1))
    plant = rpctl.start_plant(paper, "ideal", config=config)
    sent = rpctl.Controller(paper, "line", config=config).step(*plant.sample)
    assert plant.step(sent, 0.002).t == 0.002
    assert rpctl.start_plant(paper, config=Config(plant=Plant(delay=0.01))).sample.t == 0.0


def test_laws_of_a_config_may_be_names(paper: Robot) -> None:
    named = Config("horizon", "paper")  # type: ignore[arg-type]
    assert named == Config(Horizon(), PaperDynamic())


@pytest.mark.parametrize("config", [FULL, Config()], ids=["full", "default"])
def test_what_is_written_comes_back(config: Config, tmp_path: Path) -> None:
    assert read_config(write_config(config, tmp_path / "config.toml")) == config


def test_every_law_comes_back(tmp_path: Path) -> None:
    for kinematic, dynamic in zip(KINEMATIC_LAWS, cycle(DYNAMIC_LAWS), strict=False):
        config = Config().with_laws(kinematic, dynamic)
        path = write_config(config, tmp_path / "config.toml")
        assert f'law = "{kinematic}"' in path.read_text()
        assert read_config(path) == config


WRONG = """
other = 1
limits = 3
[kinematic]
law = "unified"
horizn = 3
beta = "x"
bend = true
[dynamic]
law = "integral"
gain = -1
inner.weights.v = "a"
[run]
initial_error = [1, 2]
reference = 3
"""


def test_all_that_is_wrong_is_told_with_file_and_key(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(WRONG)
    with pytest.raises(DescriptionError) as caught:
        read_config(path)
    assert str(caught.value).splitlines() == [
        f"{path}:{line}: error: {told}"
        for line, told in zip(
            (2, 3, 6, 7, 8, 12, 11, 14, 15),
            (
                "other: a configuration has no such table; it can have kinematic, dynamic, run, "
                "limits, plant, output and guards",
                "limits: is 3; write [limits]",
                "kinematic.horizn: setting 'horizn' is not known; "
                "did you mean horizon or joint_horizon?",
                "kinematic.beta: is 'x'; give a number",
                "kinematic.bend: is True; give a number",
                "dynamic.inner.weights.v: is 'a'; give a number",
                "dynamic: gain is -1; give a positive number",
                "run.initial_error: is [1, 2]; give 3 numbers, [0.1, ...]",
                "run.reference: is 3; give a text",
            ),
            strict=True,
        )
    ]


def refusal(folder: Path, text: str) -> str:
    """Return why a file of this text is no configuration, after the file's name."""
    path = folder / "config.toml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(DescriptionError) as caught:
        read_config(path)
    told = str(caught.value)
    place, _, fault = told.partition(": error: ")
    assert place.removeprefix(str(path)) in ("", *(f":{k}" for k in range(1, 8)))
    return fault


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[kinematic]\nhorizon = 1", 'kinematic: names no law; write [kinematic], then law = "'),
        ("kinematic = 3", "kinematic: names no law"),
        ('[dynamic]\nlaw = "papr"', "dynamic.law: dynamic law 'papr' is not known; did you mean"),
        ('[dynamic]\nlaw = "integral"\ninner = 2', "dynamic.inner: is 2; write [dynamic.inner]"),
        ("a = ", "not TOML"),
        ("\xff", "not UTF-8"),
    ],
)
def test_a_wrong_file_is_told(text: str, told: str, tmp_path: Path) -> None:
    assert refusal(tmp_path, text).startswith(told)


OBSTACLES = """
[kinematic]
law = "end-effector"
[kinematic.base]
law = "horizon"
[[kinematic.base.base_obstacles]]
shape = "disc"
x = 1.0
y = 0.05
radius = 0.3
[[kinematic.base.base_obstacles]]
shape = "half-plane"
nx = 0
ny = 1
offset = -1
"""


def test_obstacles_come_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(OBSTACLES)
    config = read_config(path)
    base = Horizon(base_obstacles=(Disc(1.0, 0.05, 0.3), HalfPlane(0.0, 1.0, -1.0)))
    assert config == Config(kinematic=EndEffector(base=base))
    assert read_config(write_config(config, tmp_path / "again.toml")) == config


@pytest.mark.parametrize(
    ("there", "told"),
    [
        ('shape = "disk"', "[1].shape: obstacle 'disk' is not known; did you mean disc?"),
        ("x = 1", '[1]: names no shape; write [[kinematic.base_obstacles]], then shape = "disc"'),
        ('shape = "disc"\nx = 1', "[1]: missing: y, radius"),
        ('shape = "disc"\nx = 1\ny = 1\nradius = 0', "[1]: radius of a disc is 0"),
        ('shape = "half-plane"\nnx = 0\nny = 0\noffset = 1', "[1]: length of a half-plane's"),
    ],
)
def test_a_wrong_obstacle_is_told(there: str, told: str, tmp_path: Path) -> None:
    text = f'[kinematic]\nlaw = "horizon"\n[[kinematic.base_obstacles]]\n{there}\n'
    assert refusal(tmp_path, text).startswith(f"kinematic.base_obstacles{told}")


@dataclass(frozen=True)
class _Nested:
    """Settings as a law of laws may have them."""

    fallback: KinematicLaw = field(default_factory=PaperKinematic)
    names: tuple[str, ...] = ()
    radius: float | None = None
    obstacles: tuple[_Nested, ...] = ()


def test_a_law_within_a_law_is_named() -> None:
    nested, faults = _Nested(Kanayama(kx=3.0), ("a", "b"), 0.5), list[str]()
    table = to_plain(nested)
    assert table["fallback"]["law"] == "kanayama"
    assert read_record(_Nested, table, "here", faults) == nested
    assert read_record(_Nested, to_plain(_Nested()), "here", faults) == _Nested()
    several = _Nested(obstacles=(_Nested(radius=1.0), _Nested()))
    assert read_record(_Nested, to_plain(several), "here", faults) == several
    assert not faults
    assert (
        read_record(_Nested, {"obstacles": [1], "fallback": {"law": "x"}}, "here", faults) is None
    )
    assert faults[0] == "here.obstacles[1]: is 1; write [[here.obstacles]]"
    assert faults[1].startswith("here.fallback.law: kinematic law 'x' is not known")


def test_what_no_file_can_say_is_refused() -> None:
    with pytest.raises(RpctlError, match=r"_Nested.names is .*, which a file cannot store"):
        to_plain(_Nested(names=(None,)))  # type: ignore[arg-type]
    with pytest.raises(RpctlError, match="function is none of"):
        write_config(Config(kinematic=lambda *_: None), "never.toml")  # type: ignore[arg-type]


def test_the_law_that_is_named_again_keeps_its_settings() -> None:
    assert FULL.with_laws("kanayama", None) is not FULL
    assert FULL.with_laws("kanayama", "integral") == FULL
    assert FULL.with_laws("paper", None).kinematic == PaperKinematic()
    assert FULL.with_laws(None, "bounded").dynamic == BoundedDynamic()
    assert FULL.with_run(duration=9.0, friction=None).run.duration == 9.0
    with pytest.raises(UnknownNameError, match="did you mean paper"):
        FULL.with_laws("papers", None)


def track(*words: str) -> str:
    result = CliRunner().invoke(app, ["track", "paper", "--samples", "0", *words])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_editors_complete_a_saved_configuration(tmp_path: Path) -> None:
    path = write_config(Config(), tmp_path / "mine.toml", schema=True)
    assert path.read_text().startswith("#:schema ./mine.toml.schema.json\n")
    schema = json.loads((tmp_path / "mine.toml.schema.json").read_text())
    horizon = schema["$defs"]["UnifiedKinematic"]["properties"]["horizon"]
    assert horizon == {
        "type": "number", "minimum": 1e-12, "maximum": 1e12,
        "description": "Prediction time h; default: what period and delay allow. [s]",
    }  # fmt: skip
    run = schema["$defs"]["RunSettings"]
    assert run["properties"]["friction"]["default"] == 0.7 and not run["additionalProperties"]


@pytest.mark.slow
def test_a_saved_configuration_gives_the_same_run(tmp_path: Path) -> None:
    one, two, saved = tmp_path / "one", tmp_path / "two", tmp_path / "saved.toml"
    mine = write_config(FULL, tmp_path / "mine.toml")
    words = ("--duration", "0.2", "--initial-error", "0.3,0,0")
    track("--config", str(mine), *words, "--save-config", str(saved), "--out", str(one))
    track("--config", str(saved), "--out", str(two))
    first, second = Run.load(one / "run.npz"), Run.load(two / "run.npz")
    np.testing.assert_array_equal(first.nu, second.nu)
    np.testing.assert_array_equal(first.tau, second.tau)
    assert first.config == second.config
    assert first.t[-1] == pytest.approx(0.2)
    np.testing.assert_allclose(first.log.e[0, :3], [0.3, 0.0, 0.0], atol=1e-12)
    assert first.config.kinematic == FULL.kinematic
    assert first.config.run.control_period == 0.004
    assert (first.config.limits, first.config.plant) == (FULL.limits, FULL.plant)
    assert first.robot.effort_limits == (5.0, 5.0, 7.0, 120.0)
    assert first.robot.velocity_limits[2:] == (0.5, 0.5)
    assert first.ground.friction == 0.5


def test_limits_are_set_by_pattern() -> None:
    robot = rpctl.load("paper")
    changed = rpctl.set_limits(
        robot, effort={"*": 9.0, "arm_*": 3.0}, velocity={"arm_prismatic_joint": 0.1}
    )
    assert changed.effort_limits.tolist() == [9.0, 9.0, 3.0, 3.0]
    assert [joint.velocity for joint in changed.joints] == [robot.joints[0].velocity, 0.1]
    assert robot.effort_limits.tolist() == [40.0, 40.0, 60.0, 120.0]


def test_groups_of_an_output_are_words_of_an_option_and_tables_of_a_file(tmp_path: Path) -> None:
    config = Config().with_output("base=twist, arm_*=position", lag=0.1)
    assert config.output is not None
    groups = config.output.groups
    assert {name: group.kind for name, group in groups.items()} == {
        "base": "twist",
        "arm_*": "position",
    }
    assert config.output.lag == 0.1
    group = OutputGroup(
        "twist", 0.2, 0.05, speeds={"v": 0.3}, accelerations={}, jerks={"omega": 4.0}
    )
    own = replace(config, output=VelocityOutput(groups={"base": group}))
    read = read_config(write_config(own, tmp_path / "own.toml"))
    assert read == own
    assert read.with_output("base=twist").output == own.output  # what it is keeps its settings
    assert read.with_output("velocity").output == VelocityOutput()
    with pytest.raises(RpctlError, match="each with its kind"):
        config.with_output("base=twist,arm_*")
