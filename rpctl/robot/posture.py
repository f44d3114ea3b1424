"""A posture that an arm can work from: away from singular ones, from limits, ground and base."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.robot.link_boxes import LinkBoxes, LinkPoints
from rpctl.robot.model import Robot

SEED = 0  # of the draws: the same robot has the same posture every time
SCALE_DRAWS = 64  # random postures that tell how well a branch can stand at best
SEARCH_DRAWS = 300  # random postures that a search starts from
KEPT_DRAWS = 40  # of these, the best ones, whose shapes are looked at
DRAWN_REACH = 0.75 * math.pi  # rad; how far from zero an angle is drawn
DRAWN_SLIDE = 0.5  # m; how far from zero an unlimited sliding joint is drawn
LIMIT_MARGIN = 0.15  # of a joint's range: how far a search keeps from limits
WEAK_MANIPULABILITY = 0.1  # of the best that was drawn: below it a posture is near singular
WEAK_LIGHTNESS = 0.05  # of the best that was drawn: below it joints turn about one axis
SUNK_HEIGHT = -0.02  # m over the ground: below it a posture reaches into the ground
GROUND_CLEARANCE = 0.05  # m that a search leaves below the arm
PENALTY_LENGTH = 0.02  # m into what must stay clear that weigh as a factor e of manipulability
FORWARD_LENGTH = 0.5  # m behind the front of the base that weigh so
FORWARD_CLEARANCE = 0.1  # m that the end effector keeps ahead of the base
BEARING_WEIGHT = 0.5  # per rad that the end is off straight ahead of where its branch turns
LIMIT_WEIGHT = 1.0  # per square of a joint's way from the middle of its range to a limit (mean)
OVERLOAD_WEIGHT = 10.0  # per effort limit that gravity asks beyond the share that a search leaves
HOLDING_SHARE = 0.8  # of an effort limit that gravity may take, as other branches move, too
TWIST_WEIGHT = 0.2  # per rad² (mean of the joints that turn) that a posture is off zero
FIRST_STEP, LAST_STEP = 0.15, 0.01  # of a joint's range: steps of the refinement
STARTS = 2  # drawn postures that are refined
DIGITS = 3  # after the point, of positions in rad and m
METRES_PER_RADIAN = 0.3  # m/rad: weight of an angle relative to a distance
MIN_SINGULAR = 1e-6  # of the largest singular value: below it a direction counts as lost
GROWTH = 0.03  # m; how far the end of a branch keeps from the rest of the robot


@dataclass(frozen=True)
class Scale:
    """What a branch can do at best, over random postures.

    Attributes:
        rank: Directions in which its end can be moved.
        manipulability: Largest product of the singular values of these.
        lightness: Largest of the smallest eigenvalues of the inertia, scaled.
    """

    rank: int
    manipulability: float
    lightness: float

    def ratios(self, measures: Measures) -> tuple[float, float]:
        """Return a posture's manipulability and lightness over the best, in [0, 1] as a rule."""
        manipulability = float(np.prod(measures.singular[: self.rank])) / self.manipulability
        return manipulability, measures.lightness / self.lightness


def find_posture(robot: Robot, posture: Array, force: bool) -> tuple[Array, tuple[str, ...]]:
    """Return a posture for a robot's arm and why it is not the given one.

    Each branch keeps its positions where it can work from them; else, or if ``force`` says so, a
    better posture is searched for it: the same one every time.

    Args:
        posture: Positions of all its joints (n_joints,), rad or m.
    """
    posture, reasons = posture.copy(), []
    for branch, scale, rng, reason in _judged(robot, posture):
        reasons.append(reason)
        if reason or force:
            at, box = list(branch.joints), _box(branch)
            draws = rng.uniform(*box, (SEARCH_DRAWS, len(at)))
            posture[at] = _search(branch, scale, np.vstack([posture[at], draws]), box)
    return posture, tuple(filter(None, reasons))


def judge(robot: Robot, posture: Array) -> tuple[str, ...]:
    """Return why an arm cannot work well from a posture, in words; nothing if it can.

    Args:
        posture: Positions of all its joints (n_joints,), rad or m.
    """
    return tuple(reason for *_, reason in _judged(robot, posture) if reason)


