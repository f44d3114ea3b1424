"""What a file says and the model leaves out: springs, closed loops, tracks, a second robot."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from rpctl.description.frozen_tree import FrozenTree
from rpctl.drive.drive import Drive
from rpctl.errors import Finding
from rpctl.robot.link_boxes import link_boxes

COMMENT = re.compile(rb"<!--(.*?)-->", re.DOTALL)
LOOP = re.compile(  # of a comment that says that the tree was cut out of a mechanism
    rb"four.?bar|kinematic loop|closed kinematic|loop.?(joint|closure)|cut open",
    re.IGNORECASE,
)
TRACK = re.compile(r"(^|_)(track|tread|crawler|caterpillar)s?(_|\d|$)", re.IGNORECASE)
CUT_OPEN = (
    "a URDF is a tree, so the model has it cut open: its parts move on their own; --lock their "
    "joints, or give those that follow a <mimic>"
)
WORLDS = ("world", "map", "odom", "ground", "ground_plane")  # root links that are no robot's
MAX_ABOVE_GROUND_M = 0.02  # m; what lies no higher above the ground than this stands on it


def left_out(tree: FrozenTree, drive: Drive) -> tuple[Finding, ...]:
    """Return what the file says of a robot and its model does not have, in findings."""
    return (*_springs(tree), *_loops(tree), *_robots(tree, drive), *_tracks(tree, drive))


def _springs(tree: FrozenTree) -> Iterator[Finding]:
    for joint in filter(tree.is_free, tree.description.joints):
        if joint.name in tree.description.sprung:
            yield Finding(
                "warning",
                tree.description.sprung[joint.name],
                f'joint "{joint.name}" has a spring, which the model leaves out: it moves freely; '
                f"--lock {joint.name} holds it",
            )


def _loops(tree: FrozenTree) -> Iterator[Finding]:
    """Yield the joints that simulators add between links that move, or a comment on a loop."""
    description, told = tree.description, False
    for each in description.document().xpath(
        "gazebo/joint[parent and child] | loop_joint[link1 and link2]"
        " | mujoco/equality/*[@body1 and @body2]"
    ):
        pair = [
            str(end).split("::")[-1].strip()
            for end in each.xpath("*/@link | parent/text() | child/text() | @body1 | @body2")
        ]
        if not all(name in description.link for name in pair):
            continue
        above = [{joint.name for joint in tree.free_joints(name)} for name in pair]
        if above[0] != above[1]:
            text = f'joint "{each.get("name")}" closes a loop from "{pair[0]}" to "{pair[1]}"'
            told = True
            yield Finding("warning", each.sourceline, f"{text}; {CUT_OPEN}")
    arm = any(tree.is_free(joint) and not joint.endless for joint in description.joints)
    for comment in COMMENT.finditer(description.raw) if arm and not told else ():
        word = LOOP.search(comment[1])
        if word is not None:
            line = 1 + description.raw.count(b"\n", 0, comment.start(1) + word.start())
            said = word[0].decode("utf-8", "replace")
            yield Finding("warning", line, f'a comment speaks of a loop ("{said}"); {CUT_OPEN}')
            return


def _robots(tree: FrozenTree, drive: Drive) -> Iterator[Finding]:
    """Yield that a root link such as "world" holds several bases with wheels."""
    description = tree.description
    if description.root.lower() not in WORLDS:
        return
    rolling = {wheel.joint for wheel in drive.wheels}
    bases = [
        joint
        for joint in description.child_joints[description.root]
        if any(below.name in rolling for below in description.below(joint))
    ]
    if len(bases) > 1:
        names = ", ".join(f'"{joint.child}"' for joint in bases)
        yield Finding(
            "warning",
            bases[1].line,
            f'link "{description.root}" holds {len(bases)} bases with wheels ({names}): they move '
            "as one rigid robot; give each robot a file of its own",
        )


def _tracks(tree: FrozenTree, drive: Drive) -> Iterator[Finding]:
    """Yield the links that are called tracks, are fixed to the base and stand on the ground."""
    description = tree.description
    for name, pose in tree.rigid_links(description.root) if drive.wheels else ():
        link = description.link[name]
        if not (TRACK.search(name) and (link.collisions or link.visuals)):
            continue
        places = ((pose @ at, half) for at, half in link_boxes(description, name))
        bottoms = (float(at[2, 3] - np.abs(at[2, :3]) @ half) for at, half in places)
        if min(bottoms, default=math.inf) <= drive.ground + MAX_ABOVE_GROUND_M:
            yield Finding(
                "warning",
                link.line,
                f'link "{name}" is fixed and stands on the ground, as a track does that cannot '
                f"run; the model has none: it rolls on {drive.wheels[0].joint} and the others",
            )
