"""Which laws are compiled, and two laws as statements of a program: from a state to efforts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi

from rpctl.control.approach import Approach
from rpctl.control.bounded import BoundedDynamic, BoundedLaw
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.error import Leash
from rpctl.control.integral import IntegralDynamic
from rpctl.control.twist_law import BaseLaw, formula
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.functions import missing_operation
from rpctl.kernels.program import Buffer, Call, Place, Statement, Until, When, statement
from rpctl.kernels.scalars import Layout, any_nonzero
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.laws.dynamic import (
    bounded_sample,
    follow,
    free_sample,
    paper_efforts,
)
from rpctl.simulation.compiled.laws.fragment import LawFragment, LawFrame, LimitNames, new
from rpctl.simulation.compiled.laws.limits import (
    BoundedRows,
    DualState,
    dual_step,
    effort_rows,
    limit_codes,
    limited_efforts,
    slacks,
)
from rpctl.simulation.compiled.laws.tracking import ClosedFormDynamic, by_name

MAX_STEPS = 200  # of the search for the limits that bind; 74 are the most that were seen


def bounded_fragment(frame: LawFrame, dynamic: BoundedDynamic | IntegralDynamic) -> LawFragment:
    """Return the statements of a law within limits.

    Args:
        frame: What all laws have in common.
        dynamic: The law.
    """
    started = dynamic.start(frame.reduced, frame.period)
    law = started if isinstance(started, BoundedLaw) else started.inner
    return _BoundedStatements(frame, law, isinstance(dynamic, IntegralDynamic)).fragment()


class _BoundedStatements:
    """Buffers and statements of one law within limits.

    Args:
        frame: What all laws have in common.
        law: The law on the robot.
        integral: Whether it has integral action.
    """

    def __init__(self, frame: LawFrame, law: BoundedLaw, integral: bool) -> None:
        robot, count = frame.known.robot, len(slacks(law))
        dof = robot.dof
        self._frame, self._law, self._integral = frame, law, integral
        self._limits = Buffer("law limits", len(robot.actuators) + len(law.joints.names))
        self._doubtful = new("doubtful", 1)  # whether a limit may bind; then, whether one does
        self._binds, self._going = new("binds", 1), new("going", 1)
        # What is remembered, and what it will be.
        self._dual = new("active before", count), new("multipliers before", count)
        self._next = new("active", count), new("multipliers", count)
        self._disturbance, self._disturbance_now = new("disturbance", dof), new("d", dof)
        self._before = new("nu before", dof), new("nu_dot before", dof), new("sampled", 1)
        self._nu_dot = new("nu_dot", dof)  # until the next sample, as far as the law knows
        self._elapsed = (frame.elapsed, casadi.SX.sym("elapsed"))

    def fragment(self) -> LawFragment:
        """Return the fragment."""
        memory = list(self._dual)
        if self._integral:
            memory += [self._disturbance, *self._before]
        robot = self._frame.known.robot
        return self._frame.fragment(
            self._limits,
            LimitNames(robot.actuators, self._law.joints.names),
            body=(self._free(), self._within()),
            start=(self._start(memory),),
            remember=self._remember(),
            memory=tuple(buffer for buffer, _ in memory),
        )

    def _free(self) -> Call:
        """Return the call up to where limits may bind."""
        frame = self._frame
        d = self._advanced() if self._integral else casadi.SX.zeros(frame.known.robot.dof, 1)
        sample = free_sample(self._law, frame.known, frame.sample, d)
        outputs = [
            *frame.commanded(sample.tau),
            (frame.tau, sample.tau),
            (self._limits, casadi.SX.zeros(self._limits.size, 1)),
            (self._doubtful[0], sample.doubtful),
            (self._binds[0], casadi.SX(0)),
        ]
        inputs = list(frame.inputs)
        if self._integral:
            inputs += [self._disturbance, *self._before, self._elapsed]
            outputs += [(self._disturbance_now[0], d), (self._nu_dot[0], sample.nu_dot)]
        return statement("law_free", inputs, outputs)

    def _advanced(self) -> Any:
        """Return the disturbance (dof, 1) after the time since the last sample."""
        frame, d = self._frame, self._disturbance[1]
        (_, nu), (_, nu_dot), (_, sampled) = self._before
        elapsed = self._elapsed[1]
        gain = by_name(frame.sample.s, "gain", frame.known.robot.quasi_velocities)
        # A longer pause teaches no more than ν̇.
        learnt = casadi.fmin(gain, 1.0 / elapsed) * (frame.sample.nu - nu - elapsed * nu_dot)
        return casadi.if_else(sampled, d + learnt, d)

    def _within(self) -> When:
        """Return what is done where a limit may bind in any lane."""
        frame, law, known = self._frame, self._law, self._frame.known
        tau = frame.tau, casadi.SX.sym("tau", frame.tau.size)
        sample = bounded_sample(law, known, frame.later, tau[1])
        layout = Layout(
            {
                "M": casadi.tril(sample.M),
                "push": casadi.densify(sample.push),
                "acceleration": casadi.densify(sample.acceleration),
                **{name: casadi.densify(each) for name, each in vars(sample.bounds).items()},
            }
        )
        terms = new("terms", layout.size)
        # A lane is what it is alone, also where another one's doubt brings it here.
        binds = casadi.logic_and(self._doubtful[1], sample.binds)
        judge = statement(
            "law_bounds",
            [*frame.later_inputs, tau, self._doubtful],
            [(terms[0], layout.column), (self._binds[0], binds)],
        )
        parts = layout.parts(terms[1])
        search = self._search(parts, [*frame.later_inputs, tau, terms])
        return When(self._doubtful[0], (judge, When(self._binds[0], search)))

    def _search(self, parts: Mapping[str, Any], inputs: list[Place]) -> tuple[Statement, ...]:
        """Return the search for the limits that bind.

        Args:
            parts: Terms of the sample.
            inputs: Buffers and symbols of these, and of the sample.
        """
        frame, tau = self._frame, dict(inputs)[self._frame.tau]
        program = effort_rows(self._law, frame.known, frame.later, tau, parts)
        rows = Layout(program)
        place, x = new("rows", rows.size), new("x", program["E"].shape[1])
        begin = statement(
            "law_rows",
            [*inputs, self._binds, *self._dual],
            [
                (place[0], rows.column),
                (self._next[0][0], self._dual[0][1]),
                (self._next[1][0], self._dual[1][1]),
                (self._going[0], self._binds[1]),
            ],
        )
        found = rows.parts(place[1])
        step = self._step(found, place, x)
        end = self._end(found["E"] @ x[1], parts, [*inputs, place, x])
        return begin, Until(self._going[0], MAX_STEPS, (step,)), end

    def _step(self, parts: Mapping[str, Any], place: Place, x: Place) -> Call:
        """Return one step of the search.

        Args:
            parts: The quadratic program.
            place: Where it is.
            x: Where its solution is.
        """
        G, H, lower, upper = (parts[name] for name in ("G", "H", "lower", "upper"))
        rows = BoundedRows(G, H, lower, upper, slacks(self._law))
        active, multipliers = self._next
        state = DualState(active[1], multipliers[1], x[1], self._going[1])
        after = dual_step(rows, state)
        places = (active, multipliers, x, self._going)
        values = (after.active, after.multipliers, after.x, after.going)
        outputs = [(buffer, value) for (buffer, _), value in zip(places, values, strict=True)]
        return statement("law_step", [place, *places], outputs)

    def _end(self, change: Any, parts: Mapping[str, Any], inputs: list[Place]) -> Call:
        """Return the call that makes efforts of the solution.

        Args:
            change: What it adds to the efforts over their limits (n_act, 1).
            parts: Terms of the sample.
            inputs: Buffers and symbols of both, and of the sample.
        """
        frame, law, binds = self._frame, self._law, self._binds[1]
        active, failed = self._next[0], (frame.failed, casadi.SX.sym("failed"))
        tau = limited_efforts(law, dict(inputs)[frame.tau], change, binds)
        codes = limit_codes(law, active[1], parts, binds)
        unsolved = casadi.logic_and(binds, self._going[1])
        outputs = [
            (frame.tau, tau),
            (self._limits, codes),
            (frame.failed, casadi.logic_or(failed[1], unsolved)),
        ]
        more = [self._binds, self._going, active, failed]
        if self._integral:
            d, nu_dot = self._disturbance_now, self._nu_dot
            bound = any_nonzero(codes)
            follows = follow(frame.known, frame.later, law.held_for, parts, tau) + d[1]
            outputs.append((nu_dot[0], casadi.if_else(bound, follows, nu_dot[1])))
            more += [d, nu_dot]
        return statement("law_efforts", [*inputs, *more], outputs)

    def _start(self, memory: list[Place]) -> Call:
        """Return the call that makes the memory of a robot at rest.

        Args:
            memory: What is remembered.
        """
        frame = self._frame
        q, tau = frame.inputs[0], (frame.tau, casadi.SX.sym("tau", frame.tau.size))
        zero = {buffer: casadi.SX.zeros(buffer.size, 1) for buffer, _ in memory}
        if self._integral:
            still = casadi.SX.zeros(frame.known.robot.dof, 1)
            zero[self._disturbance[0]] = -frame.known.forward(q[1], still, tau[1])
        outputs = [*zero.items(), (frame.elapsed, casadi.SX(frame.period))]
        return statement("law_start", [q, tau], outputs)

    def _remember(self) -> tuple[Statement, ...]:
        """Return what is done after a sample."""
        pairs = list(zip(self._dual, self._next, strict=True))
        bound = [(old[0], casadi.if_else(self._binds[1], new_[1], old[1])) for old, new_ in pairs]
        inputs = [self._binds, *(place for pair in pairs for place in pair)]
        found: list[Statement] = [When(self._binds[0], (statement("law_dual", inputs, bound),))]
        if self._integral:
            nu, d, nu_dot = self._frame.inputs[1], self._disturbance_now, self._nu_dot
            kept = (self._disturbance, *self._before)
            values = (d[1], nu[1], nu_dot[1], casadi.SX(1))
            outputs = [(buffer, value) for (buffer, _), value in zip(kept, values, strict=True)]
            found.append(statement("law_memory", [nu, d, nu_dot], outputs))
        return tuple(found)


DYNAMIC = (PaperDynamic, BoundedDynamic, IntegralDynamic)


def unsupported(kinematic: Any, dynamic: Any, robot: Robot) -> str | None:
    """Return why laws cannot be compiled, a clause; None if they can.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        robot: The robot that they are for.
    """
    if not isinstance(kinematic, BaseLaw) or type(kinematic).start is not BaseLaw.start:
        return f"the kinematic law {_name(kinematic)} is not one that is compiled"
    if (missing := _missing(kinematic, robot)) is not None:
        return f"the kinematic law {_name(kinematic)} has the operation {missing}"
    if type(kinematic.leash) not in (type(None), Leash):
        return f"the leash {_name(kinematic.leash)} is not one that is compiled"
    if type(kinematic.approach) not in (type(None), Approach):
        return f"the approach {_name(kinematic.approach)} is not one that is compiled"
    if type(dynamic) is IntegralDynamic and type(dynamic.inner) is not BoundedDynamic:
        return f"the law {_name(dynamic.inner)} within {_name(dynamic)} is not one that is compiled"
    if type(dynamic) not in DYNAMIC:
        return f"the dynamic law {_name(dynamic)} is not one that is compiled"
    return None


def _missing(law: BaseLaw, robot: Robot) -> str | None:
    """Return what of a user's own law has no machine code."""
    if type(law).__module__.startswith("rpctl."):
        return None
    return missing_operation(formula(law, robot, [1.0] * len(robot.joints)))


