"""An exported model on its ground, as MuJoCo runs the file: it stands, and rolls as the model does.

The motion is the one of ``rpctl verify --contact``: gentle, wheels' efforts open loop, steered and
arm joints servoed on both sides. Efforts go through the file's actuators. Wheels that are cylinders
scrub where they turn, which the reduced model leaves out: for the motion they are crowned.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.ground_reaction import Contacts, find_contacts
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.muted import muted
from rpctl.engines.mujoco.rollers import has_rollers
from rpctl.engines.mujoco.sensors import HOME
from rpctl.equivalence.contact.plan import TICK_S, ContactPlan, NotGentle, plan_motion, start
from rpctl.equivalence.contact.record import Gap, travelled
from rpctl.equivalence.contact.trial import tilt_note
from rpctl.equivalence.row import Skipped
from rpctl.errors import ActuationError, DivergedError, RpctlError, SingularBasisError
from rpctl.robot.coordinates import read_root, write_root
from rpctl.robot.model import Robot

FILE = "the file in MuJoCo"
SETTLING_S, STANDING_S = 0.5, 1.0  # s
STAND_BAND_M, STAND_BAND_RAD = 1e-3, 2e-3  # that a robot at rest may move in a second
# What hard contacts leave of the catalogue, at worst: 2.2 mm over 1 m, 5.7 mrad over 0.8 rad; of
# rollers 14 mm and 58 mrad. A wheel that is 5 % too large is 10 mm off.
PATH_BAND, PATH_FLOOR_M = 4e-3, 1e-3  # of the distance travelled; m
HEADING_BAND, HEADING_FLOOR = 8e-3, 4e-3  # of the angle turned; rad
ROLLER_BANDS = 10.0  # times wider: a dozen barrels are not quite round, and roll as bodies of mass
AHEAD_S = 1e-4  # s, of the difference quotient of a follower's rate
FOLLOWER_BANDWIDTH = 150.0  # rad/s, critically damped: stiffer than the servo of what they follow
SCRUB_NOTE = (
    "the wheels are cylinders, which scrub as they turn; the motion is compared with crowned ones"
)
STEADY = "stands still"


@dataclass(frozen=True, eq=False)
class GroundTrial:
    """What an exported model does on its ground.

    Attributes:
        checks: The rows.
        skipped: What could not be compared, and why.
        notes: What else there is to say.
    """

    checks: tuple[Gap, ...]
    skipped: tuple[Skipped, ...]
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every row is within its band."""
        return all(check.passed for check in self.checks)


class _TrialBody:
    """A model and its state, by the names of a robot."""

    def __init__(self, robot: Robot, model: Any, root: str) -> None:
        self._mujoco = mujoco_library()
        self._model, self.data = model, self._mujoco.MjData(model)
        self._robot = robot
        free = int(model.body_jntadr[model.body(root).id])
        self._free = int(model.jnt_qposadr[free])
        self._joints = {name: model.joint(name) for name in robot.moving_joint_names}
        self._order = [int(model.actuator(name).id) for name in robot.actuators]
        self._followers = _loose_followers(robot, model, self._order)
        self._steps = max(1, round(TICK_S / float(model.opt.timestep)))

    def place(self, q: Array, height: float) -> None:
        """Put it at rest at q (nq,), its root link at a height, m."""
        half = 0.5 * math.atan2(q[3], q[2])
        self._mujoco.mj_resetData(self._model, self.data)
        self.data.qpos[self._free : self._free + 7] = (
            q[0], q[1], height, math.cos(half), 0.0, 0.0, math.sin(half)
        )  # fmt: skip
        for name, joint in self._joints.items():
            self.data.qpos[int(joint.qposadr[0])] = self._robot.joint_position(q, name)
        self._mujoco.mj_forward(self._model, self.data)

    def go_home(self) -> None:
        """Put it where the file's keyframe has it.

        Raises:
            RpctlError: The file has no such keyframe.
        """
        key = int(self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_KEY, HOME))
        if key < 0:
            raise RpctlError(f'the file has no keyframe "{HOME}" for the robot to start from')
        self._mujoco.mj_resetDataKeyframe(self._model, self.data, key)
        self._mujoco.mj_forward(self._model, self.data)

    def measured(self, names: tuple[str, ...]) -> tuple[Array, Array]:
        """Return positions and rates of joints."""
        joints = [self._joints[name] for name in names]
        places = [float(self.data.qpos[int(joint.qposadr[0])]) for joint in joints]
        rates = [float(self.data.qvel[int(joint.dofadr[0])]) for joint in joints]
        return np.array(places), np.array(rates)

    def advance(self, tau: Array) -> None:
        """Hold efforts (n_act,) for a tick."""
        self.data.ctrl[self._order] = tau
        self._hold_followers()
        with muted():
            self._mujoco.mj_step(self._model, self.data, nstep=self._steps)

    def _hold_followers(self) -> None:
        """Turn swivels that no tie holds to where those that they follow have them."""
        if not self._followers:
            return
        steered = [swivel.joint for swivel in self._robot.drive.steered]
        positions, rates = self.measured(tuple(steered))
        ahead = positions + AHEAD_S * rates
        places, later = (
            follower_positions(self._robot.drive, dict(zip(steered, at.tolist(), strict=True)))
            for at in (positions, ahead)
        )
        for name, (actuator, stiffness, damping) in self._followers.items():
            (place,), (rate,) = self.measured((name,))
            wanted = (later[name] - places[name]) / AHEAD_S
            pull = stiffness * (places[name] - place) + damping * (wanted - rate)
            self.data.ctrl[actuator] = pull

    def require_finite(self) -> None:
        """Refuse a motion that left the finite numbers.

        Raises:
            DivergedError: It did.
        """
        kinds = self._mujoco.mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        finite = np.isfinite(self.data.qpos).all()
        if not finite or any(self.data.warning[int(kind)].number for kind in bad):
            raise DivergedError(f"{self._robot.name}: its motion in MuJoCo diverges")

    @property
    def pose(self) -> Array:
        """The root link's x, y (m) and heading (rad) from above, height (m) and tilt (rad)."""
        px, py, pz, w, x, y, z = self.data.qpos[self._free : self._free + 7]
        turn = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        tilt = math.acos(min(1.0, max(-1.0, 1.0 - 2.0 * (x * x + y * y))))
        return np.array([px, py, turn, pz, tilt])


