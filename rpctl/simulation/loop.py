"""The closed loop: reference → tracking error → kinematic law → dynamic law → plant → Run."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import cumulative_trapezoid

from rpctl.control.dynamic import DynamicLaw, PaperDynamic
from rpctl.control.error import tracking_error
from rpctl.control.kinematic import KinematicLaw, PaperKinematic, require_positive
from rpctl.description.records import Array
from rpctl.dynamics.contact import FRICTION, Contacts, find_contacts, ground_reaction
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.end_effector import end_effector_reference
from rpctl.reference.motion import Reference, ReferenceState, reference_by_name
from rpctl.robot.model import Robot
from rpctl.simulation.plant import advance
from rpctl.simulation.run import Run

LOST = 1e6  # m/s or rad/s: no robot moves so; the loop has diverged


def track(
    robot: Robot,
    reference: str | Reference = "eight",
    duration: float = 20.0,
    initial_error: Sequence[float] = (0.0, 0.0, 0.0),
    kinematic: KinematicLaw | None = None,
    dynamic: DynamicLaw | None = None,
    control_period: float = 0.002,
    plant_step: float = 0.002,
    certificate: Certificate | None = None,
    progress: Callable[[int, int], object] | None = None,
    friction: float = FRICTION,
) -> Run:
    """Simulate a robot that tracks a reference, from rest.

    The laws run every ``control_period``, their efforts are held in between (zero-order hold), and
    the plant is integrated in steps of at most ``plant_step``.

    Args:
        robot: The robot.
        reference: A reference, or the name of one (``line``, ``reverse``, ``spin``, ``circle``,
            ``eight``).
        duration: s.
        initial_error: Tracking error (x1, x2, x3) of the base at the start: how far the reference
            is ahead (m), to the left (m) and turned to the left (rad), seen from the robot.
        kinematic: The kinematic law; None takes the paper's.
        dynamic: The dynamic law; None takes the paper's.
        control_period: s.
        plant_step: s.
        certificate: A certificate to keep with the run.
        progress: Called with the samples done and their total.
        friction: Coefficient between wheels and ground, for the grip that the motion uses.

    Returns:
        What was logged.

    Raises:
        DivergedError: The motion left the finite numbers.
        RpctlError: A setting is out of range, or the reference does not fit the robot.
    """
    for name, value in (
        ("duration", duration),
        ("control_period", control_period),
        ("plant_step", plant_step),
    ):
        require_positive(name, value)
    kinematic, dynamic = kinematic or PaperKinematic(), dynamic or PaperDynamic()
    asked = reference
    if isinstance(reference, str):
        reference = reference_by_name(robot, reference)
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics, friction)
    log = _simulate(
        dynamics, contacts, reference, kinematic, dynamic, duration, initial_error,
        control_period, plant_step, progress,
    )  # fmt: skip
    settings = {
        "reference": asked if isinstance(asked, str) else type(asked).__name__,
        "duration": duration,
        "initial_error": [float(x) for x in initial_error],
        "kinematic": _describe(kinematic),
        "dynamic": _describe(dynamic),
        "control_period": control_period,
        "plant_step": plant_step,
    }
    joints = robot.joints
    return Run(
        **log,
        robot=robot.name,
        source=robot.source,
        urdf_sha256=robot.description.sha256,
        locked=dict(robot.locked),
        drive=dataclasses.asdict(robot.drive),
        density=robot.density,
        quasi_velocities=robot.quasi_velocities,
        actuators=robot.actuators,
        joint_names=tuple(joint.name for joint in joints),
        units=tuple("m" if joint.kind == "prismatic" else "rad" for joint in joints),
        effort_limits=tuple(robot.effort_limits.tolist()),
        velocity_limits=tuple(robot.description.joint[name].velocity for name in robot.actuators),
        lower_limits=tuple(joint.lower for joint in joints),
        upper_limits=tuple(joint.upper for joint in joints),
        end_effector=robot.end_effector,
        contacts=contacts.names if contacts else (),
        contact_points=tuple(map(tuple, contacts.points.tolist())) if contacts else (),
        axles=contacts.axles if contacts else (),
        ground_notes=contacts.notes if contacts else (),
        friction=friction,
        settings=settings,
        certificate=None if certificate is None else certificate.to_dict(),
    )


def _simulate(
    dynamics: ReducedDynamics,
    contacts: Contacts | None,
    reference: Reference,
    kinematic: KinematicLaw,
    dynamic: DynamicLaw,
    duration: float,
    initial_error: Sequence[float],
    control_period: float,
    plant_step: float,
    progress: Callable[[int, int], object] | None,
) -> dict[str, Any]:
    """Return the arrays of a Run and its wall time."""
    robot = dynamics.robot
    data = robot.model.createData()
    steps = max(1, round(duration / control_period))
    rows: list[dict[str, Any]] = []
    start = time.perf_counter()
    state = reference(0.0)
    if state.nu.shape != (robot.dof,):
        raise RpctlError(
            f"the reference has {state.nu.size} quasi-velocities, {robot.name} has {robot.dof}"
        )
    q = _start(robot, state, initial_error)
    nu, work = np.zeros(robot.dof), 0.0
    for k in range(steps + 1):
        t = k * control_period
        state = reference(t)
        e = tracking_error(robot, state, q)
        command = kinematic(state, e, nu)
        tau = dynamic(dynamics, q, nu, command)
        rows.append(
            {"t": t, "q": q, "nu": nu, "tau": tau, "nu_d": command.nu_d, "nu_ref": state.nu,
             "base": robot.base_pose(q), "base_ref": state.pose,
             "joints": robot.joint_positions(q), "joints_ref": state.joints, "e": e,
             "energy": dynamics.energy(q, nu), "work": work,
             "rates": dynamics.actuation(q).T @ nu,
             "constraint_residual": _slip(dynamics, q, nu),
             **_ground(dynamics, contacts, q, nu, tau), **_end_effector(robot, data, q, state)}
        )  # fmt: skip
        if not np.abs(nu).max() < LOST:
            raise DivergedError(
                f"the motion diverged at t = {t:g} s; shorten the control period or lengthen the "
                "horizons"
            )
        if k < steps:
            q, nu, done = advance(dynamics, q, nu, tau, control_period, plant_step)
            work += done
        if progress is not None:
            progress(k, steps)
    wall_time = time.perf_counter() - start
    log: dict[str, Any] = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    for heading in (log["base"][:, 2], log["base_ref"][:, 2]):
        heading[:] = np.unwrap(heading)
    log["q_ref"] = _reference_configurations(robot, dynamics, log)
    for array in log.values():
        array.setflags(write=False)
    return {**log, "wall_time": wall_time}


def _start(robot: Robot, state: ReferenceState, initial_error: Sequence[float]) -> Array:
    """Return q (nq,) that has the tracking error asked for, arm on its reference."""
    if len(initial_error) != 3 or not all(map(math.isfinite, initial_error)):
        raise RpctlError(f"initial error {initial_error}: give three finite numbers X,Y,THETA")
    x1, x2, x3 = initial_error
    if not robot.drive.base_speeds and any(initial_error):
        raise RpctlError(f"{robot.name} has a fixed base: it starts without a base error")
    theta = state.pose[2] - x3
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = state.pose[0] - cos * x1 + sin * x2, state.pose[1] - sin * x1 - cos * x2
    return robot.configuration_at(np.array([x, y, theta]), state.joints)


def _slip(dynamics: ReducedDynamics, q: Array, nu: Array) -> float:
    """Return the largest entry of |A v|: m/s, rad/s."""
    residual = dynamics.constraint(q) @ (dynamics.basis(q) @ nu)
    return float(np.abs(residual).max(initial=0.0))


def _ground(
    dynamics: ReducedDynamics, contacts: Contacts | None, q: Array, nu: Array, tau: Array
) -> dict[str, Any]:
    nothing = np.empty(0)
    if contacts is None:
        names = ("wheel_force", "axle_force", "contact_load", "zmp", "tip_margin", "slip_ratio")
        return dict.fromkeys(names, nothing)
    ground = ground_reaction(dynamics, contacts, q, nu, tau)
    return {
        "wheel_force": ground.longitudinal,
        "axle_force": ground.lateral,
        "contact_load": ground.load,
        "zmp": ground.zmp,
        "tip_margin": nothing if ground.tip_margin is None else ground.tip_margin,
        "slip_ratio": ground.slip_ratio.max() if ground.slip_ratio.size else nothing,
    }


def _end_effector(robot: Robot, data: pin.Data, q: Array, state: ReferenceState) -> dict[str, Any]:
    if robot.end_effector is None:
        return {"ee": np.empty(0), "ee_ref": np.empty(0), "ee_angle": 0.0}
    actual = robot.end_effector_pose(data, q)
    wanted = end_effector_reference(robot, data, state)
    turn = pin.log3(actual.rotation.T @ wanted.rotation)
    return {
        "ee": actual.translation,
        "ee_ref": wanted.translation,
        "ee_angle": float(np.linalg.norm(turn)),
    }


def _reference_configurations(
    robot: Robot, dynamics: ReducedDynamics, log: dict[str, Any]
) -> Array:
    """Return q (K, nq) of the reference, its wheels turned as far as they would have rolled."""
    wheels = robot.actuators[: len(robot.drive.wheels)]
    configurations = [
        robot.configuration_at(pose, joints)
        for pose, joints in zip(log["base_ref"], log["joints_ref"], strict=True)
    ]
    rates = np.array(
        [
            (dynamics.actuation(q).T @ nu)[: len(wheels)]
            for q, nu in zip(configurations, log["nu_ref"], strict=True)
        ]
    )
    angles = cumulative_trapezoid(rates, log["t"], axis=0, initial=0.0)
    for q, turned in zip(configurations, angles, strict=True):
        for wheel, angle in zip(wheels, turned, strict=True):
            robot.set_joint(q, wheel, float(angle))
    return np.array(configurations)


def _describe(law: object) -> dict[str, Any]:
    """Return a law's name and settings."""
    if dataclasses.is_dataclass(law) and not isinstance(law, type):
        return {"law": type(law).__name__, **dataclasses.asdict(law)}
    return {"law": getattr(law, "__name__", type(law).__name__)}
