"""What a robot does in an engine under the referee's efforts, sampled."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.engine import EngineFault, EngineRun, EngineState
from rpctl.equivalence.contact.plan import ContactPlan
from rpctl.robot.model import Robot

SETTLING_S = 0.4  # s in which a robot sinks into contacts: twenty of MuJoCo's default constants
SAMPLE_S = 0.05  # s between samples; loads and slip are means over it


@dataclass(frozen=True, eq=False)
class EngineRecording:
    """What one engine did, a row a sample; shorter than others where it could not go on.

    Attributes:
        t: Times (n,), s; 0 is when the robot, settled, sets off.
        pose: Root link's x, y (m) and heading (rad) as seen from where it set off (n, 3).
        root: Root link's x, y, z and quaternion x, y, z, w (n, 7), x and y from where it set off.
        tilt: Root link out of the level (n,), rad.
        joints: Positions of the moving joints (n,), rad or m, by name.
        load: Vertical forces of the contacts (n, n_contacts), N.
        slip: Velocities of the wheels' contact points, ahead and to the left (n, n_wheels, 2), m/s.
        energy: Kinetic and potential energy (n,), J.
        work: Work of the efforts since the robot set off (n,), J.
        crept: Way of the root link while the robot settled, m.
        sunk: How far the root link settled below the height that its wheels' radius gives, m.
        notes: Of the engine, in sentences.
        fault: Why it could not go on; empty if it could.
    """

    t: Array
    pose: Array
    root: Array
    tilt: Array
    joints: dict[str, Array]
    load: Array
    slip: Array
    energy: Array
    work: Array
    crept: float = 0.0
    sunk: float = 0.0
    notes: tuple[str, ...] = ()
    fault: str = ""


@dataclass
class _Samples:
    """Samples of a run while it is made."""

    rows: list[tuple[float, EngineState, Array, Array, float]] = field(default_factory=list)

    def recording(
        self, start: EngineState, run: EngineRun, robot: Robot, fault: str
    ) -> EngineRecording:
        states = [row[1] for row in self.rows]
        first = start.planar
        poses = np.array([_seen_from(first, state.planar) for state in states])
        poses[:, 2] = np.unwrap(poses[:, 2])
        return EngineRecording(
            t=np.array([row[0] for row in self.rows]),
            pose=poses,
            root=np.array([_root_seen_from(first, state.pose) for state in states]),
            tilt=np.array([state.tilt for state in states]),
            joints={n: np.array([s.joints[n][0] for s in states]) for n in start.joints},
            load=_after_first([row[2] for row in self.rows]),
            slip=_after_first([row[3] for row in self.rows]),
            energy=np.array([state.energy for state in states]),
            work=np.array([row[4] for row in self.rows]),
            crept=float(np.hypot(*first[:2])),
            sunk=float(-robot.drive.ground - start.pose[2]),
            notes=run.notes,
            fault=fault,
        )


def record(
    run: EngineRun, robot: Robot, plan: ContactPlan, tick: float, hold: Array | None
) -> EngineRecording:
    """Return what a robot does under the efforts of a plan.

    Args:
        run: It in an engine, at rest at the origin.
        robot: The robot.
        plan: The efforts.
        tick: How long each holds, s.
        hold: Efforts (n_act,) that hold it while it settles; None: it has settled.
    """
    samples, every, fault = _Samples(), max(1, round(SAMPLE_S / tick)), ""
    start = run.state()
    try:
        if hold is not None:
            for _ in range(round(SETTLING_S / tick)):
                _advance(run, robot, plan, -1, tick, hold)
            start = run.state()
        _drive(run, robot, plan, tick, every, samples)
    except EngineFault as error:
        fault = str(error)
    if not samples.rows:
        count, wheels = len(run.contacts), len(robot.drive.wheels)
        samples.rows.append((0.0, start, np.zeros(count), np.zeros((wheels, 2)), 0.0))
    return samples.recording(start, run, robot, fault)


def _drive(
    run: EngineRun, robot: Robot, plan: ContactPlan, tick: float, every: int, samples: _Samples
) -> None:
    """Let the robot follow the plan, and keep samples of it."""
    before, work = run.state(), 0.0
    loads, slips = [before.load], [before.slip]
    for k in range(len(plan.tau) + 1):
        if k % every == 0:
            samples.rows.append(
                (k * tick, before, np.mean(loads, axis=0), np.mean(slips, axis=0), work)
            )
            loads, slips = [], []
        if k == len(plan.tau):
            break
        efforts = _advance(run, robot, plan, k, tick, None)
        after = run.state()
        work += sum(
            effort * (after.joints[name][0] - before.joints[name][0])
            for name, effort in efforts.items()
        )
        loads.append(after.load)
        slips.append(after.slip)
        before = after


def _advance(
    run: EngineRun, robot: Robot, plan: ContactPlan, k: int, tick: float, hold: Array | None
) -> dict[str, float]:
    """Advance by a tick under the plan's efforts, and return them."""
    joints = run.state().joints
    measured = np.array([joints[name] for name in plan.names]).reshape(-1, 2)
    tau = plan.efforts(k, measured[:, 0], measured[:, 1], hold)
    efforts = dict(zip(robot.actuators, tau.tolist(), strict=True))
    run.advance(efforts, tick)
    return efforts


def _after_first(rows: list[Array]) -> Array:
    """Return means over the time before each sample; the first has none, and gets the second's."""
    return np.array([*rows[1:2], *rows[1:]] if len(rows) > 1 else rows)


def _seen_from(first: Array, pose: Array) -> Array:
    """Return a pose (3,) as seen from another."""
    cos, sin = np.cos(first[2]), np.sin(first[2])
    x, y = pose[:2] - first[:2]
    return np.array([cos * x + sin * y, cos * y - sin * x, pose[2] - first[2]])


def _root_seen_from(first: Array, pose: Array) -> Array:
    """Return x, y, z and quaternion (7,) as seen from a planar pose (3,), heights as they are."""
    x, y, _ = _seen_from(first, np.array([*pose[:2], 0.0]))
    c, s = np.cos(0.5 * first[2]), -np.sin(0.5 * first[2])
    qx, qy, qz, qw = pose[3:]
    turned = [c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz]
    return np.array([x, y, pose[2], *turned])
