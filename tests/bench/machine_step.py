"""A forward step as machine code: how long it takes in a lane."""

from __future__ import annotations

import time

import casadi
import numpy as np

from rpctl import Robot
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.machine_code import compile_program
from rpctl.kernels.program import Buffer, Call, Program, Repeat

REPEATS = 1000  # evaluations in one step of the program
ROUNDS = 5  # of which the fastest counts


def step_time(robot: Robot, lanes: int) -> float:
    """Return the processor time of a forward step of all lanes, µs."""
    dynamics = SymbolicDynamics(robot)
    sizes = {"q": robot.nq, "nu": robot.dof, "tau": len(robot.actuators)}
    inputs = [casadi.SX.sym(name, size) for name, size in sizes.items()]
    forward = casadi.Function("forward", inputs, [dynamics.forward(*inputs)], {"cse": True})
    buffers = [Buffer(name, size) for name, size in sizes.items()]
    call = Call(forward, tuple(buffers), (Buffer("nu_dot", robot.dof),))
    code = compile_program(Program((Repeat(REPEATS, (call,)),)), lanes)
    workspace, rng = code.workspace(), np.random.default_rng(1)
    workspace[buffers[0]][:] = robot.random_configuration(rng)[:, None]
    for buffer in buffers[1:]:
        workspace[buffer][:] = rng.normal(size=(buffer.size, 1))
    rounds = []
    for _ in range(ROUNDS):
        start = time.process_time()
        code.run(0, 1, workspace, {})
        rounds.append(time.process_time() - start)
    return 1e6 * min(rounds) / REPEATS