def _name(law: Any) -> str:
    return str(getattr(law, "__name__", type(law).__name__))


def law_fragment(
    kinematic: BaseLaw, dynamic: ClosedFormDynamic, known: SymbolicDynamics, period: float
) -> LawFragment:
    """Return the statements of a kinematic and a dynamic law.

    The numbers among the laws' settings are inputs; what is compiled depends on the others only.
    A stage for far starts is left out: it only gives the law another reference.

    Args:
        kinematic: The kinematic law, one that :func:`unsupported` has nothing against.
        dynamic: The dynamic law, likewise.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        RpctlError: A setting does not fit the robot or the period.
    """
    frame = LawFrame(kinematic, dynamic, known, period)
    if isinstance(dynamic, PaperDynamic):
        return _paper(frame, period if dynamic.midpoint else 0.0)
    return bounded_fragment(frame, dynamic)


def _paper(frame: LawFrame, held_for: float) -> LawFragment:
    """Return the fragment of the paper's dynamic law.

    Args:
        frame: What all laws have in common.
        held_for: For how long efforts are held, as far as the law takes account of it, s.
    """
    tau, count = paper_efforts(frame.known, frame.sample, held_for), frame.tau.size
    limits = Buffer("law limits", count), casadi.SX.zeros(count, 1)
    outputs = [*frame.commanded(tau), (frame.tau, tau), limits]
    call = statement("law", frame.inputs, outputs)
    return frame.fragment(limits[0], LimitNames(frame.known.robot.actuators, ()), body=(call,))
