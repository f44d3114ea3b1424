"""The controller drives a robot that another simulator moves: MuJoCo, at 500 Hz.

MuJoCo reads the file that ``rpctl export`` writes: nothing of rpctl's own simulation is used, and
wheels roll because friction lets them. Needs the extra ``rpctl[mujoco]``.
"""

import math
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

import rpctl

DURATION, PERIOD = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0, 0.002

robot = rpctl.load("paper")
with tempfile.TemporaryDirectory() as folder:
    file = rpctl.export_mjcf(robot, Path(folder) / "paper.xml", wheel_width=0.07).path
    model = mujoco.MjModel.from_xml_path(str(file))
data = mujoco.MjData(model)

exported = rpctl.MjcfRobot(robot, model)
controller = rpctl.Controller(robot, "eight", period=PERIOD)
start = controller.reference(0.0)
exported.place(data, robot.configuration_at(start.pose, start.joints))
distances = []
while data.time < DURATION:
    q, nu = exported.state(data)
    data.ctrl[exported.actuators] = controller.step(data.time, q, nu).efforts
    target = controller.reference(data.time).pose
    distances.append(math.dist(target[:2], robot.base_pose(q)[:2]))
    mujoco.mj_step(model, data, nstep=round(PERIOD / model.opt.timestep))

print(f"{robot.name} in MuJoCo {mujoco.__version__}, {DURATION:g} s of the eight:")
print(
    f"rms distance {1e3 * np.sqrt(np.mean(np.square(distances))):.1f} mm, "
    f"at the end {1e3 * distances[-1]:.1f} mm; {controller.report()}"
)
