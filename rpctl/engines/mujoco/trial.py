"""A trial of an exported model on its ground: it stands, and rolls as the reduced model does.

The motion is the gentle one of ``rpctl verify --contact``: the wheels' efforts are open loop, and
servos move the steered and the arm's joints on both sides. The file's actuators apply the efforts.
Cylindrical wheels scrub in turns, which the reduced model neglects, so crowned ones replace them.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.mujoco.bodies import HOME
from rpctl.engines.mujoco.ground import has_rollers
from rpctl.equivalence.certificate import Skipped
from rpctl.equivalence.contact.mujoco_body import (
    MujocoBody,
    follower_slopes,
    mujoco_library,
    muted,
    part_number,
)
from rpctl.equivalence.contact.plan import (
    TICK_S,
    ContactPlan,
    NotGentle,
    ReducedRobot,
    plan_motion,
    rest_plan,
    standing_contacts,
    start,
)
from rpctl.equivalence.contact.trial import Gap, gap_row, tilt_note, travelled
from rpctl.errors import ActuationError, DivergedError, SingularBasisError
from rpctl.robot.coordinates import read_root, write_root
from rpctl.robot.model import Robot

FILE = "the file in MuJoCo"
SETTLING_S, STANDING_S = 0.5, 1.0  # s
STAND_BAND_M, STAND_BAND_RAD = 1e-3, 2e-3  # bounds of the motion of a robot at rest in a second
# Largest gaps over the catalogue with hard contacts: 2.2 mm over 1 m, 5.7 mrad over 0.8 rad; with
# rollers 14 mm and 58 mrad. A wheel that is 5 % too large causes 10 mm.
PATH_BAND, PATH_FLOOR_M = 4e-3, 1e-3  # of the distance travelled; m
HEADING_BAND, HEADING_FLOOR = 8e-3, 4e-3  # of the angle turned; rad
ROLLER_BANDS = 10.0  # factor on the bounds: a dozen barrels are not quite round, and have mass
FOLLOWER_BANDWIDTH = 150.0  # rad/s, critically damped: stiffer than the servo of what they follow
SCRUB_NOTE = (
    "the wheels are cylinders, which scrub in turns; crowned wheels replace them in the comparison"
)
STEADY = "stands still"


@dataclass(frozen=True, eq=False)
class GroundTrial:
    """The outcome of the trial of an exported model on its ground.

    Attributes:
        checks: The rows.
        skipped: Comparisons that could not be made, with reasons.
        notes: Further sentences.
    """

    checks: tuple[Gap, ...]
    skipped: tuple[Skipped, ...]
    notes: tuple[str, ...] = ()


class _TrialBody(MujocoBody):
    """A robot in the model of a file, driven by the file's motors."""

    def __init__(self, robot: Robot, model: Any, root: str) -> None:
        super().__init__(robot, copy(model), root)  # the harness sets a flag of its own
        self._order = [int(model.actuator(name).id) for name in robot.actuators]
        joint = self.mujoco.mjtObj.mjOBJ_JOINT
        tied = {self.mujoco.mj_id2name(model, joint, int(index)) for index in model.eq_obj1id}
        self._loose = {  # swivels without a tie, and their inertia about their axes
            swivel.joint: float(model.dof_M0[self.dofs[swivel.joint]])
            for swivel in robot.drive.followers
            if swivel.joint in robot.actuators and swivel.joint not in tied
        }

    def go_home(self) -> None:
        """Reset the robot to the file's keyframe.

        Raises:
            RpctlError: The file has no such keyframe.
        """
        self.mujoco.mj_resetDataKeyframe(self.mjm, self.data, part_number(self.mjm, "key", HOME))
        self.mujoco.mj_forward(self.mjm, self.data)

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s).

        Raises:
            DivergedError: The motion left the finite numbers.
        """
        self.data.ctrl[self._order] = tau
        if self._loose:
            self._hold_loose()
        with muted():
            steps = max(1, round(dt / float(self.mjm.opt.timestep)))
            self.mujoco.mj_step(self.mjm, self.data, nstep=steps)
        if self.diverged:
            raise DivergedError(f"{self.robot.name}: its motion in MuJoCo diverges")

    def _hold_loose(self) -> None:
        """Let their motors turn swivels without a tie to the angles that they should follow."""
        leaders = {swivel.joint: self.joint(swivel.joint) for swivel in self.robot.drive.steered}
        at = {name: position for name, (position, _) in leaders.items()}
        places, slopes = follower_slopes(self.robot.drive, at)
        for name, inertia in self._loose.items():
            position, rate = self.joint(name)
            wanted = sum(slope * leaders[leader][1] for leader, slope in slopes[name].items())
            gap = FOLLOWER_BANDWIDTH * (places[name] - position) + 2.0 * (wanted - rate)
            actuator = self._order[self.robot.actuators.index(name)]
            self.data.ctrl[actuator] = inertia * FOLLOWER_BANDWIDTH * gap

    @property
    def stand(self) -> Array:
        """The root link's x, y (m) and heading (rad) from above, height (m) and tilt (rad)."""
        return np.array([*self.planar, self.pose[2], self.tilt])