def _judged(
    robot: Robot, posture: Array
) -> Iterator[tuple[Branch, Scale, np.random.Generator, str]]:
    """Yield each branch, what it can do at best, the draws' source, and why it stands badly."""
    for end, joints in split_branches(robot):
        branch, rng = Branch(robot, end, joints, posture), np.random.default_rng(SEED)
        scale = _scale(branch, rng.uniform(*_box(branch), (SCALE_DRAWS, len(joints))))
        yield branch, scale, rng, _weakness(branch, scale, posture[list(joints)])


def _box(branch: Branch) -> tuple[Array, Array]:
    """Return the limits (n,) between which postures are drawn."""
    low, high = [], []
    for index in branch.joints:
        joint = branch.robot.joints[index]
        lower, upper = joint.span(DRAWN_SLIDE if joint.kind == "prismatic" else DRAWN_REACH)
        margin = LIMIT_MARGIN * (upper - lower)
        lower, upper = lower + margin, upper - margin
        if joint.kind != "prismatic":  # of a wide range, the part about zero
            centre = min(max(0.0, lower), upper)
            lower, upper = max(lower, centre - DRAWN_REACH), min(upper, centre + DRAWN_REACH)
        low.append(lower)
        high.append(upper)
    return np.array(low), np.array(high)


def _scale(branch: Branch, draws: Array) -> Scale:
    measures = [branch.measure(positions, with_clearance=False) for positions in draws]
    values = np.array([each.singular for each in measures])
    rank = int((values > MIN_SINGULAR * values[:, :1]).sum(axis=1).max())
    best = float(values[:, :rank].prod(axis=1).max())
    return Scale(rank, max(best, 1e-300), max(each.lightness for each in measures))


def _weakness(branch: Branch, scale: Scale, positions: Array) -> str:
    """Return why a posture is none to work from; empty if it is one."""
    measures, who = branch.measure(positions), f"the arm to {branch.end}"
    ratio, lightness = scale.ratios(measures)
    if ratio < WEAK_MANIPULABILITY:
        return f"{who} is stretched or near singular ({ratio:.1%} of its best manipulability)"
    if lightness < WEAK_LIGHTNESS:
        return (
            f"joints of {who} turn about nearly the same axis, with almost no inertia between them"
        )
    if branch.robot.drive.wheels and measures.height < SUNK_HEIGHT:
        return f"{who} reaches {-measures.height:.2g} m into the ground"
    return ""


def _search(branch: Branch, scale: Scale, draws: Array, box: tuple[Array, Array]) -> Array:
    """Return the best posture (n,): of the best draws, refined joint by joint.

    Args:
        draws: Postures (k, n).
        box: Limits (n,) that the posture keeps.
    """
    low, high = box
    draws = np.clip(draws, low, high)
    rough = [_score(branch, scale, positions, with_clearance=False) for positions in draws]
    draws = draws[np.argsort(rough, kind="stable")[::-1][:KEPT_DRAWS]]
    fine = [_score(branch, scale, positions) for positions in draws]
    starts = draws[np.argsort(fine, kind="stable")[::-1][:STARTS]]
    refined = [_refine(branch, scale, positions, box) for positions in starts]
    best = max(refined, key=lambda pair: pair[1])[0]
    return np.clip(np.round(best, DIGITS), low, high) + 0.0  # no -0.0


def _refine(
    branch: Branch, scale: Scale, positions: Array, box: tuple[Array, Array]
) -> tuple[Array, float]:
    """Return a better posture near one, by steps along single joints, and its score."""
    low, high = box
    step, score = FIRST_STEP, _score(branch, scale, positions)
    while step >= LAST_STEP:
        improved = False
        for index in range(len(positions)):
            for sign in (1.0, -1.0):
                trial = positions.copy()
                trial[index] += sign * step * (high - low)[index]
                trial = np.clip(trial, low, high)
                value = _score(branch, scale, trial)
                if value > score:
                    positions, score, improved = trial, value, True
                    break
        if not improved:
            step *= 0.5
    return positions, score


