"""A run as an ordered list of meshcat commands; no server is needed to make or to play them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.simulation.obstacles import run_obstacles
from rpctl.simulation.reload import has_surroundings
from rpctl.simulation.run import Run
from rpctl.view.scene import keyframes, materials, obstacle_shapes, threejs, trails
from rpctl.view.scene.base_marker import base_marker, base_poses
from rpctl.view.scene.ground import ground_command, lights_command
from rpctl.view.scene.robot_meshes import MAX_TRIANGLES, Bodies, bounding_corners, build_bodies
from rpctl.view.scene.stand_ins import StandIn

FRAME_RATE = 30.0  # Hz: what the eye needs; the viewer interpolates between frames
MAX_FRAMES = 1800  # of a long run: its frames lie further apart, and its report stays small
TRAIL_STEP_S = 0.1  # s: so near are the points of a trail, while they are no more than these
MAX_BASE_POINTS, MAX_TIP_POINTS = 9000, 3600  # a tube takes five times the room of a ribbon
DESIRED_S = 180.0  # s of the desired path that are drawn
ROBOTS_PATH = "/rpctl/robots"
ACTUAL, REFERENCE = "robot", "reference"  # names of the nodes: robot-1 for joint 1, ...


@dataclass(frozen=True, eq=False)
class Scene:
    """What a viewer needs to play a run.

    Attributes:
        commands: meshcat commands, packed, in order: the robots and their animation are the last.
        times: Times of the frames (n,), s, from 0.
        lower: Least coordinates of the motion (3,), m.
        upper: Largest coordinates of the motion (3,), m.
        hull: Points (n, 3) of which the convex hull holds the motion, m: what a camera frames.
        start: Least and largest coordinates of the robot at the start (2, 3), m.
        follow: Name of the node that a camera follows.
        origin: Position of that node at the start (3,), m.
        notes: Where the run is not what was asked for; links whose inertias are estimates; shapes
            that are not drawn, and why.
        stand_ins: What is drawn in the place of meshes that are missing.
    """

    commands: tuple[bytes, ...]
    times: Array
    lower: Array
    upper: Array
    hull: Array
    start: Array
    follow: str
    origin: Array
    notes: tuple[str, ...]
    stand_ins: tuple[StandIn, ...] = ()

    @property
    def duration(self) -> float:
        """Length of the animation, s."""
        return float(self.times[-1])

    @property
    def robot_bytes(self) -> int:
        """Size of the command that draws the robots: what fewer triangles make smaller."""
        return len(self.commands[-2])


def build_scene(robot: Robot | RpctlError, run: Run, triangles: int = MAX_TRIANGLES) -> Scene:
    """Return the scene of a run: robot, reference ghost, trails, ground, lights, animation.

    Args:
        robot: The robot of the run, or why it cannot be had: a wedge at its base is drawn then.
        run: The run.
        triangles: About how many the robot may have; large meshes are simplified first.
    """
    frames = _frames(run.t)
    if isinstance(robot, RpctlError):
        bodies = base_marker(run, str(robot))
        poses, ghost = base_poses(run.q[frames]), base_poses(run.q_ref[frames])
    else:
        bodies = build_bodies(robot, triangles)
        poses = joint_poses(robot, run.q[frames], run.log.root_pose[frames])
        ghost = joint_poses(robot, run.q_ref[frames])
    joints = sorted({part.joint for part in bodies.parts})
    paths = _paths(run, frames)
    run.log.release()
    first = part_cloud(bodies, joints, poses[:1])
    cloud = np.concatenate(
        [part_cloud(bodies, joints, poses), part_cloud(bodies, joints, ghost), *paths.values()]
    )
    obstacles, ground = run_obstacles(run), run.robot.drive.ground
    size = float(first[:, 2].max()) - ground
    cloud = np.concatenate([cloud, obstacle_shapes.corners(obstacles, cloud, ground, size)])
    lower, upper = cloud.min(axis=0), cloud.max(axis=0)
    lower[2] = min(lower[2], ground)
    times = run.t[frames] - run.t[0]
    commands = (
        *(threejs.delete(path) for path in ("/Grid", "/Axes", "/Lights")),
        threejs.set_property("/Background", "visible", False),
        lights_command(lower, upper),
        ground_command(lower, upper, ground),
        *obstacle_shapes.commands(obstacles, lower, upper, ground, size),
        trails.trails_command(paths, lower, upper),
        _robots(bodies, joints),
        _animation(joints, times, poses, ghost),
    )
    return Scene(
        commands=commands,
        times=times,
        lower=lower,
        upper=upper,
        hull=hull_points(cloud),
        start=np.stack([first.min(axis=0), first.max(axis=0)]),
        follow=f"{ACTUAL}-{joints[0]}",
        origin=poses[0, joints[0], :3],
        notes=_notes(run, times, robot, bodies),
        stand_ins=bodies.stand_ins,
    )


def redrawn(scene: Scene, robot: Robot, run: Run, triangles: int) -> Scene:
    """Return a scene whose robot has another number of triangles; all else stays as it is.

    Args:
        scene: The scene.
        robot: Its robot.
        run: Its run.
        triangles: About how many the robot may have.
    """
    bodies = build_bodies(robot, triangles)
    joints = sorted({part.joint for part in bodies.parts})
    *before, _, motion = scene.commands
    return replace(
        scene,
        commands=(*before, _robots(bodies, joints), motion),
        notes=_notes(run, scene.times, robot, bodies),
    )


def _notes(run: Run, times: Array, robot: Robot | RpctlError, bodies: Bodies) -> tuple[str, ...]:
    """Return the notes of a scene: on the laws, the run, the frames (n,), s, and what is drawn."""
    said = (*run.law_sentences, *run.notes)
    return (*said, *_frame_note(times), *_robot_notes(robot), *bodies.notes)


def _frame_note(times: Array) -> tuple[str, ...]:
    """Return the note on a long run's frames (n,), s, which lie far apart; nothing of others."""
    if len(times) < MAX_FRAMES:
        return ()
    rate = (len(times) - 1) / float(times[-1])
    return (
        f"the animation of this long run has {rate:.2g} frames a second, and its charts keep the "
        f"extremes of each stretch; of the desired path {DESIRED_S:g} s are drawn at most; the "
        "figures of merit are of every sample",
    )


