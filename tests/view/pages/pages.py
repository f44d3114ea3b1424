"""Every kind of page that rpctl makes, as text."""

from __future__ import annotations

import numpy as np

from rpctl import Robot
from rpctl.view.film import player
from rpctl.view.pages.robot_page import LiveMotion, robot_page
from rpctl.view.scene.scene import Scene


def waiting_page(robot: Robot) -> str:
    """Return the page that waits for a simulation."""
    motion = LiveMotion(robot.configuration(), np.zeros((2, 3)), 1.0)
    return robot_page(robot, motion)


def goal_page(robot: Robot) -> str:
    """Return the page that sends a robot to goals."""
    return robot_page(robot, laws=["unified"])


def bare_scene(scene: Scene) -> str:
    """Return the page of a scene that a script of a line moves."""
    return player(scene, "scene", "window.rpctl = { ready: true };")
