"""The end of an arm: grippers, found by structure and then by name, and the end effector."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description, Joint
from rpctl.drive.drive import Drive
from rpctl.errors import Finding

MAX_FINGER_REACH = 0.25  # m, from a finger's joint to whatever it moves; the shortest arms have .3
MAX_FINGER_MASS = 1.0  # kg that a finger's joint moves; those of large grippers have .5
PARALLEL_COSINE = 0.98  # of the angle between the axes of fingers that face each other
LIMIT_TOLERANCE = 0.1  # of a finger's range: by how much mirrored limits may differ
HAND_BRANCHES = 3  # short branches below one body that make it a palm, whichever way they move
JOINT_WORDS = {"finger", "gripper", "grip", "jaw", "claw", "thumb", "knuckle", "hand"}
LINK_WORDS = {"finger", "jaw", "claw", "thumb", "knuckle"}  # a link "gripper" is often the palm
WRIST_WORDS = {"roll", "pitch", "yaw", "rotate", "rotation", "wrist", "turn", "twist", "swivel"}
WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
MIMIC, MIRRORED, BRANCHES, NAMED = (
    "they mimic one another",
    "they mirror each other",
    "short branches of one palm",
    "by name",
)
WHEEL_WORDS = {"wheel", "caster", "castor", "tire", "tyre", "steer", "steering"}
WHEEL_HEIGHT = 1.5  # of the drive's largest radius: an axle above it is no wheel's


@dataclass(frozen=True)
class Gripper:
    """Joints that close on things.

    Attributes:
        palm: The link that carries them.
        joints: Their names, mimics among them, in file order.
        why: Why they are taken for fingers.
    """

    palm: str
    joints: tuple[str, ...]
    why: str


def find_grippers(tree: FrozenTree) -> tuple[Gripper, ...]:
    """Return the grippers of a robot that have a free joint.

    Fingers are short and light, hang on an arm that can move without them, and carry no wheel.
    They are found by structure: branches of one body whose joints mimic one another, pairs of
    joints that mirror each other, or three and more short branches of a palm. What is left at
    the end of an arm counts by its name. Joints that hang on no other joint are never fingers:
    they may be all that the robot has.

    Args:
        tree: The robot, with its locked joints.
    """
    description = tree.description
    found: list[Gripper] = []
    taken: set[str] = set()
    for body, branches in _branches(description).items():
        hanging = [j for j in branches if j.name not in taken and _arm_above(tree, j)]
        short = [  # and light, and nothing in them turns for ever
            joint
            for joint in hanging
            if _is_small(tree, joint)
            and not any(each.endless and not each.mimic for each in _below(description, joint))
        ]
        fingers, why = _fingers(tree, short, complete=len(short) == len(branches))
        names = {below.name for joint in fingers for below in _below(description, joint)}
        taken |= names
        found += _gripper(tree, body, names, why)
    for joint in description.joints:
        if joint.name not in taken and _is_named_finger(tree, joint):
            names = {below.name for below in _below(description, joint)}
            taken |= names
            found += _gripper(tree, joint.parent, names, NAMED)
    return tuple(found)


def freeze_grippers(
    tree: FrozenTree, grippers: Iterable[Gripper], free: Iterable[str]
) -> tuple[FrozenTree, tuple[Finding, ...]]:
    """Return the robot with its grippers frozen, and what to tell of it.

    Each joint stays at 0, or the nearest position inside its limits; mimics where they follow.

    Args:
        tree: The robot, with its locked joints.
        free: Patterns of the joints that stay free; those that mimic them stay free, too.
    """
    description, patterns = tree.description, tuple(free)
    frozen, told = dict(tree.locked), []
    for gripper in grippers:
        released = _released(description, gripper.joints, patterns)
        names = [n for n in gripper.joints if n not in released and n not in frozen]
        if not names:
            continue
        few = ", ".join(names) if len(names) <= 2 else f"{names[0]} and {len(names) - 1} more"
        told.append(f"{few} on {gripper.palm} ({gripper.why})")
        frozen |= {n: _frozen_position(description.joint[n], frozen, description) for n in names}
    if not told:
        return tree, ()
    text = f"gripper joints are frozen: {'; '.join(told)}; --free PATTERN lets them move"
    return replace(tree, locked=frozen), (Finding("info", None, text),)


def _branches(description: Description) -> dict[str, list[Joint]]:
    """Return the moving joints below each rigid body, by its topmost link, from the root down."""
    branches: dict[str, list[Joint]] = {}
    stack = [(description.root, description.root)]
    while stack:
        link, body = stack.pop()
        for joint in description.child_joints[link]:
            if joint.moving:
                branches.setdefault(body, []).append(joint)
            stack.append((joint.child, joint.child if joint.moving else body))
    order = {joint.name: index for index, joint in enumerate(description.joints)}
    for joints in branches.values():
        joints.sort(key=lambda joint: order[joint.name])
    return branches


def _below(description: Description, joint: Joint) -> list[Joint]:
    """Return a joint and the moving ones below it."""
    return [below for below in description.below(joint) if below.moving]


def _arm_above(tree: FrozenTree, joint: Joint) -> list[Joint]:
    """Return the free joints that carry a joint and follow no other one."""
    return [above for above in tree.free_joints(joint.parent) if above.mimic is None]


def _is_small(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint moves little: no far link, no heavy one."""
    start = tree.frame(joint)[:3, 3]
    links = [tree.description.link[below.child] for below in tree.description.below(joint)]
    poses = [tree.pose(link.name) for link in links]
    origins = [pose[:3, 3] for pose in poses]
    centres = [(pose @ [*link.com, 1.0])[:3] for pose, link in zip(poses, links, strict=True)]
    reach = np.linalg.norm(np.array([*origins, *centres]) - start, axis=1).max()
    return reach <= MAX_FINGER_REACH and sum(each.mass or 0.0 for each in links) <= MAX_FINGER_MASS