def _score(branch: Branch, scale: Scale, positions: Array, with_clearance: bool = True) -> float:
    """Return how good a posture is: logarithms of its ratios, less what stands against it."""
    measures = branch.measure(positions, with_clearance)
    score = sum(math.log(max(ratio, 1e-12)) for ratio in scale.ratios(measures))
    score -= BEARING_WEIGHT * measures.bearing + _strain(branch, positions)
    score -= OVERLOAD_WEIGHT * max(0.0, measures.load - HOLDING_SHARE)
    if branch.robot.drive.wheels:
        behind = FORWARD_CLEARANCE - measures.forward
        score -= min(1.0, max(0.0, behind / FORWARD_LENGTH))
    if with_clearance:
        sunk = max(0.0, GROUND_CLEARANCE - measures.height)
        score -= (sunk + measures.depth) / PENALTY_LENGTH
    return score


def _strain(branch: Branch, positions: Array) -> float:
    """Return what stands against positions (n,) on their own: near limits, or turned far."""
    joints = [branch.robot.joints[index] for index in branch.joints]
    strain = 0.0
    for joint, position in zip(joints, positions.tolist(), strict=True):
        if math.isfinite(half := 0.5 * (joint.upper - joint.lower)) and half > 0.0:
            strain += LIMIT_WEIGHT * ((position - joint.lower) / half - 1.0) ** 2
        if joint.kind != "prismatic":
            strain += TWIST_WEIGHT * position**2
    return strain / len(joints)


@dataclass(frozen=True)
class Measures:
    """How well a branch stands in a posture.

    Attributes:
        singular: Singular values of the Jacobian of its end (6,), m and ``METRES_PER_RADIAN``
            rad, largest first.
        lightness: Smallest eigenvalue of the inertia of its joints, the diagonal scaled to 1: near
            0 where joints can move against each other and next to nothing moves.
        height: Of its lowest point above the ground, m.
        depth: How deep its outer half is in the rest of the robot, m.
        forward: How far ahead of the rest of the robot its end is, m.
        bearing: Angle between the way from where the branch begins to turn to its end and the
            forward direction, rad.
        load: What gravity asks of a joint of the robot over its effort limit, the largest.
    """

    singular: Array
    lightness: float
    height: float
    depth: float
    forward: float
    bearing: float
    load: float


