"""A robot in a model of MuJoCo, by the robot's names: it is put, pushed, stepped and read.

One harness for whoever lets a robot roll in MuJoCo. For the proof only the builder of the model is
independent: :mod:`rpctl.equivalence.contact.model` reads the file's raw bytes and asks neither
Pinocchio nor :mod:`rpctl.engines.mujoco.world`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Drive, Wheel
from rpctl.drive.steering import follower_positions
from rpctl.errors import EngineMissing, RpctlError
from rpctl.libraries import install_command
from rpctl.robot.coordinates import write_root
from rpctl.robot.model import BASE_NV, Robot

BAD = ("QPOS", "QVEL", "QACC", "CTRL")  # MuJoCo's warnings of what leaves the finite numbers
DIFFERENCE_STEP = 1e-6  # rad, of a difference quotient
ROLLER_FRICTION = 1e-5  # along which a roller runs, or a ball slides: the least MuJoCo takes
TIE_ROD_BANDWIDTH = 300.0  # rad/s: as hard as small steps allow
STABLE = 0.2  # bandwidth times the step at which a spring that is pulled once a step stays stable
UP = np.array([0.0, 0.0, 1.0])


def mujoco_absence() -> str:
    """Return the sentence that says that MuJoCo is missing, and how to install it."""
    command = install_command("mujoco")
    return f"MuJoCo is not installed; run {command}, with Python 3.11 or later"


def mujoco_library() -> Any:
    """Return the module ``mujoco``, an extra that is imported where it is needed.

    Raises:
        EngineMissing: It is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError:
        raise EngineMissing(mujoco_absence()) from None


def quaternion(pose: Array) -> Array:
    """Return MuJoCo's quaternion (4,) w, x, y, z of a pose or rotation (4, 4) or (3, 3)."""
    turn = np.zeros(4)
    mujoco_library().mju_mat2Quat(turn, np.ascontiguousarray(pose[:3, :3]).ravel())
    return turn


def part_number(model: Any, kind: str, name: str) -> int:
    """Return the number of a model's part.

    Args:
        model: The ``MjModel``.
        kind: As ``mjtObj`` calls it: ``"body"``, ``"joint"``, ``"key"`` …
        name: Its name.

    Raises:
        RpctlError: The model has no such part.
    """
    mujoco = mujoco_library()
    number = mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)
    if number < 0:
        raise RpctlError(
            f'the model has no {kind} "{name}"; it is not the file that `rpctl export` wrote of '
            "the robot, or it was edited"
        )
    return int(number)


def add_shape(body: Any, name: str, kind: str, size: Sequence[float], pose: Array) -> Any:
    """Add a geom to an ``MjsBody`` and return it.

    Args:
        body: The body.
        name: Of the geom.
        kind: As MuJoCo calls it: ``"sphere"``, ``"ellipsoid"`` …
        size: As MuJoCo counts it.
        pose: In the body (4, 4).
    """
    number = getattr(mujoco_library().mjtGeom, f"mjGEOM_{kind.upper()}")
    place, turn = pose[:3, 3], quaternion(pose)
    return body.add_geom(name=name, type=number, size=size, pos=place, quat=turn)


def add_tie(
    spec: Any,
    follower: str,
    leader: str,
    coefficients: Sequence[float],
    stiffness: tuple[Sequence[float], Sequence[float]] | None = None,
) -> None:
    """Make a joint's position a polynomial of another's.

    Args:
        spec: What is built (``MjSpec``).
        follower: The joint that follows.
        leader: The joint that leads.
        coefficients: Of the polynomial, the constant one first.
        stiffness: ``solref`` and ``solimp``; None: MuJoCo's.
    """
    mujoco, tie = mujoco_library(), spec.add_equality(name1=follower, name2=leader)
    tie.type, tie.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    tie.data[: len(coefficients)] = coefficients
    if stiffness is not None:
        tie.solref, tie.solimp = stiffness


