"""The certificate: independent derivations of a robot's dynamics, compared at random states."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.dynamics.basis import basis, selection
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.errors import RpctlError
from rpctl.robot.description import Array
from rpctl.robot.model import BASE_NV, Robot

EXACT = 1e-12  # float64 rounding over a tree of tens of links, with two decades to spare
SCALED = 1e-10  # as EXACT, but an entry may be small against its row and column
FORWARD = 1e-10  # solving with M amplifies rounding by cond M; see FORWARD_CONDITION
FORWARD_CONDITION = 10.0  # times machine epsilon times cond M
DIFFERENCE = 1e-6  # central differences: truncation h² against rounding eps/h
DIFFERENCE_STEP = 1e-5  # s; near the cube root of machine epsilon
POWER = 1e-6  # energy balance of a motion by RK4 at POWER_STEP
POWER_STEP = 1e-3  # s
POWER_STEPS = 100


@dataclass(frozen=True)
class Check:
    """One comparison and its worst case.

    Attributes:
        name: What is compared.
        against: With what.
        residual: Largest deviation over all samples, relative.
        limit: Largest deviation allowed.
        sample: Index of the random state where it occurred.
        entry: Entry where it occurred, by the names of coordinates.
    """

    name: str
    against: str
    residual: float
    limit: float
    sample: int
    entry: str

    @property
    def passed(self) -> bool:
        """Whether the residual is a number within the limit."""
        return bool(self.residual <= self.limit)


@dataclass(frozen=True)
class Certificate:
    """The outcome of :func:`verify`: all checks of one robot."""

    robot: str
    samples: int
    seed: int
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check nearest to its limit, or furthest beyond it."""
        return max(self.checks, key=lambda check: check.residual / check.limit)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values, for JSON; an infinite residual is None."""
        checks = []
        for check in self.checks:
            residual = check.residual if np.isfinite(check.residual) else None
            checks.append({**asdict(check), "residual": residual, "passed": check.passed})
        return {
            "robot": self.robot,
            "passed": self.passed,
            "samples": self.samples,
            "seed": self.seed,
            "checks": checks,
        }


@dataclass(frozen=True)
class State:
    """A random state, reproducible from the seed and its index."""

    q: Array  # (nq,) joints inside their limits
    v: Array  # (nv,) of the free tree
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)


@dataclass(frozen=True)
class _Residual:
    """One comparison at one state."""

    name: str
    against: str
    residual: float
    limit: float
    entry: str


def verify(
    robot: Robot,
    samples: int = 100,
    seed: int = 0,
    progress: Callable[[int], object] | None = None,
) -> Certificate:
    """Compare the reduced dynamics with an independent derivation at random states.

    Args:
        robot: The robot.
        samples: Number of random states.
        seed: Seed of the states; sample k is drawn from the pair (seed, k).
        progress: Called with the number of states done.

    Returns:
        The certificate; a comparison that is not finite fails.

    Raises:
        RpctlError: ``samples`` is not positive.
    """
    if samples < 1:
        raise RpctlError(f"{samples} samples prove nothing; give at least 1")
    dynamics, oracle = ReducedDynamics(robot), GibbsAppell(robot)
    worst: dict[str, Check] = {}
    for sample in range(samples):
        state = draw_state(robot, seed, sample)
        for item in _compare(dynamics, oracle, state):
            known = worst.get(item.name)
            if known is None or not item.residual / item.limit <= known.residual / known.limit:
                worst[item.name] = Check(
                    item.name, item.against, item.residual, item.limit, sample, item.entry
                )
        if progress is not None:
            progress(sample + 1)
    return Certificate(robot.name, samples, seed, tuple(worst.values()))


def draw_state(robot: Robot, seed: int, sample: int) -> State:
    """Return the random state that :func:`verify` compares at a sample of a seed."""
    rng = np.random.default_rng([seed, sample])
    q = robot.random_configuration(rng)
    v, nu, nu_dot = (rng.normal(size=n) for n in (robot.nv, robot.dof, robot.dof))
    return State(q, v, nu, nu_dot)


def _compare(dynamics: ReducedDynamics, oracle: GibbsAppell, state: State) -> Iterator[_Residual]:
    robot = dynamics.robot
    try:
        yield from _full(robot, oracle, state)
        yield from _reduced(dynamics, oracle, state)
        yield from _consistent(dynamics, state)
    except (RpctlError, np.linalg.LinAlgError) as error:
        yield _Residual("computed", "finite numbers", np.inf, EXACT, str(error))


def _full(robot: Robot, oracle: GibbsAppell, state: State) -> Iterator[_Residual]:
    """Compare the free tree: Pinocchio against the Gibbs function."""
    data = robot.model.createData()
    terms = oracle.full(state.q, state.v)
    names = _velocity_names(robot)
    bias = pin.rnea(robot.model, data, state.q, state.v, np.zeros(robot.nv))
    inertia = pin.crba(robot.model, data, state.q)
    yield _relative("full inertia", "Gibbs-Appell", inertia, terms.M, names)
    gap = (bias - terms.h) / (terms.h_size.max() or 1.0)
    yield _residual("full bias", "Gibbs-Appell", gap, EXACT, names)


def _reduced(dynamics: ReducedDynamics, oracle: GibbsAppell, state: State) -> Iterator[_Residual]:
    """Compare the reduced equations: projection against the Gibbs function in ν."""
    robot, q, nu = dynamics.robot, state.q, state.nu
    names = robot.quasi_velocities
    terms = oracle.reduced(q, nu)
    M, against = dynamics.inertia(q), "Gibbs-Appell"
    scale = np.sqrt(np.outer(np.diag(terms.M), np.diag(terms.M)))
    yield _relative("reduced inertia M", against, M, terms.M, names)
    yield _residual("M, entry by entry", against, (M - terms.M) / scale, SCALED, names)
    size = terms.h_size.max() or 1.0
    yield _residual(
        "reduced bias h", against, (dynamics.bias(q, nu) - terms.h) / size, EXACT, names
    )
    yield _relative("actuation B", against, dynamics.actuation(q), terms.B, names)
    v, rates = dynamics.basis(q) @ nu, np.zeros(robot.nv)
    rates[:BASE_NV] = terms.root @ nu
    for name, row in terms.rates.items():
        rates[robot.velocity_index(name)] = row @ nu
    yield _relative("rolling wheels S ν", against, v, rates, _velocity_names(robot))
    inverse = dynamics.inverse(q, nu, state.nu_dot)
    gradient = terms.M @ state.nu_dot + terms.h
    size += np.abs(terms.M @ state.nu_dot).max()
    yield _residual("inverse dynamics", "gradient of G", (inverse - gradient) / size, EXACT, names)


def _consistent(dynamics: ReducedDynamics, state: State) -> Iterator[_Residual]:
    """Check the reduced dynamics against themselves."""
    robot, q, nu = dynamics.robot, state.q, state.nu
    names, velocities = robot.quasi_velocities, _velocity_names(robot)
    S, A = dynamics.basis(q), dynamics.constraint(q)
    slack = A @ S / max(1.0, float(np.abs(A).max() * np.abs(S).max()) if A.size else 1.0)
    yield _residual("no slip A S", "0", slack, EXACT, [f"row {i}" for i in range(len(A))])
    step = DIFFERENCE_STEP * (S @ nu)
    ahead, behind = (
        basis(dynamics.constraint(pin.integrate(robot.model, q, s)), selection(robot)) @ nu
        for s in (step, -step)
    )
    change = (ahead - behind) / (2.0 * DIFFERENCE_STEP) - dynamics.basis_drift(q, nu)
    scale = max(1.0, float(np.abs(S @ nu).max()))
    yield _residual("basis drift Ṡ ν", "differences", change / scale, DIFFERENCE, velocities)
    force = dynamics.inverse(q, nu, state.nu_dot)
    tau = dynamics.efforts(q, force)
    M = dynamics.inertia(q)
    limit = max(FORWARD, FORWARD_CONDITION * np.finfo(float).eps * float(np.linalg.cond(M)))
    back = dynamics.forward(q, nu, tau)
    yield _relative("forward ∘ inverse", "identity", back, state.nu_dot, names, limit)
    lost = np.array([0.0 if np.linalg.eigvalsh(M)[0] > 0.0 else np.inf])
    yield _residual("M positive definite", "least eigenvalue", lost, EXACT, ["M"])
    yield _power(dynamics, state)


def _power(dynamics: ReducedDynamics, state: State) -> _Residual:
    """Follow a motion; its energy must change by the actuators' work.

    A tenth of the random speeds and accelerations keeps the motion within what the step resolves.
    """
    q, nu = state.q, 0.1 * state.nu
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, 0.1 * state.nu_dot))
    start, work, moved = dynamics.energy(q, nu), 0.0, 0.0
    for _ in range(POWER_STEPS):
        q, nu, done = rk4_step(dynamics, q, nu, tau, POWER_STEP)
        work, moved = work + done, moved + abs(done)
    gap = (dynamics.energy(q, nu) - start - work) / max(moved, 1.0)
    return _residual("power balance", "work of τ", np.array([gap]), POWER, ["energy"])


def _velocity_names(robot: Robot) -> list[str]:
    names = ["vx", "vy", "omega"] + [""] * (robot.nv - BASE_NV)
    for name in robot.model.names[2:]:
        names[robot.velocity_index(name)] = name
    return names


def _relative(
    name: str, against: str, value: Array, truth: Array, names: object, limit: float = EXACT
) -> _Residual:
    """Compare two arrays relative to the largest entry."""
    scale = float(np.abs(truth).max()) if truth.size else 0.0
    return _residual(name, against, (value - truth) / (scale or 1.0), limit, names)


def _residual(name: str, against: str, gap: Array, limit: float, names: Any) -> _Residual:
    """Return the largest deviation of an array and the entry that has it; NaN counts as largest."""
    if not gap.size:
        return _Residual(name, against, 0.0, limit, "-")
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    index = np.unravel_index(int(np.argmax(size)), size.shape)
    labels = [names[i] if i < len(names) else str(i) for i in index]
    return _Residual(name, against, float(size[index]), limit, ", ".join(labels))
