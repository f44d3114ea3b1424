"""A law within limits as statements: without them, and a search for those that bind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rpctl import math
from rpctl.control.dynamic import desired_acceleration, midpoint
from rpctl.control.fragment import (
    DISTURBANCE,
    EXPECTED,
    LIMIT_KINDS,
    LawFragment,
    LawFrame,
    LimitNames,
    effort_labels,
    is_fine,
    new,
)
from rpctl.control.within_limits import Before, BoundedLaw, learnt
from rpctl.kernels.least_squares import DualState, dual_step
from rpctl.kernels.program import Buffer, Call, Place, Statement, Until, When, statement, symbolic
from rpctl.kernels.scalars import Layout, any_true, clipped

AT_LIMIT = 1e-6  # of a limit: an effort that close to it is there
MAX_STEPS = 200  # of the search for the limits that bind; 74 are the most that were seen


class BoundedStatements:
    """Buffers and statements of one law within limits.

    Args:
        frame: What all laws have in common.
        law: The law.
        integral: Whether it has integral action.
    """

    def __init__(self, frame: LawFrame, law: BoundedLaw, integral: bool = False) -> None:
        self._frame, self._law, self._integral = frame, law, integral
        count, robot = len(law.slacks), frame.known.robot
        dof = robot.dof
        self._limits = Buffer("law limits", len(robot.actuators) + len(law.joints.names))
        self._doubtful = new("doubtful", 1)  # whether a limit may bind; then, whether one does
        self._binds, self._going = new("binds", 1), new("going", 1)
        # What is remembered, and what it will be.
        self._dual = new("active before", count), new("multipliers before", count)
        self._next = new("active", count), new("multipliers", count)
        self._disturbance = symbolic(Buffer(DISTURBANCE, dof))
        self._disturbance_now = new("d", dof)
        self._before = new("nu before", dof), symbolic(Buffer(EXPECTED, dof)), new("sampled", 1)
        self._nu_dot = new("nu_dot", dof)  # until the next sample, as far as the law knows

    def fragment(self) -> LawFragment:
        """Return the fragment."""
        memory = list(self._dual)
        if self._integral:
            memory += [self._disturbance, *self._before]
        names = LimitNames(tuple(effort_labels(self._frame.known.robot)), self._law.joints.names)
        return replace(
            self._frame.fragment(self._limits, names),
            start=(self._start(memory),),
            answer=(self._free(), self._within()),
            remember=self._remember(),
            memory=tuple(buffer for buffer, _ in memory),
        )

    def _free(self) -> Call:
        """Return the call up to where limits may bind."""
        frame, d = self._frame, math.SX.zeros(self._frame.known.robot.dof, 1)
        inputs = [*frame.sampled, frame.failed]
        if self._integral:
            inputs += [self._disturbance, *self._before, frame.elapsed]
            before = Before(*(symbols for _, symbols in self._before))
            gain, elapsed = frame.s["gain"], frame.elapsed[1]
            d = learnt(gain, self._disturbance[1], frame.nu[1], before, elapsed)
            most = enumerate(self._law.reach.tolist())
            d = math.vertcat(*(clipped(d[i], -reach, reach) for i, reach in most))
        sample = self._law.free(frame.known, frame.sample, frame.s, d)
        outputs = [
            (frame.tau[0], sample.tau),
            frame.still_failed(is_fine(frame.known, frame.q[1], sample.tau)),
            (self._limits, math.SX.zeros(self._limits.size, 1)),
            (self._doubtful[0], sample.doubtful),
            (self._binds[0], math.SX(0)),
        ]
        if self._integral:
            nu_dot = desired_acceleration(frame.sample, frame.s["time"])
            outputs += [(self._disturbance_now[0], d), (self._nu_dot[0], nu_dot)]
        return statement("law_free", inputs, outputs)

    def _within(self) -> When:
        """Return what is done where a limit may bind in any lane."""
        frame = self._frame
        sample = self._law.bound(frame.known, frame.sample, frame.s, frame.tau[1])
        dense = {**sample._asdict(), **sample.bounds._asdict(), "M": math.tril(sample.M)}
        del dense["bounds"], dense["binds"]
        layout = Layout({k: x if k == "M" else math.densify(x) for k, x in dense.items()})
        terms = new("terms", layout.size)
        # A lane is what it is alone, also where another one's doubt brings it here.
        binds = math.logic_and(self._doubtful[1], sample.binds)
        judge = statement(
            "law_bounds",
            [*frame.sampled, frame.tau, self._doubtful],
            [(terms[0], layout.column), (self._binds[0], binds)],
        )
        search = self._search(layout.parts(terms[1]), [*frame.sampled, frame.tau, terms])
        return When(self._doubtful[0], (judge, When(self._binds[0], search)))

    def _search(self, parts: Mapping[str, Any], inputs: list[Place]) -> tuple[Statement, ...]:
        """Return the search for the limits that bind.

        Args:
            parts: Terms of the sample.
            inputs: Buffers and symbols of these, and of the sample.
        """
        frame = self._frame
        program = self._law.rows(frame.known, frame.sample, frame.s, frame.tau[1], parts)
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
        places = (*self._next, x, self._going)
        after = dual_step(self._law.program(found), DualState(*(symbols for _, symbols in places)))
        values = after.active, after.multipliers, after.x, after.going
        outputs = [(buffer, value) for (buffer, _), value in zip(places, values, strict=True)]
        step = statement("law_step", [place, *places], outputs)
        end = self._end(found["known"] + found["E"] @ x[1], parts, [*inputs, place, x])
        return begin, Until(self._going[0], MAX_STEPS, (step,)), end

    def _end(self, change: Any, parts: Mapping[str, Any], inputs: list[Place]) -> Call:
        """Return the call that makes efforts of the solution.

        Args:
            change: What it adds to the efforts over their limits (n_act, 1).
            parts: Terms of the sample.
            inputs: Buffers and symbols of both, and of the sample.
        """
        frame, law, binds = self._frame, self._law, self._binds[1]
        active = self._next[0]
        tau = math.if_else(binds, law.efforts(frame.tau[1], change), frame.tau[1])
        codes = math.if_else(binds, self._codes(tau, active[1], parts), 0.0)
        unsolved = math.logic_and(binds, self._going[1])
        outputs = [
            (frame.tau[0], tau),
            (self._limits, codes),
            frame.still_failed(math.logic_not(unsolved)),
        ]
        more = [self._binds, self._going, active, frame.failed]
        if self._integral:
            d, nu_dot = self._disturbance_now, self._nu_dot
            follows = self._followed(parts, tau) + d[1]
            outputs.append((nu_dot[0], math.if_else(any_true(codes), follows, nu_dot[1])))
            more += [d, nu_dot]
        return statement("law_limited", [*inputs, *more], outputs)

    def _codes(self, tau: Any, active: Any, parts: Mapping[str, Any]) -> Any:
        """Return which limits bind, as :class:`LimitNames` reads them.

        Args:
            tau: Efforts (n_act, 1).
            active: Which rows are active at which bound (n_rows, 1), those that share first.
            parts: Terms of the sample.
        """
        law, sides = self._law, [math.SX(0)] * len(self._law.joints.names)
        for row, j in enumerate(law.shared):
            sides[j] = active[row]
        for j in law.own:
            now = parts["acceleration"][j]
            sides[j] = (now > parts["upper"][j]) - (now < parts["lower"][j])
        most = ((1.0 - AT_LIMIT) * law.effort_limits).tolist()
        codes = [math.fabs(tau[k]) > limit for k, limit in enumerate(most)]
        for j, side in enumerate(sides):
            upper = math.if_else(parts["by_upper"][j], LIMIT_KINDS.index("upper"), 1.0)
            lower = math.if_else(parts["by_lower"][j], LIMIT_KINDS.index("lower"), 1.0)
            below = math.if_else(side < 0.0, lower, 0.0)
            codes.append(math.if_else(side > 0.0, upper, below))
        return math.vertcat(*codes)

    def _followed(self, parts: Mapping[str, Any], tau: Any) -> Any:
        """Return ν̇ (dof, 1) in the middle of a period, as the model has it under efforts.

        Args:
            parts: Terms of the sample.
            tau: Efforts (n_act, 1).
        """
        frame = self._frame
        at = midpoint(frame.known, frame.sample, self._law.held_for)
        M, push = math.tril2symm(parts["M"]), frame.known.at(at.q).B @ tau + parts["push"]
        return frame.known.solve_positive(M, push)

    def _start(self, memory: list[Place]) -> Call:
        """Return the call that makes the memory of a robot at rest.

        Args:
            memory: What is remembered.
        """
        frame = self._frame
        zero = {buffer: math.SX.zeros(buffer.size, 1) for buffer, _ in memory}
        if self._integral:
            still = math.SX.zeros(frame.known.robot.dof, 1)
            zero[self._disturbance[0]] = -frame.known.forward(frame.q[1], still, frame.tau[1])
        outputs = [*zero.items(), (frame.elapsed[0], math.SX(frame.period))]
        return statement("law_start", [frame.q, frame.tau], outputs)

    def _remember(self) -> tuple[Statement, ...]:
        """Return what is done after a sample."""
        pairs = list(zip(self._dual, self._next, strict=True))
        bound = [(old[0], math.if_else(self._binds[1], new_[1], old[1])) for old, new_ in pairs]
        inputs = [self._binds, *(place for pair in pairs for place in pair)]
        found: list[Statement] = [When(self._binds[0], (statement("law_dual", inputs, bound),))]
        if self._integral:
            nu, d, nu_dot = self._frame.nu, self._disturbance_now, self._nu_dot
            kept = (self._disturbance, *self._before)
            values = (d[1], nu[1], nu_dot[1], math.SX(1))
            outputs = [(buffer, value) for (buffer, _), value in zip(kept, values, strict=True)]
            found.append(statement("law_memory", [nu, d, nu_dot], outputs))
        return tuple(found)
