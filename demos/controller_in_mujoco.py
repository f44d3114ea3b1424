"""The controller drives a robot that another simulator moves: MuJoCo, at 500 Hz.

MuJoCo reads the same URDF and sets it on a floor where wheels slip and the support rubs. Nothing of
rpctl's own simulation is used. Needs the extra ``rpctl[mujoco]``.
"""

import math
import sys
from pathlib import Path

import mujoco
import numpy as np

import rpctl

URDF = Path(__file__).parents[1] / "urdf" / "paper.urdf"
DURATION, PERIOD = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0, 0.002

robot = rpctl.load(URDF)
controller = rpctl.Controller(robot, "eight", period=PERIOD)

spec = mujoco.MjSpec.from_file(str(URDF))
spec.option.timestep, spec.option.cone = PERIOD / 2, mujoco.mjtCone.mjCONE_ELLIPTIC
spec.body("base_link").add_freejoint()
for geom in spec.geoms:
    geom.conaffinity = 0  # the robot touches the floor only
spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], conaffinity=1)
support = spec.geom("support")
support.friction, support.priority = [0.02, 0, 0], 1  # a ball that rolls, whatever the floor is
for name in robot.actuators:
    spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
model = spec.compile()
data = mujoco.MjData(model)
start = controller.reference(0.0)
x, y, theta = robot.root_pose(start.pose)
data.qpos[:7] = x, y, 0.001, math.cos(theta / 2), 0, 0, math.sin(theta / 2)
for name, position in zip(robot.joint_names, start.joints, strict=True):
    data.joint(name).qpos[0] = position
distances = []

while data.time < DURATION:
    cos, _, _, sin = data.qpos[3:7]  # of half the heading, on level ground
    pose = (*data.qpos[:2], 2 * math.atan2(sin, cos))
    forward = math.cos(pose[2]) * data.qvel[0] + math.sin(pose[2]) * data.qvel[1]
    joints = {name: data.joint(name).qpos[0] for name in robot.joint_names}
    rates = {name: data.joint(name).qvel[0] for name in robot.joint_names}
    q, nu = robot.state(pose, (forward, data.qvel[5]), joints, rates)
    data.ctrl[:] = controller.step(data.time, q, nu).efforts
    reference = controller.reference(data.time)
    distances.append(math.dist(reference.pose[:2], robot.base_pose(q)[:2]))
    mujoco.mj_step(model, data, nstep=2)

print(f"{robot.name} in MuJoCo {mujoco.__version__}, {DURATION:g} s of the eight:")
print(
    f"rms distance {1e3 * np.sqrt(np.mean(np.square(distances))):.1f} mm, "
    f"at the end {1e3 * distances[-1]:.1f} mm; {controller.report()}"
)
