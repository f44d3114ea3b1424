"""The closed loop as a program: reference → law → delay → plant, and what is logged of it.

The order of a sample is that of `simulation/loop/closed_loop.py`. A plant takes a step that is
implicit in its losses, or, without any, the explicit one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi

from rpctl.arrays import Array
from rpctl.control.fragment import LawFragment
from rpctl.control.twist_law import symbolic_error
from rpctl.dynamics.projection import dexpinv
from rpctl.dynamics.stops import Stops
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.machine_code import MachineCode
from rpctl.kernels.program import (
    Buffer,
    Place,
    Program,
    Read,
    ReadBack,
    Repeat,
    RowStream,
    Statement,
    Write,
    statement,
    symbolic,
)
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.implicit_step import (
    ImplicitStep,
    PlantBuffers,
    places,
    plant_places,
)
from rpctl.simulation.compiled.merit_fold import MeritFold, merit_fold
from rpctl.simulation.compiled.stops import stop_statements
from rpctl.simulation.loop.closed_loop import DIVERGED_SPEED
from rpctl.simulation.plants.rolling import substeps
from rpctl.simulation.plants.sensors import Sensors

STAGES = ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0))  # how far ahead the next is; the weight of this one


def explicit_step(dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> tuple[Statement, ...]:
    """Return the statements of a step; its four stages call one function.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        dt: Length of the step, s.
    """
    n, nv = dynamics.robot.dof, dynamics.robot.nv
    plant, b = plant_places(dynamics, at), places("rk4", slide=nv, speed=n)
    k, sums = places("stage", v=nv, a=n, power=1), places("sum", v=nv, a=n, power=1)
    (q, nu), ahead = (plant["q"][1], plant["nu"][1]), (b["slide"][0], b["speed"][0])
    stage = _stage(dynamics, plant, b, k)
    body: list[Statement] = [
        statement("start", [plant["nu"]], [(ahead[0], casadi.SX(nv, 1)), (ahead[1], nu)]), stage
    ]  # fmt: skip
    for i, (fraction, weight) in enumerate(STAGES):
        added = [
            (buffer, (total if i else 0.0) + weight * k[name][1])
            for name, (buffer, total) in sums.items()
        ]
        step = fraction * dt
        following = (ahead[0], step * k["v"][1]), (ahead[1], nu + step * k["a"][1])
        inputs = [plant["nu"], *k.values(), *sums.values()]
        body += [statement(f"follow{i}", inputs, [*following, *added]), stage]
    v, a, power = (dt / 6.0 * (sums[name][1] + k[name][1]) for name in sums)
    results = [
        (at.q, dynamics.integrate(q, v)),
        (at.nu, nu + a),
        (at.energy, plant["energy"][1] + casadi.vertcat(power, 0.0)),
    ]
    inputs = [plant["q"], plant["nu"], plant["energy"], *k.values(), *sums.values()]
    return *body, statement("end", inputs, results)


def _stage(
    dynamics: SymbolicDynamics, plant: dict[str, Place], b: dict[str, Place], k: Any
) -> Statement:
    """Return the call that evaluates the motion at a stage.

    Args:
        dynamics: Of the simulated robot.
        plant: What the plant works on: q is the configuration at the start of the step.
        b: How far from q the stage is, and its speed.
        k: Gets velocity, acceleration and power.
    """
    slide, speed = b["slide"][1], b["speed"][1]
    tau, reaction = plant["tau"][1], plant["reaction"][1]
    place = dynamics.integrate(plant["q"][1], slide)
    projection = dynamics.at(place)
    M, push = dynamics.lossless(place, speed, tau)
    found = {
        "v": dexpinv(slide, projection.S @ speed),
        "a": dynamics.solve_positive(M, push + reaction),
        "power": casadi.dot(projection.B @ tau + reaction, speed),
    }
    outputs = [(k[name][0], value) for name, value in found.items()]
    given = [plant[name] for name in ("q", "tau", "reaction", "p")]
    return statement("stage", [*given, b["slide"], b["speed"]], outputs)


@dataclass(frozen=True, eq=False)
class PlantFragment:
    """A plant as statements.

    Attributes:
        start: What is done once, before the first step.
        steps: What advances the plant.
        memory: What it remembers from step to step, besides its state.
    """

    start: tuple[Statement, ...]
    steps: tuple[Statement, ...]
    memory: tuple[Buffer, ...]


def plant_fragment(
    dynamics: SymbolicDynamics, at: PlantBuffers, dt: float, steps: int
) -> PlantFragment:
    """Return the statements that advance a plant by some steps.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        dt: Length of a step, s.
        steps: How many.
    """
    begin, memory = tuple[Statement, ...](), tuple[Buffer, ...]()
    if dynamics.lossy:
        step = ImplicitStep(dynamics, at, dt)
        begin, body, memory = step.start(), step.statements(), step.memory
    else:
        body = explicit_step(dynamics, at, dt)
    if (stops := Stops(dynamics.robot)).any:
        before, after = stop_statements(dynamics, stops, at, memory[:1])
        body = (*before, *body, *after)
    return PlantFragment(begin, (Repeat(steps, body),), memory)


# Why a lane does not go on: its law has no answer, its base is far and needs a way up to the
# reference, both of which Python has, or its motion left the finite numbers.
NO_TROUBLE, LAW_FAILED, FAR, DIVERGED = 0.0, 1.0, 2.0, 3.0


@dataclass(frozen=True)
class LoopShape:
    """What is compiled into a loop, besides robot and laws: another shape is compiled anew.

    Attributes:
        period: Control period, s.
        plant_step: Longest step of the plant, s.
        delayed: Whether efforts may act some periods late.
        noisy: Whether what is measured is noisy.
        saturated: Whether the true actuators saturate before the controller's model of them.
        far: Errors (m, rad) of place and heading from which on a base needs a way up to its
            reference, see ``Approach``; None: never.
        folded: Whether samples are folded to what merits need, or else logged.
    """

    period: float
    plant_step: float
    delayed: bool = False
    noisy: bool = False
    saturated: bool = False
    far: tuple[float, float] | None = None
    folded: bool = False


@dataclass(frozen=True, eq=False)
class LoopProgram:
    """A closed loop in lanes.

    Attributes:
        start: Done once, before the first sample: what laws and plant remember at rest.
        sample: A sample, and the plant until the next.
        memory: What both have in common: the start leaves it to the first sample.
        law: The laws.
        plant: What the plant works on.
        bias: Efforts (n_act,) that push besides the controller's.
        most: Efforts (n_act,) at which the true actuators saturate.
        sent: Efforts (n_act,) that were sent last; NaN: none were, and the first ones may leap.
        leap: By how much efforts (n_act,) may change at a sample.
        acting: Efforts (n_act,) that act from a sample on.
        e: Tracking error (3 + n_joints,).
        trouble: Why a lane does not go on (1,), and the number of the sample at which (2,).
        number: Of the sample (1,).
        energy_before: Work and losses (2,) until the sample, J, where samples are folded.
        back: By how many periods efforts are late (1,).
        search_from: Number of the sample from which on a way up is looked for (1,).
        reference: Rows of a reference table.
        followed: The same of what the laws are given, lane by lane, where that may differ.
        noise: What is added to what is measured.
        ring: Efforts on their way.
        log: What is written at each sample, by name.
        fold: What merits need of the samples; None where they are logged.
    """

    start: Program
    sample: Program
    memory: tuple[Buffer, ...]
    law: LawFragment
    plant: PlantBuffers
    bias: Buffer
    most: Buffer
    sent: Buffer
    leap: Buffer
    acting: Buffer
    e: Buffer
    trouble: Buffer
    number: Buffer
    energy_before: Buffer
    back: Buffer
    search_from: Buffer
    reference: RowStream
    followed: RowStream
    noise: RowStream
    ring: RowStream
    log: dict[str, RowStream]
    fold: MeritFold | None = None


@dataclass(frozen=True, eq=False)
class CompiledLoop:
    """A closed loop as machine code.

    Attributes:
        robot: The simulated robot.
        p: Its own parameters (n_p,).
        program: Its program.
        start: What is done once before the first sample.
        sample: A sample, and the plant until the next.
    """

    robot: Robot
    p: Array
    program: LoopProgram
    start: MachineCode
    sample: MachineCode


def loop_program(law: LawFragment, simulated: SymbolicDynamics, shape: LoopShape) -> LoopProgram:
    """Return the program of a closed loop.

    Args:
        law: The laws on the robot as the controller knows it.
        simulated: Dynamics of the simulated robot.
        shape: What is compiled in.
    """
    found = _buffers(law, simulated, shape)
    plant, fold = found.plant, None
    if shape.folded:
        sample = plant.q, plant.nu, found.e, found.acting, law.limits
        fold = merit_fold(simulated, sample, plant.p, found.number)
    log = _log(found, fold)
    steps = substeps(shape.period, shape.plant_step)
    moving = plant_fragment(simulated, plant, shape.period / steps, steps)
    body = (
        *_measured(found, Sensors(simulated.robot), shape),
        *law.command,
        *law.answer,
        *law.remember,
        *_judged(found, shape),
        *_acting(found, simulated, shape),
        *(() if fold is None else fold.statements),
        *(Write(buffer, stream) for buffer, stream in log.values()),
        *_pushed(found, moving, shape),
    )
    return replace(
        found,
        start=Program((*law.start, *moving.start)),
        sample=Program(body),
        memory=(*law.memory, *moving.memory),
        log={name: stream for name, (_, stream) in log.items()},
        fold=fold,
    )


def _buffers(law: LawFragment, dynamics: SymbolicDynamics, shape: LoopShape) -> LoopProgram:
    """Return a loop that does nothing: the buffers and streams that its statements will use."""
    robot = dynamics.robot
    n_act, n_e, width = len(robot.actuators), law.e.size, law.reference.size
    q, nu = law.q, law.nu
    if shape.noisy:
        q, nu = Buffer("q", robot.nq), Buffer("nu", robot.dof)
    plant = PlantBuffers(
        q,
        nu,
        Buffer("pushing", n_act),
        Buffer("energy", 2),
        Buffer("reaction", robot.dof),
        Buffer("p", dynamics.p.numel()),
    )
    sent = Buffer("sent", n_act)
    return LoopProgram(
        start=Program(()),
        sample=Program(()),
        memory=(),
        law=law,
        plant=plant,
        bias=Buffer("bias", n_act),
        most=Buffer("most", n_act),
        sent=sent,
        leap=Buffer("leap", n_act),
        acting=Buffer("acting", n_act) if shape.delayed or shape.saturated else sent,
        e=Buffer("error", n_e) if shape.noisy or shape.far else law.e,
        trouble=Buffer("trouble", 2),
        number=Buffer("number", 1),
        energy_before=Buffer("energy_before", 2),
        back=Buffer("back", 1),
        search_from=Buffer("search_from", 1),
        reference=RowStream("reference", width, laned=False),
        followed=RowStream("followed", width),
        noise=RowStream("noise", Sensors(robot).width),
        ring=RowStream("ring", n_act),
        log={},
    )


def _measured(loop: LoopProgram, sensors: Sensors, shape: LoopShape) -> tuple[Statement, ...]:
    """Give the laws what they are to follow, and what is measured."""
    law, plant = loop.law, loop.plant
    body: list[Statement] = [Read(loop.followed if shape.far else loop.reference, law.reference)]
    if shape.noisy:
        noise = Buffer("noise", sensors.width)
        inputs = [symbolic(buffer) for buffer in (plant.q, plant.nu, noise)]
        measured = sensors.symbolic(*(symbols for _, symbols in inputs))
        outputs = list(zip((law.q, law.nu), measured, strict=True))
        body += [Read(loop.noise, noise), statement("measured", inputs, outputs)]
    return tuple(body)


def _judged(loop: LoopProgram, shape: LoopShape) -> tuple[Statement, ...]:
    """Find out whether a lane goes on, and count the sample."""
    law = loop.law
    buffers = law.failed, law.e, loop.plant.nu, loop.number, loop.search_from, loop.trouble
    inputs = [symbolic(buffer) for buffer in buffers]
    failed, e, nu, number, since, trouble = (symbols for _, symbols in inputs)
    found = casadi.if_else(failed != 0.0, LAW_FAILED, NO_TROUBLE)
    if shape.far is not None:
        distance, heading = shape.far
        away = casadi.logic_or(e[0] ** 2 + e[1] ** 2 > distance**2, casadi.fabs(e[2]) > heading)
        far = casadi.logic_and(number >= since, away)
        found = casadi.if_else(casadi.logic_and(found == NO_TROUBLE, far), FAR, found)
    for speed in casadi.vertsplit(nu):
        found = casadi.if_else(casadi.fabs(speed) < DIVERGED_SPEED, found, DIVERGED)
    known = trouble[0] != NO_TROUBLE
    after = casadi.vertcat(
        casadi.if_else(known, trouble[0], found), casadi.if_else(known, trouble[1], number)
    )
    return (statement("judge", inputs, [(loop.trouble, after), (loop.number, number + 1.0)]),)


def _acting(
    loop: LoopProgram, dynamics: SymbolicDynamics, shape: LoopShape
) -> tuple[Statement, ...]:
    """Find the efforts that act from now on, and the error of the robot as it is."""
    (_, tau), (_, before), (_, leap) = inputs = [
        symbolic(buffer) for buffer in (loop.law.tau, loop.sent, loop.leap)
    ]
    change = tau - before
    slow = before + casadi.fmax(casadi.fmin(change, leap), -leap)
    within = casadi.if_else(casadi.fabs(change) > leap, slow, tau)
    body: list[Statement] = [statement("rate", inputs, [(loop.sent, within)])]
    if shape.delayed:
        body += [Write(loop.sent, loop.ring), ReadBack(loop.ring, loop.back, loop.acting)]
    if shape.saturated:
        sent = symbolic(loop.acting if shape.delayed else loop.sent)
        most = symbolic(loop.most)
        cut = casadi.fmax(casadi.fmin(sent[1], most[1]), -most[1])
        body.append(statement("saturate", [sent, most], [(loop.acting, cut)]))
    if loop.e is not loop.law.e:
        place = Buffer("reference", loop.law.reference.size)
        inputs = [symbolic(loop.plant.q), symbolic(place)]
        (_, q), (_, row) = inputs
        error = symbolic_error(dynamics, row, q)
        body += [Read(loop.reference, place), statement("error", inputs, [(loop.e, error)])]
    return tuple(body)


def _pushed(loop: LoopProgram, moving: PlantFragment, shape: LoopShape) -> tuple[Statement, ...]:
    """Push the robot until the next sample."""
    (_, tau), (_, bias) = inputs = [symbolic(loop.acting), symbolic(loop.bias)]
    push = statement("push", inputs, [(loop.plant.tau, tau + bias)])
    _, energy = before = symbolic(loop.plant.energy)
    keep = statement("keep", [before], [(loop.energy_before, energy)])
    return *((keep,) if shape.folded else ()), push, *moving.steps


def _log(loop: LoopProgram, fold: MeritFold | None) -> dict[str, tuple[Buffer, RowStream]]:
    law, plant = loop.law, loop.plant
    logged = {
        "q": plant.q,
        "nu": plant.nu,
        "tau": loop.acting,
        "nu_d": law.nu_d,
        "e": loop.e,
        "energy": plant.energy,
        "limits": law.limits,
        "trouble": loop.trouble,
    }
    if fold is not None:
        logged = {"measures": fold.measures}
    return {name: (b, RowStream(f"log of {name}", b.size)) for name, b in logged.items()}