def _loose_followers(
    robot: Robot, model: Any, order: list[int]
) -> dict[str, tuple[int, float, float]]:
    """Return the swivels whose motors must hold them: actuator, stiffness and damping of each."""
    mujoco, found = mujoco_library(), {}
    tied = {
        mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, int(joint)) for joint in model.eq_obj1id
    }
    for swivel in robot.drive.followers:
        if swivel.joint in robot.actuators and swivel.joint not in tied:
            inertia = float(model.dof_M0[int(model.joint(swivel.joint).dofadr[0])])
            actuator = order[robot.actuators.index(swivel.joint)]
            stiffness = inertia * FOLLOWER_BANDWIDTH**2
            found[swivel.joint] = actuator, stiffness, 2.0 * inertia * FOLLOWER_BANDWIDTH
    return found


def settle(robot: Robot, model: Any, root: str) -> tuple[Array, Array]:
    """Return how a robot stands at its home posture, settled in its contacts.

    Args:
        robot: The robot.
        model: ``MjModel``.
        root: The body of the root link.

    Returns:
        ``qpos`` (nq,), and the controls (n_act,) that hold it, N·m or N.

    Raises:
        DivergedError: It does not come to rest.
    """
    body, rest = _TrialBody(robot, model, root), _at_rest(ReducedDynamics(robot))
    body.place(rest.q[0], -robot.drive.ground)
    _stand(body, rest, SETTLING_S)
    return np.array(body.data.qpos), rest.tau[0]


def run_on_ground(robot: Robot, model: Any, root: str) -> GroundTrial:
    """Let an exported model stand and roll, from its home, and compare it with the reduced model.

    Args:
        robot: The robot.
        model: ``MjModel`` of the file.
        root: The body of the root link.

    Raises:
        DivergedError: MuJoCo's motion diverges.
        RpctlError: The file has no home.
    """
    dynamics = ReducedDynamics(robot)
    plan, skipped = _plan(dynamics, find_contacts(dynamics))
    body, rest = _TrialBody(robot, model, root), _at_rest(dynamics)
    body.go_home()
    first = body.pose
    _stand(body, rest, STANDING_S)
    checks = _standing_rows(first, body.pose)
    notes = tuple(tilt_note(float(first[4])))
    if plan is not None:
        rolling, scrubs = _crowned(model, robot)
        if scrubs:
            notes += (SCRUB_NOTE,)
        body = _TrialBody(robot, rolling, root)
        body.go_home()
        _stand(body, rest, SETTLING_S)
        checks += _motion_rows(dynamics, body, plan)
    return GroundTrial(tuple(checks), skipped, notes)


def _crowned(model: Any, robot: Robot) -> tuple[Any, bool]:
    """Return the model with wheels that touch at one point, and whether others were so replaced."""
    mujoco = mujoco_library()
    kinds = mujoco.mjtGeom
    wide = [
        geom
        for wheel in robot.drive.wheels
        for geom in [int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, wheel.joint))]
        if geom >= 0 and int(model.geom_type[geom]) == int(kinds.mjGEOM_CYLINDER)
    ]
    if not wide:
        return model, False
    found = copy(model)
    for geom in wide:
        radius, half_width, _ = model.geom_size[geom]
        found.geom_type[geom] = int(kinds.mjGEOM_ELLIPSOID)
        found.geom_size[geom] = radius, radius, half_width
    return found, True


