"""Poses, axes and heights of a robot's tree: locked joints held in place, all others at 0."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rpctl.arrays import Array, read_only
from rpctl.description.records import Description, Joint, Shape

MAX_TILT_SINE = 0.02  # sine of the largest angle off a level or parallel line (rounding)
MAX_LEAN_DEG = 10.0  # of a steering axis, which cars have on purpose


@dataclass(frozen=True)
class FrozenTree:
    """A description with some joints locked. All results are in the root link's frame.

    Attributes:
        description: The robot.
        locked: Positions (rad or m) of the locked joints, by name.
    """

    description: Description
    locked: Mapping[str, float] = field(default_factory=dict)

    def is_free(self, joint: Joint) -> bool:
        """Return whether a joint moves: it is neither fixed nor locked."""
        return joint.moving and joint.name not in self.locked

    def free_joints(self, link: str) -> list[Joint]:
        """Return the free joints from the root link down to ``link``."""
        return [joint for joint in self.description.chain(link) if self.is_free(joint)]

    def pose(self, link: str) -> Array:
        """Return the pose (4, 4) of a link."""
        return self._poses[link]

    def frame(self, joint: Joint) -> Array:
        """Return the pose (4, 4) of a joint's own frame, in which its axis is given."""
        return np.asarray(self.pose(joint.parent) @ joint.origin)

    def axis(self, joint: Joint) -> Array:
        """Return the unit axis (3,) of a joint."""
        return np.asarray(self.frame(joint)[:3, :3] @ joint.axis)

    def is_upright(self, joint: Joint) -> bool:
        """Return whether a joint turns about an upright axis, which may lean by 10°."""
        lean = math.hypot(*self.axis(joint)[:2])
        return joint.kind != "prismatic" and lean <= math.sin(math.radians(MAX_LEAN_DEG))

    def is_leaning(self, joint: Joint) -> bool:
        """Return whether a joint turns about an axis nearer to upright than level, and leans."""
        axis = self.axis(joint)
        return joint.kind != "prismatic" and MAX_TILT_SINE < math.hypot(*axis[:2]) < abs(axis[2])

    def is_level(self, joint: Joint) -> bool:
        """Return whether the axis of a joint is level."""
        return abs(float(self.axis(joint)[2])) <= MAX_TILT_SINE

    def rigid_links(self, link: str) -> Iterator[tuple[str, Array]]:
        """Yield a link and those fixed to it, with their poses (4, 4) in its own frame."""
        stack = [(link, np.eye(4))]
        while stack:
            name, pose = stack.pop()
            yield name, pose
            stack += [
                (below.child, pose @ self._motion(below))
                for below in reversed(self.description.child_joints[name])
                if not self.is_free(below)
            ]

    def heights(self, link: str) -> list[tuple[float, float]]:
        """Return the lowest and the highest point of each shape of a link but meshes, m.

        They are its collision shapes, on which simulators stand it; without any, what is drawn.
        """
        body = self.description.link[link]
        shapes = [shape for shape in body.collisions if shape.kind != "mesh"]
        shapes = shapes or [shape for shape in body.visuals if shape.kind != "mesh"]
        return [_heights(shape, self.pose(link) @ shape.origin) for shape in shapes]

    def lowest(self, link: str) -> float:
        """Return the height of a link's lowest point, m; inf if it has no shape but meshes."""
        return min((low for low, _ in self.heights(link)), default=math.inf)

    @cached_property
    def floor(self) -> float:
        """Height of the lowest shape of any link, meshes left out, m; inf if there is none."""
        return min(self.lowest(link.name) for link in self.description.links)

    @cached_property
    def _poses(self) -> dict[str, Array]:
        """Pose (4, 4) of every link, by name; read-only."""
        poses = {self.description.root: np.eye(4)}
        stack = [self.description.root]
        while stack:
            name = stack.pop()
            for below in self.description.child_joints[name]:
                poses[below.child] = poses[name] @ self._motion(below)
                stack.append(below.child)
        return {name: read_only(pose) for name, pose in poses.items()}

    def _motion(self, joint: Joint) -> Array:
        """Return the pose (4, 4) of a joint's child link in its parent link's frame."""
        return joint.motion(self.locked.get(joint.name, 0.0))


def _heights(shape: Shape, pose: Array) -> tuple[float, float]:
    """Return the heights of the lowest and the highest point of a shape at a pose (4, 4), m."""
    size, up = shape.size, np.abs(pose[2, :3])
    reach = size[0]
    if shape.kind == "box":
        reach = 0.5 * float(up @ size)
    elif shape.kind == "capsule":
        reach = size[0] + 0.5 * size[1] * float(up[2])
    elif shape.kind == "cylinder":
        reach = size[0] * math.sqrt(max(0.0, 1.0 - up[2] ** 2)) + 0.5 * size[1] * float(up[2])
    return float(pose[2, 3]) - reach, float(pose[2, 3]) + reach
