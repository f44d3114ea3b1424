"""A robot as a page: sliders for its base and joints, its frames, masses and wheel contacts.

The page computes the kinematics by itself (:mod:`rpctl.view.scene.skeleton`). The same page shows a
simulation that sends its motion; its sliders then follow.
"""

from __future__ import annotations

import base64
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT, read_root
from rpctl.robot.model import Robot
from rpctl.simulation.merits.obstacles import AvoidedObstacle
from rpctl.view.labels import shorten
from rpctl.view.pages.page import asset, embed, render_page, stand_in_entry
from rpctl.view.pages.third_party import licences, meshcat_script, uplot_script
from rpctl.view.scene import threejs, trails
from rpctl.view.scene.markers import (
    Markers,
    build_markers,
    hand,
    joints,
    skeleton,
    total_mass_marker,
)
from rpctl.view.scene.robot_meshes import Bodies, build_bodies, robot_nodes
from rpctl.view.scene.scene import (
    ACTUAL,
    REFERENCE,
    ROBOTS_PATH,
    joint_poses,
    opening_commands,
    part_cloud,
)
from rpctl.view.scene.stage import level, obstacle_commands, obstacle_corners
from rpctl.view.serve.server import EVENTS, GO, STOP

MIN_REACH_M = 2.0  # m; how far the sliders move the base, at least
REACH_RATIO = 2.0  # of the robot's size; how far they move it where that is farther
SCRIPTS = (
    "robot_scene.js",
    "kinematics.js",
    "handles.js",
    "goal.js",
    "chart_parts.js",
    "live_charts.js",
    "live.js",
    "robot_page.js",
)
STYLES = ("uplot/uPlot.min.css", "robot.css", "live.css", "goal.css")


@dataclass(frozen=True, eq=False)
class LiveMotion:
    """A motion that a page will be sent.

    Attributes:
        start: Configuration (nq,) that the page shows until the motion comes.
        desired: Poses (n, 3) of P that it is to follow: x, y in m, heading in rad.
        duration: s.
        obstacles: What it keeps clear of.
    """

    start: Array
    desired: Array
    duration: float
    obstacles: tuple[AvoidedObstacle, ...] = ()


