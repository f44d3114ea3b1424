"""A recorder that is given whole batches, or computes what it can when it is read."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.control.law import Limit
from rpctl.reference.motion import state_of, tabulate
from rpctl.reference.named import reference_by_name
from rpctl.simulation.config import Config
from rpctl.simulation.loop import recorder as recorder_module
from rpctl.simulation.loop.recorder import LoopSample, Recorder, Samples
from rpctl.simulation.run import derived
from rpctl.simulation.run.derived import Derivation
from rpctl.simulation.run.log import COLUMNS, Log

COUNT, PERIOD = 45, 0.05
SETS = ((), (Limit("a", "effort"),), (Limit("a", "effort"), Limit("b", "velocity")))
ROUNDING = 1e-13  # matrix products of other sizes may add in another order


@pytest.fixture(scope="module", params=["paper", "skid_steer"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return rpctl.load(request.param)


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "BATCH", 8)


def samples_of(robot: Robot) -> Samples:
    """Return samples near a reference, about which limits bind now and then."""
    rng, t = np.random.default_rng(3), PERIOD * np.arange(float(COUNT))
    table = tabulate(robot, reference_by_name(robot, "circle", collisions=False), t)
    q = np.array([robot.configuration_at(*row) for row in zip(*table.state[:4:3])])  # noqa: B905
    columns = {
        name: rng.normal(size=(COUNT, n))
        for name, n in (("nu", robot.dof), ("tau", len(robot.actuators)), ("nu_d", robot.dof))
    }
    columns |= {"q": q, "nu_cmd": np.empty((COUNT, 0)), "work": 0.1 * t, "lost": 0.05 * t}
    return Samples(table, columns, np.arange(float(COUNT)) // 7 % 3)


def recorder(robot: Robot, every: int = 1, **how: object) -> Recorder:
    config = Config(plant=Plant(tau_bias={"*": 0.1}))
    derivation = Derivation(ReducedDynamics(robot), config)
    return Recorder(derivation, COUNT - 1, every, **how)  # type: ignore[arg-type]


def add(into: Recorder, samples: Samples, k: int) -> None:
    """Add a sample alone."""
    columns = {name: each[k] for name, each in samples.columns.items()}
    t, state = float(samples.reference.t[k]), state_of(samples.reference.rows[k])
    limits = SETS[int(samples.limits[k])]
    into.add(LoopSample(t=t, e=np.empty(0), state=state, limits=limits, **columns))


def one_by_one(robot: Robot, every: int = 1) -> Log:
    into, samples = recorder(robot, every), samples_of(robot)
    for k in range(COUNT):
        add(into, samples, k)
    into.flush(ends=True)
    return into.log()


def check_same(found: Log, wanted: Log) -> None:
    assert found.bound_limits == wanted.bound_limits
    assert len(found.bound_limits) == 2
    for name in COLUMNS:
        column, expected = getattr(found, name), getattr(wanted, name)
        scale = float(np.abs(expected[np.isfinite(expected)]).max(initial=1.0))
        np.testing.assert_allclose(
            column, expected, rtol=ROUNDING, atol=ROUNDING * scale, err_msg=name
        )
        assert not column.flags.writeable, name


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("size", [5, COUNT])
def test_batches_give_the_log_of_single_samples(robot: Robot, every: int, size: int) -> None:
    into, samples = recorder(robot, every), samples_of(robot)
    for first in range(0, COUNT, size):
        into.add_batch(samples.rows(slice(first, first + size)), SETS)
    assert into.steps == COUNT - 1
    check_same(into.log(), one_by_one(robot, every))


def test_batches_and_single_samples_may_take_turns(robot: Robot) -> None:
    into, samples = recorder(robot), samples_of(robot)
    add(into, samples, 0)
    into.add_batch(samples.rows(slice(1, 20)), SETS)
    for k in range(20, 31):
        add(into, samples, k)
    into.add_batch(samples.rows(slice(31, COUNT)), SETS)
    check_same(into.log(), one_by_one(robot))


def test_sets_of_limits_keep_their_numbers(robot: Robot) -> None:
    """Each batch may name its sets in its own order."""
    into, samples = recorder(robot), samples_of(robot)
    into.add_batch(samples.rows(slice(10)), SETS)
    later = samples.rows(slice(10, COUNT))
    into.add_batch(later._replace(limits=2.0 - later.limits), SETS[::-1])
    check_same(into.log(), one_by_one(robot))


def test_what_is_no_motion_ends_the_log_before_it(robot: Robot) -> None:
    into, samples = recorder(robot), samples_of(robot)
    samples.columns["nu"][29, 0] = np.nan
    with pytest.raises(RpctlError, match=rf"the motion diverged at t = {29 * PERIOD:g} s"):
        into.add_batch(samples, SETS)
    assert (into.steps, into.rows) == (28, 29)
    into.flush(ends=True)  # nothing waits
    np.testing.assert_array_equal(into.log().t, samples.reference.t[:29])


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """The numbers of rows whose forces have been computed."""
    inner: Callable[..., dict[str, Array]] = Derivation.forces
    rows: list[int] = []

    def of(self: Derivation, log: Log, chosen: slice) -> dict[str, Array]:
        rows.append(chosen.stop - chosen.start)
        return inner(self, log, chosen)

    monkeypatch.setattr(Derivation, "forces", of)
    yield rows


def deferred(robot: Robot) -> Log:
    into = recorder(robot)
    into.add_batch(samples_of(robot), SETS)
    return into.log()


def test_deferred_columns_are_computed_when_one_is_read(
    robot: Robot, counted: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(derived, "BLOCK", 20)
    log, samples = deferred(robot), samples_of(robot)
    np.testing.assert_array_equal(log.nu, samples.columns["nu"])
    np.testing.assert_array_equal(log.base_ref[:, :2], samples.reference.state.pose[:, :2])
    assert counted == []
    assert log.energy.shape == (COUNT,)
    assert counted == [20, 20, COUNT - 40]
    check_same(log, one_by_one(robot))
    with pytest.raises(AttributeError, match="no 'colour'"):
        log.colour  # noqa: B018


@pytest.mark.parametrize(
    "kept",
    [lambda log: pickle.loads(pickle.dumps(log)), copy.deepcopy],
    ids=["pickle", "deepcopy"],
)
def test_deferred_columns_travel(robot: Robot, kept: Callable[[Log], Log]) -> None:
    found, wanted = kept(deferred(robot)), one_by_one(robot)
    np.testing.assert_allclose(found.zmp, wanted.zmp, rtol=1e-12)
    np.testing.assert_array_equal(found.t, wanted.t)


def test_deferred_columns_that_are_not_finite_are_refused(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    into, samples = recorder(robot), samples_of(robot)
    samples.columns["nu"][31] = 1e200
    into.add_batch(samples, SETS)
    with pytest.raises(RpctlError, match="not finite, or out of range"):
        into.log().energy  # noqa: B018
