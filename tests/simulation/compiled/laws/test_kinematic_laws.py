"""The kinematic laws in symbols against Python's, whose ν̇_d is written out by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

import rpctl
from rpctl import Leash, PaperDynamic, ReducedDynamics, Robot, UnifiedKinematic
from rpctl.control.error import tracking_error
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.errors import UnfitLawError
from rpctl.simulation.compiled.laws.kinematic import symbolic_command
from rpctl.simulation.compiled.laws.tracking import reference_width, settings_of, symbols_of
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from tests.grids import cells
from tests.robots import write
from tests.simulation.compiled.laws.law_cases import PERIOD, random_samples, row_of
from tests.vehicles import vehicle

LAWS = {
    "paper": PaperKinematic(),
    "smoothed": PaperKinematic(leash=Leash(0.25, 0.7), smoothing=0.3, joint_horizon=0.4),
    "unified": UnifiedKinematic(approach=None),
    "unified with the paper's sign": UnifiedKinematic(approach=None, leash=None, bend=0.0),
    "kanayama": Kanayama(approach=None),
    "kanayama, off the leash": Kanayama(approach=None, leash=None),
    "linearizing": FeedbackLinearization(approach=None),
    "linearizing, off the leash": FeedbackLinearization(approach=None, leash=None),
}
ROBOTS = ["paper", "mecanum", "tricycle", "swerve", "tiago", "car", "bicycle", "omni"]
ROBOTS += ["caster_drive", "arm", "skid_steer", "twin_casters", "casters", "mixed_chain"]
KINDS = ["parallel", "steered", "car-like", "tricycle", "bicycle", "twin", "omni", "powered"]
GRID = [(robot, law) for robot in ROBOTS for law in LAWS]
QUICK = {("paper", law) for law in ("paper", "unified", "kanayama", "linearizing")}
QUICK |= {("mecanum", "unified"), ("tricycle", "smoothed")}
SLOW = {("swerve", "unified"), ("car", "linearizing"), ("tiago", "kanayama")}
SLOW |= {("omni", "smoothed"), ("bicycle", "paper"), ("arm", "unified")}


def compiled(law: Any, robot: Robot) -> Any:
    """Return a law on a robot as a function of a row, q and ν."""
    dynamics = SymbolicDynamics(robot)
    names, values = settings_of(law, PaperDynamic(), ReducedDynamics(robot), PERIOD)
    row = casadi.SX.sym("row", reference_width(len(robot.joints)))
    q, nu = casadi.SX.sym("q", robot.nq), casadi.SX.sym("nu", robot.dof)
    found = symbolic_command(law, dynamics, row, q, nu, symbols_of(names, casadi.SX(values)))
    parts = [found.e, found.nu_d, found.nu_d_dot, found.failed]
    function = casadi.Function("law", [row, q, nu], parts)
    return lambda state, *at: [x.full().ravel() for x in function(row_of(robot, state), *at)]


def compare(law: Any, robot: Robot, rng: np.random.Generator, count: int = 30) -> None:
    """Compare a law in symbols with Python's."""
    dynamics, function = ReducedDynamics(robot), compiled(law, robot)
    started = law.start(dynamics, PERIOD)
    for sample in random_samples(robot, rng, count):
        q, nu, state = sample.q, sample.nu, sample.state
        e, nu_d, nu_d_dot, failed = function(state, q, nu)
        np.testing.assert_allclose(e, tracking_error(robot, state, q), rtol=1e-12, atol=1e-12)
        try:
            command = started(dynamics, lambda t, now=state: now, 0.0, q, nu)
        except UnfitLawError:
            assert failed[0] == 1.0
            continue
        assert failed[0] == 0.0
        for found, wanted in ((nu_d, command.nu_d), (nu_d_dot, command.nu_d_dot)):
            scale = 1.0 + np.abs(wanted).max()
            np.testing.assert_allclose(found / scale, wanted / scale, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "law"),
    cells(
        GRID,
        QUICK,
        SLOW,
    ),
)
def test_own_robots(name: str, law: str, rng: np.random.Generator) -> None:
    compare(LAWS[law], rpctl.load(name), rng)


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("kind", cells(KINDS, {"parallel"}, {"steered", "twin"}))
def test_vehicles(kind: str, tmp_path: Path, rng: np.random.Generator) -> None:
    """Wheels that mimic one another, and contacts off the steering axis."""
    compare(LAWS["unified"], rpctl.load(write(tmp_path, vehicle(kind))), rng)
