"""Several motions of one robot in one scene: the first as it is, the others as ghosts over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.scene import materials, threejs
from rpctl.view.scene.ground import ground_command, lights_command
from rpctl.view.scene.robot_meshes import Bodies, build_bodies
from rpctl.view.scene.scene import (
    ACTUAL,
    ROBOTS_PATH,
    Scene,
    hull_points,
    joint_poses,
    motion_tracks,
    node_prefix,
    part_cloud,
)
from rpctl.view.scene.trails import BASE_COLOUR, ribbon, trail_width

GHOST_OPACITY = 0.45
LIFT = 0.3  # of a trail's width that each lies above the one before: none hides another


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """A motion of a robot in space.

    Attributes:
        times: Of its samples (n,), s, from 0.
        root: Root link's x, y, z (m) and quaternion x, y, z, w (n, 7).
        joints: Positions of the moving joints (n,), rad or m, by name.
    """

    times: Array
    root: Array
    joints: Mapping[str, Array]


def scenes_of(robot: Robot, motions: Sequence[ShownMotion]) -> tuple[Scene, list[Scene]]:
    """Return the scene of several motions, and one of each for its length.

    Nodes are named as those of several runs: ``run2-robot-1``, ``run2-trail-base`` and so on.

    Args:
        robot: The robot.
        motions: At least one, of two samples or more.
    """
    bodies = build_bodies(robot)
    joints = sorted({part.joint for part in bodies.parts})
    poses = [_poses(robot, motion) for motion in motions]
    first = part_cloud(bodies, joints, poses[0][:1])
    cloud = np.concatenate([part_cloud(bodies, joints, each) for each in poses])
    lower, upper = cloud.min(axis=0), cloud.max(axis=0)
    lower[2] = min(lower[2], 0.0)
    commands = (
        *(threejs.delete(path) for path in ("/Grid", "/Axes", "/Lights")),
        threejs.set_property("/Background", "visible", False),
        lights_command(lower, upper),
        ground_command(lower, upper, 0.0),
        _trails(motions, lower, upper),
        _robots(bodies, joints, len(motions)),
        _animation(joints, motions, poses),
    )
    scenes = [
        Scene(
            commands=commands,
            times=motion.times,
            lower=lower,
            upper=upper,
            hull=hull_points(cloud),
            start=np.stack([first.min(axis=0), first.max(axis=0)]),
            follow=f"{ACTUAL}-{joints[0]}",
            origin=poses[0][0, joints[0], :3],
            notes=bodies.notes,
            stand_ins=bodies.stand_ins,
        )
        for motion in motions
    ]
    return max(scenes, key=lambda scene: scene.duration), scenes


def _poses(robot: Robot, motion: ShownMotion) -> Array:
    """Return the poses (n, njoints, 7) of all joints in the world, the root link free in space."""
    from scipy.spatial.transform import Rotation

    q = np.array(
        [
            robot.configuration(
                joints={name: float(values[k]) for name, values in motion.joints.items()}
            )
            for k in range(len(motion.times))
        ]
    )
    for name, values in motion.joints.items():  # what the engine lets mimics and followers do
        robot.entries[name].write_all(q, values)
    poses = joint_poses(robot, q)
    turns = Rotation.from_quat(motion.root[:, 3:])
    for joint in range(ROOT_JOINT, poses.shape[1]):
        poses[:, joint, :3] = turns.apply(poses[:, joint, :3]) + motion.root[:, :3]
        poses[:, joint, 3:] = (turns * Rotation.from_quat(poses[:, joint, 3:])).as_quat()
    return poses


def _robots(bodies: Bodies, joints: list[int], count: int) -> bytes:
    """Return the command that draws the robot and its ghosts, which share their meshes."""
    paints = materials.materials(bodies)
    tint = next(paint for paint in paints if paint["uuid"] == "tint")
    groups = []
    for k in range(1, count + 1):
        prefix = node_prefix(k)
        if k > 1:
            paints.append({**tint, "uuid": f"{prefix}tint", "opacity": GHOST_OPACITY})
        for joint in joints:
            children = materials.solid(bodies, joint)
            if k > 1:
                children = [_ghostly(mesh, prefix) for mesh in materials.ghost(bodies, joint)]
            groups.append(threejs.node("Group", f"{prefix}{ACTUAL}-{joint}", children=children))
    root = threejs.node("Group", "robots", children=groups)
    return threejs.set_object(
        ROBOTS_PATH, root, materials.geometries(bodies), paints, **materials.images(bodies)
    )


def _ghostly(mesh: threejs.Json, prefix: str) -> threejs.Json:
    """Return a part of a ghost as one of a certain run, in its colour."""
    paint = f"{prefix}tint" if mesh["material"] == "tint" else mesh["material"]
    return {**mesh, **{key: f"{prefix}{mesh[key]}" for key in ("uuid", "name")}, "material": paint}


def _trails(motions: Sequence[ShownMotion], lower: Array, upper: Array) -> bytes:
    """Return the command that draws the way of each root link on the ground."""
    width = trail_width(lower, upper)
    geometries, paints, nodes = [], [], []
    for k, motion in enumerate(motions, 1):
        path = np.column_stack([motion.root[:, :2], np.full(len(motion.times), k * LIFT * width)])
        mesh = ribbon(path, width)
        if mesh is None:
            continue
        name = f"{node_prefix(k)}trail-base"
        position = {"position": threejs.attribute(mesh[0].astype(np.float32))}
        geometries.append(threejs.geometry(name, position, mesh[1]))
        paint = {"uuid": name, "type": "MeshBasicMaterial", "color": BASE_COLOUR, "side": 2}
        paints.append(paint)
        entries = {"geometry": name, "material": name, "renderOrder": 3}
        nodes.append(threejs.node("Mesh", name, frustumCulled=False, **entries))
    root = threejs.node("Group", "trails", children=nodes)
    return threejs.set_object("/rpctl/trails", root, geometries, paints)


def _animation(joints: list[int], motions: Sequence[ShownMotion], poses: Sequence[Array]) -> bytes:
    tracks = [
        track
        for k, (motion, each) in enumerate(zip(motions, poses, strict=True), 1)
        for joint in joints
        for track in motion_tracks(
            f"{node_prefix(k)}{ACTUAL}-{joint}", motion.times, each[:, joint]
        )
    ]
    return threejs.set_animation(f"{ROBOTS_PATH}/<object>", tracks)
