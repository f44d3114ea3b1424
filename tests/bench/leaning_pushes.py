"""The largest pushes that robots that lean survive on contact, late or not, beside a plain LQR's.

``python -m tests.bench.leaning_pushes [URDF …]`` prints a table for the project's own robots and
those of some files. A push goes through the robot's centre of mass, ahead or at a bicycle's side,
for .1 s; or ahead at the origin of its root link, for .1 or .6 s. It is survived if the robot leans
by less than .3 rad three seconds later.

The plain LQR knows the textbook's planar pendulum on wheels, or the linear bicycle of Meijaard et
al. 2007 at 3 m/s. It keeps upright and no more: it has no wish, foretells nothing, and its efforts
are clipped. Legs and arms it leaves to servos, which are never late.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_continuous_are

import rpctl
from rpctl import Plant, ReducedDynamics
from rpctl.arrays import Array
from rpctl.control.steady_motion import Posture
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.equivalence.contact.plan import felt_inertia
from rpctl.robot.leaning import LeaningRobot, lies
from rpctl.simulation.merits.outcome import FELL
from rpctl.simulation.plants.contact import LeaningMotion
from rpctl.simulation.plants.settings import Wrench
from tests.dynamics.whipple import PUBLISHED
from tests.leaning import OWN

PERIOD, LATER, UPRIGHT = 2e-3, 3.0, 0.3  # s, s, rad
DELAYS = 0.0, 0.02  # s
CENTRE, ROOT = "centre of mass", "root link"
PUSHES = (CENTRE, 0.1), (ROOT, 0.1), (ROOT, 0.6)  # s
SPEED, SLOW, G, FRICTION = 3.0, 0.1, 9.81, 0.7  # m/s of a bicycle and of others; m/s²
FIRST, GROWTH, HALVINGS, MOST = 0.1, 1.6, 2, 5.0  # m/s that pushes give; steps of the search
SERVO = 80.0  # rad/s of legs and arms, critically damped
TILT, RATE, DRIFT = 0.1, 1.0, 0.3  # rad, rad/s, m/s that cost alike
SHARE = 0.3  # of a motor's limit, which costs as much

Law = Callable[[Array, Array], Array]  # from q and ν to efforts


def regulator(A: Array, B: Array, costs: list[float], effort: float) -> Array:
    """Return K (n,) of u = −K x."""
    Q, R = np.diag(np.array(costs) ** -2.0), np.array([[effort**-2.0]])
    P = solve_continuous_are(A, B[:, None], Q, R)
    return np.asarray(effort**2 * B @ P)


def pendulum(robot: LeaningRobot, q: Array) -> Array:
    """Return the torque of both wheels by tilt, its rate and v."""
    data, wheels = robot.model.createData(), {axle.joint: axle for axle in robot.axles}
    pin.forwardKinematics(robot.model, data, q)
    inertias = {j: robot.model.inertias[j] for j in range(1, robot.model.njoints)}
    body = pin.Inertia.Zero()
    for j in set(inertias) - set(wheels):
        body += data.oMi[j].act(inertias[j])
    m, r = body.mass, robot.axles[0].radius
    tall = body.lever[2] - r
    rolls = sum(inertias[j].mass + a.left @ inertias[j].inertia @ a.left / r**2
                for j, a in wheels.items())  # fmt: skip
    M = np.array([[m + rolls, m * tall], [m * tall, body.inertia[1, 1] + m * tall**2]])
    (dv_u, ddphi_u), (dv, ddphi) = (
        np.linalg.solve(M, [1.0 / r, -1.0]),
        np.linalg.solve(M, [0.0, m * G * tall]),
    )
    A = np.array([[0.0, 1.0, 0.0], [ddphi, 0.0, 0.0], [dv, 0.0, 0.0]])
    limit = robot.effort_limits[robot.actuators.index(robot.drive.wheels[0].joint)]
    B = np.array([0.0, ddphi_u, dv_u])
    return regulator(A, B, [TILT, RATE, DRIFT], SHARE * 2.0 * float(limit))


def bicycle(robot: LeaningRobot) -> Array:
    """Return the steering torque to the left by lean, steering to the left, and their rates."""
    inverse = np.linalg.inv(PUBLISHED.M)
    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, 2:] = np.eye(2), -SPEED * inverse @ PUBLISHED.C1
    A[2:, :2] = -inverse @ (G * PUBLISHED.K0 + SPEED**2 * PUBLISHED.K2)
    B = np.concatenate([[0.0, 0.0], inverse[:, 1]])
    limit = robot.effort_limits[robot.actuators.index(robot.drive.swivels[0].joint)]
    K = regulator(A, B, [TILT, TILT, RATE, RATE], SHARE * float(limit))
    return K * [-1.0, 1.0, -1.0, 1.0]  # the benchmark steers to the right


def plain_lqr(dynamics: ReducedDynamics, q: Array) -> Law:
    """Return the law of a robot that is in balance at q (nq,): what it adds to what holds that."""
    robot = dynamics.robot
    assert isinstance(robot, LeaningRobot)
    upright, names, ahead = robot.tilt(q), robot.actuators, dynamics.actuation(q)[0]
    wheels = [names.index(wheel.joint) for wheel in robot.drive.wheels if wheel.driven]
    K = bicycle(robot) if robot.rolls_sideways else pendulum(robot, q)

    def law(now: Array, nu: Array) -> Array:
        tau, lean = np.zeros(len(names)), robot.tilt(now) - upright
        if robot.rolls_sideways:
            steer = robot.drive.swivels[0].joint
            state = np.array([lean, robot.joint_position(now, steer), nu[1], nu[2]])
            tau[names.index(steer)] = -K @ state
            tau[wheels] = robot.mass * (SPEED - nu[0]) / ahead[wheels]
        else:
            pull = -K @ np.array([lean, nu[2], nu[0]]) / len(wheels)
            tau[wheels] = np.sign(ahead[wheels]) * pull
        return tau

    return law


def servos(dynamics: ReducedDynamics, q: Array) -> Law:
    """Return what the servos of legs and arms add to what holds a robot at q (nq,)."""
    robot, felt = dynamics.robot, felt_inertia(dynamics, q, dynamics.robot.joint_names)
    arm, first = [robot.actuators.index(n) for n in robot.joint_names], robot.dof - len(felt)

    def law(now: Array, nu: Array) -> Array:
        tau, bent = np.zeros(len(robot.actuators)), robot.joint_positions(now) - robot.home
        tau[arm] = -SERVO * felt @ (SERVO * bent + 2.0 * nu[first:])
        return tau

    return law


class Push(NamedTuple):
    """A push of a robot that leans."""

    at: str
    duration: float  # s
    size: float  # N s
    delay: float  # s, of the efforts


def wrench(robot: LeaningRobot, q: Array, push: Push, start: float) -> Wrench:
    """Return a push of a robot that stands at q (nq,)."""
    own = push.size / push.duration
    force = (0.0, own, 0.0) if robot.rolls_sideways else (own, 0.0, 0.0)
    arm = pin.centerOfMass(robot.model, robot.model.createData(), q) - q[:3]
    x, y, z = np.cross(arm if push.at == CENTRE else np.zeros(3), force).tolist()
    return Wrench(robot.description.root, force, (x, y, z), start=start,
                  end=start + push.duration)  # fmt: skip


def survives_by_lqr(robot: LeaningRobot, push: Push) -> bool:
    """Return whether the plain LQR keeps a robot upright."""
    dynamics = ReducedDynamics(robot)
    steady = Posture(dynamics).steady(0.0, 0.0, robot.home)
    law, hold = plain_lqr(dynamics, steady.q), servos(dynamics, steady.q)
    pushed, limits = wrench(robot, steady.q, push, 1.0), robot.effort_limits
    motion = LeaningMotion(robot, ContactSettings(), FRICTION, steady.q)
    if robot.rolls_sideways:
        nu = np.zeros(robot.dof)
        nu[0] = SPEED
        motion.launch(dynamics.basis(motion.q) @ nu)
    sent = deque([np.zeros_like(steady.tau)] * round(push.delay / PERIOD))
    for k in range(round((1.0 + push.duration + LATER) / PERIOD)):
        q = motion.q
        if lies(q):
            return False
        nu = motion.nu
        sent.append(law(q, nu))
        tau = np.clip(steady.tau + sent.popleft() + hold(q, nu), -limits, limits)
        motion.advance(tau, PERIOD, (pushed,) if pushed.acts(PERIOD * k) else ())
    return abs(robot.tilt(motion.q) - robot.tilt(steady.q)) < UPRIGHT


def survives_by_balance(robot: LeaningRobot, push: Push) -> bool:
    """Return whether the law ``balance`` keeps a robot upright."""
    steady = Posture(ReducedDynamics(robot)).steady(0.0, 0.0, robot.home)
    start = 4.0 if robot.rolls_sideways else 1.0  # until it goes 3 m/s
    run = rpctl.track(
        robot, "line", duration=start + push.duration + LATER, collisions=False,
        speed=SPEED if robot.rolls_sideways else SLOW,
        plant=Plant(kind="contact", wrenches=(wrench(robot, steady.q, push, start),),
                    delay=push.delay),
    )  # fmt: skip
    off = abs(robot.tilt(run.q[-1]) - robot.tilt(steady.q))
    return rpctl.summarize(run).outcome != FELL and off < UPRIGHT


def largest(survives: Callable[[LeaningRobot, Push], bool], robot: LeaningRobot,
            push: Push) -> str:  # fmt: skip
    """Return the largest size of a push that is survived, N s, in words."""

    def stands(size: float) -> bool:
        return survives(robot, push._replace(size=size))

    if not stands(0.0):
        return "falls"
    low, high = 0.0, FIRST * robot.mass
    while stands(high):
        low, high = high, GROWTH * high
        if high > MOST * robot.mass:
            return f"> {low:.3g}"
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(middle) else (low, middle)
    return f"{low:.3g}"


def main() -> None:
    """Print the table."""
    print("| robot, kg | at its | for, s | delay, ms | balance, N s | plain LQR, N s |")
    print("|---|---|---|---|---|---|")
    for source in (*OWN, *sys.argv[1:]):
        robot = rpctl.load(source)
        assert isinstance(robot, LeaningRobot)
        for (at, duration), delay in product(PUSHES, DELAYS):
            if at == ROOT and robot.rolls_sideways:
                continue
            push = Push(at, duration, 0.0, delay)
            found = (largest(s, robot, push) for s in (survives_by_balance, survives_by_lqr))
            name = f"{robot.name}, {robot.mass:.3g}"
            cells = name, at, f"{duration:g}", f"{1e3 * delay:.0f}", *found
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
