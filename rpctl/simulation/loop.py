"""The closed loop: reference → tracking error → kinematic law → dynamic law → plant → Run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from rpctl.control.command import KinematicLaw
from rpctl.control.dynamic import DynamicLaw, PaperDynamic
from rpctl.control.error import tracking_error
from rpctl.control.kinematic import PaperKinematic
from rpctl.description.records import Array
from rpctl.dynamics.contact import FRICTION, find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.errors import DivergedError, RpctlError, require_positive
from rpctl.reference.motion import Reference, ReferenceState, reference_by_name
from rpctl.robot.model import Robot
from rpctl.simulation.plant import advance
from rpctl.simulation.record import Recorder, describe, facts
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
    settings = {
        "reference": reference if isinstance(reference, str) else type(reference).__name__,
        "duration": duration,
        "initial_error": [float(x) for x in initial_error],
        "kinematic": describe(kinematic),
        "dynamic": describe(dynamic),
        "control_period": control_period,
        "plant_step": plant_step,
    }
    if isinstance(reference, str):
        reference = reference_by_name(robot, reference)
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics, friction)
    recorder = Recorder(dynamics, contacts)
    steps = max(1, round(duration / control_period))
    began = time.perf_counter()
    q, nu, work = _start(robot, reference(0.0), initial_error), np.zeros(robot.dof), 0.0
    for k in range(steps + 1):
        t = k * control_period
        state = reference(t)
        e = tracking_error(robot, state, q)
        command = kinematic(dynamics, reference, t, q, nu)
        tau = dynamic(dynamics, q, nu, command)
        recorder.add(t, q, nu, tau, e, state, command, work)
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
    wall_time = time.perf_counter() - began
    report = getattr(kinematic, "report", None)  # a law that counts has more to tell than settings
    if report is not None:
        settings["kinematic_report"] = report()
    return Run(
        **recorder.arrays(),
        **facts(robot, contacts),
        friction=friction,
        settings=settings,
        certificate=None if certificate is None else certificate.to_dict(),
        wall_time=wall_time,
    )


def _start(robot: Robot, state: ReferenceState, initial_error: Sequence[float]) -> Array:
    """Return q (nq,) that has the tracking error asked for, arm on its reference."""
    if len(state.joints) != len(robot.joints):
        raise RpctlError(
            f"the reference has {len(state.joints)} joints, {robot.name} has {len(robot.joints)}"
        )
    if len(initial_error) != 3 or not all(map(math.isfinite, initial_error)):
        raise RpctlError(f"initial error {initial_error}: give three finite numbers X,Y,THETA")
    x1, x2, x3 = initial_error
    if not robot.drive.base_speeds and any(initial_error):
        raise RpctlError(f"{robot.name} has a fixed base: it starts without a base error")
    theta = state.pose[2] - x3
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = state.pose[0] - cos * x1 + sin * x2, state.pose[1] - sin * x1 - cos * x2
    return robot.configuration_at(np.array([x, y, theta]), state.joints)
