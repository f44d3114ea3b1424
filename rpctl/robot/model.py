"""``Robot``: a Pinocchio model on a planar root, its drive, and the names of its coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from rpctl.errors import DescriptionError, Finding, RpctlError, UnknownNameError
from rpctl.robot import catalog
from rpctl.robot.description import Array, Description, Joint
from rpctl.robot.drive import FIXED, Drive, detect
from rpctl.robot.urdf import read

BASE_NQ = 4  # x, y, cos θ, sin θ of the planar root
BASE_NV = 3
SINGULAR = 1e-12  # least eigenvalue of M with its diagonal scaled to one; below is rounding
HOME_MARGIN = 0.3  # of a joint's range: home keeps this far from its limits


@dataclass(frozen=True)
class Robot:
    """A wheeled robot on flat ground.

    Attributes:
        name: The robot's name.
        source: What it was loaded from: an absolute path or a catalogue name.
        description: Its URDF.
        model: ``pinocchio.Model`` with a ``JointModelPlanar`` root, locked joints frozen.
        drive: Its wheels.
        locked: Frozen joints and their positions (rad or m).
        joints: The arm: moving joints that are neither wheels nor mimics, in file order.
        end_effector: Link whose pose is tracked, or None for a robot without an arm.
        findings: What was noticed in the description and the model.
    """

    name: str
    source: str
    description: Description = field(repr=False)
    model: pin.Model = field(repr=False)
    drive: Drive
    locked: Mapping[str, float] = field(repr=False)
    joints: tuple[Joint, ...] = field(repr=False)
    end_effector: str | None
    findings: tuple[Finding, ...] = field(repr=False)

    @cached_property
    def quasi_velocities(self) -> tuple[str, ...]:
        """Names of ν: the base's speeds (v of P, omega), then the joints' rates."""
        return self.drive.base_speeds + tuple(joint.name for joint in self.joints)

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        """Names of τ: the wheels' joints, left before right, then the arm's."""
        wheels = tuple(wheel.joint for wheel in self.drive.wheels)
        return wheels + tuple(joint.name for joint in self.joints)

    @property
    def dof(self) -> int:
        """Number of quasi-velocities."""
        return len(self.quasi_velocities)

    @property
    def nq(self) -> int:
        """Length of q."""
        return int(self.model.nq)

    @property
    def nv(self) -> int:
        """Length of v."""
        return int(self.model.nv)

    @property
    def mass(self) -> float:
        """Total mass, kg."""
        return float(pin.computeTotalMass(self.model))

    @cached_property
    def mimics(self) -> tuple[Joint, ...]:
        """Moving joints that follow another one."""
        return tuple(
            joint
            for joint in self.description.joints
            if joint.moving and joint.mimic is not None and self.model.existJointName(joint.name)
        )

    def end_effector_pose(self, data: pin.Data, q: Array) -> pin.SE3:
        """Return the pose of the end effector in the world; ``data`` is overwritten.

        Raises:
            RpctlError: The robot has no end effector.
        """
        if self.end_effector is None:
            raise RpctlError(f"{self.name} has no arm, so no end effector")
        frame = self.model.getFrameId(self.end_effector, pin.FrameType.BODY)
        pin.forwardKinematics(self.model, data, q)
        return pin.updateFramePlacement(self.model, data, frame).copy()

    @cached_property
    def effort_limits(self) -> Array:
        """Limits of τ (n_act,), N·m or N; inf where the URDF gives none."""
        return np.array([self.description.joint[name].effort for name in self.actuators])

    def velocity_index(self, joint: str) -> int:
        """Return a joint's index in v."""
        return int(self.model.joints[self.model.getJointId(joint)].idx_v)

    @cached_property
    def _positions(self) -> dict[str, tuple[int, int]]:
        """Index in q and number of entries of each moving joint."""
        ids = ((n, self.model.joints[self.model.getJointId(n)]) for n in self.model.names[2:])
        return {name: (int(j.idx_q), int(j.nq)) for name, j in ids}

    def configuration(
        self,
        x: float = 0.0,
        y: float = 0.0,
        theta: float = 0.0,
        joints: Mapping[str, float] | None = None,
    ) -> Array:
        """Return q (nq,) for a pose of the root link and joint positions.

        Args:
            x: Position of the root link, m.
            y: Position of the root link, m.
            theta: Heading of the root link, rad.
            joints: Positions (rad or m) by joint name; 0 for those left out. Mimic joints follow.

        Raises:
            UnknownNameError: A joint is not among the model's.
        """
        q: Array = pin.neutral(self.model)
        q[:BASE_NQ] = x, y, math.cos(theta), math.sin(theta)
        for name, position in (joints or {}).items():
            self.set_joint(q, name, position)
        for joint in self.mimics:
            if joint.mimic is not None:
                multiplier, offset = joint.mimic.multiplier, joint.mimic.offset
                followed = self.joint_position(q, joint.mimic.joint)
                self.set_joint(q, joint.name, multiplier * followed + offset)
        return q

    def set_joint(self, q: Array, joint: str, position: float) -> None:
        """Set a joint's position (rad or m) in q, in place.

        Raises:
            UnknownNameError: The joint is not among the model's.
        """
        if joint not in self._positions:
            raise UnknownNameError("joint", joint, self._positions)
        index, count = self._positions[joint]
        q[index : index + count] = (
            (math.cos(position), math.sin(position)) if count == 2 else (position,)
        )

    def joint_position(self, q: Array, joint: str) -> float:
        """Return a joint's position (rad or m) in q, or where it is locked."""
        if joint in self.locked:
            return self.locked[joint]
        index, count = self._positions[joint]
        return math.atan2(q[index + 1], q[index]) if count == 2 else float(q[index])

    def joint_positions(self, q: Array) -> Array:
        """Return the arm's positions (n_joints,), rad or m; continuous joints in (−π, π]."""
        return np.array([self.joint_position(q, joint.name) for joint in self.joints])

    def base_pose(self, q: Array) -> Array:
        """Return the pose (x, y, θ) of P and of the forward direction in the world; m, rad."""
        cos, sin = q[2], q[3]
        px, py = self.drive.point
        theta = math.atan2(sin, cos) + self.drive.heading
        return np.array([q[0] + cos * px - sin * py, q[1] + sin * px + cos * py, theta])

    def configuration_at(self, pose: Array, joints: Array) -> Array:
        """Return q (nq,) for a pose (x, y, θ) of P and arm positions (n_joints,)."""
        theta = pose[2] - self.drive.heading
        cos, sin = math.cos(theta), math.sin(theta)
        px, py = self.drive.point
        x, y = pose[0] - cos * px + sin * py, pose[1] - sin * px - cos * py
        names = (joint.name for joint in self.joints)
        return self.configuration(x, y, theta, dict(zip(names, joints, strict=True)))

    def random_configuration(self, rng: np.random.Generator) -> Array:
        """Return a random q (nq,): base anywhere within 10 m, joints within their limits.

        An unlimited revolute joint is drawn from (−π, π), an unlimited prismatic one from ±1 m.
        """
        x, y = rng.uniform(-10.0, 10.0, 2)
        positions = {}
        for name in self.model.names[2:]:
            joint = self.description.joint[name]
            reach = 1.0 if joint.kind == "prismatic" else math.pi
            low = joint.lower if math.isfinite(joint.lower) else -reach
            high = joint.upper if math.isfinite(joint.upper) else reach
            positions[name] = float(rng.uniform(low, high))
        return self.configuration(x, y, float(rng.uniform(-math.pi, math.pi)), positions)

    @cached_property
    def home(self) -> Array:
        """A posture (n_joints,) of the arm well inside its limits: 0, or the nearest to it."""
        return np.array([_home(joint) for joint in self.joints])


