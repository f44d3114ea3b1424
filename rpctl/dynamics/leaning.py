"""Rolling without slipping of two wheels that lean: A(q), W(q), their rates, and where S is.

A wheel's contact lies at c + r d, which depends on how its axle leans; see
:func:`rpctl.robot.leaning.contact_arm`. It has three rows of A v = 0: its material point moves
neither ahead nor to the side, and its lowest point stays on the ground, which is the rate of
c_z − r s = 0. Wheels side by side share one lateral row, their mean: on one axle both have the
same, and where legs part them both at once would forbid all turning.

All is written once, over CasADi's scalars, as functions of q; rates are taken, not typed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from rpctl import math as casadi  # imported when a robot leans
from rpctl.arrays import Array
from rpctl.dynamics.projection import Projection, effort_columns
from rpctl.dynamics.rolling import RANK_MARGIN, mimic_rows
from rpctl.errors import RpctlError, SingularBasisError
from rpctl.kernels.calls import interpreted
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.leaning import FREE_NQ, FREE_NV, KEPT_ROBOTS, UP, Axle, LeaningRobot, contact_arm

MAX_SETTLING = 20  # steps of Newton's that bring wheels back to the ground
SETTLED_M = 1e-13  # m, of the robot's size


class LeaningFormulas:
    """What rolling makes of a robot's velocities, as functions over ``casadi.SX``.

    Args:
        robot: The robot.

    Attributes:
        q: The symbols of a configuration (nq, 1).
        heights: Of both wheels' lowest points, m.
        pose: x, y and heading of P, and the tilt (4, 1); see :meth:`LeaningRobot.base_pose`.
        A: Constraint matrix (rows, nv): mimic joints; both wheels' speeds ahead; their lateral one,
            or a bicycle's two; the rates of both heights.
        W: Selection of the quasi-velocities (dof, nv).
        L: [A; W] (nv, nv).
        twist: P's speed ahead and to the left, and the turning rate, by v (3, nv).
        rate: q̇ = ``rate`` v, (nq, nv).
    """

    def __init__(self, robot: LeaningRobot) -> None:
        self.robot = robot
        self.q = casadi.SX.sym("q", robot.nq)
        self.rate = self._rate()
        self._places = self._walk()
        wheels = [self._wheel(axle) for axle in robot.axles]
        self.heights = casadi.vertcat(*(wheel.height for wheel in wheels))
        held = [w for w, axle in zip(wheels, robot.axles, strict=True) if not axle.steers]
        place = sum((w.centre + w.arm for w in held), casadi.SX.zeros(3)) / len(held)
        left = sum((w.left for w in held), casadi.SX.zeros(3))
        heading = casadi.atan2(-left[0], left[1])
        self.pose = casadi.vertcat(place[0], place[1], heading, self._tilt(held[0].left))
        moved = casadi.jacobian(self.pose, self.q) @ self.rate
        cos, sin = casadi.cos(heading), casadi.sin(heading)
        ahead = cos * moved[0, :] + sin * moved[1, :]
        self.twist = casadi.vertcat(ahead, cos * moved[1, :] - sin * moved[0, :], moved[2, :])
        lateral = [wheel.beside for wheel in wheels]
        if not robot.rolls_sideways:
            lateral = [0.5 * (lateral[0] + lateral[1])]
        rise = casadi.jacobian(self.heights, self.q) @ self.rate
        rows = [wheel.ahead for wheel in wheels] + lateral
        self.A = casadi.vertcat(casadi.SX(mimic_rows(robot)), *rows, rise)
        own = [ahead, moved[3, :]] if robot.rolls_sideways else [ahead, moved[2, :], moved[3, :]]
        names = [*(swivel.joint for swivel in robot.drive.steered), *robot.joint_names]
        joints = np.eye(robot.nv)[[robot.velocity_index(name) for name in names]]
        self.W = casadi.vertcat(*own, casadi.SX(joints))
        self.L = casadi.vertcat(self.A, self.W)

    def L_rate(self, v: Any) -> Any:
        """Return d/dt [A; W] v (nv, 1) at v (nv, 1) held, symbols of its own."""
        return casadi.jtimes(self.L @ v, self.q, self.rate @ v)

    @property
    def back(self) -> Any:
        """The least v (nv, 1) that brings both heights to 0 in 1 s, to first order."""
        rise = self.A[self.A.shape[0] - 2 :, :]
        return -rise.T @ casadi.solve(rise @ rise.T, self.heights)

    @cached_property
    def functions(self) -> tuple[Callable[..., Any], ...]:
        """[A; W], its rate times v, the twist's map, and the heights with the way to 0, at q."""
        v = casadi.SX.sym("v", self.robot.nv)
        return (
            self.function("equations", [self.q], [self.L]),
            self.function("rates", [self.q, v], [self.L_rate(v)]),
            self.function("twist", [self.q], [self.twist]),
            self.function("heights", [self.q], [self.heights, self.back]),
        )

    def function(self, name: str, given: list[Any], found: list[Any]) -> Callable[..., list[Array]]:
        """Return a function of dense arrays."""
        dense = [casadi.densify(each) for each in casadi.cse(found)]
        shapes = [each.shape for each in found]
        call = interpreted(casadi.Function(name, given, dense))

        def arrays(*columns: Array) -> list[Array]:
            flat = zip(call(*columns), shapes, strict=True)
            return [each.reshape(shape, order="F").copy() for each, shape in flat]

        return arrays

    def _rate(self) -> Any:
        """Return the map (nq, nv) from v to q̇."""
        robot, q = self.robot, self.q
        rate = casadi.SX(robot.nq, robot.nv)
        rate[:3, :3] = self.root_axes
        x, y, z, w = (q[i] for i in range(3, FREE_NQ))
        rate[3:FREE_NQ, 3:FREE_NV] = 0.5 * casadi.vertcat(
            casadi.horzcat(w, -z, y),
            casadi.horzcat(z, w, -x),
            casadi.horzcat(-y, x, w),
            casadi.horzcat(-x, -y, -z),
        )
        for name, entry in robot.entries.items():
            index, i = robot.velocity_index(name), entry.index
            if entry.is_pair:
                rate[i, index], rate[i + 1, index] = -q[i + 1], q[i]
            else:
                rate[i, index] = 1.0
        return rate

    @property
    def root_axes(self) -> Any:
        """The root link's axes in the world (3, 3), columns."""
        x, y, z, w = (self.q[i] for i in range(3, FREE_NQ))
        return casadi.vertcat(
            casadi.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            casadi.horzcat(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            casadi.horzcat(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )

    def _walk(self) -> dict[int, tuple[Any, Any]]:
        """Return axes (3, 3) and origin (3, 1) in the world of the wheels' joints and all above."""
        model, q = self.robot.model, self.q
        places = {ROOT_JOINT: (self.root_axes, q[:3])}
        wheels = {axle.joint for axle in self.robot.axles}
        wanted = {j for wheel in wheels for j in model.supports[wheel] if j}
        for joint in sorted(wanted - {ROOT_JOINT}):
            R, p = places[int(model.parents[joint])]
            held = model.jointPlacements[joint]
            p, R = p + R @ held.translation, R @ held.rotation
            name = model.names[joint]
            axis, entry = self.robot.description.joint[name].axis, self.robot.entries[name]
            if joint in wheels:  # whose spin moves neither axle nor centre
                places[joint] = R, p
                continue
            if self.robot.description.joint[name].kind == "prismatic":
                places[joint] = R, p + R @ axis * q[entry.index]
                continue
            cos, sin = (
                (q[entry.index], q[entry.index + 1])
                if entry.is_pair
                else (casadi.cos(q[entry.index]), casadi.sin(q[entry.index]))
            )
            skew = np.array(
                [[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]
            )
            places[joint] = R @ (np.eye(3) + sin * skew + (1 - cos) * (skew @ skew)), p
        return places

    def _wheel(self, axle: Axle) -> _Wheel:
        """Return a wheel's place, and the rows of its contact."""
        R, p = self._places[axle.joint]
        centre, left = p + R @ axle.centre, R @ axle.left
        a = [left[0], left[1], left[2]]
        arm = casadi.vertcat(*contact_arm(a, axle, casadi.sqrt))
        linear = self._jacobian(axle.joint, centre + arm)
        sine = casadi.sqrt(1 - a[2] * a[2])
        ahead = casadi.vertcat(a[1], -a[0], 0) / sine
        beside = casadi.vertcat(a[0], a[1], 0) / sine
        height = axle.lowest(centre[2], a[2], casadi.sqrt)
        return _Wheel(centre, left, arm, height, ahead.T @ linear, beside.T @ linear)

    def _jacobian(self, joint: int, point: Any) -> Any:
        """Return the velocity (3, nv) of a point fixed to a joint's body."""
        robot, model = self.robot, self.robot.model
        found = casadi.SX(3, robot.nv)
        R, p = self._places[ROOT_JOINT]
        found[:, :3] = R
        for k in range(3):
            found[:, 3 + k] = casadi.cross(R[:, k], point - p)
        for above in model.supports[joint]:
            if above <= ROOT_JOINT:
                continue
            name, index = model.names[above], int(model.joints[above].idx_v)
            R, p = self._places[above]
            axis = R @ robot.description.joint[name].axis
            slides = robot.description.joint[name].kind == "prismatic"
            found[:, index] = axis if slides else casadi.cross(axis, point - p)
        return found

    def _tilt(self, left: Any) -> Any:
        """Return the coordinate that the robot balances; see :class:`LeaningRobot`."""
        if self.robot.rolls_sideways:
            return casadi.asin(left[2])
        ahead = casadi.vertcat(left[1], -left[0], 0) / casadi.sqrt(1 - left[2] * left[2])
        upright = self._places[ROOT_JOINT][0] @ UP
        return casadi.atan2(
            casadi.dot(upright, ahead), casadi.dot(upright, casadi.cross(ahead, left))
        )


@lru_cache(maxsize=KEPT_ROBOTS)
def find_formulas(robot: LeaningRobot) -> LeaningFormulas:
    """Return the formulas of a robot; those of the last robots are kept."""
    return LeaningFormulas(robot)


@dataclass(frozen=True, eq=False)
class _Wheel:
    """A wheel's place in symbols, and the rows (1, nv) of its contact's velocity."""

    centre: Any
    left: Any
    arm: Any
    height: Any
    ahead: Any
    beside: Any


@dataclass(frozen=True, eq=False)
class LeaningProjection(Projection):
    """What rolling makes of velocities and efforts where wheels lean."""

    _q: Array = field(repr=False)
    _factors: tuple[Array, Array] = field(repr=False)

    @cached_property
    def A(self) -> Array:
        """Constraint matrix (rows, nv): A v = 0."""
        return np.asarray(self.projector.equations(self._q)[: self.projector.rows])

    @cached_property
    def W(self) -> Array:
        """Selection of the quasi-velocities (dof, nv): ν = W v."""
        return np.asarray(self.projector.equations(self._q)[self.projector.rows :])

    def drift(self, nu: Array) -> Array:
        """Return Ṡν (nv,): the part of v̇ = S ν̇ + Ṡν that the motion itself brings."""
        lu, pivots = self._factors
        rate = self.projector.equations_rate(self._q, self.S.dot(nu))
        found, _ = dgetrs(lu, pivots.copy(), -rate)
        return np.asarray(found)

    @cached_property
    def multipliers(self) -> Array:
        """Map (rows, nv) from a force Aᵀλ to λ: no two rows say the same, so there is one λ."""
        lu, pivots = self._factors
        found, _ = dgetrs(lu, pivots.copy(), np.eye(len(lu)), trans=1)
        return np.asarray(found[: self.projector.rows])

    @cached_property
    def twist(self) -> Array:
        """Map (3, dof) from ν to P's speed ahead and to the left (m/s), and the turning rate."""
        return np.asarray(self.projector.twist(self._q) @ self.S)


class LeaningProjector:
    """Makes the projections of one robot; keeps the last.

    Args:
        robot: The robot.
    """

    constant, gliding = None, ()

    def __init__(self, robot: LeaningRobot) -> None:
        self.robot = robot
        self.columns = effort_columns(robot)
        formulas = find_formulas(robot)
        self.rows, self._functions = formulas.A.shape[0], formulas.functions
        self._last: tuple[bytes, LeaningProjection] | None = None

    def equations(self, q: Array) -> Array:
        """Return [A; W] (nv, nv) at q (nq,)."""
        return self._functions[0](q)[0]

    def equations_rate(self, q: Array, v: Array) -> Array:
        """Return d/dt [A; W] v (nv,) at q (nq,) and v (nv,) held."""
        return self._functions[1](q, v)[0][:, 0]

    def twist(self, q: Array) -> Array:
        """Return the map (3, nv) from v to P's twist."""
        return self._functions[2](q)[0]

    def heights(self, q: Array) -> Array:
        """Return how high both wheels' lowest points are (2,), m."""
        return self._functions[3](q)[0][:, 0]

    def at(self, q: Array) -> LeaningProjection:
        """Return the projection at q (nq,).

        Raises:
            SingularBasisError: At q the wheels fix no one motion; the joints are named.
        """
        key = q.tobytes()
        last = self._last  # read once: another thread may write it meanwhile
        if last is None or last[0] != key:
            last = self._last = key, self._project(q)
        return last[1]

    def _project(self, q: Array) -> LeaningProjection:
        L = self.equations(q)
        lu, pivots, info = dgetrf(L)
        if info or not dgecon(lu, float(np.abs(L).sum(axis=0).max()))[0] > RANK_MARGIN:
            raise SingularBasisError(
                f"the two wheels do not determine the motion: {self._posture(q)}"
            )
        wanted = np.eye(self.robot.nv)[:, self.rows :]
        S, _ = dgetrs(lu, pivots.copy(), wanted)
        more, _ = dgetrs(lu, pivots.copy(), wanted - L @ S)
        S = S + more
        S.setflags(write=False)
        return LeaningProjection(S, self, q.copy(), (lu, pivots))

    def _posture(self, q: Array) -> str:
        robot = self.robot
        names = [name for name in robot.quasi_velocities if name in robot.entries]
        angles = ", ".join(f"{n} at {robot.joint_position(q, n):.3g}" for n in names)
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        rises = [(data.oMi[axle.joint].rotation @ axle.left)[2] for axle in robot.axles]
        k = int(np.argmax(np.abs(rises)))
        lean = np.degrees(np.arcsin(min(abs(rises[k]), 1.0)))
        axle = f"the axle of {robot.drive.wheels[k].joint} {lean:.3g}° off horizontal"
        return f"{axle}{', ' if angles else ''}{angles}"

    @staticmethod
    def dexpinv(slide: Array, v: Array) -> Array:
        """Return dexp⁻¹ of the free-flyer, as :func:`rpctl.dynamics.projection.dexpinv`."""
        found, u = v.copy(), pin.Motion(slide[:FREE_NV])
        bracket = u.cross(pin.Motion(v[:FREE_NV]))
        found[:FREE_NV] += 0.5 * bracket.vector + u.cross(bracket).vector / 12.0
        return found

    def settle(self, q: Array) -> Array:
        """Return q (nq,) moved the least way that brings both wheels back to the ground.

        Raises:
            RpctlError: No way does.
        """
        for _ in range(MAX_SETTLING):
            heights, back = self._functions[3](q)
            if max(abs(heights.min()), abs(heights.max())) <= SETTLED_M:
                return q
            q = pin.integrate(self.robot.model, q, back)
        raise RpctlError(f"{self.robot.name}: its wheels cannot come back to the ground")
