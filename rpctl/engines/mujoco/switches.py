"""What MuJoCo does with a robot's file by default, and how to mend it, in a spec and in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Shape
from rpctl.drive.drive import Wheel
from rpctl.dynamics.stance import find_supports
from rpctl.engines.edited_urdf import collision_name, drawn_kinds, links_below
from rpctl.engines.engine import Mended, Switch
from rpctl.engines.mujoco.bodies import (
    body_inertia,
    head_link,
    link_fault,
    place_in_body,
)
from rpctl.engines.mujoco.user_load import GROUND, PREFIX
from rpctl.engines.mujoco.world import tie_polynomials
from rpctl.equivalence.contact.model import (
    IMPRATIO,
    SOLIMP,
    SOLREF,
    STEP_S,
    geom_size,
    support_shapes,
    tyre,
)
from rpctl.equivalence.contact.mujoco_body import (
    Touching,
    add_shape,
    add_tie,
    mujoco_library,
    one_directional,
)
from rpctl.errors import listed
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot

SELF, FLOOR = 1, 2  # bits of contype and conaffinity: the robot's own shapes, and the ground
MAX_NAMED = 3  # names in a sentence
SOLREF_WORDS = " ".join(f"{value:g}" for value in SOLREF)
SOLIMP_WORDS = " ".join(f"{value:g}" for value in SOLIMP[:3])


def mend(spec: Any, robot: Robot, mended: Mended, friction: float) -> Touching:
    """Mend the spec as the switches say, and return the geoms that touch the ground.

    Args:
        spec: The ``MjSpec``, of :func:`rpctl.engines.mujoco.user_load.load_as_user`.
        robot: The robot.
        mended: The mended switches.
        friction: Coefficient of friction between the robot and the ground.
    """
    mender = _Mender(spec, robot, mended)
    supports = list(support_shapes(robot, find_supports(robot)))
    tied = "mimic" in mended and mender.tie()
    mender.open_to_all()
    for wheel in robot.drive.wheels:
        mender.take_wheel(wheel)
    for name, link, shape in supports:
        mender.take_support(name, link, shape)
    if "collisions" in mended:
        mender.close()
    mender.set_contacts(friction)
    if "inertia" in mended:
        mender.give_inertias()
    wheels = [wheel.joint for wheel in robot.drive.wheels]
    contacts = (*wheels, *(name for name, _, _ in supports))
    return Touching(contacts, mender.owner, mender.crowned, tied)


class _Mender:
    """Edits the spec of a robot as a user loads it."""

    def __init__(self, spec: Any, robot: Robot, mended: Mended) -> None:
        self._spec, self._robot, self._mended = spec, robot, mended
        self._mujoco = mujoco_library()
        self.owner: dict[str, str] = {}
        self.crowned: dict[str, str] = {}

    def tie(self) -> bool:
        """Tie swivels to the one that they follow; return whether that is possible."""
        ties = tie_polynomials(self._robot)
        for name, coefficients in ties.items():
            add_tie(self._spec, name, self._robot.drive.steered[0].joint, coefficients)
        return bool(ties)

    def open_to_all(self) -> None:
        """Let all geoms collide, as by default, with different bits for robot and ground."""
        for geom in self._spec.geoms:
            geom.contype, geom.conaffinity = SELF, SELF | FLOOR
        ground = self._spec.geom(GROUND)
        ground.contype, ground.conaffinity = FLOOR, 0

    def take_wheel(self, wheel: Wheel) -> None:
        """Find the geoms of a wheel; if ``wheel`` is mended, replace them by a crowned one."""
        robot = self._robot
        drawn = [
            PREFIX + collision_name(link, k)
            for link in links_below(robot, robot.description.joint[wheel.joint].child)
            for k in range(len(robot.description.link[link].collisions))
        ]
        # A sliding ball is treated as a caster.
        crowned = ("caster" if wheel.slides else "wheel") in self._mended
        self._take(drawn, wheel.joint, replaced=crowned)
        if crowned:
            tread = tyre(robot, wheel)
            size = [tread.radius, tread.radius, tread.half_width]
            geom = self._touch(tread.link, wheel.joint, "ellipsoid", size, tread.pose)
            self.crowned[wheel.joint] = geom.name

    def take_support(self, name: str, link: str, shape: Shape) -> None:
        """Find the geoms of a support; if ``caster`` is mended, replace them by a sliding one."""
        shapes, sliding = self._robot.description.link[link].collisions, "caster" in self._mended
        drawn = [k for k, one in enumerate(shapes) if one.line == shape.line]
        names = [PREFIX + collision_name(link, k) for k in drawn]
        self._take(names, name, replaced=sliding)
        if sliding:
            self._touch(link, name, shape.kind, geom_size(shape), shape.origin).condim = 1

    def _take(self, names: list[str], contact: str, *, replaced: bool) -> None:
        """Assign geoms to a contact, or keep them from touching the ground."""
        for geom in filter(None, map(self._spec.geom, names)):
            if replaced:
                geom.conaffinity = SELF
            else:
                self.owner[geom.name] = contact

    def _touch(self, link: str, name: str, kind: str, size: list[float], pose: Array) -> Any:
        """Add a massless geom of a contact that touches the ground and nothing else."""
        # On the moving body: MuJoCo 3.14 misplaces geoms that are added to links that it fuses.
        head, place = place_in_body(self._robot, link)
        geom = add_shape(self._spec.body(PREFIX + head), PREFIX + name, kind, size, place @ pose)
        geom.mass = 0.0
        geom.contype, geom.conaffinity, geom.priority = 0, FLOOR, 1
        self.owner[geom.name] = name
        return geom

    def close(self) -> None:
        """Let only wheels and supports touch the ground, and exclude all other collisions."""
        for geom in self._spec.geoms:
            if geom.name != GROUND:
                geom.contype = 0
                geom.conaffinity = geom.conaffinity & FLOOR if geom.name in self.owner else 0

    def set_contacts(self, friction: float) -> None:
        """Set the cone, the friction, the softness and the step."""
        spec, mended, option = self._spec, self._mended, self._spec.option
        if "cone" in mended:
            option.cone = self._mujoco.mjtCone.mjCONE_ELLIPTIC
        if "timestep" in mended:
            option.timestep = STEP_S
        if "softness" in mended:
            option.impratio = IMPRATIO
            for soft in (*spec.geoms, *spec.equalities):
                soft.solref, soft.solimp = SOLREF, SOLIMP
            for joint in spec.joints:
                joint.solref_friction = SOLREF
        if "friction" in mended:
            for geom in spec.geoms:
                geom.friction[0] = friction
        if "mimic" in mended:
            for tie in spec.equalities:
                tie.solref, tie.solimp = SOLREF, SOLIMP
        option.disableflags |= int(self._mujoco.mjtDisableBit.mjDSBL_ISLAND)  # contacts are edited

    def give_inertias(self) -> None:
        """Give each moving body the inertia of all links fixed to it, and joints their rotors."""
        spec, robot, compiler = self._spec, self._robot, self._spec.compiler
        compiler.fusestatic = False  # nothing is left to fuse: fixed bodies are massless
        compiler.balanceinertia, compiler.boundmass, compiler.boundinertia = False, 0.0, 0.0
        compiler.inertiafromgeom = self._mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        for link in robot.description.links:
            body = spec.body(PREFIX + link.name)
            body.mass, body.ipos, body.inertia = 0.0, np.zeros(3), np.zeros(3)
            body.fullinertia, body.explicitinertial = np.full(6, np.nan), True
        for index in range(ROOT_JOINT, robot.model.njoints):
            inertia, _ = body_inertia(robot, index)
            inertia.put(spec.body(PREFIX + head_link(robot, index)))
        for name in robot.moving_joint_names:
            spec.joint(name).armature = float(robot.armature[robot.velocity_index(name)])


SAID = {  # what MuJoCo does by default with any robot, and how to mend it
    "cone": (
        "friction is a pyramid, stronger along some directions than along others",
        'set <option cone="elliptic"/>',
    ),
    "friction": (
        "friction is MuJoCo's own coefficient, 1",
        'set <geom friction="MU 0.005 0.0001"/> on the wheels and the ground',
    ),
    "softness": (
        "contacts are soft (solref 0.02 s): wheels sink and creep",
        f'set <geom solref="{SOLREF_WORDS}" solimp="{SOLIMP_WORDS}"/> and <option impratio="0.1"/>',
    ),
    "timestep": ("a step takes 2 ms", f'set <option timestep="{STEP_S:g}"/>'),
    "collisions": (
        "links that overlap push each other apart, or rest on the ground",
        'set contype="0" conaffinity="0" on all but wheels and supports, or <contact><exclude/>',
    ),
}


def mujoco_switches(robot: Robot) -> Iterator[Switch]:
    """Yield the switches that matter for a robot in MuJoCo."""
    for name, (fault, setting) in SAID.items():
        yield Switch(name, fault, setting)
    yield _wheel(robot)
    yield from _caster(robot)
    yield from _inertia(robot)
    yield from _mimic(robot)
    yield from _losses(robot)


def _wheel(robot: Robot) -> Switch:
    """Return the switch of the wheels' shape."""
    wheels = [wheel for wheel in robot.drive.wheels if not wheel.slides]
    treads = [tyre(robot, wheel) for wheel in wheels]
    radius = max((tread.radius for tread in treads), default=0.0)
    half = max((tread.half_width for tread in treads), default=0.0)
    setting = (
        f'make them <geom type="ellipsoid" size="{radius:.4g} {radius:.4g} {half:.4g}"/> with z '
        "along the axle: crowned wheels touch at one point"
    )
    bare = [wheel.joint for wheel in wheels if not drawn_kinds(robot, wheel.joint)]
    if bare:
        return Switch("wheel", f"{listed(bare, MAX_NAMED)} have no <collision> to roll on", setting)
    if any(one_directional(robot, wheel) for wheel in wheels):
        return Switch(
            "wheel",
            "solid wheels have lateral friction where rollers would roll",
            "model each roller as a body on its own hinge, or turn the contact's frame between "
            "mj_step1 and mj_step2",
        )
    kinds = sorted({kind for wheel in wheels for kind in drawn_kinds(robot, wheel.joint)})
    drawn = (
        "hulls of meshes" if kinds == ["mesh"] else " and ".join(_plural(kind) for kind in kinds)
    )
    fault = f"wheels are {drawn} {2e3 * half:.3g} mm wide, which touch along a line and scrub"
    return Switch("wheel", fault, setting)


