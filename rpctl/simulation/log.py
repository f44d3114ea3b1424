"""The log of a closed loop: arrays with a row a sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.columns import release

MIN_SAMPLES = 2  # of a run: one moment is no motion


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """The samples of a run: K rows in each array; arrays are read-only.

    Attributes:
        t: Time (K,), s.
        q: Configuration (K, nq).
        nu: Quasi-velocities (K, dof); m/s, rad/s.
        tau: Actuator efforts from each sample on (K, n_act); N·m or N.
        rates: Rate of each actuator's joint (K, n_act), wheels included; rad/s or m/s.
        nu_d: Quasi-velocities that the kinematic law asks for (K, dof).
        nu_cmd: Quasi-velocities that were sent from each sample on (K, dof); (K, 0) where the
            controller sent efforts.
        nu_ref: Quasi-velocities of the reference (K, dof).
        base: Pose of P (K, 3): x, y in m, heading in rad.
        base_ref: Reference pose of P (K, 3).
        joints: Positions of the arm (K, n_joints); rad or m.
        joints_ref: Their references (K, n_joints).
        steering: Positions of the joints that steer wheels (K, n_steering), rad.
        others: Positions of the other moving joints (K, n_others), wheels and mimic joints
            included; rad or m, those of continuous joints in (−π, π].
        other_rates: Their rates (K, n_others); rad/s or m/s.
        e: Tracking error (K, 3 + n_joints): longitudinal, lateral, heading, joints.
        q_ref: Configuration of the reference robot (K, nq), wheels turned as they would roll.
        ee: Position of the end effector (K, 3), m; (K, 0) for a robot without an arm.
        ee_ref: Its reference (K, 3), m.
        ee_angle: Angle between the end effector's and its reference's orientation (K,), rad.
        energy: Kinetic plus potential energy (K,), J.
        work: Work done by the actuators since the start (K,), J.
        lost: What damping and friction in the joints have taken since the start (K,), J; in files
            of schema 5 and older, friction counts as negative work.
        constraint_residual: Largest entry of |A v| (K,); m/s, rad/s.
        wheel_force: Force of the ground on each wheel, forward (K, n_wheels), N.
        axle_force: Force of the ground on each axle, to the left (K, n_axles), N.
        contact_load: Vertical force of the ground on each contact (K, n_contacts), N; (K, 0) where
            the contacts known do not hold a balance. Beyond three contacts, of equal springs.
        zmp: Zero-moment point (K, 2), m; (K, 0) for a fixed base.
        tip_margin: Distance of the zero-moment point to the edge of the support polygon (K,), m;
            negative outside; (K, 0) where it is not defined.
        slip_ratio: Largest of the wheels' horizontal force over friction times load (K,); above 1
            a wheel slips; (K, 0) where it is not defined. The loads are ``contact_load``.
        load_range: Least and largest load of each contact (K, n_contacts, 2) of all splits that
            statics admit, N; NaN where the robot tips. (K, 0) where ``contact_load`` is the only
            split or not defined, and in files of versions that logged none.
        slip_range: Least and largest ``slip_ratio`` of those splits (K, 2); inf where a wheel that
            pushes may bear nothing, NaN where the robot tips; (K, 0) where ``load_range`` is.
        root_pose: Pose of the root link (K, 7): x, y, z (m) and quaternion x, y, z, w; (K, 0) of a
            plant whose wheels roll: it stays level.
        ground_load: Load of each contact (K, n_contacts), N, as the plant has it; (K, 0) of one
            whose wheels roll, and where it does not know.
        wheel_slip: Velocity of each wheel's contact point (K, n_wheels, 2), m/s, along its rolling
            direction and to its left; likewise.
        active_limits: 1 where a limit bound the efforts, else 0 (K, n_bound).
        bound_limits: Joint and kind of each limit that ever bound the efforts, a column of
            ``active_limits`` each.
    """

    t: Array
    q: Array
    nu: Array
    tau: Array
    rates: Array
    nu_d: Array
    nu_cmd: Array
    nu_ref: Array
    base: Array
    base_ref: Array
    joints: Array
    joints_ref: Array
    steering: Array
    others: Array
    other_rates: Array
    e: Array
    q_ref: Array
    ee: Array
    ee_ref: Array
    ee_angle: Array
    energy: Array
    work: Array
    lost: Array
    constraint_residual: Array
    wheel_force: Array
    axle_force: Array
    contact_load: Array
    zmp: Array
    tip_margin: Array
    slip_ratio: Array
    load_range: Array
    slip_range: Array
    root_pose: Array
    ground_load: Array
    wheel_slip: Array
    active_limits: Array
    bound_limits: tuple[tuple[str, str], ...]

    def release(self) -> None:
        """Take what was read of arrays that lie in files from the process's memory; they keep."""
        for item in fields(self):
            if isinstance(array := getattr(self, item.name), np.ndarray):
                release(array)


class DeferredLog(Log):
    """A log with columns that are computed when one of them is read for the first time.

    Args:
        later: Computes those columns; None: there are none.
        known: The others by name, and ``bound_limits``.
    """

    def __init__(
        self, later: Callable[[], Mapping[str, Array]] | None = None, **known: Any
    ) -> None:
        for name, value in {**known, **({} if later is None else {"_later": later})}.items():
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Any:
        """Return a column that has not been computed; it is then, with all others."""
        if name not in COLUMNS or "_later" not in vars(self):
            raise AttributeError(f"a log has no {name!r}")
        for each, column in self._later().items():
            object.__setattr__(self, each, column)
        object.__delattr__(self, "_later")
        return getattr(self, name)

    def __reduce__(self) -> tuple[type[Log], tuple[Any, ...]]:
        """Return it as the log that it is, all columns computed: what computes them stays here."""
        return Log, tuple(getattr(self, item.name) for item in fields(Log))

    def release(self) -> None:
        """Take what was read of arrays that lie in files from the process's memory; they keep."""
        for array in vars(self).values():
            if isinstance(array, np.ndarray):
                release(array)


COLUMNS = frozenset(item.name for item in fields(Log))
_NONE = dict.fromkeys((item.name for item in fields(Log)), np.empty(0))
NO_SAMPLES = Log(**{**_NONE, "bound_limits": ()})  # type: ignore[arg-type]
