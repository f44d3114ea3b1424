"""``build``: a robot as MuJoCo's ``MjSpec``, free on a ground with friction.

No equation says that a wheel rolls, and none that the robot stays upright: wheels are bodies that
friction turns (E. Todorov, "Convex and analytically-invertible dynamics with contacts and
constraints", ICRA 2014). The model is plain: any MuJoCo runs it, without callbacks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rpctl.engines.mujoco.bodies import add_bodies, add_motors
from rpctl.engines.mujoco.even import even_contacts
from rpctl.engines.mujoco.heights import BASE, LEAST, Heights, read_heights
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.rollers import NOTE, add_rollers, has_rollers
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.ties import Follower, tie_followers, tie_mimics
from rpctl.engines.mujoco.touch import GRIP, GROUND, add_drawn, add_supports, add_wheels
from rpctl.errors import RpctlError, require_positive
from rpctl.robot.model import Robot


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
        followers: Swivels whose ties change as the robot steers; see
            :mod:`rpctl.engines.mujoco.ties`.
        notes: What was assumed, in sentences.
        repairs: What of the file was mended, in sentences.
        heights: Of the ground; None: it is the plane z = 0.
    """

    spec: Any
    contacts: tuple[str, ...]
    geoms: Mapping[str, str]
    followers: tuple[Follower, ...]
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

    Args:
        robot: The robot.
        settings: How it meets the ground.
        friction: Coefficient between wheels and ground.

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
    geoms, notes = _add_wheels(spec, robot, settings, friction)
    geoms |= add_supports(spec, robot, settings, friction)
    drawn = add_drawn(spec, robot, settings, friction)
    tie_mimics(spec, robot, settings)
    followers, ties = tie_followers(spec, robot, settings)
    contacts = tuple(dict.fromkeys(geoms.values()))
    rollers = geoms.keys() - set(contacts)  # they have hard contacts of their own
    even_contacts(spec, [pair.name for pair in spec.pairs if pair.name not in rollers])
    return Built(spec, contacts, geoms, followers, (*notes, *drawn, *ties), repairs, heights)


def _add_wheels(
    spec: Any, robot: Robot, settings: ContactSettings, friction: float
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Add the wheels, or their rollers."""
    if not has_rollers(robot):
        return add_wheels(spec, robot, settings, friction)
    owners: dict[str, str] = {}
    for wheel in robot.drive.wheels:
        owners |= add_rollers(spec, robot, wheel, settings, friction)
    return owners, (NOTE,)


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
