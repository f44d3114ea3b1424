"""``MujocoWorld``: a robot that moves in MuJoCo, and its measured state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from rpctl.arrays import Array
from rpctl.drive.steering import MAX_STEERING, follower_positions
from rpctl.engines.engine import LinkMotion, wheel_slips
from rpctl.engines.mujoco.bodies import add_bodies, add_motors, body_name
from rpctl.engines.mujoco.ground import GRIP, GROUND, GroundContacts, LeaningContacts
from rpctl.engines.mujoco.settings import BASE, LEAST, ContactSettings, Heights, read_heights
from rpctl.equivalence.contact.mujoco_body import MujocoBody, add_tie, mujoco_library, muted
from rpctl.errors import DivergedError, RpctlError, require_positive
from rpctl.robot.model import Robot

HELD = 1e6  # kg·m² or kg: armature of joints that are held while the robot settles
SETTLING_S = 2.0  # s: longest time to come to rest
AT_REST = 1e-6  # m/s and rad/s: a slower robot counts as at rest
STEP_ROUNDING = 1e-9  # of a step: an interval that is longer by less takes no further step


class MujocoWorld(MujocoBody):
    """A robot in MuJoCo, and its state.

    After each call positions, velocities and contacts are up to date.
    """

    def __init__(self, robot: Robot, built: Built) -> None:
        root = body_name(robot.description.root)
        super().__init__(robot, built.compile(), root, built.contacts, built.geoms)
        self._timestep = float(self.mjm.opt.timestep)
        self._motors = np.array([self.mjm.actuator(name).trnid[0] for name in robot.actuators])
        self._tied = bool(built.followers)
        self._links: dict[str, tuple[int, int]] = {}
        self._settled: Array | None = None

    def place(self, q: Array, height: float) -> None:
        """Set the robot to q (nq,), at rest, with its root link level at a ``height`` (m)."""
        self.put(q, height)
        self.mujoco.mj_step1(self.mjm, self.data)
        if self._tied:
            self.tie()

    def _held(self) -> Array:
        """Return 1 for the coordinates (nv,) that are held while the robot settles, else 0."""
        held = np.ones(self.mjm.nv)
        held[self.root_rate] = 0.0
        return held

    def settle(self) -> None:
        """Let the robot settle into its contacts, with all joints held."""
        model, data = self.mjm, self.data
        armature, flags = model.dof_armature.copy(), int(model.opt.disableflags)
        off = self.mujoco.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_LIMIT) | int(off.mjDSBL_EQUALITY)
        model.dof_armature += HELD * self._held()
        model.opt.timestep = self._timestep
        self.mujoco.mj_step1(model, data)  # with these
        start, seen = data.time, self.q
        while data.time - start < SETTLING_S:
            self._step(20)
            if np.abs(data.qvel[self.root_rate]).max() < AT_REST:
                break
        self._settled = self.loads()
        model.dof_armature[:], model.opt.disableflags = armature, flags
        data.time, data.qvel[:] = start, 0.0
        self._return(seen)
        self.mujoco.mj_step1(model, data)

    def _return(self, q: Array) -> None:
        """Move the robot back to its planar pose and joint positions at q (nq,)."""
        data, now = self.data, self.q
        turn = math.atan2(q[3] * now[2] - q[2] * now[3], q[2] * now[2] + q[3] * now[3])
        turned = np.zeros(4)
        half = np.array([math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)])
        self.mujoco.mju_mulQuat(turned, half, data.qpos[3:7])
        data.qpos[:2], data.qpos[3:7] = q[:2], turned
        self.set_joints(q)

    def run(self, tau: Array, dt: float) -> float:
        """Simulate under constant efforts for ``dt`` (s); return their work, J.

        Args:
            tau: Actuator efforts (n_act,), N·m or N; the motors saturate at their limits.
            dt: Duration, s, divided into equal steps.

        Raises:
            DivergedError: The state is no longer finite.
        """
        data = self.data
        steps = max(1, math.ceil(dt / self._timestep - STEP_ROUNDING))
        self.mjm.opt.timestep = dt / steps
        before = self.places
        data.ctrl[:], self._settled = tau, None
        self._step(steps)
        return float(data.actuator_force @ (self.places - before))

    @property
    def places(self) -> Array:
        """Positions of the actuators' joints (n_act,), rad or m."""
        return np.array(self.data.qpos[self.mjm.jnt_qposadr[self._motors]])

    def serve(self, stiffness: Array, damping: Array) -> None:
        """Replace motors by servos with the motors' limits.

        From then on :meth:`run` takes the desired positions of these joints, rad or m, and the
        efforts of those that keep motors.

        Args:
            stiffness: Stiffness of each servo (n_act,), N·m/rad or N/m; 0 keeps the motor.
            damping: Damping of each servo (n_act,), N·m·s/rad or N·s/m.
        """
        model, limits = self.mjm, self.robot.effort_limits
        model.actuator_ctrllimited[:], model.actuator_forcelimited[:] = 0, np.isfinite(limits)
        model.actuator_forcerange[:] = np.where(np.isfinite(limits), limits, 0.0)[:, None] * [-1, 1]
        model.actuator_biastype[:] = int(self.mujoco.mjtBias.mjBIAS_AFFINE)
        model.actuator_gainprm[:, 0] = np.where(stiffness > 0.0, stiffness, 1.0)
        model.actuator_biasprm[:, 1:3] = -np.stack([stiffness, damping], axis=1)

    def push(self, link: str, force: Sequence[float], moment: Sequence[float]) -> None:
        """Push a link until :meth:`release`; pushes add up.

        Args:
            link: The link.
            force: Force at the link's origin (3,), N, world axes.
            moment: Moment (3,), N·m, world axes.
        """
        body, _ = self._place_of(link)
        self.push_body(body, self.origin(link), np.asarray(force), np.asarray(moment))

    def release(self) -> None:
        """End all pushes."""
        self.data.xfrc_applied[:] = 0.0

    def origin(self, link: str) -> Array:
        """Return the position of a link's origin (3,) in the world, m."""
        body, site = self._place_of(link)
        return np.array(self.data.xpos[body] if site < 0 else self.data.site_xpos[site])

    def velocity(self, link: str) -> Array:
        """Return the velocity (6,) of a link's origin (m/s), then ω (rad/s), in world axes."""
        (body, site), kinds = self._place_of(link), self.mujoco.mjtObj
        return (
            self.twist(kinds.mjOBJ_XBODY, body) if site < 0 else self.twist(kinds.mjOBJ_SITE, site)
        )

    def loads(self) -> Array:
        """Return the load of each contact (n,), N, under the present efforts and pushes."""
        if self._settled is not None:  # the efforts that hold the joints are not known yet
            return self._settled.copy()
        self.mujoco.mj_fwdActuation(self.mjm, self.data)
        self.mujoco.mj_fwdAcceleration(self.mjm, self.data)
        self.mujoco.mj_fwdConstraint(self.mjm, self.data)
        return super().loads()

    def slips(self) -> Array:
        """Return the velocity of each wheel's lowest point (n_wheels, 2), m/s: forward, left."""
        return wheel_slips(self.robot, self._motion)

    def _motion(self, link: str) -> LinkMotion:
        velocity, R = self.velocity(link), self.data.body(body_name(link)).xmat.reshape(3, 3)
        return LinkMotion(R, self.origin(link), velocity[:3], velocity[3:])

    def _step(self, steps: int) -> None:
        with muted():
            at_once = 1 if self.rods else steps  # the rods' forces are computed in each step
            for _ in range(steps // at_once):
                self.data.qfrc_applied[:] = 0.0
                self.pull_rods()
                self.mujoco.mj_step2(self.mjm, self.data)
                if at_once > 1:
                    self.mujoco.mj_step(self.mjm, self.data, at_once - 1)
                self.mujoco.mj_step1(self.mjm, self.data)
        if self.diverged:
            raise DivergedError(
                f"the motion in MuJoCo diverged at {self.data.time:.3f} s; shorten the timestep of "
                "[plant.contact], or lengthen the controller's horizons"
            )

    def _place_of(self, link: str) -> tuple[int, int]:
        """Return a link's body, and its site, or -1 if its frame is the body's."""
        if link not in self._links:
            site = int(self.mujoco.mj_name2id(self.mjm, self.mujoco.mjtObj.mjOBJ_SITE, link))
            fixed = site >= 0
            body = self.mjm.site_bodyid[site] if fixed else self.mjm.body(body_name(link)).id
            self._links[link] = int(body), site
        return self._links[link]


TIE_STEPS = 4.0  # timesteps: time constant of a tie
TIE_SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)
DEGREE = 4  # of MuJoCo's polynomials
FIT = 2e-3  # rad: largest error of a polynomial that replaces a tie rod


