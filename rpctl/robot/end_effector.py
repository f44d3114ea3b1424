"""The end effector that nobody named: the last link of the longest arm, before its gripper."""

from __future__ import annotations

from collections.abc import Iterable

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description, Joint
from rpctl.drive.drive import Drive
from rpctl.errors import Finding
from rpctl.robot.grippers import Gripper, name_words

WHEEL_WORDS = {"wheel", "caster", "castor", "tire", "tyre", "steer", "steering"}
WHEEL_HEIGHT = 1.5  # of the drive's largest radius: an axle above it is no wheel's


def find_end_effector(
    tree: FrozenTree, drive: Drive, joints: tuple[Joint, ...], grippers: Iterable[Gripper]
) -> tuple[str | None, tuple[Finding, ...]]:
    """Return the end effector, None for a robot without an arm, and what to tell of the choice.

    It is on the arm of most joints, of equals the file's first: the palm of a gripper that the
    arm's last joint carries, else the last link before a fork. Joints of wheels, also of those
    that the drive leaves out, and joints that carry one are no arm.

    Args:
        tree: The robot, with its locked joints.
        drive: Its drive.
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
    if not others:
        return ()
    listed = ", ".join(others)
    text = f"end effector is {chosen}; the robot has other arms, which end in {listed}"
    return (Finding("info", last.line, f"{text}: choose with --end-effector"),)