def free_inertia(model: Any, data: Any) -> Array:
    """Return the inertia (nv, nv) of all of a model's coordinates, at the posture computed last."""
    M = np.zeros((model.nv, model.nv))
    for row, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco_library().mj_mulM(model, data, row, unit)
    return M


@contextmanager
def muted() -> Iterator[None]:
    """Let MuJoCo warn nobody, neither on stderr nor in a file; its ``MjData`` counts warnings."""
    mujoco = mujoco_library()
    known = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(known)


class MujocoBody:
    """A robot on a free root in MuJoCo, and its state.

    Args:
        robot: The robot, whose names the model has.
        model: The ``MjModel``.
        root: Name of the root link's body.
        contacts: Names of the contacts, wheels first.
        owner: Name of the contact of each geom that meets the ground, by the geom's name.

    Attributes:
        mjm: The ``MjModel``.
        data: The ``MjData``.
        root: Index of the root link's body.
        dofs: Index in ``qvel`` of each moving joint.
        rods: What each follower weighs about its axis, by joint, kg·m²; without, no rod pulls.
    """

    def __init__(
        self,
        robot: Robot,
        model: Any,
        root: str,
        contacts: Sequence[str] = (),
        owner: Mapping[str, str] | None = None,
    ) -> None:
        self.mujoco = mujoco_library()
        self.robot, self.mjm, self.contacts = robot, model, tuple(contacts)
        self.data: Any = self.mujoco.MjData(model)
        self.root = int(model.body(root).id)
        names = robot.moving_joint_names
        joints = [int(model.joint(name).id) for name in names]
        places, dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self.dofs = dict(zip(names, dofs.tolist(), strict=True))
        self._places = dict(zip(names, places.tolist(), strict=True))
        self._joints = np.array(places, dtype=int), np.array(dofs, dtype=int)
        self._index = np.array([robot.entries[name].index for name in names], dtype=int)
        self._pair = np.array([robot.entries[name].is_pair for name in names], dtype=bool)
        self._columns = np.array([robot.velocity_index(name) for name in names], dtype=int)
        free = int(model.body_jntadr[self.root])
        at, dof = int(model.jnt_qposadr[free]), int(model.jnt_dofadr[free])
        self.root_place, self.root_rate = slice(at, at + 7), slice(dof, dof + 6)
        order = {name: k for k, name in enumerate(self.contacts)}
        self.owner = {int(model.geom(g).id): order[name] for g, name in (owner or {}).items()}
        model.opt.disableflags |= int(self.mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.rods: dict[str, float] = {}

    def put(self, q: Array, height: float) -> None:
        """Put the robot at q (nq,), at rest, its root link level at a height (m).

        What follows from that, MuJoCo has yet to compute.
        """
        half = 0.5 * math.atan2(float(q[3]), float(q[2]))
        self.mujoco.mj_resetData(self.mjm, self.data)
        self.data.qpos[self.root_place] = (
            q[0], q[1], height, math.cos(half), 0.0, 0.0, math.sin(half)
        )  # fmt: skip
        self.set_joints(q)

    def set_joints(self, q: Array) -> None:
        """Put the moving joints where they are at q (nq,)."""
        positions, pairs = q[self._index], self._index[self._pair]
        positions[self._pair] = np.arctan2(q[pairs + 1], q[pairs])
        self.data.qpos[self._joints[0]] = positions

    def joint(self, name: str) -> tuple[float, float]:
        """Return a joint's position (rad or m) and its rate."""
        return float(self.data.qpos[self._places[name]]), float(self.data.qvel[self.dofs[name]])

    def measured(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return positions (n,), rad or m, and rates (n,) of joints."""
        both = np.array([self.joint(name) for name in names]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w."""
        x, y, z, qw, qx, qy, qz = self.data.qpos[self.root_place].tolist()
        return np.array([x, y, z, qx, qy, qz, qw])

    @property
    def planar(self) -> Array:
        """The root link's x, y (m) and heading (rad) seen from above (3,)."""
        return planar(self.pose)

    @property
    def tilt(self) -> float:
        """How far the root link leans out of the level, rad."""
        return tilt(self.pose)

    @property
    def q(self) -> Array:
        """Configuration (nq,) seen from above."""
        q = np.zeros(self.robot.nq)
        write_root(q, *self.planar.tolist())
        self._write_joints(q)
        return q

    def _write_joints(self, q: Array) -> None:
        """Write where the moving joints are into q (nq,), in place."""
        positions = self.data.qpos[self._joints[0]]
        q[self._index] = positions
        pairs, angles = self._index[self._pair], positions[self._pair]
        q[pairs], q[pairs + 1] = np.cos(angles), np.sin(angles)

    @property
    def v(self) -> Array:
        """Velocity (nv,) seen from above: the root link's along its heading, then the joints'."""
        v, rate = np.empty(self.robot.nv), self.data.qvel[self.root_rate]
        R = self.data.xmat[self.root].reshape(3, 3)
        size = math.hypot(R[0, 0], R[1, 0])
        cos, sin = R[0, 0] / size, R[1, 0] / size
        x, y = rate[:2].tolist()
        v[:BASE_NV] = cos * x + sin * y, cos * y - sin * x, R[2] @ rate[3:]
        v[self._columns] = self.data.qvel[self._joints[1]]
        return v

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, J."""
        self.mujoco.mj_energyPos(self.mjm, self.data)
        self.mujoco.mj_energyVel(self.mjm, self.data)
        return float(self.data.energy.sum())

    @property
    def diverged(self) -> bool:
        """Whether the motion left the finite numbers."""
        kinds, warned = self.mujoco.mjtWarning, self.data.warning
        bad = any(warned[int(getattr(kinds, f"mjWARN_BAD{kind}"))].number for kind in BAD)
        return bad or not np.isfinite(self.data.qpos).all()

    def twist(self, kind: Any, index: int) -> Array:
        """Return the velocity (6,) of an object's origin (m/s), then angular (rad/s); world."""
        both = np.zeros(6)
        self.mujoco.mj_objectVelocity(self.mjm, self.data, kind, index, both, 0)
        return np.concatenate([both[3:], both[:3]])

    def tie(self) -> None:
        """Let stiff tie rods hold the swivels that follow others, from where the robot stands."""
        own = np.diag(free_inertia(self.mjm, self.data))
        followers = [swivel.joint for swivel in self.robot.drive.followers]
        self.rods = {name: float(own[self.dofs[name]]) for name in followers}

    def pull_rods(self) -> None:
        """Pull each swivel that follows towards its place, and those that it follows back."""
        if self.rods:
            drive = self.robot.drive
            swivels = [swivel.joint for swivel in (*drive.steered, *drive.followers)]
            joints = {name: self.joint(name) for name in swivels}
            bandwidth = min(TIE_ROD_BANDWIDTH, STABLE / self.mjm.opt.timestep)
            for name, effort in tie_rod_efforts(drive, joints, self.rods, bandwidth).items():
                self.data.qfrc_applied[self.dofs[name]] += effort

    def push_body(self, body: int, at: Array, force: Array, moment: Array) -> None:
        """Push a body besides, until ``xfrc_applied`` is cleared.

        Args:
            body: Its index.
            at: Where the force acts (3,), world, m.
            force: (3,), world, N.
            moment: (3,), world, N·m.
        """
        applied = self.data.xfrc_applied[body]  # MuJoCo takes it at the centre of mass
        applied[:3] += force
        applied[3:] += moment + np.cross(at - self.data.xipos[body], force)

    def bearing(self) -> Iterator[tuple[int, int, Array]]:
        """Yield each contact with the ground: its number, whose it is, and its wrench (6,)."""
        for k, (one, other) in enumerate(self.data.contact.geom.tolist()):
            contact = self.owner.get(other)
            if contact is not None and self.mjm.geom_bodyid[one] == 0:
                wrench = np.zeros(6)
                self.mujoco.mj_contactForce(self.mjm, self.data, k, wrench)
                yield k, contact, wrench

    def loads(self) -> Array:
        """Return what each contact bears (n,), N, by the forces computed last."""
        load = np.zeros(len(self.contacts))
        for _, contact, wrench in self.bearing():
            load[contact] += wrench[0]
        return load


def planar(pose: Array) -> Array:
    """Return x, y (m) and heading (rad) of a pose (7,) seen from above."""
    x, y, z, w = pose[3:]
    turn = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.array([pose[0], pose[1], turn])


def tilt(pose: Array) -> float:
    """Return how far a pose (7,) leans out of the level, rad."""
    x, y = pose[3:5]
    return math.acos(min(1.0, max(-1.0, 1.0 - 2.0 * (x * x + y * y))))


def vertical_inverse_masses(model: Any, geoms: Collection[int]) -> Array:
    """Return how vertical forces accelerate geoms' middles vertically (n_geoms,), 1/kg.

    MuJoCo scales a contact's softness by the inverse mass that a body shows in all directions
    (``body_invweight0``). A caster's wheel swings aside about its swivel as if it weighed its own
    few grams, and so MuJoCo presses it in up to a hundred times further than a driven wheel under
    the same load: the robot leans on its casters. Upwards, all of them bear the robot.

    Args:
        model: The ``MjModel``, in its reference posture.
        geoms: Ids of the geoms that meet the ground.
    """
    mujoco = mujoco_library()
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    jacobian, moved, found = np.zeros((3, model.nv)), np.zeros((1, model.nv)), []
    for geom in geoms:
        body = int(model.geom_bodyid[geom])
        mujoco.mj_jac(model, data, jacobian, None, data.geom_xpos[geom], body)
        mujoco.mj_solveM(model, data, moved, jacobian[2:])
        found.append(float(jacobian[2] @ moved[0]))
    return np.array(found)


def follower_slopes(
    drive: Drive, at: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return each follower's angle (rad), and its derivative by each leader's.

    Args:
        drive: The drive.
        at: The leaders' angles, rad.
    """
    place = follower_positions(drive, dict(at))
    slopes: dict[str, dict[str, float]] = {name: {} for name in place}
    for leader in at:
        nearby = follower_positions(drive, {**at, leader: at[leader] + DIFFERENCE_STEP})
        for name in place:  # heading back is heading along
            change = math.remainder(nearby[name] - place[name], math.pi)
            slopes[name][leader] = change / DIFFERENCE_STEP
    return place, slopes


def tie_rod_efforts(
    drive: Drive,
    joints: Mapping[str, tuple[float, float]],
    inertia: Mapping[str, float],
    bandwidth: float,
) -> dict[str, float]:
    """Return the efforts (N·m) of tie rods, critically damped, on followers and their leaders.

    A rod is a spring and a damper on φ = δ − f(leaders), so it does no work but on φ: the follower
    feels −(k φ + d φ̇), the leaders ∂f/∂δ times the opposite.

    Args:
        drive: The drive.
        joints: Positions (rad) and rates (rad/s) of its swivels, by joint.
        inertia: Of each follower about its axis, kg·m².
        bandwidth: Of each spring, against the inertia of the swivel that it turns, rad/s.
    """
    if not drive.followers:
        return {}
    leaders = {swivel.joint: joints[swivel.joint] for swivel in drive.steered}
    place, slopes = follower_slopes(drive, {name: at for name, (at, _) in leaders.items()})
    efforts = dict.fromkeys((*leaders, *place), 0.0)
    for name, wanted in place.items():
        position, rate = joints[name]
        rate -= sum(slope * leaders[leader][1] for leader, slope in slopes[name].items())
        gap = math.remainder(position - wanted, math.pi)  # heading back is heading along
        pull = inertia[name] * bandwidth * (bandwidth * gap + 2.0 * rate)
        efforts[name] -= pull
        for leader, slope in slopes[name].items():
            efforts[leader] += slope * pull
    return efforts


@dataclass(frozen=True, eq=False)
class Touching:
    """What of a robot meets the ground in MuJoCo.

    Attributes:
        contacts: Names of the contacts, as ``Contacts.names``.
        owner: Name of the contact of each geom, by the geom's name.
        crowned: Name of the geom of each wheel that touches at one point, by its joint.
        tied: Whether swivels follow another one by an equality.
    """

    contacts: tuple[str, ...]
    owner: Mapping[str, str]
    crowned: Mapping[str, str]
    tied: bool = False


class RollingBody(MujocoBody):
    """A robot in MuJoCo whose rollers and tie rods are worked in each step.

    Rollers and balls are held by the ground in one direction only; rods are springs that hold the
    swivels that follow others to their places.

    Args:
        robot: The robot, whose names the model has.
        model: The ``MjModel``.
        root: Name of the root link's body.
        touching: What of it meets the ground.
        friction: Coefficient along the direction in which rollers and balls are held.

    Attributes:
        rolling: The wheels that are held in one direction only, by the index of their geom.
    """

    def __init__(
        self, robot: Robot, model: Any, root: str, touching: Touching, friction: float
    ) -> None:
        super().__init__(robot, model, root, touching.contacts, touching.owner)
        crowned = {w: touching.crowned.get(w.joint) for w in robot.drive.wheels}
        self.rolling: dict[int, Wheel] = {
            int(model.geom(geom).id): wheel
            for wheel, geom in crowned.items()
            if geom is not None and one_directional(robot, wheel)
        }
        self._friction = friction
        self._motors = [self.dofs[name] for name in robot.actuators]

    def start(self, q: Array, tied: bool = True) -> None:
        """Put the robot at q (nq,), at rest, its wheels at the height of the ground.

        Args:
            q: Configuration.
            tied: Whether tie rods hold the swivels that follow others.
        """
        self.put(q, -self.robot.drive.floor)
        self.mujoco.mj_forward(self.mjm, self.data)
        if tied:
            self.tie()

    def steps(self, tau: Array, count: int) -> Iterator[int]:
        """Step under efforts (n_act,), N·m or N, and yield the number of each step."""
        with muted():
            for step in range(count):
                self.data.qfrc_applied[:] = 0.0
                self.data.qfrc_applied[self._motors] = tau
                self.pull_rods()
                self.mujoco.mj_step1(self.mjm, self.data)
                self._turn_contacts()
                self.mujoco.mj_step2(self.mjm, self.data)
                yield step

    def _turn_contacts(self) -> None:
        """Let friction hold rollers and balls along one direction only, between two half steps."""
        if not self.rolling:
            return
        frames, friction = self.data.contact.frame, self.data.contact.friction
        for k, geom in enumerate(self.data.contact.geom2.tolist()):
            wheel = self.rolling.get(geom)
            if wheel is not None:
                (nx, ny, nz), (x, y, _) = frames[k, :3].tolist(), self.held(wheel).tolist()
                frames[k, 3:] = x, y, 0.0, -nz * y, nz * x, nx * y - ny * x  # n × held
                friction[k, :2] = self._friction, ROLLER_FRICTION
        self.mujoco.mj_makeConstraint(self.mjm, self.data)
        self.mujoco.mj_projectConstraint(self.mjm, self.data)
        self.mujoco.mj_fwdVelocity(self.mjm, self.data)

    def held(self, wheel: Wheel) -> Array:
        """Return the direction (3,) in which the ground holds a wheel, level, world.

        It turns with the wheel's axle, which the file draws and MuJoCo has now.
        """
        now = complex(*self.data.xaxis[self.mjm.joint(wheel.joint).id][:2])
        drawn = complex(*self.robot.tree.axis(self.robot.description.joint[wheel.joint])[:2])
        turned = complex(*wheel.direction) * now / drawn
        return np.array([turned.real, turned.imag, 0.0]) / abs(turned)


def one_directional(robot: Robot, wheel: Wheel) -> bool:
    """Return whether the ground holds a wheel in one direction only."""
    return wheel.slides or robot.drive.type in ("mecanum", "omni")
