"""Motions as an ordered list of meshcat commands; no server is needed to make or to play them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rpctl.arrays import Array
from rpctl.engines.recording import EngineRecording
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.simulation.merits.obstacles import AvoidedObstacle, run_obstacles
from rpctl.simulation.run.run import Run, has_surroundings
from rpctl.view.scene import threejs, trails
from rpctl.view.scene.robot_meshes import (
    GHOST_OPACITY,
    MAX_TRIANGLES,
    Bodies,
    base_marker,
    bounding_corners,
    build_bodies,
    robot_nodes,
)
from rpctl.view.scene.stage import (
    ground_command,
    level,
    lights_command,
    obstacle_commands,
    obstacle_corners,
)
from rpctl.view.scene.stand_ins import StandIn

FRAME_RATE = 30.0  # Hz: what the eye needs; the viewer interpolates between frames
MAX_FRAMES = 1800  # of a long run: its frames lie further apart, and its report stays small
TRAIL_STEP_S = 0.1  # s: so near are the points of a trail, while they are no more than these
MAX_BASE_POINTS, MAX_TIP_POINTS = 9000, 3600  # a tube takes five times the room of a ribbon
DESIRED_S = 180.0  # s of the desired path that are drawn
ROBOTS_PATH = "/rpctl/robots"
OWN_OBJECTS = ("Grid", "Axes", "Lights")  # of meshcat
INVISIBLE = {"property": "visible", "value": False}
LATER_OPACITY = 0.55  # of the robots of all motions but the first
ACTUAL, REFERENCE = "robot", "reference"  # names of the nodes: robot-1 for joint 1, ...


@dataclass(frozen=True, eq=False)
class Scene:
    """What a viewer needs to play a motion, or several over one another.

    Attributes:
        commands: meshcat commands, packed, in order: the robots and their animation are the last.
        motions: Times of the frames (n,), s, from 0, of each motion.
        hull: Points (n, 3) of which the convex hull holds all motion, m: what a camera frames.
        start: Least and largest coordinates of the first robot at the start (2, 3), m.
        follow: Name of the node that a camera follows.
        origin: Position of that node at the start (3,), m.
        notes: Where a run is not what was asked for; links whose inertias are estimates; shapes
            that are not drawn, and why.
        stand_ins: What is drawn in the place of meshes that are missing.
    """

    commands: tuple[bytes, ...]
    motions: tuple[Array, ...]
    hull: Array
    start: Array
    follow: str
    origin: Array
    notes: tuple[str, ...]
    stand_ins: tuple[StandIn, ...] = ()

    @property
    def times(self) -> Array:
        """Times of the frames (n,) of the longest motion, s."""
        return max(self.motions, key=lambda times: float(times[-1]))

    @property
    def duration(self) -> float:
        """Length of the animation, s."""
        return float(self.times[-1])


@dataclass(frozen=True, eq=False)
class Motion:
    """A robot that moves in a scene.

    Attributes:
        bodies: What is drawn of it.
        times: Of its frames (n,), s, from 0.
        poses: Of all joints (n, njoints, 7): position, m, and quaternion x, y, z, w.
        paths: Of base and end effector, see :func:`rpctl.view.scene.trails.trails_command`.
        desired: The poses of its reference, which a ghost shows; None: there is no ghost.
        notes: On its run, before those on its bodies.
    """

    bodies: Bodies
    times: Array
    poses: Array
    paths: dict[str, Array] = field(default_factory=dict)
    desired: Array | None = None
    notes: tuple[str, ...] = ()

    @property
    def joints(self) -> list[int]:
        """The joints that carry something."""
        return sorted({part.joint for part in self.bodies.parts})


def build_scene(robot: Robot | RpctlError, run: Run, triangles: int = MAX_TRIANGLES) -> Scene:
    """Return the scene of a run: robot, reference ghost, trails, ground, lights, animation.

    Args:
        robot: The robot of the run, or why it cannot be had: a wedge at its base is drawn then.
        run: The run.
        triangles: About how many the robot may have; large meshes are simplified first.
    """
    return _compose([_motion_of(robot, run, triangles)], run_obstacles(run), run.robot.drive.floor)


def compare_scene(robots: Sequence[Robot | RpctlError], runs: Sequence[Run]) -> Scene:
    """Return the scene of several runs: the first as it is, the others' robots as ghosts.

    Nodes of run k, from 2, are named ``run2-robot-1``, ``run2-trail-base`` and so on; robots that
    are alike share their meshes. The obstacles of all are drawn, each once.
    """
    motions = [_motion_of(robot, run) for robot, run in zip(robots, runs, strict=True)]
    obstacles = tuple(dict.fromkeys(each for run in runs for each in run_obstacles(run)))
    return _compose(motions, obstacles, float(runs[0].robot.drive.floor))


def free_scene(robot: Robot, motions: Sequence[EngineRecording]) -> Scene:
    """Return the scene of several motions of one robot, the first as it is, others as ghosts.

    Args:
        robot: The robot.
        motions: At least one, of two samples or more.
    """
    bodies = build_bodies(robot)
    shown = [
        Motion(bodies, each.t, _free_poses(robot, each), {"base": level(each.root[:, :2], 0.0)})
        for each in motions
    ]
    return _compose(shown, (), 0.0)


def _free_poses(robot: Robot, motion: EngineRecording) -> Array:
    """Return the poses (n, njoints, 7) of all joints in the world, the root link free in space."""
    rows = ({n: float(x[k]) for n, x in motion.joints.items()} for k in range(len(motion.t)))
    q = np.array([robot.configuration(joints=row) for row in rows])
    for name, values in motion.joints.items():  # what the engine lets mimics and followers do
        robot.entries[name].write_all(q, values)
    poses = joint_poses(robot, q)
    turns = Rotation.from_quat(motion.root[:, 3:])
    for joint in range(ROOT_JOINT, poses.shape[1]):
        poses[:, joint, :3] = turns.apply(poses[:, joint, :3]) + motion.root[:, :3]
        poses[:, joint, 3:] = (turns * Rotation.from_quat(poses[:, joint, 3:])).as_quat()
    return poses


def _motion_of(robot: Robot | RpctlError, run: Run, triangles: int = MAX_TRIANGLES) -> Motion:
    frames = _frames(run.t)
    if isinstance(robot, RpctlError):
        bodies = base_marker(run, str(robot))
        poses, desired = (base_poses(q[frames], run.robot.drive.leans) for q in (run.q, run.q_ref))
    else:
        bodies = build_bodies(robot, triangles)
        poses = joint_poses(robot, run.q[frames], run.log.root_pose[frames])
        desired = joint_poses(robot, run.q_ref[frames])
    times, paths = run.t[frames] - run.t[0], _paths(run, frames)
    return Motion(bodies, times, poses, paths, desired, tuple(_notes(run, times, robot)))


def _compose(
    motions: Sequence[Motion], obstacles: Sequence[AvoidedObstacle], ground: float
) -> Scene:
    """Return the scene of motions over one another.

    Args:
        motions: At least one.
        obstacles: That are drawn.
        ground: Height of the ground, m.
    """
    starts = [part_cloud(each.bodies, each.joints, each.poses[:1]) for each in motions]
    size = max(float(start[:, 2].max()) for start in starts) - ground
    clouds = [path for motion in motions for path in motion.paths.values()]
    clouds += [
        part_cloud(motion.bodies, motion.joints, poses)
        for motion in motions
        for poses in (motion.poses, motion.desired)
        if poses is not None
    ]
    cloud = np.concatenate(clouds)
    cloud = np.concatenate([cloud, obstacle_corners(obstacles, cloud, ground, size)])
    lower, upper = cloud.min(axis=0), cloud.max(axis=0)
    lower[2] = min(lower[2], ground)
    paths = {node_prefix(k): motion.paths for k, motion in enumerate(motions, 1)}
    first = motions[0]
    stand_ins = dict.fromkeys(each for motion in motions for each in motion.bodies.stand_ins)
    return Scene(
        commands=(
            *opening_commands(lower, upper, ground),
            *obstacle_commands(obstacles, lower, upper, ground, size),
            trails.trails_command(paths, lower, upper),
            _robots(motions),
            _animation(motions),
        ),
        motions=tuple(motion.times for motion in motions),
        hull=hull_points(cloud),
        start=np.stack([starts[0].min(axis=0), starts[0].max(axis=0)]),
        follow=f"{ACTUAL}-{first.joints[0]}",
        origin=first.poses[0, first.joints[0], :3],
        notes=tuple(
            dict.fromkeys(note for each in motions for note in (*each.notes, *each.bodies.notes))
        ),
        stand_ins=tuple(stand_ins),
    )


def opening_commands(lower: Array, upper: Array, ground: float) -> list[bytes]:
    """Return the commands that clear meshcat's own scene, and draw ground and lights.

    Args:
        lower: Least coordinates of what the scene shows (3,), m.
        upper: Largest coordinates (3,), m.
        ground: Height of the ground, m.
    """
    return [
        *(threejs.pack({"type": "delete", "path": f"/{name}"}) for name in OWN_OBJECTS),
        threejs.pack({"type": "set_property", "path": "/Background", **INVISIBLE}),
        lights_command(lower, upper),
        ground_command(lower, upper, ground),
    ]


def _notes(run: Run, times: Array, robot: Robot | RpctlError) -> Iterator[str]:
    """Yield the notes of a scene: on the laws, the run, the frames (n,), s, and the robot."""
    yield from (*run.law_sentences, *run.notes)
    if len(times) >= MAX_FRAMES:
        rate = (len(times) - 1) / float(times[-1])
        yield (
            f"the animation of this long run has {rate:.2g} frames a second, and its charts keep "
            f"the extremes of each stretch; of the desired path {DESIRED_S:g} s are drawn at most; "
            "the figures of merit are of every sample"
        )
    if isinstance(robot, RpctlError):
        return
    if names := robot.description.estimated_links:
        density = f"{robot.loaded_with.density:g} kg/m³"
        yield f"mass and inertia of {', '.join(names)} are estimates at {density}"
    if not has_surroundings(robot) and robot.description.mesh_lines:
        yield (
            f"{robot.description.path.name}, the robot's file, is missing or was edited: rpctl "
            "does not draw meshes beside it; declare their folder with --package-dir"
        )


def _frames(t: Array) -> NDArray[np.int64]:
    """Return the samples that become frames, first and last among them."""
    wanted = int(np.ceil((t[-1] - t[0]) * FRAME_RATE)) + 1
    count = min(max(wanted, 1), MAX_FRAMES, len(t))
    return np.unique(np.rint(np.linspace(0, len(t) - 1, count)).astype(np.int64))


def _paths(run: Run, frames: NDArray[np.int64]) -> dict[str, Array]:
    """Return the paths (n, 3) in the world, m: desired and actual, of P and the end effector."""
    desired = _desired_samples(run.t, frames)
    height = run.robot.drive.floor
    paths = {
        "base-desired": level(run.base_ref[desired, :2], height),
        "base": level(run.log.base[_trail_samples(run.t, frames, MAX_BASE_POINTS), :2], height),
    }
    if run.log.ee.shape[1] == 3:
        actual = _trail_samples(run.t, frames, MAX_TIP_POINTS)
        paths |= {"tip-desired": run.log.ee_ref[desired], "tip": run.log.ee[actual]}
    return paths


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
        turns = Rotation.from_quat(poses[:, joint, 3:]).as_matrix()
        moved = np.einsum("kij,cj->kci", turns, bounding_corners(bodies, joint))
        clouds.append((moved + poses[:, joint, None, :3]).reshape(-1, 3))
    return np.concatenate(clouds)


def hull_points(cloud: Array) -> Array:
    """Return the extreme points (n, 3) of a cloud in evenly spread directions."""
    count = 128
    heights = np.linspace(-1.0, 1.0, count)
    turns = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)  # a golden spiral over the sphere
    rings = np.sqrt(1.0 - heights**2)
    around = np.column_stack([rings * np.cos(turns), rings * np.sin(turns), heights])
    # One by one: all at once would take a gigabyte of a long run.
    return np.asarray(cloud[np.unique([(cloud @ direction).argmax() for direction in around])])


def node_prefix(motion: int) -> str:
    """Return what the names of a motion's nodes begin with; they are counted from 1."""
    return f"run{motion}-" if motion > 1 else ""


