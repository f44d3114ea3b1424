"""How long a sample of each law takes while a robot is stepped at 500 Hz in real time.

Usage: python demos/real_time.py [SECONDS of each law, 5 if left out; then names of robots]
"""

import itertools
import sys
import time

import numpy as np
import pinocchio as pin

import rpctl

PERIOD = 0.002  # s
KINEMATIC = ("unified", "paper", "end-effector", "horizon", "kanayama", "feedback-linearization")
LAWS = [(each, "integral") for each in KINEMATIC] + [("unified", "bounded"), ("paper", "paper")]
HEAD = ("robot", "kinematic law", "dynamic law", "median", "99.9 %", "worst", "late", "fallbacks")


def stepped(controller: rpctl.Controller, duration: float) -> np.ndarray:
    """Return the time (s) of each step of a controller whose robot moves as its model does."""
    robot, seconds = controller.robot, []
    dynamics = rpctl.ReducedDynamics(robot)
    start = controller.reference(0.0)
    q, nu = robot.configuration_at(start.pose, start.joints), np.zeros(robot.dof)
    began = time.perf_counter()
    for k in itertools.count():
        time.sleep(max(0.0, began + k * PERIOD - time.perf_counter()))
        before = time.perf_counter()
        if before - began >= duration:  # a law that comes late takes fewer samples
            break
        output = controller.step(before - began, q, nu)
        seconds.append(time.perf_counter() - before)
        nu = nu + PERIOD * dynamics.forward(q, nu, output.efforts)
        q = pin.integrate(robot.model, q, PERIOD * dynamics.basis(q) @ nu)
    return np.array(seconds)


duration = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
print("{:8}{:24}{:13}{:>8}{:>8}{:>8}{:>7}{:>11}   (ms)".format(*HEAD))
for name in sys.argv[2:] or ("tiago", "swerve"):
    robot = rpctl.load(name)
    for kinematic, dynamic in LAWS:
        try:
            controller = rpctl.Controller(
                robot, "eight", kinematic=kinematic, dynamic=dynamic, period=PERIOD
            )
            seconds = 1e3 * stepped(controller, duration)
        except rpctl.RpctlError as error:
            print(f"{name:8}{kinematic:24}{dynamic:13}{error}")
            continue
        median, most = np.percentile(seconds, [50.0, 99.9])
        counts = controller.report()
        times = f"{median:8.3f}{most:8.3f}{seconds.max():8.2f}"
        counted = f"{counts['late']:7.0f}{counts['fallbacks']:11.0f}"
        print(f"{name:8}{kinematic:24}{dynamic:13}{times}{counted}", flush=True)