def load(
    source: str | Path,
    drive: Drive | None = None,
    lock: Iterable[str] | Mapping[str, float] = (),
    end_effector: str | None = None,
) -> Robot:
    """Load a robot.

    Args:
        source: A URDF path or a catalogue name (``rpctl robots``).
        drive: The drive; None finds it.
        lock: Joints to freeze: name patterns (``"hand_*"``), at position 0, or ``{pattern:
            position}`` (rad or m). They add to those that the catalogue freezes.
        end_effector: Link to track; None takes the end of the longest chain of moving joints.

    Raises:
        DescriptionError: The file cannot be used; every fault is named with its line.
        DriveError: No drive was found, or more than one.
        UnknownNameError: A name is not known; the nearest are suggested.
    """
    path, entry = _resolve(source)
    description = read(path)
    locked = _locked(description, entry.lock if entry else (), lock)
    if drive is None:
        fixed = entry is not None and entry.base == "fixed"
        drive = FIXED if fixed else detect(description, locked)
    model, findings = _build(description, locked)
    _require_inertia(description, model)
    wheels = {wheel.joint for wheel in drive.wheels}
    joints = tuple(
        joint
        for joint in description.joints
        if joint.moving
        and joint.mimic is None
        and joint.name not in wheels
        and joint.name not in locked
    )
    if end_effector is not None and end_effector not in description.link:
        raise UnknownNameError("link", end_effector, description.link)
    return Robot(
        name=entry.name if entry else description.name,
        source=entry.name if entry else str(path.resolve()),
        description=description,
        model=model,
        drive=drive,
        locked=locked,
        joints=joints,
        end_effector=end_effector or _tip(description, joints),
        findings=description.findings + findings,
    )


def _resolve(source: str | Path) -> tuple[Path, catalog.Entry | None]:
    """Return the file of a path or catalogue name; a name without a dot or slash is a name."""
    path = Path(source)
    if isinstance(source, Path) or path.exists() or path.suffix or "/" in str(source):
        return path, None
    entry = catalog.find(str(source))
    return entry.path, entry