def _plural(kind: str) -> str:
    return f"{kind}es" if kind.endswith(("x", "h")) else f"{kind}s"


def _caster(robot: Robot) -> Iterator[Switch]:
    """Yield the switch of supports and wheels that slide."""
    parts = find_supports(robot).parts
    names = [part.name for part in parts]
    names += [wheel.joint for wheel in robot.drive.wheels if wheel.slides]
    if not names:
        return
    bare = [
        part.name
        for part in parts
        if all(s.line != part.line for s in robot.description.link[part.link].collisions)
    ]
    fault = f"{listed(names, MAX_NAMED)} {'drag' if len(names) > 1 else 'drags'} with friction"
    slide = 'set <geom condim="1" priority="1"/>'
    setting = f"{slide} on them, so that they slide"
    if bare:
        have = "have" if len(bare) > 1 else "has"
        fault = (
            f"{listed(bare, MAX_NAMED)} {have} no <collision>, so nothing carries the load there"
        )
        setting = f"give them a <collision>, and {slide}"
    yield Switch("caster", fault, setting)


def _inertia(robot: Robot) -> Iterator[Switch]:
    links = robot.description.links
    guessed = [link.name for link in links if link.mass is None and link.collisions]
    unphysical = [link.name for link in links if link_fault(link)]
    faults = {}
    if guessed:
        fault = f"{listed(guessed, MAX_NAMED)} have no <inertial> and weigh 1000 kg/m³"
        faults[fault] = 'set <compiler inertiafromgeom="false"/>'
    if unphysical:
        fault = f"the inertias of {listed(unphysical, MAX_NAMED)} are unphysical and are changed"
        faults[fault] = "give the moving body the summed inertia of the links fixed to each other"
    if robot.armature.any():
        faults["rotors have no inertia"] = (
            'set <joint armature="..."/> to that of the <transmission>'
        )
    if faults:
        yield Switch("inertia", "; ".join(faults), "; ".join(faults.values()))