@dataclass(frozen=True, eq=False)
class Built:
    """A robot in MuJoCo.

    Attributes:
        spec: The ``MjSpec``. Bodies have the names of links (see
            :func:`rpctl.engines.mujoco.bodies.body_name`), joints those of joints, actuators those
            of ``robot.actuators``; other links are sites.
        contacts: Names of the contacts: the wheels' joints, then the supports, as
            ``Contacts.names``.
        geoms: Name of the contact of each geom that meets the ground, by the geom's name.
        followers: Swivels that no equality ties; the caller applies the forces of tie rods.
        notes: Sentences on what was assumed.
        repairs: Sentences on what was changed in the file.
        heights: Heights of the ground; None: the plane z = 0.
    """

    spec: Any
    contacts: tuple[str, ...]
    geoms: Mapping[str, str]
    followers: tuple[str, ...]
    notes: tuple[str, ...]
    repairs: tuple[str, ...]
    heights: Heights | None = None

    def compile(self) -> Any:
        """Return the ``MjModel``.

        Raises:
            RpctlError: MuJoCo refuses it.
        """
        try:
            return self.spec.compile()
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise RpctlError(f"MuJoCo refuses the robot: {reason}") from None


def build(robot: Robot, settings: ContactSettings, friction: float) -> Built:
    """Return a robot in MuJoCo.

    Masses and inertias come from the robot's model, radii and centres of wheels from its drive, so
    that variations and payloads are simulated.

    Raises:
        EngineMissing: MuJoCo is not installed.
        RpctlError: MuJoCo cannot use a number of the robot.
        InputError: The heights of the ground cannot be read.
    """
    require_positive("friction", friction)
    spec = mujoco_library().MjSpec()
    spec.modelname = robot.name
    _set_options(spec, robot, settings)
    heights = read_heights(settings)
    _add_ground(spec, friction, heights)
    repairs = add_bodies(spec, robot, settings)
    add_motors(spec, robot)
    kind = LeaningContacts if robot.drive.leans else GroundContacts
    ground = kind(spec, robot, settings, friction)
    ground.add_all()
    stiffness = [TIE_STEPS * settings.timestep, 1.0], TIE_SOLIMP
    for joint in robot.mimics:
        if joint.mimic is not None and joint.mimic.joint not in robot.locked:
            line = joint.mimic.offset, joint.mimic.multiplier
            add_tie(spec, joint.name, joint.mimic.joint, line, stiffness)
    polynomials, notes = tie_polynomials(robot), ground.notes
    for name, coefficients in polynomials.items():
        add_tie(spec, name, robot.drive.steered[0].joint, coefficients, stiffness)
    followers = tuple(s.joint for s in robot.drive.followers if s.joint not in polynomials)
    if polynomials:
        turned = ", ".join(polynomials)
        notes = [
            *notes,
            f"a polynomial of degree {DEGREE} replaces the tie rod that turns {turned}",
        ]
    ground.even()
    contacts = tuple(dict.fromkeys(ground.owners.values()))
    return Built(spec, contacts, ground.owners, followers, tuple(notes), repairs, heights)


