"""Figures of merit of a run: how well it tracked, and whether it stayed within the limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.libraries import library
from rpctl.reference.sizing import Sizing
from rpctl.simulation.merits.collision_facts import NO_COLLISIONS, Collision, LinkClearance
from rpctl.simulation.merits.ground import FeltGround, GroundFigures, felt_ground, ground
from rpctl.simulation.merits.impossible import chatter, impossible, joint_speeds
from rpctl.simulation.merits.obstacles import BASE, TIP, run_obstacles
from rpctl.simulation.merits.outcome import SUCCESSES, outcome, trace_points
from rpctl.simulation.merits.path_error import PathFigures, path_figures
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.run.run import Run

LIMIT_NAMES = {"lower": "lower position", "upper": "upper position"}  # in words
LIMIT_TOLERANCE = 1e-9  # of a limit: touching it is not breaking it


@dataclass(frozen=True)
class JointError:
    """How far a joint was from its reference, in its unit; ``settled`` as of a :class:`Summary`.

    ``largest`` is over all samples, and ``speed_ratio`` its largest speed over its limit, 0 where
    it has no motor or no limit.
    """

    joint: str
    unit: str
    rms: float
    final: float
    settled: float
    largest: float
    speed_ratio: float


@dataclass(frozen=True)
class EffortPeak:
    """The largest effort of an actuator, and its limit, N·m or N; inf where there is none.

    ``chatter`` is by how much of its limit it leaps to and fro each sample, on average over the
    second half.
    """

    actuator: str
    peak: float
    limit: float
    ratio: float
    chatter: float


@dataclass(frozen=True)
class Violation:
    """A limit of the URDF that a run broke.

    Attributes:
        joint: The joint.
        limit: ``"effort"``, ``"velocity"``, ``"lower"`` or ``"upper"``.
        value: The furthest beyond the limit: of a lower limit the least position; of efforts and
            rates the largest size.
        allowed: The limit, in the same unit.
        first_time: When it was broken first, s.
        duration: For how long in all, s.
    """

    joint: str
    limit: str
    value: float
    allowed: float
    first_time: float
    duration: float


@dataclass(frozen=True)
class BindingLimit:
    """A limit that bound the efforts.

    Attributes:
        joint: The joint.
        limit: ``"effort"``, ``"velocity"``, ``"lower"`` or ``"upper"``.
        first_time: When it bound first, s.
        first_place: Where P was then (x, y), m.
        duration: For how long in all, s.
    """

    joint: str
    limit: str
    first_time: float
    first_place: tuple[float, float]
    duration: float

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        x, y = self.first_place
        return (
            f"{self.joint} {LIMIT_NAMES.get(self.limit, self.limit)} limit bound from "
            f"{self.first_time:.3g} s, at ({x:.2f}, {y:.2f}) m, {self.duration:.2g} s in all"
        )


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The figures of merit of a run; ``settled`` figures are the largest over its second half.

    Attributes:
        outcome: The outcome in one word of :mod:`rpctl.simulation.merits.outcome`.
        outcome_sentence: The reason, in one sentence.
        nominal: Whether the simulated robot is the controller's model and nothing disturbs it.
        duration: Simulated time, s.
        rms_base_error: Root mean square of P's distance from its reference, m.
        final_base_error: That distance at the end, m.
        settled_base_error: Its largest over the second half, m.
        final_lateral_error: Its lateral part at the end, m.
        base_path: Distance of P from the path of its reference, and how far behind it was on it.
        joint_errors: Errors of each joint of the arm.
        rms_end_effector_error: Root mean square of the end effector's distance from its
            reference, m; None for a robot without an arm, like the next three.
        final_end_effector_error: That distance at the end, m.
        settled_end_effector_error: Its largest over the second half, m.
        end_effector_path: Distance of the end effector from the path of its reference, and how far
            behind it was on it.
        efforts: Largest effort of each actuator.
        max_effort_ratio: Largest ratio of an effort to its limit; None without effort limits.
        max_effort_joint: The actuator with this ratio.
        limits_violated: The limits of the URDF that were violated.
        limits_bound: The limits that bound the dynamic law.
        ground: Figures of the ground's forces.
        kinematic_report: Counts and figures of the kinematic law, by name; may be empty.
        work: Work of the actuators, J.
        lost: Energy that damping, friction and stops of the joints dissipated, J.
        energy_residual: Largest difference of the energy and the work minus losses, relative to the
            range of the work.
        constraint_residual: Largest entry of |A v|; m/s, rad/s.
        wall_time: Duration of the simulation, s.
        realtime_factor: Simulated time over ``wall_time``.
        sizing: Size and speed of a named reference, with reasons; None for other references.
        recording: How the rows of a recorded reference were changed, and where they exceed limits.
        log_every: Every Nth sample was logged and enters these figures; this is N.
        clearances: Smallest distances of the links to the ground, to obstacles and to each other.
        collisions: Collisions of the links, the deepest first.
        collision_notes: Sentences on links that may touch, and on shapes that replace others.
    """

    outcome: str
    outcome_sentence: str
    nominal: bool
    duration: float
    rms_base_error: float
    final_base_error: float
    settled_base_error: float
    final_lateral_error: float
    base_path: PathFigures
    joint_errors: tuple[JointError, ...]
    rms_end_effector_error: float | None
    final_end_effector_error: float | None
    settled_end_effector_error: float | None
    end_effector_path: PathFigures | None
    efforts: tuple[EffortPeak, ...]
    max_effort_ratio: float | None
    max_effort_joint: str | None
    limits_violated: tuple[Violation, ...]
    limits_bound: tuple[BindingLimit, ...]
    ground: GroundFigures
    kinematic_report: Mapping[str, float]
    work: float
    lost: float
    energy_residual: float
    constraint_residual: float
    wall_time: float
    realtime_factor: float
    sizing: Sizing | None = None
    recording: Mapping[str, Any] | None = None
    log_every: int = 1
    clearances: tuple[LinkClearance, ...] = ()
    collisions: tuple[Collision, ...] = ()
    collision_notes: tuple[str, ...] = ()
    felt_ground: FeltGround | None = None

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return str(library("rpctl.view.pages.page").render("notebook_summary.html", summary=self))

    @property
    def succeeded(self) -> bool:
        """Whether the robot tracked its reference, late or not, within the limits."""
        return self.outcome in SUCCESSES and not self.limits_violated

    @property
    def energy_sentence(self) -> str | None:
        """A sentence on the actuators' work and its losses; None without losses."""
        if not self.lost:
            return None
        return (
            f"the actuators did {self.work:.3g} J of work; damping, friction and stops dissipated "
            f"{self.lost:.3g} J"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain values for JSON, in one level, with the ground's."""
        found: dict[str, Any] = {}
        for name, value in asdict(self).items():
            if name == "ground":
                found |= {"ground" if key == "sentence" else key: v for key, v in value.items()}
            else:
                found[name] = value
        found["sizing"] = None if self.sizing is None else self.sizing.to_dict()
        if self.felt_ground is not None:
            found["felt_ground"]["sentence"] = self.felt_ground.sentence
        found["kinematic_report"] = self.kinematic_report or None
        found["collisions"] = [{**asdict(c), "sentence": c.sentence} for c in self.collisions]
        found["limits_bound"] = [{**asdict(b), "told": b.sentence} for b in self.limits_bound]
        return found


def summarize(run: Run) -> Summary:
    """Return the figures of merit of a run.

    Args:
        run: The run.
    """
    log, bodies = run.log, run.collisions or NO_COLLISIONS
    points = trace_points(run.t, log.base, log.base_ref, log.ee, log.ee_ref)
    name, sentence = outcome(run.t, points, run_obstacles(run), bodies, impossible(run))
    paths = {key: path_figures(point.trace, key == BASE) for key, point in points.items()}
    away = np.linalg.norm(log.ee - log.ee_ref, axis=1) if TIP in points else None
    efforts, most = _efforts(run)
    return Summary(
        outcome=name,
        outcome_sentence=sentence,
        nominal=run.controller_model is None and replace(run.config.plant, seed=0) == Plant(),
        duration=float(run.t[-1]),
        final_lateral_error=float(abs(log.e[-1, 1])),
        base_path=paths[BASE],
        joint_errors=_joint_errors(run),
        end_effector_path=paths.get(TIP),
        efforts=efforts,
        max_effort_ratio=None if most is None else most.ratio,
        max_effort_joint=None if most is None else most.actuator,
        limits_violated=violations(run),
        limits_bound=binding_limits(run),
        ground=ground(run),
        kinematic_report=run.kinematic_report,
        work=float(log.work[-1]),
        lost=float(log.lost[-1]),
        energy_residual=_energy_residual(run),
        constraint_residual=float(log.constraint_residual.max()),
        wall_time=run.wall_time,
        realtime_factor=float(run.t[-1]) / run.wall_time,
        sizing=run.sizing,
        recording=run.recording,
        log_every=run.config.run.log_every or 1,
        clearances=bodies.clearances,
        collisions=bodies.collisions,
        collision_notes=bodies.remarks,
        felt_ground=felt_ground(run),
        **_errors("base", np.hypot(*log.e[:, :2].T)),
        **_errors("end_effector", away),
    )


def violations(run: Run) -> tuple[Violation, ...]:
    """Return the limits of the URDF that a run broke."""
    found = []
    for joint, kind, values, limit in _limited(run):
        sign = -1.0 if kind == "lower" else 1.0
        broken = sign * values > sign * limit + LIMIT_TOLERANCE * max(abs(limit), 1.0)
        if broken.any():
            first, duration = float(run.t[int(np.argmax(broken))]), float(broken.mean() * run.t[-1])
            worst = sign * float((sign * values).max())
            found.append(Violation(joint, kind, worst, float(limit), first, duration))
    return tuple(found)


def _limited(run: Run) -> Iterator[tuple[str, str, Array, float]]:
    """Yield all that has a limit: the joint, the kind of limit, the values (K,), and the limit."""
    log, robot = run.log, run.robot
    for k, name in enumerate(robot.actuators):
        yield name, "effort", np.abs(run.tau[:, k]), robot.effort_limits[k]
        yield name, "velocity", np.abs(log.rates[:, k]), robot.velocity_limits[k]
    for k, name in enumerate(robot.joint_names):
        yield name, "lower", log.joints[:, k], robot.lower_limits[k]
        yield name, "upper", log.joints[:, k], robot.upper_limits[k]
    for k, name in enumerate(robot.steering_names):
        for kind, limit in zip(("lower", "upper"), robot.steering_limits[k], strict=True):
            yield name, kind, log.steering[:, k], limit
    for k, name in enumerate(robot.other_names):
        lower, upper, fastest = robot.other_limits[k]
        if name not in robot.actuators:
            yield name, "velocity", np.abs(log.other_rates[:, k]), fastest
        if name not in robot.steering_names:
            yield name, "lower", log.others[:, k], lower
            yield name, "upper", log.others[:, k], upper


def binding_limits(run: Run) -> tuple[BindingLimit, ...]:
    """Return the limits that bound the efforts."""
    found = []
    for (joint, kind), active in zip(run.log.bound_limits, run.log.active_limits.T, strict=True):
        first, duration = int(np.argmax(active)), float(active.mean() * run.t[-1])
        x, y = run.log.base[first, :2].tolist()
        found.append(BindingLimit(joint, kind, float(run.t[first]), (x, y), duration))
    return tuple(found)


def _error(sizes: Array) -> tuple[float, float, float]:
    """Return the root mean square of an error's sizes (K,), the last, and the settled one."""
    rms = float(np.sqrt(np.mean(np.square(sizes))))
    return rms, float(sizes[-1]), float(sizes[len(sizes) // 2 :].max())


def _errors(of: str, sizes: Array | None) -> dict[str, Any]:
    """Return what a summary says of an error's sizes (K,); None: there is no such error."""
    figures = (None,) * 3 if sizes is None else _error(sizes)
    names = [f"{when}_{of}_error" for when in ("rms", "final", "settled")]
    return dict(zip(names, figures, strict=True))


def _joint_errors(run: Run) -> tuple[JointError, ...]:
    away, robot = np.abs(run.log.e[:, 3:].T), run.robot
    rows = zip(robot.joint_names, robot.units, away, joint_speeds(run).tolist(), strict=True)
    return tuple(
        JointError(name, unit, *_error(sizes), float(sizes.max()), speed)
        for name, unit, sizes, speed in rows
    )


def _efforts(run: Run) -> tuple[tuple[EffortPeak, ...], EffortPeak | None]:
    """Return the peak of each actuator, and that which takes most of its limit, if any has one."""
    sizes = np.abs(run.tau).max(axis=0).tolist()
    leaps, limits = chatter(run).tolist(), run.robot.effort_limits
    rows = zip(run.robot.actuators, sizes, limits, leaps, strict=True)
    peaks = tuple(EffortPeak(name, top, most, top / most, leap) for name, top, most, leap in rows)
    limited = [peak for peak in peaks if math.isfinite(peak.limit)]
    return peaks, max(limited, key=lambda peak: peak.ratio, default=None)


def _energy_residual(run: Run) -> float:
    """Return the largest gap between energy, work and loss, relative to the work's swing."""
    gap = run.log.energy - run.log.energy[0] - run.log.work + run.log.lost
    return float(np.abs(gap).max() / max(float(np.ptp(run.log.work)), 1e-12))