def _robots(motions: Sequence[Motion]) -> bytes:
    """Return the command that draws the robots and ghosts, which share their meshes.

    A node stands for a joint and is animated. The page gives ghosts of later motions the colours of
    their lines.
    """
    groups: list[threejs.Json] = []
    for k, motion in enumerate(motions, 1):
        prefix = node_prefix(k)
        opacity = LATER_OPACITY if k > 1 else GHOST_OPACITY
        for joint, nodes in sorted(robot_nodes(motion.bodies, prefix, opacity).items()):
            shown = nodes.ghost if k > 1 else nodes.solid
            groups.append(threejs.node("Group", f"{prefix}{ACTUAL}-{joint}", children=shown))
            if motion.desired is not None and k == 1:
                groups.append(threejs.node("Group", f"{REFERENCE}-{joint}", children=nodes.ghost))
    return threejs.set_group(ROBOTS_PATH, "robots", groups)


def _animation(motions: Sequence[Motion]) -> bytes:
    tracks: list[threejs.Json] = []
    for k, motion in enumerate(motions, 1):
        shown = {f"{node_prefix(k)}{ACTUAL}": motion.poses}
        if motion.desired is not None and k == 1:
            shown[REFERENCE] = motion.desired
        for joint in motion.joints:
            for name, poses in shown.items():
                tracks += threejs.motion_tracks(f"{name}-{joint}", motion.times, poses[:, joint])
    return threejs.set_animation(f"{ROBOTS_PATH}/<object>", tracks)


