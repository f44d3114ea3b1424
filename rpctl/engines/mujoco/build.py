"""``build``: a robot as MuJoCo's ``MjSpec``, free on a ground with friction.

No equation says that a wheel rolls, and none that the robot stays upright: wheels are bodies that
friction turns (E. Todorov, "Convex and analytically-invertible dynamics with contacts and
constraints", ICRA 2014). The model is plain: any MuJoCo runs it, without callbacks.

What a tie rod does on a car, a constraint does here. Where one swivel leads, its follower's angle
is a polynomial of its own (MuJoCo's joint equality). Where several lead, no constraint of MuJoCo's
says so: the rods are springs of whoever steps the robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from rpctl.drive.steering import MAX_STEERING, follower_positions
from rpctl.engines.mujoco.bodies import add_bodies, add_motors
from rpctl.engines.mujoco.ground import GRIP, GROUND, GroundContacts
from rpctl.engines.mujoco.settings import BASE, LEAST, ContactSettings, Heights, read_heights
from rpctl.equivalence.contact.mujoco_body import mujoco_library
from rpctl.errors import RpctlError, require_positive
from rpctl.robot.model import Robot

TIE_STEPS = 4.0  # timesteps: time constant of a tie
TIE_SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)
DEGREE = 4  # of MuJoCo's polynomial
FIT = 2e-3  # rad: largest error of a polynomial that stands for a tie rod


@dataclass(frozen=True, eq=False)
class Built:
    """A robot in MuJoCo.

    Attributes:
        spec: The ``MjSpec``. Bodies have the names of links (see
            :func:`rpctl.engines.mujoco.bodies.body_name`), joints those of joints, actuators those
            of ``robot.actuators``; other links are sites.
        contacts: Names of the contacts: the wheels' joints, then the supports, as
            ``Contacts.names``.
        geoms: Name of the contact of each geom that meets the ground, by the geom's name.
        followers: Swivels that no equality ties: whoever steps the robot pulls them by rods.
        notes: What was assumed, in sentences.
        repairs: What of the file was mended, in sentences.
        heights: Of the ground; None: it is the plane z = 0.
    """

    spec: Any
    contacts: tuple[str, ...]
    geoms: Mapping[str, str]
    followers: tuple[str, ...]
    notes: tuple[str, ...]
    repairs: tuple[str, ...]
    heights: Heights | None = None

    def compile(self) -> Any:
        """Return the ``MjModel``.

        Raises:
            RpctlError: MuJoCo refuses it.
        """
        try:
            return self.spec.compile()
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise RpctlError(f"MuJoCo refuses the robot: {reason}") from None


def build(robot: Robot, settings: ContactSettings, friction: float) -> Built:
    """Return a robot in MuJoCo.

    Masses and inertias are those of its model, radii and centres of wheels those of its drive, so
    that a robot that was varied, or carries a load, is simulated as such.

    Raises:
        EngineMissing: MuJoCo is not installed.
        RpctlError: A number is none that it can take.
        InputError: The heights of the ground cannot be read.
    """
    require_positive("friction", friction)
    spec = mujoco_library().MjSpec()
    spec.modelname = robot.name
    _set_options(spec, robot, settings)
    heights = read_heights(settings)
    _add_ground(spec, friction, heights)
    repairs = add_bodies(spec, robot, settings)
    add_motors(spec, robot)
    ground = GroundContacts(spec, robot, settings, friction)
    ground.add_all()
    for joint in robot.mimics:
        if joint.mimic is not None and joint.mimic.joint not in robot.locked:
            line = joint.mimic.offset, joint.mimic.multiplier
            _tie(spec, joint.name, joint.mimic.joint, line, settings)
    polynomials, notes = tie_polynomials(robot), ground.notes
    for name, coefficients in polynomials.items():
        _tie(spec, name, robot.drive.steered[0].joint, coefficients, settings)
    followers = tuple(s.joint for s in robot.drive.followers if s.joint not in polynomials)
    if polynomials:
        turned = ", ".join(polynomials)
        notes = [*notes, f"a tie rod, as a polynomial of degree {DEGREE}, turns {turned}"]
    ground.even()
    contacts = tuple(dict.fromkeys(ground.owners.values()))
    return Built(spec, contacts, ground.owners, followers, tuple(notes), repairs, heights)


def _set_options(spec: Any, robot: Robot, settings: ContactSettings) -> None:
    mujoco, option, compiler = mujoco_library(), spec.option, spec.compiler
    compiler.degree = compiler.balanceinertia = compiler.fusestatic = False
    compiler.boundmass = compiler.boundinertia = 0.0
    compiler.autolimits = False
    option.timestep, option.gravity = settings.timestep, robot.model.gravity.linear
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    elliptic = settings.cone == "elliptic"
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC if elliptic else mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.impratio = GRIP if elliptic else 1.0


def _add_ground(spec: Any, friction: float, heights: Heights | None) -> None:
    kinds = mujoco_library().mjtGeom
    ground = spec.worldbody.add_geom(name=GROUND, type=kinds.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    ground.contype = ground.conaffinity = 0
    ground.friction = [friction, 0.0, 0.0]
    if heights is None:
        return
    low, high = float(heights.grid.min()), float(heights.grid.max())
    rows, columns = heights.grid.shape
    field = spec.add_hfield(name=GROUND, nrow=rows, ncol=columns)
    relief = max(high - low, LEAST)
    field.size = [0.5 * heights.extent[0], 0.5 * heights.extent[1], relief, BASE]
    field.userdata = ((heights.grid - low) / relief).ravel()
    ground.type, ground.hfieldname, ground.pos = kinds.mjGEOM_HFIELD, GROUND, [0.0, 0.0, low]


def tie_polynomials(robot: Robot) -> dict[str, tuple[float, ...]]:
    """Return, by the joint of each swivel that follows a single one, its angle's coefficients (5,).

    They are of a polynomial of the leader's angle, MuJoCo's ``polycoef``; none, where one of them
    is no such polynomial.
    """
    if len(robot.drive.steered) != 1:
        return {}
    leader = robot.drive.steered[0].joint
    joint = robot.description.joint[leader]
    low, high = max(joint.lower, -MAX_STEERING), min(joint.upper, MAX_STEERING)
    angles = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.linspace(0.0, math.pi, 41))
    places = [follower_positions(robot.drive, {leader: angle}) for angle in angles.tolist()]
    found = {}
    for name in places[0]:
        wanted = [place[name] for place in places]
        fitted = polynomial.polyfit(angles, wanted, DEGREE)
        if np.abs(polynomial.polyval(angles, fitted) - wanted).max() > FIT:
            return {}
        found[name] = tuple(fitted.tolist())
    return found


def _tie(
    spec: Any,
    follower: str,
    leader: str,
    coefficients: Sequence[float],
    settings: ContactSettings,
) -> None:
    """Make a joint's position a polynomial of another's."""
    mujoco = mujoco_library()
    tie = spec.add_equality(name1=follower, name2=leader)
    tie.type, tie.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    tie.data[: len(coefficients)] = coefficients
    tie.solref, tie.solimp = [TIE_STEPS * settings.timestep, 1.0], TIE_SOLIMP