def robot_page(
    robot: Robot,
    motion: LiveMotion | None = None,
    command: str | None = None,
    laws: Sequence[str] = (),
    charts: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Return the page of a robot as HTML; it fetches nothing but the motion that a server sends.

    Args:
        robot: The robot.
        motion: The motion that it will be sent; None for sliders and handles that move the robot.
        command: The words that a command to go to a goal begins with; None: ``rpctl track`` and
            the name of the robot's file, or of its entry in the catalogue.
        laws: Names of the kinematic laws with which its server moves the robot to a goal, the
            default one first; none: the page shows the command that does.
        charts: The charts of what a server sends: title, unit, limits and the lines' names.

    Raises:
        RpctlError: meshcat lacks its viewer.
    """
    command = command or f"rpctl track {shlex.quote(Path(robot.source).name)}"
    served = motion is not None or bool(laws)
    bodies = build_bodies(robot)
    scripts = (meshcat_script(), *[uplot_script()] * served, "\n".join(map(asset, SCRIPTS)))
    data = _data(robot, bodies, motion)
    goal = {
        "hand": hand(robot),
        "moves": bool(robot.drive.base_speeds),
        "heading": robot.drive.heading,
        "command": command,
        "laws": list(laws),
    }
    live = {
        "stream": EVENTS,
        "stop": STOP,
        "go": GO if laws else None,
        "duration": None if motion is None else motion.duration,
        "charts": list(charts),
    }
    data |= {"goal": goal if motion is None else None, "live": live if served else None}
    return render_page(
        "robot.html",
        title=f"{robot.name} · rpctl",
        styles=STYLES,
        scripts=scripts,
        served=served,
        name=robot.name,
        subtitle=_subtitle(robot),
        notes=bodies.notes,
        stand_in=stand_in_entry(bodies.stand_ins),
        wheels=shorten([wheel.joint for wheel in robot.drive.wheels]).shared,
        data=embed(data, shown=False),
        licences=licences(charts=served),
    )


def _subtitle(robot: Robot) -> str:
    words = [f"{robot.drive.type} drive", f"{len(robot.drive.wheels)} wheels"]
    words = words if robot.drive.wheels else ["fixed base"]
    return " · ".join([*words, f"{robot.dof} quasi-velocities", f"{robot.mass:.4g} kg"])


def _names(entries: Sequence[Mapping[str, Any]], locked: Iterable[str]) -> dict[str, Any]:
    """Return the rows' names without what those under one heading share, and what that is."""
    roles: dict[str, list[str]] = {"locked": list(locked)}
    for entry in entries:
        roles.setdefault(str(entry["role"]), []).append(str(entry["name"]))
    found = {role: (names, shorten(names)) for role, names in roles.items()}
    return {
        "shared": {role: short.shared for role, (_, short) in found.items()},
        "short": {
            name: label
            for names, short in found.values()
            for name, label in zip(names, short.names, strict=True)
            if short.shared
        },
    }


def _data(robot: Robot, bodies: Bodies, motion: LiveMotion | None) -> dict[str, Any]:
    q = robot.configuration_at(np.zeros(3), robot.home) if motion is None else motion.start
    box = _box(robot, bodies, q)
    size = float(np.linalg.norm(box[1] - box[0]))
    reach = max(MIN_REACH_M, REACH_RATIO * size)
    around = np.array([[-reach, -reach, 0.0], [reach, reach, 0.0]])
    area = None if motion is None else _area(motion, box, robot.drive.floor)
    moves = bool(robot.drive.base_speeds)
    shown = area if area is not None else box + around if moves else box
    markers = build_markers(robot, size)
    rows = joints(robot, q)
    return {
        "name": robot.name,
        "commands": _commands(robot, bodies, markers, shown, box, motion),
        "joints": rows,
        "locked": {name: _locked(robot, name) for name in robot.locked},
        "names": _names(rows, robot.locked),
        "labels": markers.labels,
        "masses": markers.masses,
        "wheels": markers.wheels,
        "point": robot.drive.point,
        "ground": robot.drive.floor,
        "start": read_root(q),
        "height": float(q[2]) if robot.drive.leans else 0.0,
        "reach": [-reach, reach] if moves else None,
        "robot": (box - [q[0], q[1], 0.0]).tolist(),
        "area": None if area is None else area.tolist(),
        "trail": trails.trail_width(*shown),
    }


def _commands(
    robot: Robot,
    bodies: Bodies,
    markers: Markers,
    shown: Array,
    box: Array,
    motion: LiveMotion | None,
) -> list[str]:
    """Return the commands that draw all, the robot last, as base64."""
    lower, upper = shown
    ground = robot.drive.floor
    commands = opening_commands(lower, upper, ground)
    parts = robot_nodes(bodies)
    marked = markers.joint_nodes.items()
    solid = {j: [*(parts[j].solid if j in parts else ()), *nodes] for j, nodes in marked}
    ghost = {j: nodes.ghost for j, nodes in parts.items()}
    figures = [
        total_mass_marker(robot.mass),
        skeleton(robot, ACTUAL, solid),
        skeleton(robot, REFERENCE, ghost),
    ]
    if motion is not None:
        desired = level(motion.desired[:, :2], ground)
        paths = {"base-desired": desired, "base": desired[:1]}
        size = float(box[1, 2]) - ground
        commands += obstacle_commands(motion.obstacles, lower, upper, ground, size)
        commands.append(trails.trails_command({"": paths}, lower, upper))
    commands.append(threejs.set_group(ROBOTS_PATH, "robots", figures))
    return [base64.b64encode(command).decode() for command in commands]


def _box(robot: Robot, bodies: Bodies, q: Array) -> Array:
    """Return the least and the largest coordinates (2, 3) of a robot and of its ground, m."""
    every = list(range(ROOT_JOINT, robot.model.njoints))
    foot = np.array([[q[0], q[1], robot.drive.floor]])
    cloud = np.concatenate([foot, part_cloud(bodies, every, joint_poses(robot, q[None]))])
    return np.stack([cloud.min(axis=0), cloud.max(axis=0)])


def _area(motion: LiveMotion, box: Array, ground: float) -> Array:
    """Return the box (2, 3) around the robot along its desired path, and obstacles nearby, m."""
    places = motion.desired[:, :2]
    radius = 0.5 * float(np.linalg.norm((box[1] - box[0])[:2]))
    area = box.copy()
    area[0, :2] = np.minimum(area[0, :2], places.min(axis=0) - radius)
    area[1, :2] = np.maximum(area[1, :2], places.max(axis=0) + radius)
    size = float(box[1, 2]) - ground
    cloud = np.concatenate([area, obstacle_corners(motion.obstacles, area, ground, size)])
    return np.stack([cloud.min(axis=0), cloud.max(axis=0)])


def _locked(robot: Robot, name: str) -> dict[str, Any]:
    unit = "m" if robot.description.joint[name].kind == "prismatic" else "rad"
    return {"position": robot.locked[name], "unit": unit}