class Branch:
    """The joints of a robot that carry one end and no branch before it.

    Attributes:
        robot: The robot.
        joints: Indices of these joints in ``robot.joints``, from the root on.
        end: The link that they carry.
    """

    def __init__(self, robot: Robot, end: str, joints: tuple[int, ...], posture: Array) -> None:
        """See the class.

        Args:
            joints: Indices in ``robot.joints``.
            posture: Positions of all joints (n_joints,): where the others stay.
        """
        self.robot, self.end, self.joints = robot, end, joints
        self._data = robot.model.createData()
        self._frame = robot.model.getFrameId(end, pin.FrameType.BODY)
        self._q = robot.configuration_at(np.zeros(3), posture)
        names = [robot.joints[i].name for i in joints]
        self._entries = [robot.entries[name] for name in names]
        self._mimics = [
            (robot.entries[j.name], names.index(j.mimic.joint), j.mimic)
            for j in robot.mimics
            if j.mimic is not None and j.mimic.joint in names
        ]
        self._columns = rate_columns(robot, names)
        self._holding = rate_columns(robot, robot.joint_names)
        self._limits = np.array([joint.effort or math.inf for joint in robot.joints])
        pin.forwardKinematics(robot.model, self._data, self._q)
        links = [name for name, _ in robot.tree.rigid_links(robot.description.root)]
        links += [robot.description.joint[wheel.joint].child for wheel in robot.drive.wheels]
        # How far ahead of P the foremost point of the base is, m.
        self._front = float(LinkPoints(robot, links)(self._data)[:, 0].max())
        # Where the first joint that turns lies, or the first one at all (3,), m.
        turning = (i for i in joints if robot.joints[i].kind != "prismatic")
        mount = robot.model.getJointId(robot.joints[next(turning, joints[0])].name)
        self._mount = np.array(self._data.oMi[mount].translation)

    def measure(self, positions: Array, with_clearance: bool = True) -> Measures:
        """Return how well the branch stands.

        Args:
            positions: Of its joints (n,), rad or m.
            with_clearance: Whether to look at shapes, too; else heights and depths are 0.
        """
        model, data, q = self.robot.model, self._data, self._q
        for entry, position in zip(self._entries, positions, strict=True):
            entry.write(q, position)
        for entry, index, mimic in self._mimics:
            entry.write(q, mimic.multiplier * positions[index] + mimic.offset)
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = pin.computeFrameJacobian(model, data, q, self._frame, frame) @ self._columns
        jacobian[3:] *= METRES_PER_RADIAN
        singular = np.linalg.svd(jacobian, compute_uv=False)
        pin.crba(model, data, q, pin.Convention.WORLD)
        inertia = np.triu(data.M) + np.triu(data.M, 1).T
        inertia = self._columns.T @ inertia @ self._columns
        scale = 1.0 / np.sqrt(np.diag(inertia))
        lightness = float(np.linalg.eigvalsh(inertia * np.outer(scale, scale))[0])
        height = depth = 0.0
        if with_clearance:
            points = self._moved(data)
            height = float(points[:, 2].min()) - self.robot.drive.ground
            depth = self._rest.depth(data, self._outer(data))
        at = pin.updateFramePlacement(model, data, self._frame).translation
        x, y, z = at - self._mount
        bearing = math.atan2(math.hypot(y, z), x)
        gravity = self._holding.T @ pin.computeGeneralizedGravity(model, data, q)
        load = float((np.abs(gravity) / self._limits).max())
        forward = float(at[0]) - self._front
        return Measures(singular, lightness, height, depth, forward, bearing, load)

    @cached_property
    def _moved(self) -> LinkPoints:
        """Points of all links that the branch moves."""
        return LinkPoints(self.robot, self._links_below(0))

    @cached_property
    def _outer(self) -> LinkPoints:
        """Points of the links beyond the middle of the branch."""
        return LinkPoints(self.robot, self._links_below((len(self.joints) - 1) // 2))

    @cached_property
    def _rest(self) -> LinkBoxes:
        """Boxes of the links that stay, or that move with the first joints only."""
        moved = set(self._links_below(max(0, (len(self.joints) - 1) // 2 - 2)))
        others = [name for name in self.robot.description.link if name not in moved]
        return LinkBoxes(self.robot, others, GROWTH)

    def _links_below(self, index: int) -> list[str]:
        """Return the links that one of the branch's joints moves."""
        joint = self.robot.joints[self.joints[index]]
        return [below.child for below in self.robot.description.below(joint)]


def rate_columns(robot: Robot, names: Sequence[str]) -> Array:
    """Return v (nv, n) for a unit rate of each of some joints, mimics following."""
    columns = np.zeros((robot.nv, len(names)))
    for column, name in enumerate(names):
        columns[robot.velocity_index(name), column] = 1.0
        for joint in robot.mimics:
            if joint.mimic is not None and joint.mimic.joint == name:
                columns[robot.velocity_index(joint.name), column] = joint.mimic.multiplier
    return columns


def split_branches(robot: Robot) -> list[tuple[str, tuple[int, ...]]]:
    """Return the ends of an arm with the joints (indices) that carry each and none before it.

    The end effector comes first, then the others by the number of joints.
    """
    description, names = robot.description, list(robot.joint_names)

    def carriers(link: str) -> list[int]:
        chain = {joint.name: joint for joint in description.chain(link)}
        followed = {j.mimic.joint for j in chain.values() if j.mimic is not None}
        return [names.index(n) for n in names if n in chain or n in followed]

    tips = sorted((joint.child for joint in robot.joints), key=lambda link: -len(carriers(link)))
    ends = [robot.end_effector, *tips] if robot.end_effector else tips
    branches, seen = [], set[int]()
    for end in ends:
        own = [index for index in carriers(end) if index not in seen]
        if own:
            branches.append((end, tuple(own)))
            seen |= set(own)
    return branches
