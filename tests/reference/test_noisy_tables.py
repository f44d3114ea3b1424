"""Tables as they are recorded: noise on places and headings, and the splines that take it out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rpctl import Robot, RpctlError
from rpctl.arrays import Array
from rpctl.errors import DescriptionError
from rpctl.reference.load import load_reference
from rpctl.reference.paths import PathTime
from rpctl.reference.recorded import smoothing
from rpctl.reference.recorded.recording import RecordedPath
from rpctl.reference.recorded.smoothing import Smoothed, SmoothingProblem, smooth, spread
from tests.grids import cells
from tests.reference.differences import check_derivatives, check_rest

SIGMA, HEADING_SIGMA = 0.01, 0.03  # m, rad
RADIUS = 1.5  # m


def soft(u: Array) -> Array:
    """Return numbers from 0 to 1 that rest before u = 0 and after u = 1."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))


def arc(angle: Array) -> tuple[Array, Array, Array]:
    return RADIUS * np.sin(angle), RADIUS * (1.0 - np.cos(angle)), angle


def way(kind: str, u: Array) -> tuple[Array, Array, Array]:
    """Return x, y (m) and heading (rad) at shares of a table's time."""
    if kind == "stands":  # for a fifth of the time at either end
        return arc(2.5 * soft((u - 0.2) / 0.6))
    if kind == "reverses":
        return arc(1.2 * (soft(2.0 * u) - soft(2.0 * u - 1.0)))
    if kind == "three-point":  # forward to the left, back to the right
        first, second = 1.2 * soft(2.0 * u), 0.8 * soft(2.0 * u - 1.0)
        x, y, _ = arc(first)
        centre = 2.0 * RADIUS * math.sin(1.2), RADIUS * (1.0 - 2.0 * math.cos(1.2))
        heading = 1.2 + second
        back = centre[0] - RADIUS * np.sin(heading), centre[1] + RADIUS * np.cos(heading)
        return np.where(u < 0.5, x, back[0]), np.where(u < 0.5, y, back[1]), first + second
    if kind == "spot":
        out, turn, on = soft(3.0 * u), 2.5 * soft(3.0 * u - 1.0), soft(3.0 * u - 2.0)
        return out + math.cos(2.5) * on, math.sin(2.5) * on, turn
    assert kind == "wraps"  # twice round
    return arc(4.0 * math.pi * soft(u))