def _fingers(tree: FrozenTree, short: list[Joint], complete: bool) -> tuple[list[Joint], str]:
    """Return the fingers among the short branches of one body, and why they are fingers.

    Args:
        tree: The robot, with its locked joints.
    """
    fingers, why = _mimicking(tree.description, short), MIMIC
    if not fingers:
        fingers, why = _mirrored(tree, short), MIRRORED
    if complete and not fingers and len(short) >= HAND_BRANCHES:
        return short, BRANCHES
    # All branches of a body: a thumb, or one finger more than the pair, closes with them.
    return (short if complete and fingers else fingers), why


def _mimicking(description: Description, branches: list[Joint]) -> list[Joint]:
    """Return the branches of which one has a joint that follows a joint of another."""
    owner = {
        below.name: branch.name for branch in branches for below in _below(description, branch)
    }
    coupled: set[str] = set()
    for name, branch in owner.items():
        mimic = description.joint[name].mimic
        if mimic is not None and owner.get(mimic.joint, branch) != branch:
            coupled |= {branch, owner[mimic.joint]}
    return [branch for branch in branches if branch.name in coupled]


def _mirrored(tree: FrozenTree, branches: list[Joint]) -> list[Joint]:
    """Return the branches that are one of a pair that opens and closes."""
    paired: set[str] = set()
    for index, one in enumerate(branches):
        for other in branches[index + 1 :]:
            if _mirror_each_other(tree, one, other) and not {one.name, other.name} & paired:
                paired |= {one.name, other.name}
    return [branch for branch in branches if branch.name in paired]


def _mirror_each_other(tree: FrozenTree, one: Joint, other: Joint) -> bool:
    """Return whether two joints of one kind move against each other over mirrored ranges."""
    cosine = float(tree.axis(one) @ tree.axis(other))
    slides = one.kind == "prismatic"
    if slides != (other.kind == "prismatic") or abs(cosine) < PARALLEL_COSINE:
        return False
    low, high = (other.lower, other.upper) if cosine > 0.0 else (-other.upper, -other.lower)
    span = one.upper - one.lower
    if math.isinf(span):
        return cosine < 0.0 and math.isinf(high - low)
    slack = LIMIT_TOLERANCE * span
    if cosine > 0.0 and abs(one.lower + one.upper) <= slack:
        return False  # side by side, as two eyes are: they move along, not against each other
    return abs(one.lower + high) <= slack and abs(one.upper + low) <= slack


def _is_named_finger(tree: FrozenTree, joint: Joint) -> bool:
    """Return whether a joint at the end of an arm, with all below it, is called a finger."""
    if not (tree.is_free(joint) and _has_finger_name(joint) and _is_small(tree, joint)):
        return False
    above = _arm_above(tree, joint)
    if not above or any(_has_finger_name(each) for each in above):
        return False  # of "finger_joint_1" to "finger_joint_3" all are the arm
    return all(_has_finger_name(each) or each.mimic for each in _below(tree.description, joint))


def _has_finger_name(joint: Joint) -> bool:
    words = name_words(joint.name)
    named = words & JOINT_WORDS or name_words(joint.child) & LINK_WORDS
    return bool(named and not words & WRIST_WORDS)


def name_words(name: str) -> set[str]:
    """Return the words of a name in lower case, without the s of a plural."""
    words = {word.lower() for word in WORD.findall(name)}
    return words | {word.removesuffix("s") for word in words}