def _set_options(spec: Any, robot: Robot, settings: ContactSettings) -> None:
    mujoco, option, compiler = mujoco_library(), spec.option, spec.compiler
    compiler.degree = compiler.balanceinertia = compiler.fusestatic = False
    compiler.boundmass = compiler.boundinertia = 0.0
    compiler.autolimits = False
    option.timestep, option.gravity = settings.timestep, robot.model.gravity.linear
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    elliptic = settings.cone == "elliptic"
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC if elliptic else mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.impratio = GRIP if elliptic else 1.0


def _add_ground(spec: Any, friction: float, heights: Heights | None) -> None:
    kinds = mujoco_library().mjtGeom
    ground = spec.worldbody.add_geom(name=GROUND, type=kinds.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    ground.contype = ground.conaffinity = 0
    ground.friction = [friction, 0.0, 0.0]
    if heights is None:
        return
    low, high = float(heights.grid.min()), float(heights.grid.max())
    rows, columns = heights.grid.shape
    field = spec.add_hfield(name=GROUND, nrow=rows, ncol=columns)
    relief = max(high - low, LEAST)
    field.size = [0.5 * heights.extent[0], 0.5 * heights.extent[1], relief, BASE]
    field.userdata = ((heights.grid - low) / relief).ravel()
    ground.type, ground.hfieldname, ground.pos = kinds.mjGEOM_HFIELD, GROUND, [0.0, 0.0, low]


def tie_polynomials(robot: Robot) -> dict[str, tuple[float, ...]]:
    """Return, by joint, the coefficients (5,) of the angle of each swivel that follows one other.

    They belong to a polynomial in the leader's angle, MuJoCo's ``polycoef``; the result is empty if
    a follower's angle is not such a polynomial.
    """
    if len(robot.drive.steered) != 1:
        return {}
    leader = robot.drive.steered[0].joint
    joint = robot.description.joint[leader]
    low, high = max(joint.lower, -MAX_STEERING), min(joint.upper, MAX_STEERING)
    angles = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.linspace(0.0, math.pi, 41))
    places = [follower_positions(robot.drive, {leader: angle}) for angle in angles.tolist()]
    found = {}
    for name in places[0]:
        wanted = [place[name] for place in places]
        fitted = polynomial.polyfit(angles, wanted, DEGREE)
        if np.abs(polynomial.polyval(angles, fitted) - wanted).max() > FIT:
            return {}
        found[name] = tuple(fitted.tolist())
    return found
