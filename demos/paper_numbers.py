"""The paper's robot: its reduced equations at one state, next to the printed numbers.

M, h and ν̇ are those of the closed form that [MS21, Eq. 5] leads to.
"""

import numpy as np

import rpctl


def main() -> None:
    np.set_printoptions(precision=9, suppress=True)
    robot = rpctl.load("paper")
    dynamics = rpctl.ReducedDynamics(robot)
    q = robot.configuration(joints={"arm_revolute_joint": 0.7, "arm_prismatic_joint": 0.6})
    nu = np.array([0.8, 0.5, -0.4, 0.3])
    tau = np.array([2.0, 3.0, 1.0, -1.0])
    print("ν  =", robot.quasi_velocities)
    print("τ  =", robot.actuators)
    print("M  =\n", dynamics.inertia(q), sep="")
    print("−h =", -dynamics.bias(q, nu))
    print("ν̇  =", dynamics.forward(q, nu, tau))
    printed = [1.060716590, -0.014540282, 2.146075282, -1.524852341]
    print("largest difference:", np.abs(dynamics.forward(q, nu, tau) - printed).max())


if __name__ == "__main__":
    main()
