"""One step of a robot whose wheels slip: implicit in what is stiff, tyres and losses.

The method is ARS(2,2,2) of [ARS97], as in :func:`rpctl.dynamics.motion.imex_step`: order 2, and
L-stable for tyres and losses, so slip that dies away within a step does so at any stiffness. Loads
depend on the accelerations and these on the loads; a stage solves for both at once. With y₀ what
the explicit part leaves, and w its share of the step, the stage's velocities y have

    M (y − y₀) = w (ℓ(y) − Gᵀ N(y) g(G y)),   N(y) = split of  m₀ + K (a + (y − y₀)/w),

where g is the tyres' grip per load and a + (y − y₀)/w the acceleration, a without tyres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dgesv

from rpctl.arrays import Array
from rpctl.dynamics.motion import DELTA, GAMMA, solve_positive
from rpctl.dynamics.projection import dexpinv
from rpctl.dynamics.stance import ContactLoads, share_load
from rpctl.dynamics.stops import Stops, impact, stopped
from rpctl.errors import RpctlError
from rpctl.simulation.plants.free_tree import FreeTree, Posture
from rpctl.simulation.plants.settings import Wrench
from rpctl.simulation.plants.tyres import Grip, TyreLaw

CONVERGED = 1e-8  # of the largest rate: the error after a correction that small is its square
NEWTON_STEPS = 20  # with loads that depend on the accelerations; it takes 2 to 4
SURE_STEPS = 200  # with loads that do not
SOFTER = (1e-4, 1e-3, 1e-2, 1e-1)  # parts of the stiffness on the way to very stiff tyres
HALVINGS = 20  # of a Newton step that goes too far
OVERSHOOT = 0.5  # of the residual along a Newton step at its start: more at its end is too far


@dataclass(frozen=True, eq=False)
class SlipState:
    """A robot on tyres at one instant.

    Attributes:
        at: What its configuration makes of the tree.
        y: Velocities (ny,).
        acceleration: ẏ (ny,), a guess for the next step.
        load: Load of each contact (n_contacts,), N.
        reaction: Of the stops that joints rest on (ny,), N·m or N.
        tips: Whether no loads that only push balance it.
        held: Whether loads and forces found no common solution in the step that led here; the
            loads were then those of the accelerations before.
    """

    at: Posture
    y: Array
    acceleration: Array
    load: Array
    reaction: Array
    tips: bool = False
    held: bool = False

    @property
    def v(self) -> Array:
        """Velocity (nv,)."""
        return self.at.velocity(self.y)

    @property
    def contact_velocity(self) -> Array:
        """Velocities of the contact points (3, n_wheels), m/s."""
        return np.asarray(self.at.G.dot(self.y).reshape(3, -1))


@dataclass(frozen=True, eq=False)
class _Stage:
    """A stage's equations: what they hold fixed."""

    at: Posture
    y0: Array  # (ny,)
    w: float  # s
    a: Array  # (ny,) acceleration without tyres and losses
    moments: Array  # (3,) m₀
    rolling_speed: Array  # (n_wheels,)


@dataclass(frozen=True, eq=False)
class _Solved:
    """A stage's solution."""

    y: Array
    force: Array  # (ny,) of tyres and losses
    loads: ContactLoads
    held: bool


@dataclass(frozen=True, eq=False)
class _Residual:
    """What is left of a stage's equations at some velocities, and what it was made of."""

    rest: Array  # (ny,) N·m·s or N·s
    v: Array  # (nv,)
    grip: Grip
    loads: ContactLoads
    force: Array  # (ny,) of tyres and losses


