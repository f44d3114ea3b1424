"""The motion of a robot on the referee's course, in an engine or by the reduced model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, ground_reaction
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.engine import EngineRun, EngineState, LinkMotion, wheel_slips
from rpctl.equivalence.contact.mujoco_body import planar
from rpctl.equivalence.contact.plan import TICK_S, ContactPlan, Course, ReducedRobot
from rpctl.errors import DivergedError
from rpctl.robot.coordinates import level_pose
from rpctl.robot.model import Robot

LAST_SPEED_RATIO = 0.3  # of the top speed, after braking
SKID_NOTE = (
    "straight ahead only: a skid-steer base turns by scrubbing, which the reduced model replaces "
    "by an effective track"
)
SETTLING_S = 0.4  # s for a robot to settle: twenty of MuJoCo's default time constants
SAMPLE_S = 0.05  # s between samples, over which loads and slip are averaged


def referee_course(duration: float, tick: float = TICK_S) -> Course:
    """Return the referee's course: the robot accelerates, turns in the middle half, and brakes.

    It does not stop, because the friction of its joints would then change sign.
    """
    return Course(duration, tick, rise=1.0 / 3.0, pulse=0.5, lost=1.0 - LAST_SPEED_RATIO)


class ReducedRun(ReducedRobot):
    """The reduced model as an :class:`rpctl.engines.engine.EngineRun`.

    Args:
        dynamics: The robot's reduced dynamics.
        contacts: The robot's contacts with the ground.
        q: Configuration at the start (nq,).
    """

    def __init__(self, dynamics: ReducedDynamics, contacts: Contacts, q: Array) -> None:
        super().__init__(dynamics, q)
        self._known, self._tau = contacts, np.zeros(len(self.robot.actuators))
        self.contacts = contacts.names
        skids = self.robot.drive.type == "skid-steer"
        self.notes: tuple[str, ...] = (SKID_NOTE,) if skids else ()
        names = self.robot.moving_joint_names
        self._turned = {name: self.robot.joint_position(q, name) for name in names}

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        super().advance(tau, dt)
        self._tau = tau
        for name, before in self._turned.items():
            moved = self.robot.joint_position(self.q, name) - before
            if self.robot.entries[name].is_pair:
                moved = math.remainder(moved, 2.0 * math.pi)
            self._turned[name] = before + moved

    def state(self) -> EngineState:
        """Return the state now."""
        robot, dynamics, q, nu = self.robot, self.dynamics, self.q, self.nu
        v = dynamics.basis(q) @ nu
        rates = {name: float(v[robot.velocity_index(name)]) for name in self._turned}
        pin.forwardKinematics(robot.model, dynamics.data, q, v)
        return EngineState(
            pose=level_pose(q, -robot.drive.ground),
            joints={name: (at, rates[name]) for name, at in self._turned.items()},
            load=ground_reaction(dynamics, self._known, q, nu, self._tau).load,
            slip=wheel_slips(robot, self._motion),
            energy=dynamics.energy(q, nu),
        )

    def _motion(self, link: str) -> LinkMotion:
        model, data = self.robot.model, self.dynamics.data
        index = model.frames[model.getFrameId(link)].parentJoint
        place, frame = data.oMi[index], pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        motion = pin.getVelocity(model, data, index, frame)
        return LinkMotion(place.rotation, place.translation, motion.linear, motion.angular)


@dataclass(frozen=True, eq=False)
class EngineRecording:
    """The motion in one engine, one row per sample; shorter if the engine could not go on.

    Attributes:
        t: Times (n,), s; at 0 the robot has settled and sets off.
        pose: Root link's x, y (m) and heading (rad) as seen from where it set off (n, 3).
        root: Root link's x, y, z and quaternion x, y, z, w (n, 7), x and y from where it set off.
        tilt: Angle between the root link's z axis and the vertical (n,), rad.
        joints: Positions of the moving joints (n,), rad or m, by name.
        load: Vertical forces of the contacts (n, n_contacts), N.
        slip: Velocities of the wheels' contact points, ahead and to the left (n, n_wheels, 2), m/s.
        energy: Kinetic and potential energy (n,), J.
        work: Work of the efforts since the robot set off (n,), J.
        crept: Distance that the root link moved while the robot settled, m.
        sunk: How far the root link settled below the height that its wheels' radius gives, m.
        notes: The engine's notes, in sentences.
        fault: Why the engine could not go on; empty if it could.
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


# Time (s), state, means of loads and slip since the last sample, work so far (J).
_Sample = tuple[float, EngineState, Array, Array, float]


def record(
    run: EngineRun, robot: Robot, plan: ContactPlan, tick: float, settled: bool = False
) -> EngineRecording:
    """Return the motion of a robot under the efforts of a plan.

    Args:
        run: The robot in the engine, at rest at the origin.
        robot: The robot.
        plan: The efforts; each is held for a ``tick`` (s).
        settled: Whether the robot needs no time to settle into its contacts.
    """
    start, fault = run.state(), ""
    samples: list[_Sample] = []
    try:
        for _ in range(0 if settled else round(SETTLING_S / tick)):
            plan.drive(run, -1, tick)
        start = run.state()
        samples.extend(_samples(run, robot, plan, tick))  # samples before a fault are kept
    except DivergedError as error:
        fault = str(error)
    samples = samples or [(0.0, start, 0.0 * start.load, 0.0 * start.slip, 0.0)]
    t, states, load, slip, work = zip(*samples, strict=True)
    x, y, turn = start.planar
    home = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, turn), np.array([x, y, 0.0]))
    root = np.array(
        [pin.SE3ToXYZQUAT(home.actInv(pin.XYZQUATToSE3(state.pose))) for state in states]
    )
    poses = np.array([planar(pose) for pose in root])
    poses[:, 2] = np.unwrap(poses[:, 2])
    return EngineRecording(
        t=np.array(t),
        pose=poses,
        root=root,
        tilt=np.array([state.tilt for state in states]),
        joints={n: np.array([state.joints[n][0] for state in states]) for n in start.joints},
        load=_after_first(load),
        slip=_after_first(slip),
        energy=np.array([state.energy for state in states]),
        work=np.array(work),
        crept=math.hypot(x, y),
        sunk=float(-robot.drive.ground - start.pose[2]),
        notes=run.notes,
        fault=fault,
    )


def _samples(run: EngineRun, robot: Robot, plan: ContactPlan, tick: float) -> Iterator[_Sample]:
    """Apply the efforts of the plan, and yield samples of the motion."""
    every, before, work = max(1, round(SAMPLE_S / tick)), run.state(), 0.0
    loads, slips = [before.load], [before.slip]
    for k in range(len(plan.tau) + 1):
        if k % every == 0:
            yield k * tick, before, np.mean(loads, axis=0), np.mean(slips, axis=0), work
            loads, slips = [], []
        if k == len(plan.tau):
            return
        tau, after = plan.drive(run, k, tick), run.state()
        for name, effort in zip(robot.actuators, tau.tolist(), strict=True):
            work += effort * (after.joints[name][0] - before.joints[name][0])
        loads.append(after.load)
        slips.append(after.slip)
        before = after


def _after_first(rows: Sequence[Array]) -> Array:
    """Return the means before each sample; the first, which has none, gets the second's."""
    return np.array([*rows[1:2], *rows[1:]] if len(rows) > 1 else rows)
