"""Where the root link's pose and the joints' positions stand in q; Pinocchio's scratch memory."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array

BASE_NQ = 4  # x, y, cos θ, sin θ of the planar root
ROOT_JOINT = 1  # Pinocchio's index of the planar root; 0 is the universe


@dataclass(frozen=True)
class JointEntry:
    """The entry of a joint in q; that of a continuous joint is the pair (cos, sin)."""

    index: int
    is_pair: bool

    def write(self, q: Array, position: float) -> None:
        """Set the joint's position (rad or m) in q (nq,), in place."""
        if self.is_pair:
            q[self.index], q[self.index + 1] = math.cos(position), math.sin(position)
        else:
            q[self.index] = position

    def read(self, q: Array) -> float:
        """Return the joint's position in q (nq,), rad or m; a continuous joint's in (−π, π]."""
        if self.is_pair:
            return math.atan2(q[self.index + 1], q[self.index])
        return float(q[self.index])

    def write_all(self, q: Array, positions: Array) -> None:
        """Set the joint's positions (K,), rad or m, in K configurations (K, nq), in place."""
        if self.is_pair:
            q[:, self.index], q[:, self.index + 1] = np.cos(positions), np.sin(positions)
        else:
            q[:, self.index] = positions

    def read_all(self, q: Array) -> Array:
        """Return the joint's positions (K,) in K configurations (K, nq), as :meth:`read`."""
        if self.is_pair:
            return np.asarray(np.arctan2(q[:, self.index + 1], q[:, self.index]))
        return q[:, self.index]

    def directions(self, q: Array) -> tuple[Array, Array]:
        """Return cosines and sines (K,) of a turning joint's positions in q (K, nq)."""
        if self.is_pair:
            return q[:, self.index], q[:, self.index + 1]
        return np.cos(q[:, self.index]), np.sin(q[:, self.index])


def joint_entries(model: pin.Model) -> dict[str, JointEntry]:
    """Return the entries of all joints but the root, by name, in the model's order."""
    joints = zip(model.names[ROOT_JOINT + 1 :], list(model.joints)[ROOT_JOINT + 1 :], strict=True)
    return {name: JointEntry(int(joint.idx_q), joint.nq == 2) for name, joint in joints}


def write_root(q: Array, x: float, y: float, theta: float) -> None:
    """Set the root link's pose in q, in place.

    Args:
        q: Configuration (nq,).
        x: Position, m.
        y: Position, m.
        theta: Heading, rad.
    """
    q[:BASE_NQ] = x, y, math.cos(theta), math.sin(theta)


def read_root(q: Array) -> tuple[float, float, float]:
    """Return the root link's pose (x, y, θ) in q (nq,): m, m, rad; θ in (−π, π]."""
    return float(q[0]), float(q[1]), math.atan2(q[3], q[2])


def level_pose(q: Array, height: float) -> Array:
    """Return the pose of a root link that stays level (7,): x, y, z (m), quaternion x, y, z, w.

    Args:
        q: Configuration (nq,).
        height: Of the root link above the ground, m.
    """
    x, y, theta = read_root(q)
    return np.array([x, y, height, 0.0, 0.0, math.sin(0.5 * theta), math.cos(0.5 * theta)])


class Workspace(threading.local):
    """A ``pinocchio.Data`` for each thread that asks: threads that share one overwrite it.

    Attributes:
        data: That of the calling thread.
    """

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()  # in every thread anew
