"""The end effector that nobody named: the last link of the longest arm, before its gripper."""

from __future__ import annotations

from collections.abc import Iterable

from rpctl.description.records import Description, Joint
from rpctl.errors import Finding
from rpctl.robot.grippers import Gripper


def find_end_effector(
    description: Description,
    joints: tuple[Joint, ...],
    rolling: Iterable[str],
    grippers: Iterable[Gripper],
) -> tuple[str | None, tuple[Finding, ...]]:
    """Return the end effector, None for a robot without an arm, and what to tell of the choice.

    It is on the arm of most joints, of equals the file's first: the palm of a gripper that the
    arm's last joint carries, else the last link before a fork. Joints that carry a wheel are no
    arm.

    Args:
        description: The robot.
        joints: Its free joints that are no wheels, swivels or mimics, in file order.
        rolling: Names of the joints of wheels and swivels.
        grippers: Its grippers, frozen or not.
    """
    rolling, grippers = set(rolling), tuple(grippers)
    fingers = {name for gripper in grippers for name in gripper.joints}
    holding_wheels = {
        above.name for name in rolling for above in description.chain(description.joint[name].child)
    }
    arm = [j for j in joints if j.name not in fingers | holding_wheels]
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
