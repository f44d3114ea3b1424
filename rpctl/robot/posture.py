"""A posture that an arm can work from: away from singular ones, from limits, ground and base."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.branch import MIN_SINGULAR, Branch, Measures, split_branches
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
TWIST_WEIGHT = 0.2  # per rad² (mean of the joints that turn) that a posture is off zero
FIRST_STEP, LAST_STEP = 0.15, 0.01  # of a joint's range: steps of the refinement
STARTS = 2  # drawn postures that are refined
DIGITS = 3  # after the point, of positions in rad and m


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

    def manipulability_ratio(self, measures: Measures) -> float:
        """Return a posture's manipulability over the best one, in [0, 1] as a rule."""
        return float(np.prod(measures.singular[: self.rank])) / self.manipulability

    def lightness_ratio(self, measures: Measures) -> float:
        """Return a posture's smallest scaled inertia over the best one, in [0, 1] as a rule."""
        return measures.lightness / self.lightness


def find_posture(robot: Robot, posture: Array, force: bool) -> tuple[Array, tuple[str, ...]]:
    """Return a posture for a robot's arm and why it is not the given one.

    Each branch keeps its positions where it can work from them; else, or if ``force`` says so, a
    better posture is searched for it: the same one every time.

    Args:
        robot: The robot.
        posture: Positions of all its joints (n_joints,), rad or m.
        force: Whether to search in any case.
    """
    posture, reasons = posture.copy(), []
    for end, joints in split_branches(robot):
        branch = Branch(robot, end, joints, posture)
        at = list(joints)
        low, high = _box(branch)
        rng = np.random.default_rng(SEED)
        scale = _scale(branch, rng.uniform(low, high, (SCALE_DRAWS, len(at))))
        reason = _weakness(branch, scale, posture[at])
        if reason:
            reasons.append(reason)
        if reason or force:
            draws = rng.uniform(low, high, (SEARCH_DRAWS, len(at)))
            posture[at] = _search(branch, scale, np.vstack([posture[at], draws]), (low, high))
    return posture, tuple(reasons)


def judge(robot: Robot, posture: Array) -> tuple[str, ...]:
    """Return why an arm cannot work well from a posture, in words; nothing if it can.

    Args:
        robot: The robot.
        posture: Positions of all its joints (n_joints,), rad or m.
    """
    found = []
    for end, joints in split_branches(robot):
        branch, rng = Branch(robot, end, joints, posture), np.random.default_rng(SEED)
        scale = _scale(branch, rng.uniform(*_box(branch), (SCALE_DRAWS, len(joints))))
        found.append(_weakness(branch, scale, posture[list(joints)]))
    return tuple(reason for reason in found if reason)


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
    ratio = scale.manipulability_ratio(measures)
    if ratio < WEAK_MANIPULABILITY:
        return f"{who} is stretched or near singular ({ratio:.1%} of its best manipulability)"
    if scale.lightness_ratio(measures) < WEAK_LIGHTNESS:
        return f"joints of {who} turn about nearly one axis, with next to no inertia between them"
    if branch.robot.drive.wheels and measures.height < SUNK_HEIGHT:
        return f"{who} reaches {-measures.height:.2g} m into the ground"
    return ""


def _search(branch: Branch, scale: Scale, draws: Array, box: tuple[Array, Array]) -> Array:
    """Return the best posture (n,): of the best draws, refined joint by joint.

    Args:
        branch: The branch.
        scale: What it can do at best.
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
    manipulability = max(scale.manipulability_ratio(measures), 1e-12)
    lightness = max(scale.lightness_ratio(measures), 1e-12)
    score = math.log(manipulability) + math.log(lightness)
    score -= BEARING_WEIGHT * measures.bearing + _strain(branch, positions)
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