@dataclass(frozen=True, eq=False)
class SlipStepper:
    """Advances a robot on tyres.

    Attributes:
        tree: The robot's tree.
        law: Its tyres.
        columns: Map (nv, n_act) from efforts to generalised forces.
        stops: Of the joints whose rates are entries of y.
    """

    tree: FreeTree
    law: TyreLaw
    columns: Array
    stops: Stops

    def start(self, q: Array, v: Array) -> SlipState:
        """Return the state at q (nq,) and v (nv,), with the loads that it has unaccelerated."""
        at = self.tree.at(q)
        y = v[self.tree.free]
        _, moments = self.tree.push(at, y, np.zeros(len(v)), np.zeros(3))
        loads = share_load(at.split, moments)
        still = np.zeros(len(y))
        return SlipState(at, y, still, loads.load, still, loads.tips)

    def step(
        self, state: SlipState, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()
    ) -> tuple[SlipState, float, float]:
        """Return the state after ``dt``, the work of efforts and pushes and what was lost, J.

        Work and loss are impulses times the mean of the speeds before and after, as in
        :func:`rpctl.dynamics.motion.imex_step`.

        Raises:
            RpctlError: The motion left the finite numbers, or the inertia is not positive.
        """
        given, own = self.columns.dot(tau), GAMMA * dt
        given[self.tree.free] += state.reaction
        at, y = state.at, state.y
        push, _ = self._push(at, y, given, wrenches)
        a1, v1 = solve_positive(at.M, push), state.v
        slide = own * v1
        at2 = self.tree.at(self.tree.integrate(at.q, slide))
        y0 = y + own * a1
        middle = self._solve(at2, y0, own, y + own * state.acceleration, given, wrenches)
        v2 = at2.velocity(middle.y)
        push, _ = self._push(at2, middle.y, given, wrenches)
        a2 = solve_positive(at2.M, push)
        brake = (middle.y - y0) / own
        end = self.tree.integrate(at.q, dt * (DELTA * v1 + (1.0 - DELTA) * dexpinv(slide, v2)))
        at3 = self.tree.at(end)
        y0 = y + dt * (DELTA * a1 + (1.0 - DELTA) * a2 + (1.0 - GAMMA) * brake)
        last = self._solve(at3, y0, own, y + dt * (a2 + brake), given, wrenches)
        v3 = at3.velocity(last.y)
        impulse = dt * ((1.0 - GAMMA) * middle.force + GAMMA * last.force)
        loads, held = last.loads, middle.held or last.held
        rates = last.y, (last.y - y) / dt
        after = SlipState(at3, *rates, loads.load, state.reaction, loads.tips, held)
        work = given.dot(v1 + v3)
        if wrenches:
            (before, _), (then, _) = (self.tree.pushes(each, wrenches) for each in (at.q, end))
            work += before.dot(v1) + then.dot(v3)
        after, met = self._at_stops(after, self.stops.ends(at.q))
        return after, 0.5 * dt * float(work), met - 0.5 * float(impulse.dot(y + last.y))

    def _at_stops(self, state: SlipState, ends: tuple[Array, Array]) -> tuple[SlipState, float]:
        """Return the state with joints at their stops, which are at ``ends``, and the loss, J.

        The reaction of the next step is that at the accelerations of this one.
        """
        held, at, M = np.sign(state.reaction), state.at, state.at.M
        s = np.where(held != 0.0, held, self.stops.sides(at.q, ends))
        if not s.any():
            return state, 0.0
        y = impact(M, state.y, s, held)
        put = self.tree.at(
            self.tree.integrate(at.q, at.velocity(self.stops.back(at.q, ends, s, held)))
        )
        push = M @ state.acceleration - state.reaction
        rates, reaction = stopped(M, push, s * (s * y <= 0.0), np.zeros(len(y)))
        lost = 0.5 * float((state.y - y) @ M @ (state.y + y)) + self.tree.fall(at.q, put.q)
        return replace(state, at=put, y=y, acceleration=rates, reaction=reaction), lost

    def _push(
        self, at: Posture, y: Array, given: Array, wrenches: Sequence[Wrench]
    ) -> tuple[Array, Array]:
        """Return the force (ny,) without tyres and losses, and the moments (3,) at ẏ = 0."""
        force, pressed = self.tree.pushes(at.q, wrenches)
        return self.tree.push(at, y, given + force, pressed)

    def _solve(
        self,
        at: Posture,
        y0: Array,
        w: float,
        guess: Array,
        given: Array,
        wrenches: Sequence[Wrench],
    ) -> _Solved:
        """Return the solution of a stage.

        Args:
            at: The posture.
            y0: Velocities (ny,) without tyres and losses.
            w: Their share of the step, s.
            guess: Of the velocities (ny,), to second order: what varies slowly is taken there.
            given: Generalised force (nv,) of the actuators.
            wrenches: What pushes besides.
        """
        push, moments = self._push(at, guess, given, wrenches)
        a = solve_positive(at.M, push)
        spin = at.G.dot(guess).reshape(3, -1)[2]
        stage = _Stage(at, y0, w, a, moments, self.law.rolling_speed(spin))
        return self._newton(stage, guess, None) or self._by_softer(stage, guess)

    def _by_softer(self, stage: _Stage, guess: Array) -> _Solved:
        """Return the solution by way of those of softer tyres, then with loads held if need be.

        Very stiff tyres stick and slide within so little slip that Newton's steps from afar jump
        from one to the other; from the solution of softer ones they do not.
        """
        for soft in SOFTER:
            softer = replace(self, law=replace(self.law, stiffness=soft * self.law.stiffness))
            found = softer._newton(stage, guess, None)
            guess = guess if found is None else found.y
        found = self._newton(stage, guess, None)
        found = found or self._newton(stage, guess, self._loads(stage, guess))
        if found is None:
            raise RpctlError("the tyre forces do not determine the speeds")
        return found

    def _loads(self, stage: _Stage, y: Array) -> ContactLoads:
        """Return the loads at the velocities y (ny,)."""
        acceleration = stage.a + (y - stage.y0) / stage.w
        moments = stage.moments + stage.at.K.dot(acceleration)
        if not math.isfinite(moments.sum()):
            raise RpctlError("the accelerations are not finite")
        return share_load(stage.at.split, moments)

    def _newton(self, stage: _Stage, guess: Array, held: ContactLoads | None) -> _Solved | None:
        """Return the solution by Newton's steps, or None where they do not end.

        With given loads it is the minimum of a strictly convex function, and a step with the
        secants in place of the slopes always comes nearer.

        Args:
            stage: The stage.
            guess: Of its velocities (ny,).
            held: Loads that do not depend on the accelerations; None: those that do.
        """
        y = guess
        now = self._residual(stage, y, held)
        for _ in range(NEWTON_STEPS if held is None else SURE_STEPS):
            step = self._correction(stage, now, held is None)
            ahead = self._residual(stage, y + step, held)
            small = np.abs(step).max(initial=0.0) <= CONVERGED * (
                self.law.creep_speed + np.abs(y).max(initial=0.0)
            )
            if small:
                return _Solved(y + step, ahead.force, ahead.loads, held is not None)
            for _ in range(HALVINGS):
                if ahead.rest.dot(step) <= OVERSHOOT * abs(now.rest.dot(step)):
                    break
                step = 0.5 * step
                ahead = self._residual(stage, y + step, held)
            else:
                step = self._correction(stage, now, held is None, sure=True)
                ahead = self._residual(stage, y + step, held)
            y, now = y + step, ahead
        return None

    def _residual(self, stage: _Stage, y: Array, held: ContactLoads | None) -> _Residual:
        """Return what is left of the equations at the velocities y (ny,).

        Args:
            stage: The stage.
            y: Velocities (ny,).
            held: The loads, where they do not depend on the accelerations.
        """
        at, losses = stage.at, self.tree.robot.losses
        loads = held or self._loads(stage, y)
        grip = self.law.grip(at.G.dot(y).reshape(3, -1), stage.rolling_speed)
        wheels = grip.force.shape[1]
        force = -(grip.force * loads.load[:wheels]).ravel().dot(at.G)
        v = at.velocity(y)
        if losses is not None:
            force = force + at.reduced(losses.force(v))
        return _Residual(at.M.dot(y - stage.y0) - stage.w * force, v, grip, loads, force)

    def _correction(
        self, stage: _Stage, now: _Residual, coupled: bool, sure: bool = False
    ) -> Array:
        """Return a step (ny,) towards the solution.

        Args:
            stage: The stage.
            now: What is left of its equations.
            coupled: Whether the loads depend on the accelerations.
            sure: Whether secants take the place of slopes.
        """
        at, losses, grip = stage.at, self.tree.robot.losses, now.grip
        wheels = grip.force.shape[1]
        G, load = at.G.reshape(3, wheels, len(at.M)), now.loads.load[:wheels, None]
        bent = stage.w * load
        if sure:
            change = grip.secant[..., None] * bent * G
        else:
            slope = grip.slope[..., None]
            change = np.empty_like(G)
            change[0] = slope[0, 0] * G[0] + slope[0, 1] * G[1]
            change[1] = slope[1, 0] * G[0] + slope[1, 1] * G[1]
            change[2] = slope[2, 2] * G[2]
            change *= bent
        if coupled:
            change += grip.force[..., None] * now.loads.slope[:wheels].dot(at.K)
        H = at.M + at.G.T.dot(change.reshape(3 * wheels, len(at.M)))
        if losses is not None:
            brake = stage.w * (losses.secant(now.v) if sure else losses.slope(now.v))
            if at.E is None:
                H.reshape(-1)[:: len(H) + 1] += brake
            else:
                H += at.E.T.dot(brake[:, None] * at.E)
        _, _, step, info = dgesv(H, -now.rest)
        if info or not np.isfinite(step).all():
            raise RpctlError("the tyre forces do not determine the speeds")
        return np.asarray(step)