def _locked(
    description: Description,
    defaults: Iterable[str],
    lock: Iterable[str] | Mapping[str, float],
) -> dict[str, float]:
    wanted = dict.fromkeys(defaults, 0.0)
    if isinstance(lock, str):
        lock = (lock,)
    wanted.update(lock if isinstance(lock, Mapping) else dict.fromkeys(lock, 0.0))
    moving = [joint.name for joint in description.joints if joint.moving]
    locked: dict[str, float] = {}
    for pattern, position in wanted.items():
        names = [name for name in moving if fnmatchcase(name, pattern)]
        if not names and pattern not in defaults:
            raise UnknownNameError("joint to lock", pattern, moving)
        locked.update(dict.fromkeys(names, float(position)))
    return locked


def _build(
    description: Description, locked: dict[str, float]
) -> tuple[pin.Model, tuple[Finding, ...]]:
    """Return the model with a planar root and the locked joints frozen, and what was noticed."""
    _require_mass(description, locked)
    full = pin.buildModelFromXML(description.xml, pin.JointModelPlanar())
    if not locked:  # buildReducedModel refuses a link and a joint of one name; do without it
        return full, _ignored_losses(description)
    at = pin.neutral(full)
    for name, position in locked.items():
        joint = full.joints[full.getJointId(name)]
        two = joint.nq == 2
        at[joint.idx_q : joint.idx_q + joint.nq] = (
            (math.cos(position), math.sin(position)) if two else (position,)
        )
    model = pin.buildReducedModel(full, [full.getJointId(name) for name in locked], at)
    return model, _ignored_losses(description)


def _ignored_losses(description: Description) -> tuple[Finding, ...]:
    lossy = [j for j in description.joints if j.moving and (j.damping or j.friction)]
    if not lossy:
        return ()
    text = f"damping and friction of {len(lossy)} joints are left out: rigid bodies, no losses"
    return (Finding("info", lossy[0].line, text),)


def _require_mass(description: Description, locked: dict[str, float]) -> None:
    """Refuse a joint that moves no mass: the inertia matrix would be singular.

    Raises:
        DescriptionError: Naming each such joint and the links that lack an inertia.
    """
    faults = []
    for joint in description.joints:
        if not joint.moving or joint.name in locked:
            continue
        carried, edge = [], [joint.child]
        while edge:
            link = edge.pop()
            carried.append(link)
            edge.extend(below.child for below in description.child_joints[link])
        masses = [description.link[name].mass for name in carried]
        if any(masses):
            continue
        first = description.link[joint.child]
        lacking = "has no <inertial>" if first.mass is None else "has no mass"
        faults.append(
            Finding(
                "error",
                first.line,
                f'link "{first.name}" {lacking}, yet joint "{joint.name}" moves it; give its '
                "<inertial> (mass, centre of mass, inertia), or freeze the joint with --lock "
                f"{joint.name}",
            )
        )
    if not any(link.mass for link in description.links):
        root = description.link[description.root]
        text = "no link has a mass; dynamics need <inertial> elements"
        faults.insert(0, Finding("error", root.line, text))
    if faults:
        raise DescriptionError(description.path, faults)


def _require_inertia(description: Description, model: pin.Model) -> None:
    """Refuse a robot whose inertia matrix is not positive definite: its forces say no motion.

    Raises:
        DescriptionError: Naming the joint that can move without a force.
    """
    M = pin.crba(model, model.createData(), pin.neutral(model))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(scale[:, None] * M * scale)
    if values[0] > SINGULAR:
        return
    index = int(np.abs(vectors[:, 0]).argmax())
    names = ("root", *model.names[2:])
    joint = next(n for n, j in zip(names, model.joints[1:], strict=True) if index < j.idx_v + j.nv)
    line = description.joint[joint].line if joint in description.joint else None
    text = (
        f'the inertia matrix is not positive definite: joint "{joint}" moves links of no or '
        "negative inertia; correct their <inertial>"
    )
    raise DescriptionError(description.path, [Finding("error", line, text)])


def _tip(description: Description, joints: tuple[Joint, ...]) -> str | None:
    """Return the link at the end of the longest arm: past its last joint, up to a fork."""
    names = {joint.name for joint in joints}

    def length(joint: Joint) -> int:
        return sum(above.name in names for above in description.chain(joint.child))

    if not joints:
        return None
    link = max(joints, key=length).child
    while len(description.child_joints[link]) == 1:
        (below,) = description.child_joints[link]
        link = below.child
    return link


def _home(joint: Joint) -> float:
    if math.isinf(joint.lower) or math.isinf(joint.upper):
        return 0.0
    margin = HOME_MARGIN * (joint.upper - joint.lower)
    return float(np.clip(0.0, joint.lower + margin, joint.upper - margin))