def _robot_notes(robot: Robot | RpctlError) -> tuple[str, ...]:
    """Return the notes on links whose inertias are estimates, and on meshes left alone."""
    notes: list[str] = []
    if isinstance(robot, RpctlError):
        return ()
    if names := robot.description.estimated_links:
        density = f"{robot.loaded_with.density:g} kg/m³"
        notes.append(f"mass and inertia of {', '.join(names)} are estimates at {density}")
    if not has_surroundings(robot) and robot.description.has_meshes:
        notes.append(
            f"{robot.description.path.name}, the robot's file, is not there as it was: meshes "
            "beside it are not drawn; declare their folder with --package-dir"
        )
    return tuple(notes)


def _frames(t: Array) -> NDArray[np.int64]:
    """Return the samples that become frames, first and last among them."""
    wanted = int(np.ceil((t[-1] - t[0]) * FRAME_RATE)) + 1
    count = min(max(wanted, 1), MAX_FRAMES, len(t))
    return np.unique(np.rint(np.linspace(0, len(t) - 1, count)).astype(np.int64))


def joint_poses(robot: Robot, q: Array, roots: Array | None = None) -> Array:
    """Return the poses (n, njoints, 7) of all joints at configurations (n, nq).

    A pose is the position in the world, m, and the unit quaternion (x, y, z, w).

    Args:
        robot: The robot.
        q: Configurations (n, nq).
        roots: Poses of the root link (n, 7) over the ground, where it may tilt and hop; (n, 0) or
            None: it stays level.
    """
    tilted = roots is not None and roots.shape[1] > 0
    data = robot.model.createData()
    poses = np.empty((len(q), robot.model.njoints, 7))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(robot.model, data, configuration)
        moved = pin.SE3.Identity()
        if tilted and roots is not None:
            root = pin.XYZQUATToSE3(roots[k])
            root.translation[2] += robot.drive.ground
            moved = root * data.oMi[ROOT_JOINT].inverse()
        for j, placement in enumerate(data.oMi):
            poses[k, j] = pin.SE3ToXYZQUAT(moved * placement if j and tilted else placement)
    return poses


def _paths(run: Run, frames: NDArray[np.int64]) -> dict[str, Array]:
    """Return the paths (n, 3) in the world, m: desired and actual, of P and the end effector."""
    desired = _desired_samples(run.t, frames)
    height = run.robot.drive.ground
    paths = {
        "base-desired": _on_ground(run.base_ref[desired], height),
        "base": _on_ground(run.log.base[_trail_samples(run.t, frames, MAX_BASE_POINTS)], height),
    }
    if run.log.ee.shape[1] == 3:
        actual = _trail_samples(run.t, frames, MAX_TIP_POINTS)
        paths |= {"tip-desired": run.log.ee_ref[desired], "tip": run.log.ee[actual]}
    return paths


def _on_ground(poses: Array, height: float) -> Array:
    return np.column_stack([poses[:, :2], np.full(len(poses), height)])


