"""``Losses``: what damping and friction in the joints take of a motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array, read_only
from rpctl.description.records import Description
from rpctl.robot.coordinates import joint_entries

# ε: a slower joint has less than its dry friction, so under a load of 70 % of that it creeps at
# this rate instead of standing still. rad/s of a joint that turns, m/s of one that slides.
TURNING_RATE, SLIDING_RATE = 1e-2, 1e-3


@dataclass(frozen=True, eq=False)
class Losses:
    """What opposes the rate q̇ of each joint: −d q̇ − f q̇/√(q̇² + ε²).

    The first is viscous damping, the second Coulomb friction, made smooth where q̇ changes its sign.
    Entries are ordered as v's; those of the planar root are 0.

    Attributes:
        damping: d (nv,), N·m·s/rad or N·s/m.
        friction: f (nv,), N·m or N.
        rate: ε (nv,), rad/s or m/s; positive.
    """

    damping: Array
    friction: Array
    rate: Array

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("damping", "friction", "rate"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def force(self, v: Array) -> Array:
        """Return the generalised force (nv,) at v (nv,), N·m or N; it opposes v."""
        return np.asarray(-self.secant(v) * v)

    def slope(self, v: Array) -> Array:
        """Return −∂force/∂v (nv,) at v (nv,), N·m·s/rad or N·s/m; none is negative."""
        smooth = self.friction * self._squares * (v * v + self._squares) ** -1.5
        return np.asarray(self.damping + smooth)

    def secant(self, v: Array) -> Array:
        """Return −force/v (nv,) at v (nv,): at least the slope, and positive."""
        return np.asarray(self.damping + self.friction / np.sqrt(v * v + self._squares))

    @cached_property
    def _squares(self) -> Array:
        return np.square(self.rate)


def find_losses(description: Description, model: pin.Model) -> Losses | None:
    """Return the losses that a file gives the joints of a model, or None where it gives none.

    Args:
        model: Of the robot, with a planar root; its locked joints lose nothing.
    """
    d, f, rate = np.zeros(model.nv), np.zeros(model.nv), np.full(model.nv, TURNING_RATE)
    for name in joint_entries(model):
        joint, index = description.joint[name], model.joints[model.getJointId(name)].idx_v
        d[index], f[index] = joint.damping, joint.friction
        if joint.kind == "prismatic":
            rate[index] = SLIDING_RATE
    return Losses(d, f, rate) if d.any() or f.any() else None