def table(path: Path, kind: str, headings: bool, seed: int = 0, rows: int = 200) -> Array:
    """Write a noisy table, 20 s at uneven times; return times and true poses (K, 4)."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 20.0, rows)
    t[1:-1] += 0.4 * (t[1] - t[0]) * rng.uniform(-1.0, 1.0, rows - 2)
    true = np.column_stack([t, *way(kind, t / 20.0)])
    noisy = true.copy()
    noisy[:, 1:3] += SIGMA * rng.normal(size=(rows, 2))
    noisy[:, 3] += HEADING_SIGMA * rng.normal(size=rows)
    noisy[:, 3] = np.remainder(noisy[:, 3] + math.pi, 2.0 * math.pi) - math.pi
    head, columns = ("t,x,y,theta", 4) if headings else ("t,x,y", 3)
    np.savetxt(path, noisy[:, :columns], delimiter=",", header=head, comments="", fmt="%.6f")
    return true


def read(
    robot: Robot, path: Path, smooth: float | str | None, retime: bool = False
) -> RecordedPath:
    found = load_reference(robot, str(path), smooth=smooth, retime=retime)
    assert isinstance(found, RecordedPath)
    return found


KINDS = ("stands", "reverses", "three-point", "spot", "wraps")
# A turn on the spot is not seen in a table without headings.
GRID = [(kind, told) for kind in KINDS for told in (True, False) if (kind, told) != ("spot", False)]
CASES = [(kind, told, smooth) for kind, told in GRID for smooth in ("auto", SIGMA)]
QUICK = [("three-point", False, "auto")]
SLOW = [("stands", True, "auto"), ("spot", True, SIGMA), ("wraps", False, SIGMA)]


@pytest.mark.parametrize(("kind", "headings", "smooth"), cells(CASES, QUICK, SLOW))
def test_noise_is_taken_out_of_every_motion(
    paper: Robot, tmp_path: Path, kind: str, headings: bool, smooth: float | str
) -> None:
    true = table(tmp_path / "a.csv", kind, headings)
    back = read(paper, tmp_path / "a.csv", smooth)
    states = [back.at(PathTime(float(t), 1.0, 0.0)) for t in true[:, 0]]
    poses, twists = (np.array(part) for part in zip(*((s.pose, s.twist) for s in states),
                                                    strict=True))  # fmt: skip
    off = np.hypot(*(poses[:, :2] - true[:, 1:3]).T)
    assert math.sqrt(float((off**2).mean())) < 0.8 * SIGMA
    turned = np.remainder(poses[:, 2] - true[:, 3] + math.pi, 2.0 * math.pi) - math.pi
    moving = np.hypot(twists[:, 0], 0.3 * twists[:, 2]) > 0.1
    assert np.abs(turned[moving]).max() < (3.0 * HEADING_SIGMA if headings else 0.35)
    assert np.abs(twists[:, 1]).max() < 1e-3
    check_rest(back, 0.0)
    check_rest(back, back.duration)
    check_derivatives(back, np.linspace(1.5, 18.5, 12), atol=1e-3)


@pytest.mark.parametrize("seed", cells(range(12), [0]))
def test_what_smoothing_changed_is_told(paper: Robot, tmp_path: Path, seed: int) -> None:
    table(tmp_path / "a.csv", "wraps", headings=True, seed=seed)
    rows = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    back = read(paper, tmp_path / "a.csv", "auto")
    places, headings = back.recording.smoothed if back.recording else ()
    poses = np.array([back.at(PathTime(float(t), 1.0, 0.0)).pose for t in rows[:, 0]])
    off = np.hypot(*(poses[:, :2] - rows[:, 1:3]).T)
    assert places.rms == pytest.approx(math.sqrt(float((off**2).mean() / 2.0)))
    assert places.largest == pytest.approx(off.max())
    assert places.line == int(off.argmax()) + 2
    assert (places.columns, places.unit) == ("x, y", "m")
    assert places.noise == pytest.approx(SIGMA, rel=0.25)
    assert headings.noise == pytest.approx(HEADING_SIGMA, rel=0.25)
    assert (headings.columns, headings.unit) == ("theta", "rad")
    assert f"x, y by {1e3 * places.rms:.3g} mm rms" in places.sentence


def test_a_clean_table_is_left_alone(paper: Robot, tmp_path: Path) -> None:
    t = np.linspace(0.0, 20.0, 150)
    rows = np.column_stack([t, *way("reverses", t / 20.0)])
    head = "t,x,y,theta"
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=head, comments="", fmt="%.15g")
    before, after = (read(paper, tmp_path / "a.csv", smooth) for smooth in (None, "auto"))
    for at in np.linspace(0.0, 20.0, 31):
        np.testing.assert_allclose(after(at).pose, before(at).pose, atol=1e-9)
        np.testing.assert_allclose(after(at).twist_dot, before(at).twist_dot, atol=1e-6)
    assert after.recording is not None
    assert not before.recording.changes if before.recording else False


def test_joints_are_smoothed_in_their_own_units(paper: Robot, tmp_path: Path) -> None:
    turning, sliding = paper.joint_names
    rng, t = np.random.default_rng(5), np.linspace(0.0, 20.0, 200)
    angle, reach = 0.8 * soft(t / 20.0), 0.5 + 0.2 * soft(t / 20.0)
    rows = np.column_stack([t, angle + 0.01 * rng.normal(size=200), reach])
    head = f"t,{turning},{sliding}"
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=head, comments="", fmt="%.12g")
    back = read(paper, tmp_path / "a.csv", "auto")
    assert back.recording is not None
    (change,) = back.recording.smoothed  # the other has no noise
    assert (change.columns, change.unit) == (turning, "rad")
    assert change.noise == pytest.approx(0.01, rel=0.25)
    joints = np.array([back(float(at)).joints for at in t])
    assert math.sqrt(float(((joints[:, 0] - angle) ** 2).mean())) < 0.006
    np.testing.assert_allclose(joints[:, 1], reach, atol=1e-6)


def test_a_heading_across_the_way_is_told(paper: Robot, tmp_path: Path) -> None:
    true = table(tmp_path / "a.csv", "wraps", headings=True)
    rows = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    rows[:, 3] = true[:, 3] + 1.3
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,x,y,theta", comments="")
    with pytest.raises(DescriptionError, match=r"a base that follows theta stays off"):
        read(paper, tmp_path / "a.csv", "auto")


@pytest.mark.parametrize(
    ("source", "smooth", "why"),
    [
        ("a.csv", -1.0, "smooth is -1; give a positive number"),
        ("a.csv", "much", 'smooth is "much"; give metres, such as 0.01, or auto'),
        ("eight", 0.01, r"smooth = 0\.01: eight has no rows to smooth"),
    ],
)
def test_smoothing_without_sense_is_refused(
    paper: Robot, source: str, smooth: float | str, why: str
) -> None:
    with pytest.raises(RpctlError, match=why):
        load_reference(paper, source, smooth=smooth)
    with pytest.raises(RpctlError, match="retime: eight has no times to change"):
        load_reference(paper, "eight", retime=True)


def eight(t: Array) -> Array:
    """Return a figure-eight (K, 2), m, that is at rest at both ends."""
    u = t / t[-1]
    angle = 2.0 * math.pi * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    return np.column_stack([0.8 * np.sin(angle), 0.4 * np.sin(2.0 * angle)])


def noisy(step: float, sigma: float, seed: int = 0) -> tuple[Array, Array]:
    t = np.arange(0.0, 20.0 + 1e-9, step)
    return t, eight(t) + sigma * np.random.default_rng(seed).normal(size=(len(t), 2))


def found(t: Array, rows: Array, tolerance: float | None) -> Smoothed:
    smoothed = smooth(t, rows, tolerance)
    assert smoothed is not None
    return smoothed


def differences(smoothed: Smoothed, t: Array, rows: Array) -> float:
    off = rows - smoothed.problem.spline(smoothed.coefficients)(t)
    return math.sqrt(float((off**2).mean()))


@pytest.mark.parametrize("sigma", [1e-5, 1e-2])
@pytest.mark.parametrize("step", [0.1, 0.025])  # the second has fewer knots than rows
def test_cross_validation_finds_the_noise(step: float, sigma: float) -> None:
    t, rows = noisy(step, sigma)
    smoothed = found(t, rows, None)
    assert smoothed.noise == pytest.approx(sigma, rel=0.12)
    spline = smoothed.problem.spline(smoothed.coefficients)
    error = math.sqrt(float(((spline(t) - eight(t)) ** 2).mean()))
    assert error < 0.7 * sigma
    assert differences(smoothed, t, rows) == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize("step", [0.1, 0.02, 0.005])
def test_rows_without_noise_stay_as_they_are(step: float) -> None:
    t, rows = noisy(step, 0.0)
    smoothed = smooth(t, rows, None)
    if smoothed is not None:
        assert differences(smoothed, t, rows) < 1e-9


@pytest.mark.parametrize("tolerance", [2e-3, 0.01, 0.05])
@pytest.mark.parametrize("step", [0.1, 0.02])
def test_a_tolerance_is_used_and_kept(step: float, tolerance: float) -> None:
    t, rows = noisy(step, 0.01)
    off = differences(found(t, rows, tolerance), t, rows)
    assert 0.98 * tolerance < off <= tolerance


def test_a_tolerance_that_nothing_smooth_keeps_leaves_rows_as_they_are() -> None:
    assert smooth(*noisy(0.1, 0.01), 1e-6) is None


def cost(problem: SmoothingProblem, tau: float, coefficients: Array) -> float:
    """Return Σ |y - f|² + λ ∫ |f'''|² dt by the trapezium rule."""
    spline = problem.spline(coefficients)
    t = np.linspace(problem.t[0], problem.t[-1], 20001)
    bend = np.trapezoid((spline(t, 3) ** 2).sum(axis=1), t)
    weight = (tau * problem.unit) ** 6 / problem.unit
    return float(((problem.values - spline(problem.t)) ** 2).sum() + weight * bend)


def test_no_other_spline_costs_less() -> None:
    rng = np.random.default_rng(2)
    t = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 3.0, 28)), [3.0]])
    problem = SmoothingProblem(t, rng.normal(size=(30, 2)))
    for tau in (0.5, 2.0, 8.0):
        best = problem.coefficients(tau)
        least = cost(problem, tau, best)
        slope, step = [], 1e-4
        for _ in range(6):
            way = rng.normal(size=best.shape)
            up, down = (cost(problem, tau, best + sign * step * way) for sign in (1.0, -1.0))
            assert min(up, down) > least
            slope.append((up - down) / (up + down - 2.0 * least))
        assert np.abs(slope).max() < 1e-2  # of the step: the least is there, not nearby


@pytest.mark.parametrize("rests", [(True, False), (False, True), (True, True)])
def test_a_rest_is_one(rests: tuple[bool, bool]) -> None:
    t, rows = noisy(0.1, 0.01)
    problem = SmoothingProblem(t, rows + t[:, None])
    spline = problem.spline(problem.coefficients(3.0, rests))
    for at, rest in zip((0.0, 20.0), rests, strict=True):
        assert bool(np.abs(spline(at, 1)).max() < 1e-9) == rest
        assert bool(np.abs(spline(at, 2)).max() < 1e-9) == rest
    # In the middle the ends are not felt.
    free = problem.spline(problem.coefficients(3.0))
    np.testing.assert_allclose(spline(10.0), free(10.0), atol=1e-4)


def test_who_starts_at_rest_is_seen() -> None:
    t, rows = noisy(0.1, 0.01)
    assert found(t, rows, None).rests == (True, True)
    assert found(t, rows + 0.1 * t[:, None], None).rests == (False, False)
    early = t < 10.0
    assert found(t[early], rows[early], None).rests == (True, False)


def test_degrees_of_freedom_are_the_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    t, rows = noisy(0.1, 0.01)
    for tau in (0.3, 3.0):
        problem = SmoothingProblem(t, rows)
        each = SmoothingProblem(t, np.eye(len(t)))
        exact = float(np.trace(each.at_rows @ each.coefficients(tau)))
        assert problem.freedom(tau) == pytest.approx(exact, rel=1e-9)
        with monkeypatch.context() as patch:
            patch.setattr(smoothing, "EXACT_TRACE", 0)
            sampled = SmoothingProblem(t, rows).freedom(tau)
        assert sampled == pytest.approx(exact, rel=0.08)
        assert sampled != exact


def test_the_error_of_a_rate_is_that_of_many_trials() -> None:
    t = np.arange(0.0, 10.0 + 1e-9, 0.1)
    rows = np.random.default_rng(1).normal(size=(len(t), 400))  # a trial a column
    rates, errors = SmoothingProblem(t, rows).rates(3.0)
    np.testing.assert_allclose(rates.std(axis=1), errors, rtol=0.15)
    line = SmoothingProblem(t, np.column_stack([0.5 * t, -t])).rates(3.0)[0]
    np.testing.assert_allclose(line, np.tile([0.5, -1.0], (3, 1)), atol=1e-6)


def test_spread_keeps_both_ends_and_the_least_distance() -> None:
    u = np.array([0.0, 0.1, 0.5, 0.9, 1.2, 2.0, 2.4, 2.5])
    np.testing.assert_array_equal(spread(u, 0.5), [0, 2, 4, 5, 7])
    np.testing.assert_array_equal(spread(u, 0.0), np.arange(8))
    np.testing.assert_array_equal(spread(u, 10.0), [0, 7])
