"""What a file needs beyond the model that rpctl itself steps: ties, and names for all of it.

A file runs without rpctl, so what MuJoCo cannot do by itself is either put into an element of its
own or refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rpctl.engines.mujoco.build import Built, build
from rpctl.engines.mujoco.rollers import has_rollers
from rpctl.engines.mujoco.sensors import FREE
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

LINK_GROUP, CONTACT_GROUP = 4, 3  # of sites and of contact shapes; a viewer shows 0 to 2
HARD_STEPS = 4.0  # timesteps: time constant of the contacts of crowned wheels
HARD_IMPEDANCE = (0.99, 0.999, 1e-4, 0.5, 2.0)


def prepare(robot: Robot, settings: ContactSettings, friction: float, hidden: bool = True) -> Built:
    """Return a robot as MuJoCo's model of a file that runs by itself.

    Args:
        robot: The robot.
        settings: How it meets the ground. Crowned wheels do not scrub, so their contacts are as
            hard as the timestep lets them be: the robot neither sinks nor creeps.
        friction: Coefficient between wheels and ground.
        hidden: Whether the shapes that touch the ground are in a group that viewers do not show.

    Raises:
        RpctlError: MuJoCo cannot do the robot by itself; the message says why.
    """
    _require_possible(robot)
    built = build(robot, settings, friction)
    spec = built.spec
    for body in spec.bodies:
        for joint in body.joints:
            joint.name = joint.name or f"{body.name}{FREE}"
    for site in spec.sites:
        site.group = LINK_GROUP
    for geom in spec.geoms:
        if hidden and geom.name in built.geoms:
            geom.group = CONTACT_GROUP
    if settings.wheel_shape == "crowned" and not has_rollers(robot):
        spec.option.impratio = 1.0
        for pair in spec.pairs:
            pair.solref, pair.solimp = [HARD_STEPS * settings.timestep, 1.0], HARD_IMPEDANCE
            pair.solreffriction = [0.0, 0.0]  # as solref
    _drop_changing_ties(spec, built)
    notes = tuple(note for note in built.notes if not note.startswith("tie rods that change"))
    return replace(built, notes=(*notes, *_loose_note(robot, built)))


def _drop_changing_ties(spec: Any, built: Built) -> None:
    """Leave out ties that rpctl turns as it steps, which no file can; name the others."""
    changing = {follower.tie for follower in built.followers}
    for element in (*spec.equalities, *spec.tendons):
        if element.name in changing:
            spec.delete(element)
    for tie in spec.equalities:
        tie.name = tie.name or f"{tie.name1}_tie"


def _require_possible(robot: Robot) -> None:
    """Refuse robots whose wheels no plain MuJoCo model has."""
    drive = robot.drive
    if not drive.wheels:
        raise RpctlError(
            f"{robot.name} has no wheels; a fixed base is read by MuJoCo from its URDF as it is"
        )
    rolling = has_rollers(robot) or drive.type == "skid-steer"
    sliding = [wheel.joint for wheel in drive.wheels if wheel.slides and not rolling]
    if sliding:
        raise RpctlError(
            f"{robot.name}: nothing holds {', '.join(sliding)} sideways, but friction of MuJoCo's "
            "contacts holds in all directions alike; lock what they hang on, or declare another "
            "drive with --drive"
        )


def _loose_note(robot: Robot, built: Built) -> tuple[str, ...]:
    """Return what is to be said of swivels that no tie holds."""
    loose = [follower.joint for follower in built.followers]
    if not loose:
        return ()
    leaders = ", ".join(swivel.joint for swivel in robot.drive.steered)
    return (
        f"{', '.join(loose)} follow {leaders} in a way that no tie of MuJoCo says: the file leaves "
        "them to their motors; hold each at its angle of robot.configuration(...)",
    )