def _mimic(robot: Robot) -> Iterator[Switch]:
    followers = [swivel.joint for swivel in robot.drive.followers]
    if followers:
        fault = f"nothing holds {listed(followers, MAX_NAMED)} to the common centre of rotation"
        ties = [
            f'<joint joint1="{name}" joint2="{robot.drive.steered[0].joint}" '
            f'polycoef="{" ".join(f"{c:.4g}" for c in coefficients)}"/>'
            for name, coefficients in tie_polynomials(robot).items()
        ]
        springs = "hold them with stiff springs at the angles that follow from the others"
        setting = f"set <equality>{''.join(ties)}</equality>" if ties else springs
        yield Switch("mimic", fault, setting)
    elif robot.mimics:
        yield Switch(
            "mimic",
            f"{listed([joint.name for joint in robot.mimics], MAX_NAMED)} follow softly",
            f'set <equality><joint solref="{SOLREF_WORDS}" solimp="{SOLIMP_WORDS}"/></equality>',
        )


def _losses(robot: Robot) -> Iterator[Switch]:
    given = any(joint.damping or joint.friction for joint in robot.description.joints)
    if robot.losses is None and given:
        yield Switch(
            "losses",
            "joints have the losses of the file's <dynamics>, which the model ignores",
            'set <joint damping="0" frictionloss="0"/>, or give the model the same losses',
        )
    elif robot.losses is not None:
        yield Switch(
            "losses",
            "joints have the losses of the file's <dynamics>, or none",
            'set <joint damping="..." frictionloss="..."/> to those of the model',
        )
