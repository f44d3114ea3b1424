"""What a file needs beyond the model that rpctl itself steps: ties, and names for all of it.

A file runs without rpctl, so what MuJoCo cannot do by itself is either put into an element of its
own or refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rpctl.drive.drive import Swivel
from rpctl.drive.steering import MAX_STEERING, follower_positions
from rpctl.engines.mujoco.build import Built, build
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

LINK_GROUP, CONTACT_GROUP = 4, 3  # of sites and of contact shapes; a viewer shows 0 to 2
POLYNOMIAL = 4  # degree of MuJoCo's ties of joints
FIT_SAMPLES = 201
TIE_STEPS, TIE_SOLIMP = 4.0, (0.99, 0.999, 1e-3, 0.5, 2.0)  # time constant in steps; impedance
TOLD_ANGLE = 1e-3  # rad: a tie that is further off is told


def prepare(robot: Robot, settings: ContactSettings, friction: float) -> Built:
    """Return a robot as MuJoCo's model of a file that runs by itself.

    Args:
        robot: The robot.
        settings: How it meets the ground.
        friction: Coefficient between wheels and ground.

    Raises:
        RpctlError: MuJoCo cannot do the robot by itself; the message says why.
    """
    _require_possible(robot)
    built = build(robot, settings, friction)
    spec = built.spec
    for body in spec.bodies:
        for joint in body.joints:
            joint.name = joint.name or f"{body.name}_free"
    for site in spec.sites:
        site.group = LINK_GROUP
    for geom in spec.geoms:
        if geom.name in built.geoms:
            geom.group = CONTACT_GROUP
    for tendon in spec.tendons:  # rpctl turns these as it steps, which no file can
        spec.delete(tendon)
    for tie in spec.equalities:
        if tie.type == mujoco_library().mjtEq.mjEQ_TENDON:
            spec.delete(tie)
            continue
        tie.name = tie.name or f"{tie.name1}_tie"
    return replace(built, notes=(*built.notes, *_tie_followers(spec, robot, settings)))


def _require_possible(robot: Robot) -> None:
    """Refuse robots whose wheels no plain MuJoCo model has."""
    drive = robot.drive
    if not drive.wheels:
        raise RpctlError(
            f"{robot.name} has no wheels; a fixed base is read by MuJoCo from its URDF as it is"
        )
    if drive.type in ("mecanum", "omni"):
        raise RpctlError(
            f"{robot.name} rolls on the rollers of {drive.type} wheels, which its file does not "
            "draw as bodies: friction of MuJoCo's contacts holds in all directions alike, so such "
            "wheels would not slide along their rollers; `rpctl verify --contact` and `rpctl "
            "referee` turn the contacts at every step, which no file can"
        )
    sliding = [wheel.joint for wheel in drive.wheels if wheel.slides and drive.type != "skid-steer"]
    if sliding:
        raise RpctlError(
            f"{robot.name}: {', '.join(sliding)} slide sideways freely; friction of MuJoCo's "
            "contacts holds in all directions alike"
        )


def follows_one(robot: Robot) -> bool:
    """Return whether the swivels that follow depend on one steered joint alone."""
    return len(robot.drive.steered) == 1


def _tie_followers(spec: Any, robot: Robot, settings: ContactSettings) -> tuple[str, ...]:
    """Tie swivels that keep to the centre of rotation; return what is to be said of them."""
    followers = robot.drive.followers
    if not followers:
        return ()
    names = ", ".join(swivel.joint for swivel in followers)
    if not follows_one(robot):
        leaders = ", ".join(swivel.joint for swivel in robot.drive.steered)
        return (
            f"{names} follow {leaders} together, which no tie of MuJoCo says: the file leaves them "
            "to their motors; hold each at its angle of robot.configuration(...)",
        )
    tied = {tie.name1 for tie in spec.equalities}
    loose = [swivel for swivel in followers if swivel.joint not in tied]
    return tuple(note for swivel in loose for note in _tie(spec, robot, settings, swivel))


def _tie(spec: Any, robot: Robot, settings: ContactSettings, follower: Swivel) -> tuple[str, ...]:
    """Tie a follower to its leader by a polynomial over the leader's range."""
    leader = robot.drive.steered[0].joint
    limits = np.clip(
        robot.description.joint[leader].span(MAX_STEERING), -MAX_STEERING, MAX_STEERING
    )
    at = np.linspace(float(limits[0]), float(limits[1]), FIT_SAMPLES)
    places = np.array([
        follower_positions(robot.drive, {leader: float(angle)})[follower.joint] for angle in at
    ])  # fmt: skip
    polynomial = np.polynomial.polynomial.polyfit(at, places, POLYNOMIAL)
    off = float(np.abs(np.polynomial.polynomial.polyval(at, polynomial) - places).max())
    mujoco = mujoco_library()
    tie = spec.add_equality(name=f"{follower.joint}_tie", name1=follower.joint, name2=leader)
    tie.type, tie.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    tie.data[: POLYNOMIAL + 1] = polynomial
    tie.solref, tie.solimp = [TIE_STEPS * settings.timestep, 1.0], TIE_SOLIMP
    if off <= TOLD_ANGLE:
        return ()
    return (
        f"{follower.joint} is tied to {leader} by a polynomial, at most {1e3 * off:.2g} mrad off "
        "the common centre of rotation",
    )