def _plan(
    dynamics: ReducedDynamics, contacts: Contacts | None
) -> tuple[ContactPlan | None, tuple[Skipped, ...]]:
    """Return the motion to make, or the row that says why there is none."""
    name = "rolls as the reduced model"
    if contacts is None:
        return None, (Skipped(name, FILE, "a fixed base has nothing to roll"),)
    if not contacts.balanced:
        return None, (Skipped(name, FILE, f"not known to stand: {'; '.join(contacts.notes[:1])}"),)
    try:
        return plan_motion(dynamics, contacts), ()
    except (NotGentle, ActuationError, SingularBasisError) as reason:
        return None, (Skipped(name, FILE, str(reason)),)


def _at_rest(dynamics: ReducedDynamics) -> ContactPlan:
    """Return the plan of a robot that stays at its home posture."""
    robot = dynamics.robot
    q, still = start(robot), np.zeros(robot.dof)
    try:
        hold = dynamics.efforts(q, dynamics.inverse(q, still, still))
    except ActuationError:  # what nothing drives hangs as it likes
        hold = np.zeros(len(robot.actuators))
    own = [name for name in robot.actuators if name in robot.quasi_velocities]
    columns = [robot.quasi_velocities.index(name) for name in own]
    felt = np.linalg.inv(np.linalg.inv(dynamics.inertia(q))[np.ix_(columns, columns)])
    places = np.array([robot.joint_position(q, name) for name in own])
    return ContactPlan(
        q=q[None],
        v=np.zeros((1, robot.nv)),
        tau=hold[None],
        servoed=tuple(robot.actuators.index(name) for name in own),
        names=tuple(own),
        targets=(places[None], np.zeros((1, len(own)))),
        inertia=felt[None],
    )


def _stand(body: _TrialBody, rest: ContactPlan, duration: float) -> None:
    """Let it stand for a while (s)."""
    for _ in range(round(duration / TICK_S)):
        body.advance(rest.efforts(0, *body.measured(rest.names)))
        body.require_finite()


def _standing_rows(first: Array, last: Array) -> list[Gap]:
    """Return the rows of a robot that is left alone for a second: it neither moves nor leans."""
    moved = float(np.linalg.norm((last - first)[[0, 1, 3]]))
    turned = max(abs(math.remainder(last[2] - first[2], 2.0 * math.pi)), abs(last[4] - first[4]))
    return [
        _gap(f"{STEADY}: place", moved, STAND_BAND_M, "m"),
        _gap(f"{STEADY}: turn and lean", turned, STAND_BAND_RAD, "rad"),
    ]


def _motion_rows(dynamics: ReducedDynamics, body: _TrialBody, plan: ContactPlan) -> list[Gap]:
    """Return the rows of the gentle motion, from where the robot stands."""
    robot, poses = dynamics.robot, [body.pose]
    index = [robot.velocity_index(name) for name in plan.names]
    q, nu, apart = plan.q[0].copy(), np.zeros(robot.dof), [np.zeros(2)]
    write_root(q, *poses[0][:3])
    start_joints = body.measured(plan.names)[0]
    for name, place in zip(plan.names, start_joints.tolist(), strict=True):
        robot.set_joint(q, name, place)
    for tick in range(len(plan.tau)):
        body.advance(plan.efforts(tick, *body.measured(plan.names)))
        body.require_finite()
        at = np.array([robot.joint_position(q, name) for name in plan.names])
        tau = plan.efforts(tick, at, (dynamics.basis(q) @ nu)[index])
        q, nu, *_ = step(dynamics, q, nu, tau, TICK_S)
        pose = body.pose
        x, y, turn = read_root(q)
        away = math.hypot(pose[0] - x, pose[1] - y)
        apart.append(np.array([away, abs(math.remainder(pose[2] - turn, 2.0 * math.pi))]))
        poses.append(pose)
    way = travelled(np.array(poses))
    turned = float(np.abs(np.diff(np.array(poses)[:, 2])).sum())
    far, off = np.array(apart).max(axis=0).tolist()
    wide = ROLLER_BANDS if has_rollers(robot) else 1.0
    return [
        _gap("path", far, wide * (PATH_BAND * way + PATH_FLOOR_M), "m"),
        _gap("heading", off, wide * (HEADING_BAND * turned + HEADING_FLOOR), "rad"),
    ]


def _gap(name: str, gap: float, band: float, unit: str) -> Gap:
    size = gap if math.isfinite(gap) else math.inf
    return Gap(name, FILE, size / band, 1.0, gap=size, band=band, unit=unit)
