"""A controller for a microcontroller: the law as one C file, compiled, driving the robot."""

import ctypes
import math
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import rpctl

START = (0.1, 0.2, 0.3)  # tracking error: m, m, rad


def compiled(source: str, folder: str) -> Any:
    Path(folder, "law.c").write_text(source)
    command = ["cc", "-std=c99", "-O2", "-shared", "-fPIC", "law.c", "-o", "law.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(f"{folder}/law.so").paper_law


robot = rpctl.load("paper")
written = rpctl.derive_law(robot, kinematic="unified", format="c")
tau, nu_d, nu_d_dot = results = np.zeros((3, 4))
with tempfile.TemporaryDirectory() as folder:
    law = compiled(written.text, folder)

    def kinematic(dynamics: Any, reference: Any, t: float, q: Any, nu: Any) -> rpctl.Command:
        base, direction, arm = (r := reference(t))[:3], r.direction, r[3:6]
        seen = np.array([q[0], q[1], math.atan2(q[3], q[2])]), robot.joint_positions(q), nu
        state = np.concatenate([*base, np.ravel(direction), *arm])  # the eight has a direction
        law(*(ctypes.c_void_p(each.ctypes.data) for each in (*seen, state, *results)))
        return rpctl.Command(nu_d.copy(), nu_d_dot.copy())

    ours = rpctl.track(
        robot,
        "eight",
        duration=10.0,
        initial_error=START,
        kinematic=kinematic,
        dynamic=lambda *_: tau.copy(),
    )
theirs = rpctl.track(
    robot, "eight", duration=10.0, initial_error=START, dynamic=rpctl.PaperDynamic()
)
print(f"at most {written.operations}")
print("largest difference of q to Python's law:", np.abs(ours.q - theirs.q).max())