def joint_poses(robot: Robot, q: Array, roots: Array | None = None) -> Array:
    """Return the poses (n, njoints, 7) of all joints at configurations (n, nq).

    A pose is the position in the world, m, and the unit quaternion (x, y, z, w).

    Args:
        robot: The robot.
        q: Configurations (n, nq).
        roots: Poses of the root link (n, 7) over the ground, where it may tilt and hop; (n, 0) or
            None: it stays level.
    """
    data = robot.model.createData()
    poses = np.empty((len(q), robot.model.njoints, 7))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(robot.model, data, configuration)
        placements = list(data.oMi)
        if roots is not None and roots.shape[1]:
            root = pin.XYZQUATToSE3(roots[k])
            root.translation[2] += robot.drive.floor
            moved = root * data.oMi[ROOT_JOINT].inverse()
            placements[ROOT_JOINT:] = [moved * each for each in placements[ROOT_JOINT:]]
        poses[k] = [pin.SE3ToXYZQUAT(placement) for placement in placements]
    return poses


def base_poses(q: Array, leans: bool = False) -> Array:
    """Return the poses (n, 2, 7) of the universe and the root link, level or not, at q (n, nq).

    A pose is the position in the world, m, and the unit quaternion (x, y, z, w).
    """
    poses = np.zeros((len(q), ROOT_JOINT + 1, 7))
    poses[:, :, 6] = 1.0
    if leans:
        poses[:, ROOT_JOINT] = q[:, :7]
        return poses
    half = 0.5 * np.arctan2(q[:, 3], q[:, 2])
    poses[:, ROOT_JOINT, :2] = q[:, :2]
    poses[:, ROOT_JOINT, 5:] = np.column_stack([np.sin(half), np.cos(half)])
    return poses
