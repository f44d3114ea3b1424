"""The contact trial: the reduced model against the robot itself, rolling on a plane in MuJoCo.

Both get the same efforts from the same plan. One side integrates M ν̇ + h = B τ, in which rolling
is an equation; on the other the wheels roll because friction lets them. Their paths, the ground's
forces and the efforts of steered and arm joints must agree within bands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, find_contacts, ground_reaction
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.contact.comparison import caster_names, gaps, rolling_casters
from rpctl.equivalence.contact.model import STEP_S, ContactModel
from rpctl.equivalence.contact.plan import TICK_S, ContactPlan, NotGentle, plan_motion
from rpctl.equivalence.contact.record import ContactMotion, ContactTrial
from rpctl.equivalence.mujoco_model import EngineRefused
from rpctl.equivalence.row import CONTACT_ORACLE, Skipped
from rpctl.errors import ActuationError, RpctlError, SingularBasisError
from rpctl.robot.coordinates import read_root, write_root
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

CHECK_NAME = "motion on the ground"
SETTLING_S = 0.3  # s in which the robot sinks into its contacts: 150 of their time constants
MAX_TILT = 2e-3  # rad; soft contacts let a robot lean by a tenth of it
TICKS_PER_SAMPLE = 5  # ticks between two samples

Row = tuple[Array, ...]  # of Motion's arrays


def contact_trial(robot: Robot) -> ContactTrial | Skipped:
    """Let a robot roll on a plane in MuJoCo, and compare it with the reduced model.

    Wheels get their efforts open loop, the same numbers on both sides; steered and arm joints
    have one servo law, each side on its own measured state, for under efforts alone an arm falls.
    MuJoCo starts settled in its contacts, the reduced model where MuJoCo then stands. Joints lose
    nothing on either side: it is the ground that is compared.

    Returns:
        The trial, or the row that says why there is none.
    """
    if not robot.drive.wheels:
        return Skipped(CHECK_NAME, CONTACT_ORACLE, "a fixed base has nothing to roll")
    robot = without_losses(robot)
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    if contacts is None or not contacts.balanced:
        why = contacts.notes[0] if contacts is not None else "it has no contacts"
        return Skipped(CHECK_NAME, CONTACT_ORACLE, f"not known to stand: {why}")
    try:
        plan, model = plan_motion(dynamics, contacts), ContactModel(robot)
    except (NotGentle, ActuationError, SingularBasisError, EngineRefused) as reason:
        return Skipped(CHECK_NAME, CONTACT_ORACLE, str(reason))
    engine = _motion(list(_engine_rows(dynamics, contacts, plan, model)))
    reduced = _motion(_reduced_rows(dynamics, contacts, plan, engine.pose[0]))
    times: Array = TICKS_PER_SAMPLE * TICK_S * np.arange(len(engine.pose), dtype=float)
    times.setflags(write=False)
    rows = gaps(robot, contacts, plan.names, reduced, engine)
    return ContactTrial(
        checks=tuple(replace(row, time=float(times[row.sample])) for row in rows),
        notes=(*model.notes, *tilt_note(model.tilt), *_notes(robot, contacts, engine)),
        contacts=contacts.names,
        determinate=contacts.determinate,
        joints=plan.names,
        slides=tuple(robot.description.joint[n].kind == "prismatic" for n in plan.names),
        footprint=contacts.points,
        t=times,
        reduced=reduced,
        engine=engine,
    )


def _motion(rows: list[Row]) -> ContactMotion:
    return ContactMotion(*(np.array(column) for column in zip(*rows, strict=True)))


def _engine_rows(
    dynamics: ReducedDynamics, contacts: Contacts, plan: ContactPlan, model: ContactModel
) -> Iterator[Row]:
    """Yield what MuJoCo does, from where the robot has settled."""
    robot, still = dynamics.robot, np.zeros(dynamics.robot.dof)
    casters = caster_names(robot)
    order = [model.names.index(name) for name in contacts.names]
    hold = dynamics.efforts(plan.q[0], dynamics.inverse(plan.q[0], still, still))
    model.start(plan.q[0])
    for tick in range(-round(SETTLING_S / TICK_S), len(plan.tau) + 1):
        measured = np.array([model.joint(name) for name in plan.names]).reshape(-1, 2)
        planned = hold if tick < 0 else None
        tau = plan.efforts(tick, measured[:, 0], measured[:, 1], planned)
        pose, caster_angles = model.pose, np.array([model.joint(name)[0] for name in casters])
        ground = model.advance(dict(zip(robot.actuators, tau, strict=True)), round(TICK_S / STEP_S))
        if tick >= 0 and tick % TICKS_PER_SAMPLE == 0:
            yield (
                pose,
                ground.load[order],
                ground.force,
                ground.zmp,
                tau[list(plan.servoed)],
                caster_angles,
            )


def _reduced_rows(
    dynamics: ReducedDynamics, contacts: Contacts, plan: ContactPlan, pose: Array
) -> list[Row]:
    """Return what the reduced model does.

    A wrong model may run into a posture that is singular; from there on its rows are NaN.
    """
    rows: list[Row] = []
    try:
        rows.extend(_stepped_rows(dynamics, contacts, plan, pose))  # rows before an error stay
    except RpctlError:
        if not rows:
            raise
    lost = tuple(np.full_like(part, np.nan) for part in rows[0])
    return rows + [lost] * (1 + len(plan.tau) // TICKS_PER_SAMPLE - len(rows))


def _stepped_rows(
    dynamics: ReducedDynamics, contacts: Contacts, plan: ContactPlan, pose: Array
) -> Iterator[Row]:
    """Yield what the reduced model does from a pose (3,) of the root link, at rest."""
    robot = dynamics.robot
    index = [robot.velocity_index(name) for name in plan.names]
    q, nu = plan.q[0].copy(), np.zeros(robot.dof)
    write_root(q, *pose)
    for tick in range(len(plan.tau) + 1):
        at = np.array([robot.joint_position(q, name) for name in plan.names])
        tau = plan.efforts(tick, at, (dynamics.basis(q) @ nu)[index])
        if tick % TICKS_PER_SAMPLE == 0:
            yield _reduced_row(dynamics, contacts, plan, (q, nu, tau))
        q, nu, *_ = rk4_step(dynamics, q, nu, tau, TICK_S)


def _reduced_row(
    dynamics: ReducedDynamics,
    contacts: Contacts,
    plan: ContactPlan,
    state: tuple[Array, Array, Array],
) -> Row:
    """Return a row of :class:`ContactMotion` at q, ν and τ."""
    robot, (q, nu, tau) = dynamics.robot, state
    ground = ground_reaction(dynamics, contacts, q, nu, tau)
    pose = np.array(read_root(q))
    caster_angles = np.array([robot.joint_position(q, name) for name in caster_names(robot)])
    return pose, ground.load, ground.force, ground.zmp, tau[list(plan.servoed)], caster_angles


def tilt_note(tilt: float) -> Iterator[str]:
    """Yield a note if a robot settles at a larger tilt (rad) than soft contacts explain."""
    if tilt > MAX_TILT:
        yield (
            f"it stands {math.degrees(tilt):.2g}° out of the level: its wheels and supports do not "
            "end at one height in the file, as the reduced model takes them to; correct their "
            "origins or sizes"
        )


def _notes(robot: Robot, contacts: Contacts, engine: ContactMotion) -> Iterator[str]:
    """Yield what the two sides share, and what is not compared."""
    drive = robot.drive
    if drive.type == "skid-steer":
        yield (
            "straight ahead only: a skid-steer base turns by scrubbing, which the effective track "
            "stands for in the reduced model"
        )
    if drive.type in ("mecanum", "omni"):
        yield (
            "rollers are friction along the roller's axle and none across it; their angle on the "
            "wheel is the drive's"
        )
    if any(wheel.slides for wheel in drive.wheels):
        yield "wheels that nothing holds sideways have friction along their rolling only"
    if drive.followers:
        names = ", ".join(swivel.joint for swivel in drive.followers)
        yield f"stiff tie rods hold {names} to the common centre of rotation"
    if not contacts.determinate:
        count = len(contacts.names)
        yield f"{count} contacts: statics fix their sum and its centre, not each load"
    rolling = rolling_casters(robot, contacts, engine)
    lifted = [name for name in caster_names(robot) if name not in rolling]
    if lifted:
        yield f"{', '.join(lifted)} bear no load all the while: how they swing is not compared"