def _gripper(tree: FrozenTree, palm: str, names: set[str], why: str) -> list[Gripper]:
    """Return a gripper of these joints, none where all of them are locked."""
    joints = [joint for joint in tree.description.joints if joint.name in names]
    if not any(tree.is_free(joint) for joint in joints):
        return []
    tops = {
        joint.parent
        for joint in joints
        if not any(above.name in names for above in tree.description.chain(joint.parent))
    }
    palm = tops.pop() if len(tops) == 1 else palm
    return [Gripper(palm, tuple(joint.name for joint in joints), why)]


def _released(
    description: Description, names: Iterable[str], patterns: tuple[str, ...]
) -> set[str]:
    """Return the joints that patterns name, with those that they follow or that follow them."""
    joints = [description.joint[name] for name in names]
    groups: dict[str, set[str]] = {}
    for joint in joints:
        leader = joint.name if joint.mimic is None else joint.mimic.joint
        groups.setdefault(leader, {leader}).add(joint.name)
    return {
        name
        for group in groups.values()
        if any(fnmatchcase(each, pattern) for each in group for pattern in patterns)
        for name in group
    }


def _frozen_position(joint: Joint, locked: Mapping[str, float], description: Description) -> float:
    """Return where a joint is frozen (rad or m): 0 or nearest to it, or where it follows."""
    if joint.mimic is None:
        return joint.nearest_to_zero
    leader = description.joint[joint.mimic.joint]
    position = locked.get(leader.name, leader.nearest_to_zero)
    return joint.mimic.multiplier * position + joint.mimic.offset


def find_end_effector(
    tree: FrozenTree, drive: Drive, joints: tuple[Joint, ...], grippers: Iterable[Gripper]
) -> tuple[str | None, tuple[Finding, ...]]:
    """Return the end effector, None for a robot without an arm, and what to tell of the choice.

    It is on the arm of most joints, of equals the file's first: the palm of a gripper that the
    arm's last joint carries, else the last link before a fork. Joints of wheels, also of those
    that the drive leaves out, and joints that carry one are no arm.

    Args:
        tree: The robot, with its locked joints.
        joints: Its free joints that are no wheels, swivels or mimics, in file order.
        grippers: Its grippers, frozen or not.
    """
    description, grippers = tree.description, tuple(grippers)
    fingers = {name for gripper in grippers for name in gripper.joints}
    rolling = [description.joint[wheel.joint] for wheel in drive.wheels]
    rolling += [joint for joint in joints if _looks_like_a_wheel(tree, drive, joint)]
    holding = {above.name for joint in rolling for above in description.chain(joint.child)}
    arm = [j for j in joints if j.name not in fingers | holding]
    if not arm:
        return None, ()
    names = {joint.name for joint in arm}
    chains = {
        joint.name: [above for above in description.chain(joint.child) if above.name in names]
        for joint in arm
    }
    last = max(arm, key=lambda joint: len(chains[joint.name]))
    palms = {gripper.palm for gripper in grippers}
    chosen = _last_link(description, last, palms)
    return chosen, _tell_others(chosen, last, chains, description, palms)


def _looks_like_a_wheel(tree: FrozenTree, drive: Drive, joint: Joint) -> bool:
    """Return whether a joint is called a wheel, or turns one at the height of the drive's."""
    words = name_words(joint.name) | name_words(joint.child)
    if words & WHEEL_WORDS:
        return True
    radius = max((wheel.radius for wheel in drive.wheels), default=0.0)
    height = float(tree.frame(joint)[2, 3]) - drive.ground
    return joint.endless and tree.is_level(joint) and height < WHEEL_HEIGHT * radius


def _last_link(description: Description, last: Joint, palms: set[str]) -> str:
    """Return the palm that an arm's last joint carries, else the last link up to a fork."""
    stack = [last.child]
    while stack:
        link = stack.pop()
        if link in palms:
            return link
        below = reversed(description.child_joints[link])
        stack += [joint.child for joint in below if not joint.moving or joint.mimic is not None]
    link = last.child
    while len(description.child_joints[link]) == 1:
        (only,) = description.child_joints[link]
        link = only.child
    return link


def _tell_others(
    chosen: str,
    last: Joint,
    chains: dict[str, list[Joint]],
    description: Description,
    palms: set[str],
) -> tuple[Finding, ...]:
    """Return a remark where another arm of half as many joints of its own could be meant."""
    longest = {joint.name for joint in chains[last.name]}
    inner = {joint.name for chain in chains.values() for joint in chain[:-1]}
    others = []
    for name, chain in chains.items():
        shared = sum(joint.name in longest for joint in chain)
        own = len(chain) - shared
        if own and name not in inner and 2 * own >= len(longest) - shared:
            others.append(_last_link(description, description.joint[name], palms))
    text = (
        f"end effector is {chosen}; the robot has other arms, which end in {', '.join(others)}: "
        "choose with --end-effector"
    )
    return (Finding("info", last.line, text),) if others else ()
