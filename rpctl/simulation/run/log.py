"""The log of a run: what is kept of its samples, and what follows from that when it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np

from rpctl.arrays import Array

MIN_SAMPLES = 2  # of a run: one moment is no motion
DOUBLE, SINGLE = "<f8", "<f4"
Size = int | str  # of a dimension, or what there is one of for each


class Column(NamedTuple):
    """What an array of a log is.

    Attributes:
        sizes: Its dimensions behind the first, the samples.
        kept: Type of its numbers in a file; empty: it follows from the others.
        absent: Whether a robot or a plant may have no such thing; (K, 0) then.
    """

    sizes: tuple[Size, ...] = ()
    kept: str = ""
    absent: bool = False


class Log:
    """The samples of a run: K rows in each array; arrays are read-only.

    Attributes:
        t: Time (K,), s.
        q: Configuration (K, nq).
        nu: Quasi-velocities (K, dof); m/s, rad/s.
        tau: Actuator efforts from each sample on (K, n_act); N·m or N.
        nu_d: Quasi-velocities that the kinematic law asks for (K, dof).
        nu_cmd: Quasi-velocities that were sent from each sample on (K, dof); (K, 0) where the
            controller sent efforts.
        nu_ref: Quasi-velocities of the reference (K, dof).
        base_ref: Reference pose of P (K, 3): x, y in m, heading in rad.
        joints_ref: References of the arm's positions (K, n_joints); rad or m.
        wheels_ref: Positions of the reference robot's steered joints, wheels and casters (K, n),
            rad, wheels turned as they would roll.
        turns: Full turns of P's heading since the start (K,).
        work: Work done by the actuators since the start (K,), J.
        lost: What damping, friction and stops of the joints have taken since the start (K,), J.
        root_pose: Pose of the root link (K, 7): x, y, z (m) and quaternion x, y, z, w; (K, 0) of a
            plant whose wheels roll: it stays level.
        ground_load: Load of each contact (K, n_contacts), N, as the plant has it; (K, 0) of one
            whose wheels roll, and where it does not know.
        wheel_slip: Velocity of each wheel's contact point (K, n_wheels, 2), m/s, along its rolling
            direction and to its left; likewise.
        active_limits: 1 where a limit bound the efforts, else 0 (K, n_bound).
        base: Pose of P (K, 3): x, y in m, heading in rad.
        joints: Positions of the arm (K, n_joints); rad or m.
        steering: Positions of the joints that steer wheels (K, n_steering), rad.
        others: Positions of the other moving joints (K, n_others), wheels and mimic joints
            included; rad or m, those of continuous joints in (−π, π].
        e: Tracking error (K, 3 + n_joints): longitudinal, lateral, heading, joints.
        q_ref: Configuration of the reference robot (K, nq).
        rates: Rate of each actuator's joint (K, n_act), wheels included; rad/s or m/s.
        other_rates: Rates of the other moving joints (K, n_others); rad/s or m/s.
        ee: Position of the end effector (K, 3), m; (K, 0) for a robot without an arm.
        ee_ref: Its reference (K, 3), m.
        ee_angle: Angle between the end effector's and its reference's orientation (K,), rad.
        energy: Kinetic plus potential energy (K,), J.
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
            split or not defined.
        slip_range: Least and largest ``slip_ratio`` of those splits (K, 2); inf where a wheel that
            pushes may bear nothing, NaN where the robot tips; (K, 0) where ``load_range`` is.
        bound_limits: Joint and kind of each limit that ever bound the efforts, a column of
            ``active_limits`` each.
    """

    t: Annotated[Array, Column(kept=DOUBLE)]
    q: Annotated[Array, Column(("q",), DOUBLE)]
    nu: Annotated[Array, Column(("nu",), SINGLE)]
    tau: Annotated[Array, Column(("actuators",), SINGLE)]
    nu_d: Annotated[Array, Column(("nu",), SINGLE)]
    nu_cmd: Annotated[Array, Column(("nu",), SINGLE, absent=True)]
    nu_ref: Annotated[Array, Column(("nu",), SINGLE)]
    base_ref: Annotated[Array, Column((3,), DOUBLE)]
    joints_ref: Annotated[Array, Column(("joints",), DOUBLE)]
    wheels_ref: Annotated[Array, Column(("wheels_ref",), SINGLE)]
    turns: Annotated[Array, Column(kept=SINGLE)]
    work: Annotated[Array, Column(kept=DOUBLE)]
    lost: Annotated[Array, Column(kept=DOUBLE)]
    root_pose: Annotated[Array, Column((7,), SINGLE, absent=True)]
    ground_load: Annotated[Array, Column(("contacts",), SINGLE, absent=True)]
    wheel_slip: Annotated[Array, Column(("wheels", 2), SINGLE, absent=True)]
    active_limits: Annotated[Array, Column(("bound_limits",), SINGLE)]
    base: Annotated[Array, Column((3,))]
    joints: Annotated[Array, Column(("joints",))]
    steering: Annotated[Array, Column(("steering",))]
    others: Annotated[Array, Column(("others",))]
    e: Annotated[Array, Column(("e",))]
    q_ref: Annotated[Array, Column(("q",))]
    rates: Annotated[Array, Column(("actuators",))]
    other_rates: Annotated[Array, Column(("others",))]
    ee: Annotated[Array, Column((3,), absent=True)]
    ee_ref: Annotated[Array, Column((3,), absent=True)]
    ee_angle: Annotated[Array, Column()]
    energy: Annotated[Array, Column()]
    constraint_residual: Annotated[Array, Column()]
    wheel_force: Annotated[Array, Column(("wheels",), absent=True)]
    axle_force: Annotated[Array, Column(("axles",))]
    contact_load: Annotated[Array, Column(("contacts",), absent=True)]
    zmp: Annotated[Array, Column((2,), absent=True)]
    tip_margin: Annotated[Array, Column(absent=True)]
    slip_ratio: Annotated[Array, Column(absent=True)]
    load_range: Annotated[Array, Column(("contacts", 2), absent=True)]
    slip_range: Annotated[Array, Column((2,), absent=True)]

    def __init__(
        self,
        arrays: Mapping[str, Array],
        bound_limits: tuple[tuple[str, str], ...] = (),
        derive: Derive | None = None,
    ) -> None:
        """Make a log of its arrays by name; ``derive`` computes those that are not given."""
        self.bound_limits, self._derive = bound_limits, derive
        self._keep(arrays)

    def _keep(self, arrays: Mapping[str, Array]) -> None:
        for name, array in arrays.items():
            kept = array.view()
            kept.setflags(write=False)
            vars(self).setdefault(name, kept)

    def __getattr__(self, name: str) -> Array:
        """Return an array that has not been computed; it is then, with others of its kind."""
        derive = vars(self).get("_derive")
        if name not in COLUMNS or derive is None:
            raise AttributeError(f"a log has no {name!r}")
        self._keep(derive(self, name))
        return np.asarray(vars(self)[name])

    def arrays(self, names: tuple[str, ...] | None = None) -> dict[str, Array]:
        """Return arrays by name; None: all."""
        return {name: getattr(self, name) for name in names or COLUMNS}

    def changed(self, arrays: Mapping[str, Array], **other: Any) -> Log:
        """Return a log with other arrays; ``bound_limits`` may be another, too."""
        return Log({**self.arrays(), **arrays}, other.get("bound_limits", self.bound_limits))

    def __reduce__(self) -> tuple[type[Log], tuple[Any, ...]]:
        """Return it with all arrays computed: what computes them stays here."""
        return Log, (self.arrays(), self.bound_limits)


Derive = Callable[[Log, str], Mapping[str, Array]]
COLUMNS: dict[str, Column] = {
    name: hint.__metadata__[0]
    for name, hint in get_type_hints(Log, include_extras=True).items()
    if hasattr(hint, "__metadata__")
}
KEPT = tuple(name for name, column in COLUMNS.items() if column.kept)