def _trail_samples(t: Array, frames: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Return the samples of a trail: as many from each frame to the next, for the viewer counts so.

    Frames of a long run lie so far apart that lines between them would cut its corners.

    Args:
        t: Time (K,), s.
        frames: Samples that are frames (n,).
        most: How many points there may be, unless there are more frames.
    """
    steps = len(frames) - 1
    if len(frames) < MAX_FRAMES:
        return frames
    wanted = int(np.ceil((t[-1] - t[0]) / (steps * TRAIL_STEP_S)))
    each = max(1, min(wanted, most // steps, (len(t) - 1) // steps))
    return np.rint(np.linspace(0, len(t) - 1, each * steps + 1)).astype(np.int64)


def _desired_samples(t: Array, frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the samples of a desired path: the first laps, whose dashes can be told apart."""
    if t[-1] - t[0] <= DESIRED_S:
        return frames
    last = int(np.searchsorted(t, t[0] + DESIRED_S))
    return np.rint(np.linspace(0, last, MAX_FRAMES)).astype(np.int64)


def part_cloud(bodies: Bodies, joints: list[int], poses: Array) -> Array:
    """Return the corners (n, 3) of the boxes around all parts as they move, m.

    Args:
        bodies: What is drawn.
        joints: The joints that carry it.
        poses: Of all joints (k, njoints, 7): position, m, and quaternion x, y, z, w.
    """
    clouds = [np.empty((0, 3))]
    for joint in joints:
        corners = bounding_corners(bodies, joint)
        if corners is not None:
            turns = _rotations(poses[:, joint, 3:])
            moved = np.einsum("kij,cj->kci", turns, corners) + poses[:, joint, None, :3]
            clouds.append(moved.reshape(-1, 3))
    return np.concatenate(clouds)


def hull_points(cloud: Array) -> Array:
    """Return the extreme points (n, 3) of a cloud in evenly spread directions."""
    count = 128
    heights = np.linspace(-1.0, 1.0, count)
    turns = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)  # a golden spiral over the sphere
    rings = np.sqrt(1.0 - heights**2)
    around = np.column_stack([rings * np.cos(turns), rings * np.sin(turns), heights])
    # One direction at a time: all at once would take a gigabyte of a long run.
    found = [int((cloud @ direction).argmax()) for direction in around]
    return np.asarray(cloud[np.unique(found)])


def _rotations(quaternions: Array) -> Array:
    """Return rotation matrices (n, 3, 3) of unit quaternions (n, 4), (x, y, z, w)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(quaternions).as_matrix())


def _robots(bodies: Bodies, joints: list[int]) -> bytes:
    """Return the command that draws the robot and its ghost, which share their meshes.

    A node stands for a joint and is animated; below it each part keeps a fixed matrix, mirrored
    or scaled as it may be.
    """
    groups = []
    for joint in joints:
        solid, ghost = materials.solid(bodies, joint), materials.ghost(bodies, joint)
        groups.append(threejs.node("Group", f"{ACTUAL}-{joint}", children=solid))
        groups.append(threejs.node("Group", f"{REFERENCE}-{joint}", children=ghost))
    root = threejs.node("Group", "robots", children=groups)
    return threejs.set_object(
        ROBOTS_PATH,
        root,
        materials.geometries(bodies),
        materials.materials(bodies),
        **materials.images(bodies),
    )


def _animation(joints: list[int], times: Array, poses: Array, ghost: Array) -> bytes:
    tracks = []
    for joint in joints:
        for name, motion in ((f"{ACTUAL}-{joint}", poses), (f"{REFERENCE}-{joint}", ghost)):
            tracks += motion_tracks(name, times, motion[:, joint])
    return threejs.set_animation(f"{ROBOTS_PATH}/<object>", tracks)


def node_prefix(run: int) -> str:
    """Return what the names of a run's nodes begin with; runs are counted from 1."""
    return f"run{run}-" if run > 1 else ""


def motion_tracks(name: str, times: Array, motion: Array) -> list[threejs.Json]:
    """Return the tracks of a node's position and quaternion.

    Args:
        name: The node.
        times: Of the frames (n,), s.
        motion: Its poses (n, 7): position, m, and quaternion x, y, z, w.
    """
    places, turns = motion[:, :3], motion[:, 3:]
    kept = keyframes.position_keyframes(times, places)
    tracks = [threejs.track(f"{name}.position", "vector3", times[kept], places[kept])]
    kept = keyframes.rotation_keyframes(times, turns)
    return [*tracks, threejs.track(f"{name}.quaternion", "quaternion", times[kept], turns[kept])]
