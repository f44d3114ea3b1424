"""Both backends of a loop: their numbers agree, and which is taken is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.control import law_kernel
from rpctl.control.baselines import Kanayama
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.horizon.law import Horizon
from rpctl.control.safeguards import Guards
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import DivergedError, UnknownNameError
from rpctl.robot.model import Robot
from rpctl.robot.variation import CarriedLoad
from rpctl.simulation.config import Config, LimitOverrides, RunSettings, read_config
from rpctl.simulation.loop.backend import pays, plant_refusal, refusal
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.settings import Noise, SensorBias, Wrench
from rpctl.simulation.run.run import Run
from tests.grids import cells

SAME = 1e-9  # of what is logged, over 4 s; 1e-11 is what is seen
COLUMNS = ("q", "nu", "tau", "e", "nu_d", "work", "lost")
START = (0.1, -0.1, 0.1)


def both(robot: Robot, config: Config) -> tuple[Run, Run]:
    runs = [simulate(robot, config, collisions=False, backend=x) for x in ("compiled", "pinocchio")]
    return runs[0], runs[1]


def require_same(one: Run, other: Run, tolerance: float = SAME) -> None:
    for name in COLUMNS:
        found, expected = getattr(one.log, name), getattr(other.log, name)
        assert found.shape == expected.shape, name
        apart = np.abs(found - expected).max(initial=0.0)
        assert apart <= tolerance * np.abs(expected).max(initial=1.0), (name, apart)
    assert one.log.bound_limits == other.log.bound_limits
    assert (one.log.active_limits == other.log.active_limits).all()
    assert one.kinematic_report == other.kinematic_report


def test_a_run_is_the_same_whatever_computes_it(paper: Robot) -> None:
    # Limits bind, actuators saturate before, efforts come late and with a bias, the robot carries
    # something, and what is measured is noisy and off.
    plant = Plant(
        tau_bias={paper.actuators[0]: 0.2},
        delay=0.004,
        noise=Noise(position=1e-3, joints=1e-3),
        sensor_bias=SensorBias(heading=0.01, joint_rates=0.02),
        payload=CarriedLoad(mass=2.0, com=(0.0, 0.1, 0.0)),
        slope=(0.05, -0.03),
        effort=0.2,
        seed=3,
    )
    config = Config(run=RunSettings("eight", 0.8, (0.4, -0.4, 0.5)), plant=plant)
    one, other = both(paper, config)
    require_same(one, other)
    assert one.notes == other.notes
    reached = np.abs(other.tau).max(axis=0) / paper.effort_limits
    assert reached.max() == pytest.approx(0.2)
    told: list[tuple[int, int]] = []
    quiet = replace(config, plant=replace(plant, noise=Noise()))
    bare = simulate(
        paper, quiet, backend="compiled", progress=lambda done, total: told.append((done, total))
    )
    assert told == [(400, 400)]
    assert np.abs(bare.log.q - one.log.q).max() > 1e-4


@pytest.mark.parametrize(
    "name",
    cells(
        ["paper", "tiago", "swerve", "car", "casters", "mecanum", "omni", "arm", "skid_steer",
         "tricycle", "bicycle", "twin_casters", "caster_drive", "mixed_chain"],
        slow=["casters"],
    ),
)  # fmt: skip
def test_runs_of_all_drives_are_the_same(name: str) -> None:
    robot = rpctl.load(name)
    start = START if robot.drive.base_speeds else (0.0, 0.0, 0.0)
    one, other = both(robot, Config(run=RunSettings("eight", 4.0, start)))
    require_same(one, other)


@pytest.mark.parametrize("name", cells(["car", "swerve", "tricycle"], slow=["tricycle"]))
def test_a_base_far_away_drives_up_in_both(name: str) -> None:
    robot = rpctl.load(name)
    one, other = both(robot, Config(run=RunSettings("eight", 3.0, (0.8, -0.6, 1.2))))
    require_same(one, other, 1e-6)  # steered far off, rounding grows
    assert one.kinematic_report["approaches"] >= 1


@pytest.mark.parametrize(
    ("law", "dynamic"),
    [
        pytest.param(Kanayama(), BoundedDynamic(midpoint=False), marks=pytest.mark.slow),
        pytest.param(UnifiedKinematic(leash=None), BoundedDynamic(), marks=pytest.mark.thorough),
    ],
    ids=["kanayama", "bare"],
)
def test_other_laws(paper: Robot, law: object, dynamic: BoundedDynamic) -> None:
    config = Config(kinematic=law, dynamic=dynamic, run=RunSettings("circle", 3.0, START))  # type: ignore[arg-type]
    require_same(*both(paper, config))


def test_what_cannot_be_compiled_is_said_and_done_in_python(paper: Robot) -> None:
    config = Config(kinematic=Horizon(), run=RunSettings("line", 0.1))
    run = simulate(paper, config, backend="compiled")
    assert any(
        "ran in Python, not as machine code: the kinematic law Horizon" in note
        for note in run.notes
    )
    assert not simulate(paper, config).notes


@pytest.mark.parametrize(
    ("plant", "reason"),
    [
        (Plant(dropped=0.1), "dropped"),
        (Plant(computing_time=0.001), "computing"),
        (Plant(lag=0.1), "lag"),
        (Plant(effort_lag=0.01), "efforts lag"),
        (Plant(backlash={"*": 0.1}), "backlash"),
        (Plant(encoder_bits=12), "encoders"),
        (Plant(jitter=1e-4), "jitter"),
        (Plant(wrenches=(Wrench("base_link"),)), "pushed"),
    ],
)
def test_plants_that_only_python_has(paper: Robot, plant: Plant, reason: str) -> None:
    assert reason in (refusal(paper, Config(plant=plant)) or "")
    assert refusal(paper, Config()) is None
    free = Plant(payload=CarriedLoad(mass=1.0), losses=2.0, effort=0.5, slope=(0.1, 0.0))
    assert refusal(paper, Config(plant=free)) is None
    assert plant_refusal(Plant(), ["plant.payload.mass", "run.jitter"]) is None
    assert "jitter" in (plant_refusal(Plant(), ["plant.jitter"]) or "")
    assert "every sample" in (refusal(paper, Config(), watched=True) or "")


def test_an_unknown_backend_is_refused(paper: Robot) -> None:
    with pytest.raises(UnknownNameError, match="backend 'fortran'"):
        rpctl.track(paper, "line", duration=0.1, backend="fortran")


def test_short_runs_are_not_worth_building_for(paper: Robot) -> None:
    assert not pays(paper, 50)
    assert pays(paper, 5000)


@pytest.mark.parametrize("asked", ["pinocchio", "auto"])
def test_short_runs_and_those_of_pinocchio_compile_nothing(
    paper: Robot, asked: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compiled(*_: object) -> None:
        raise AssertionError("compiled")

    monkeypatch.setattr("rpctl.simulation.loop.backend._compiled", compiled)
    config = Config(run=RunSettings("line", 0.01))
    assert not simulate(paper, config, collisions=False, backend=asked).notes
    with pytest.raises(AssertionError, match="compiled"):
        simulate(paper, config, collisions=False, backend="compiled")


@pytest.mark.slow
def test_a_loop_that_differs_is_refused(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(law_kernel, "EQUAL", -1.0)
    robot = replace(paper)  # not one whose loop is known already
    run = simulate(robot, Config(run=RunSettings("line", 0.05)), backend="compiled")
    assert any("gives other desired speeds than Pinocchio" in note for note in run.notes)


def test_a_run_that_diverges_ends_at_the_same_sample() -> None:
    """At the usual rate of efforts it does not diverge so soon."""
    arm = rpctl.load("arm")
    hasty = Config(
        dynamic=PaperDynamic(5e-4), run=RunSettings("eight", 1.0), guards=Guards(effort_rate=1e12)
    )
    ends = []
    for backend in ("compiled", "pinocchio"):
        kept: list[Run] = []
        with pytest.raises(DivergedError):
            simulate(arm, hasty, backend=backend, ended=kept.append, collisions=False)
        ends.append(len(kept[0].t))
    assert ends[0] == ends[1]


def test_a_robot_that_is_lost_is_told_and_stopped_in_both(paper: Robot) -> None:
    """Machine code let it go on, and only a controller on a robot stopped it."""
    plant = Plant(tau_bias={"wheel_*": -1.2})
    limits = LimitOverrides({"wheel_*": 1.0})  # less than what pulls it back
    coarse = RunSettings("line", 4.0, control_period=0.01, plant_step=0.01)
    one, other = both(paper, Config(run=coarse, limits=limits, plant=plant))
    require_same(one, other)
    assert "ran in Python, not as machine code: the robot is lost" in one.notes[0]
    assert other.notes[0] in one.notes[1]
    summary = summarize(one)
    assert summary.outcome == "lost"
    assert "at its limits for 2 s, 0.99 m or rad from its reference" in summary.outcome_sentence


def test_a_rate_of_efforts_that_a_file_tells_is_kept(paper: Robot, tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text("[run]\nreference = 'eight'\ninitial_error = [0.3, 0.3, 0.5]\nduration = 0.5\n"
                    "[guards]\neffort_rate = 10.0\n")  # fmt: skip
    one, other = both(paper, read_config(file))
    assert not one.notes
    require_same(one, other)
    efforts = np.vstack([np.zeros(4), one.log.tau])
    leaps = np.abs(np.diff(efforts, axis=0)) / paper.effort_limits
    assert leaps.max() == pytest.approx(10.0 * 0.002)


def test_the_usual_rate_of_efforts_is_kept_in_both(paper: Robot) -> None:
    """Noise of .5 rad/s made them leap by up to 140 % of a limit; the first sample's may."""
    plant = Plant(noise=Noise(joint_rates=0.5), delay=0.004)
    run = RunSettings("eight", 0.8, (0.4, -0.4, 0.5))
    one, other = both(paper, Config(run=run, plant=plant))
    require_same(one, other)
    leaps = np.abs(np.diff(one.log.tau, axis=0)) / paper.effort_limits
    assert leaps[1].max() > 0.25  # from rest to the first that was sent, two samples late
    assert leaps[2:].max() == pytest.approx(100.0 * 0.002)