def settle(robot: Robot, model: Any, root: str) -> tuple[Array, Array]:
    """Let a robot settle into its contacts at its home posture.

    Returns:
        ``qpos`` (nq,), and the controls (n_act,) that hold it, N·m or N.

    Raises:
        DivergedError: It does not come to rest.
    """
    body, rest = _TrialBody(robot, model, root), _at_rest(ReducedDynamics(robot))
    body.put(rest.q[0], -robot.drive.ground)
    body.mujoco.mj_forward(body.mjm, body.data)
    _stand(body, rest, SETTLING_S)
    return np.array(body.data.qpos), rest.hold


def run_on_ground(robot: Robot, model: Any, root: str) -> GroundTrial:
    """Let an exported model stand at home and roll; compare it with the reduced model.

    Raises:
        DivergedError: MuJoCo's motion diverges.
        RpctlError: The file has no keyframe of the home posture.
    """
    dynamics = ReducedDynamics(robot)
    plan = _plan(dynamics)
    body, rest = _TrialBody(robot, model, root), _at_rest(dynamics)
    body.go_home()
    first = body.stand
    _stand(body, rest, STANDING_S)
    checks = _standing_rows(first, body.stand)
    notes = tuple(tilt_note(float(first[4])))
    if isinstance(plan, Skipped):
        return GroundTrial(tuple(checks), (plan,), notes)
    rolling, scrubs = _crowned(model, robot)
    if scrubs:
        notes += (SCRUB_NOTE,)
    body = _TrialBody(robot, rolling, root)
    body.go_home()
    _stand(body, rest, SETTLING_S)
    checks += _motion_rows(dynamics, body, plan)
    return GroundTrial(tuple(checks), (), notes)


def _crowned(model: Any, robot: Robot) -> tuple[Any, bool]:
    """Return the model with wheels that touch at one point, and whether any were replaced."""
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


def _plan(dynamics: ReducedDynamics) -> ContactPlan | Skipped:
    """Return the plan of the motion, or the row that says why there is none."""
    try:
        return plan_motion(dynamics, standing_contacts(dynamics))
    except (NotGentle, ActuationError, SingularBasisError) as reason:
        return Skipped("rolls as the reduced model", FILE, str(reason))


def _at_rest(dynamics: ReducedDynamics) -> ContactPlan:
    """Return the plan of a robot that stays at its home posture."""
    return rest_plan(dynamics, start(dynamics.robot))


def _stand(body: _TrialBody, rest: ContactPlan, duration: float) -> None:
    """Let the robot stand for a time (s)."""
    for _ in range(round(duration / TICK_S)):
        rest.drive(body, 0)


def _standing_rows(first: Array, last: Array) -> list[Gap]:
    """Return the rows of a robot at rest for a second: it neither moves nor leans."""
    moved = np.array([[np.linalg.norm((last - first)[[0, 1, 3]])]])
    turn = math.remainder(last[2] - first[2], 2.0 * math.pi)
    turned = np.array([[max(abs(turn), abs(last[4] - first[4]))]])
    return [
        gap_row(f"{STEADY}: place", moved, STAND_BAND_M, "m", against=FILE),
        gap_row(f"{STEADY}: turn and lean", turned, STAND_BAND_RAD, "rad", against=FILE),
    ]


def _motion_rows(dynamics: ReducedDynamics, body: _TrialBody, plan: ContactPlan) -> list[Gap]:
    """Return the rows of the gentle motion, which starts where the robot stands."""
    model, poses, apart = ReducedRobot(dynamics, plan.q[0]), [body.planar], [np.zeros(2)]
    write_root(model.q, *poses[0])
    places, _ = body.measured(plan.names)
    for name, place in zip(plan.names, places.tolist(), strict=True):
        dynamics.robot.set_joint(model.q, name, place)
    for tick in range(len(plan.tau)):
        plan.drive(body, tick)
        plan.drive(model, tick)
        pose, (x, y, turn) = body.planar, read_root(model.q)
        away = math.hypot(pose[0] - x, pose[1] - y)
        apart.append(np.array([away, abs(math.remainder(pose[2] - turn, 2.0 * math.pi))]))
        poses.append(pose)
    way = travelled(np.array(poses))
    turned = float(np.abs(np.diff(np.array(poses)[:, 2])).sum())
    far, off = np.array(apart).max(axis=0).reshape(2, 1, 1)
    wide = ROLLER_BANDS if has_rollers(dynamics.robot) else 1.0
    band = wide * (HEADING_BAND * turned + HEADING_FLOOR)
    return [
        gap_row("path", far, wide * (PATH_BAND * way + PATH_FLOOR_M), "m", against=FILE),
        gap_row("heading", off, band, "rad", against=FILE),
    ]
