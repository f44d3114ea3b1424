"""Mechanisms on a fixed base that paper and pencil are enough for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rpctl
from rpctl import Robot
from tests.robots import write
from tests.urdf import inertial, joint, limit, link
from tests.urdf import robot as urdf

POINT = (1e-6, 1e-6, 1e-6)  # kg·m²: a point mass, as good as
ELBOW_M = np.array([[5.0, 2.0], [2.0, 1.0]])  # kg·m² of the bars, stretched out


def load_lift(folder: Path, effort: float = 20.0) -> Robot:
    """Return a carriage of 6 kg that a post lets slide up from 0 to 0.5 m."""
    post = link("post", inertial(50.0, (1.0, 1.0, 1.0)))
    carriage = link("carriage", inertial(6.0, (0.1, 0.1, 0.1)))
    lift = joint("lift", "prismatic", ("post", "carriage"), axis="0 0 1",
                 more=limit(0.0, 0.5, effort, 2.0))  # fmt: skip
    return rpctl.load(write(folder, urdf("lift", post, carriage, lift)), drive="fixed",
                      home={"lift": 0.3})  # fmt: skip


def load_two_bars(folder: Path, elbow: tuple[float, float]) -> Robot:
    """Return two bars in the plane: 1 kg at the elbow and at the end, 1 m apart each.

    Args:
        folder: Where its file is written.
        elbow: Limits of the elbow, rad.
    """
    ends = link("post", inertial(50.0, (1.0, 1.0, 1.0)))
    bars = [link(name, inertial(1.0, POINT, xyz=(1.0, 0.0, 0.0))) for name in ("upper", "fore")]
    joints = [
        joint("shoulder", "revolute", ("post", "upper"), "0 0 0", "0 0 1", limit(-3, 3, 50, 9)),
        joint("elbow", "revolute", ("upper", "fore"), "1 0 0", "0 0 1", limit(*elbow, 50, 9)),
    ]
    return rpctl.load(write(folder, urdf("bars", ends, *bars, *joints)), drive="fixed")
