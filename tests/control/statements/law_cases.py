"""Samples of laws: states and references, near and far, and what NumPy makes of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rpctl import PaperDynamic, ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.fragment import law_fragment, settings_of
from rpctl.control.law import Command, Rest, as_efforts
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Program
from rpctl.reference.motion import ReferenceState, tabulate
from tests.control.referee import Referee
from tests.kernels.interpreted import Interpreted

PERIOD = 0.002
NEAR, FAR = 1e-3, 3.0  # rad or m: within the series of the leash, and round by more than a turn


class Sample(NamedTuple):
    """A measured state and the reference at that time."""

    q: Array
    nu: Array
    state: ReferenceState


def random_samples(robot: Robot, rng: np.random.Generator, count: int) -> Iterator[Sample]:
    """Yield samples of all kinds: near, far and on the reference, at rest and moving.

    Args:
        robot: The robot.
        rng: Where they come from.
        count: How many.
    """
    for k in range(count):
        q = robot.random_configuration(rng)
        nu = rng.normal(size=robot.dof) * rng.choice([0.0, 0.01, 1.0])
        size = [0.0, NEAR, 0.1, 1.0, FAR][k % 5]
        yield Sample(q, nu, random_state(robot, rng, q, size, k))


def random_state(
    robot: Robot, rng: np.random.Generator, q: Array, size: float, kind: int
) -> ReferenceState:
    """Return a reference at one time.

    Args:
        robot: The robot.
        rng: Where it comes from.
        q: Where the robot is (nq,).
        size: How far that is off, m or rad.
        kind: Which sort: with a direction, with one of zeros, or without; at rest, ...
    """
    sideways = not robot.drive.has_axle and kind % 2 == 0
    planar = np.array([1.0, float(sideways), 1.0]) * bool(robot.drive.base_speeds)
    twist, twist_dot = rng.normal(size=(2, 3)) * planar * [1.0, 0.01, 1.0, 0.0][kind % 4]
    if kind % 6 == 1:
        twist[0] = 0.0  # a spin
    if kind % 6 == 2:
        twist[2] = twist_dot[2] = 0.0  # a line
    direction = rng.normal(size=(3, 3)) * planar
    pose = robot.base_pose(q) + size * rng.normal(size=3)
    if kind % 7 == 3:
        pose[2] = robot.base_pose(q)[2] + math.copysign(math.pi, kind % 2 - 0.5)  # faces back
    n = len(robot.joints)
    joints = robot.joint_positions(q) + size * rng.normal(size=n)
    rates, accelerations = size * rng.normal(size=(2, n))
    given = [direction, None, 0.0 * direction][kind % 3]
    return ReferenceState(pose, twist, twist_dot, joints, rates, accelerations, given)


def row_of(robot: Robot, state: ReferenceState) -> Array:
    """Return the row of a reference table for one state."""
    return np.asarray(tabulate(robot, lambda t: state, np.zeros(1)).rows[0])


def drifting_samples(
    dynamics: ReducedDynamics, rng: np.random.Generator, count: int, jerk: float
) -> list[Sample]:
    """Return samples along a motion whose reference jumps about it.

    Args:
        dynamics: The robot's dynamics.
        rng: Where they come from.
        count: How many.
        jerk: How much ν changes from sample to sample.
    """
    robot, found = dynamics.robot, []
    q, nu = robot.random_configuration(rng), 0.3 * rng.normal(size=robot.dof)
    for k in range(count):
        found.append(Sample(q, nu, random_state(robot, rng, q, [NEAR, 0.02, 0.2][k % 3], k)))
        q = pin.integrate(robot.model, q, PERIOD * (dynamics.basis(q) @ nu))
        nu = nu + jerk * rng.normal(size=robot.dof)
    return found


class RunningLaws:
    """A kinematic and a dynamic law, as statements and in NumPy, side by side; a lane for each run.

    Args:
        robot: The robot.
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        rests: States of the lanes before they begin.
    """

    def __init__(self, robot: Robot, kinematic: Any, dynamic: Any, rests: list[Rest]) -> None:
        self.robot, self.dynamics = robot, ReducedDynamics(robot)
        self.fragment = law_fragment(kinematic, dynamic, SymbolicDynamics(robot), PERIOD)
        self.laws = [
            (
                kinematic.start(self.dynamics, PERIOD),
                self._dynamic(dynamic, rest),
            )
            for rest in rests
        ]
        fragment = self.fragment
        self.settings = settings_of(kinematic, dynamic, self.dynamics, PERIOD)
        body = *fragment.command, *fragment.answer, *fragment.remember
        self.body = Interpreted(Program(body), len(rests))
        self.workspace = self.body.workspace()
        if fragment.start:
            begin = Interpreted(Program(fragment.start), len(rests))
            space = begin.workspace()
            space[fragment.q][:] = np.column_stack([rest.q for rest in rests])
            space[fragment.tau][:] = np.column_stack([rest.tau for rest in rests])
            begin.run(0, 1, space, {})
            for buffer in space.keys() & self.workspace.keys():
                self.workspace[buffer][:] = space[buffer]

    def _dynamic(self, law: Any, rest: Rest) -> Any:
        """Return the dynamic law's referee; the paper's law is Pinocchio's already."""
        if not isinstance(law, PaperDynamic):
            return Referee(law, self.dynamics, PERIOD, rest)
        started = law.start(self.dynamics, PERIOD)
        return lambda *sample: started(self.dynamics, *sample)

    def compiled(self, samples: list[Sample]) -> None:
        """Do a sample in each lane, in the compiled laws."""
        at, fragment = self.workspace, self.fragment
        at[fragment.q][:] = np.column_stack([sample.q for sample in samples])
        at[fragment.nu][:] = np.column_stack([sample.nu for sample in samples])
        rows = [row_of(self.robot, sample.state) for sample in samples]
        at[fragment.reference][:] = np.column_stack(rows)
        at[fragment.settings][:] = self.settings[:, None]
        self.body.run(0, 1, at, {})

    def python(self, lane: int, sample: Sample) -> tuple[Command, Any]:
        """Return what Python's laws answer in a lane, command and efforts."""
        kinematic, dynamic = self.laws[lane]
        command = kinematic(self.dynamics, lambda t: sample.state, 0.0, sample.q, sample.nu)
        return command, as_efforts(dynamic(sample.q, sample.nu, command))
