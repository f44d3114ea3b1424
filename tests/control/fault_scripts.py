"""Random faults of a robot, in pairs, and what its controller makes of them.

Controller and plant both run as machine code. ``python -m tests.control.fault_scripts`` runs a
thousand scripts and prints what came of each kind of fault.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from rpctl import Controller, Robot
from rpctl.arrays import Array
from rpctl.control.error import tracking_error
from rpctl.control.safeguards import LOST_ERROR
from rpctl.control.transition import Following, Stop, Transition
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.machine_code import code_key
from rpctl.kernels.program import Buffer, Program
from rpctl.kernels.stored import stored
from rpctl.reference.load import load_reference
from rpctl.reference.motion import configuration_along
from rpctl.robot.inspection import robot_identity
from rpctl.simulation.compiled.implicit_step import PlantBuffers
from rpctl.simulation.compiled.loop import plant_fragment
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import rest_at
from tests.catalogue import robot_of

ROBOTS = "paper", "tiago", "car", "mecanum"
PERIOD = 0.002  # s
BEGINS, RECOVERED_IN = 2.0, 5.0  # s: when the first fault comes; after the last one
NEAR = 0.03  # m or rad: back on the reference
MOST_JUMP = 0.3  # of an effort's limit, from a sample to the next
BEYOND = 0.1  # of a joint's limit of speed; of its range where it has one
SETTLED = 10  # samples after which the start's own jump is over
LASTING = 15.0  # s more at most, in which a wheel that stays dead shows on a bend of its eight
BRAKES = 0.95  # of the speeds is left after a sample with the brakes on
KINDS = "delay", "loss", "jump", "dead", "nan", "clock", "stop"


@dataclass(frozen=True)
class Fault:
    """A fault of a robot for a while.

    Attributes:
        kind: What is wrong.
        start: When it begins, s.
        end: When it ends, s; infinite: never.
        size: s of delay and of a clock; the share lost; m and rad of a jump; number of an actuator.
    """

    kind: str
    start: float
    end: float
    size: float

    def acts(self, t: float) -> bool:
        """Return whether it is there at a time (s)."""
        return self.start <= t < self.end


def draw(rng: np.random.Generator, robot: Robot) -> list[Fault]:
    """Return two faults, each of a random kind, time and size."""
    found = []
    for kind in rng.choice(KINDS, size=2).tolist():
        start = BEGINS + rng.uniform(0.0, 1.5)
        lasts = rng.uniform(0.1, 1.5)
        size = rng.uniform(0.1, 1.0)
        if kind == "delay":
            size *= 0.05
        elif kind == "loss":
            size *= 0.6
        elif kind == "jump":
            size, lasts = 0.3 * size * rng.choice([-1.0, 1.0]), math.inf
        elif kind == "dead":
            wheels = [k for k, name in enumerate(robot.actuators) if name not in robot.joint_names]
            size = float(rng.choice(wheels))
            lasts = rng.choice([lasts, math.inf])
        elif kind == "nan":
            lasts *= 0.3
        elif kind == "clock":
            size = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-2.0, 3.0)
            lasts = rng.choice([PERIOD, math.inf])
        found.append(Fault(kind, start, start + lasts, float(size)))
    return found


class MachinePlant:
    """A robot that rolls, with its losses and stops, as machine code.

    Attributes:
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
    """

    def __init__(self, robot: Robot, q: Array) -> None:
        dynamics = SymbolicDynamics(robot)
        sizes = robot.nq, robot.dof, len(robot.actuators), 2, robot.dof, dynamics.p.numel()
        names = PlantBuffers.__dataclass_fields__

        def make() -> tuple[tuple[PlantBuffers, tuple[Buffer, ...]], Sequence[Program]]:
            at = PlantBuffers(*map(Buffer, names, sizes))
            plant = plant_fragment(dynamics, at, PERIOD, 1)
            return (at, plant.memory), (Program(plant.start), Program(plant.steps))

        key = code_key(robot_identity(robot), ("plant of fault scripts", PERIOD))
        (at, memory), (start, steps) = stored(key, make)
        space = steps.workspace()
        space[at.q][:, 0] = q
        if memory:
            begins = start.workspace()
            for buffer in begins:
                if buffer in space:
                    begins[buffer][:] = space[buffer]
            start.stepper(begins)()
            for buffer in memory:
                space[buffer][:] = begins[buffer]
        self.q, self.nu, self.tau = space[at.q][:, 0], space[at.nu][:, 0], space[at.tau][:, 0]
        self.step = steps.stepper(space)


@dataclass
class Told:
    """What came of a script.

    Attributes:
        faults: Of the script.
        speed_ratio: Largest speed of an arm's joint over its limit.
        beyond: How far a joint was beyond its range, over it.
        jump: Largest change of an effort in a sample over its limit, but for an emergency stop.
        jumped_at: When, s.
        error: Largest error at the end, m or rad.
        status: Of the controller at the end.
        report: Its counts.
    """

    faults: list[Fault]
    speed_ratio: float = 0.0
    beyond: float = 0.0
    jump: float = 0.0
    jumped_at: float = 0.0
    error: float = math.inf
    status: str = ""
    report: dict[str, float] = field(default_factory=dict)

    def wrong(self) -> Iterator[str]:
        """Yield what is not as it is to be, in words.

        A robot whose wheel stays dead may go on with the others, as near as no lost one is.
        """
        if self.speed_ratio > 1.0 + BEYOND:
            yield f"a joint at {self.speed_ratio:.0%} of its speed"
        if self.beyond > BEYOND:
            yield f"a joint beyond its range by {self.beyond:.0%}"
        if self.jump > MOST_JUMP:
            yield f"an effort jumps by {self.jump:.0%} at {self.jumped_at:.3f} s"
        stays = any(f.kind == "dead" and math.isinf(f.end) for f in self.faults)
        if not self.error < (LOST_ERROR if stays else NEAR) and self.status != "lost":
            yield f"{self.error:.3g} m or rad off, {self.status}"


def run(name: str, seed: int) -> Told:
    """Return what comes of the script of a seed on a robot."""
    robot, rng = robot_of(name), np.random.default_rng(seed)
    return run_faults(robot, draw(rng, robot), rng)


def run_faults(robot: Robot, faults: list[Fault], rng: np.random.Generator) -> Told:
    """Return what comes of faults on a robot."""
    reference, told = load_reference(robot, "eight"), Told(faults)
    dynamics = ReducedDynamics(robot)
    first = reference(0.0)
    rest = rest_at(dynamics, Plant(), configuration_along(robot, first, np.asarray(first.pose)))
    controller = Controller(robot, reference, period=PERIOD, rest=rest)
    plant, sent = MachinePlant(robot, rest.q), deque([(rest.tau, True)], maxlen=64)
    limits, n = robot.effort_limits, len(robot.joints)
    speeds, (low, high) = joint_limits(robot)
    last = max(f.end if math.isfinite(f.end) else f.start for f in faults)
    if any(f.kind == "dead" and math.isinf(f.end) for f in faults):
        last += LASTING
    jumped = dict.fromkeys(range(len(faults)), False)
    pivots: dict[int, Array] = {}
    off, stops, before, output = False, False, rest.tau, None
    lost = 0  # samples
    for k in range(round((last + RECOVERED_IN) / PERIOD)):
        t = k * PERIOD
        given, q, nu, late, arrives, dead = t, plant.q.copy(), plant.nu.copy(), 0, True, []
        exempt = k < SETTLED
        for i, fault in enumerate(faults):
            if not fault.acts(t):
                continue
            if fault.kind == "delay":
                late = max(late, round(fault.size / PERIOD))
            elif fault.kind == "loss":
                arrives = arrives and rng.uniform() > fault.size
            elif fault.kind == "jump":
                pivot = pivots.setdefault(i, plant.q[:2].copy())
                moved_frame(q, fault.size, pivot)
            elif fault.kind == "dead":
                dead.append(int(fault.size))
            elif fault.kind == "nan":
                q, nu = q * np.nan, nu * np.nan
            elif fault.kind == "clock":
                given += fault.size
            elif not jumped[i]:
                controller.pause(motors_off=True)
                jumped[i] = off = stops = True
        if off and not any(f.kind == "stop" and f.acts(t) for f in faults):
            controller.resume()
            off = False
        if arrives or output is None:
            output = controller.step(given, q, nu)
            exempt, stops = exempt or stops, False
        sent.append((output.efforts, not off))
        change = float(np.max(np.abs(output.efforts - before) / limits))
        before = output.efforts
        if not exempt and change > told.jump:
            told.jump, told.jumped_at = change, t
        lost += output.status == "lost"
        if lost * PERIOD > RECOVERED_IN:
            break
        acting, moves = sent[-1 - min(late, len(sent) - 1)]
        acting = acting.copy()
        acting[dead] = 0.0
        if not moves:  # brakes take the place of motors
            plant.nu *= BRAKES
            acting = dynamics.efforts(plant.q, dynamics.bias(plant.q, plant.nu))
        plant.tau[:] = acting
        plant.step()
        if n:
            told.speed_ratio = max(told.speed_ratio, float(np.max(np.abs(plant.nu[-n:]) / speeds)))
            place = robot.joint_positions(plant.q)
            out = np.maximum(low - place, place - high) / (high - low)
            told.beyond = float(np.fmax.reduce(out, initial=told.beyond))  # NaN without a range
    q = plant.q.copy()
    for i, pivot in pivots.items():
        moved_frame(q, faults[i].size, pivot)
    told.error = left(controller, q)
    told.status, told.report = output.status if output else "", controller.report()
    return told


def left(controller: Controller, q: Array) -> float:
    """Return how far a robot is from its reference, m or rad, the way back to it included."""
    following: Following = controller._following
    t = controller._reader.time
    if isinstance(following.now, Stop):
        return math.inf
    e = np.abs(tracking_error(controller.robot, following.now(t), q))
    offset = np.zeros_like(e)
    if isinstance(following.now, Transition):
        offset = np.abs(following.now.left(t)[0])
    return float((e + offset).max())


def joint_limits(robot: Robot) -> tuple[Array, tuple[Array, Array]]:
    """Return the arm's limits of speed (n_joints,), and its ranges' ends, infinite without."""
    joints = [robot.description.joint[name] for name in robot.joint_names]
    speeds = np.array([joint.velocity or math.inf for joint in joints])
    ends = [(joint.lower, joint.upper) for joint in joints]
    return speeds, (np.array([e[0] for e in ends]), np.array([e[1] for e in ends]))


def moved_frame(q: Array, size: float, pivot: Array) -> None:
    """Measure a pose in another frame, in place.

    Args:
        q: Configuration (nq,).
        size: By how much the frame is turned (rad), and moved along x (m); half of it along y.
        pivot: Where it is turned about (2,), m.
    """
    cos, sin = math.cos(size), math.sin(size)
    turn = np.array([[cos, -sin], [sin, cos]])
    q[:2] = pivot + turn @ (q[:2] - pivot) + [size, 0.5 * size]
    q[2:4] = turn @ q[2:4]


def main() -> None:
    """Run scripts and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", nargs="*", default=ROBOTS)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    each = options.count // len(options.robots)
    seeds = range(options.seed, options.seed + each)
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in options.robots:
            wrong, lost = Counter[str](), 0
            for seed, told in zip(seeds, pool.map(partial(run, name), seeds), strict=True):
                lost += told.status == "lost"
                found = list(told.wrong())
                if found:
                    wrong["+".join(sorted(f.kind for f in told.faults))] += 1
                    print(name, seed, "; ".join(found), told.faults, flush=True)
            print(f"{name}: {each} scripts, {lost} lost, {wrong.total()} wrong: {dict(wrong)}")


if __name__ == "__main__":
    main()
