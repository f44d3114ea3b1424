"""What MuJoCo does with a robot's file by default, and the setting that mends it, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rpctl.dynamics.supports import find_supports
from rpctl.engines.mujoco.inertias import link_fault
from rpctl.engines.mujoco.mends import (
    HARD_SOLIMP,
    HARD_SOLREF,
    HARD_STEP_S,
    links_below,
    tie_polynomials,
)
from rpctl.engines.switches import Switch
from rpctl.equivalence.contact.shapes import tyre
from rpctl.equivalence.contact.ties import one_directional
from rpctl.robot.model import Robot

MAX_NAMED = 3  # names in a sentence
SOLREF = " ".join(f"{value:g}" for value in HARD_SOLREF)
SOLIMP = " ".join(f"{value:g}" for value in HARD_SOLIMP[:3])


def mujoco_switches(robot: Robot) -> tuple[Switch, ...]:
    """Return the switches that mean something in MuJoCo of a robot."""
    return tuple(_switches(robot))


def listed(names: Sequence[str]) -> str:
    """Return a few names in words."""
    more = len(names) - MAX_NAMED
    shown = names if more < 1 else [*names[:MAX_NAMED], f"{more} more"]
    *rest, last = shown
    return f"{', '.join(rest)} and {last}" if rest else last


def _switches(robot: Robot) -> Iterator[Switch]:
    yield _wheel(robot)
    yield from _caster(robot)
    yield Switch(
        "cone",
        "friction is a pyramid, stronger along some directions than along others",
        'set <option cone="elliptic"/>',
    )
    yield Switch(
        "friction",
        "friction is MuJoCo's own coefficient, 1",
        'set <geom friction="MU 0.005 0.0001"/> on the wheels and the ground',
    )
    yield from _inertia(robot)
    yield Switch(
        "softness",
        "contacts are soft (solref 0.02 s): wheels sink and creep",
        f'set <geom solref="{SOLREF}" solimp="{SOLIMP}"/> and <option impratio="0.1"/>',
    )
    yield Switch("timestep", "a step takes 2 ms", f'set <option timestep="{HARD_STEP_S:g}"/>')
    yield from _mimic(robot)
    yield from _losses(robot)
    yield Switch(
        "collisions",
        "links that overlap push each other apart, or rest on the ground",
        'set contype="0" conaffinity="0" on all but wheels and supports, or <contact><exclude/>',
    )


def _wheel(robot: Robot) -> Switch:
    """Return the switch of the wheels' shape."""
    wheels = [wheel for wheel in robot.drive.wheels if not wheel.slides]
    treads = [tyre(robot, wheel) for wheel in wheels]
    radius = max((tread.radius for tread in treads), default=0.0)
    half = max((tread.half_width for tread in treads), default=0.0)
    setting = (
        f'make them <geom type="ellipsoid" size="{radius:.4g} {radius:.4g} {half:.4g}"/>, z along '
        "the axle: crowned, they touch at one point"
    )
    bare = [wheel.joint for wheel in wheels if not _shapes(robot, wheel.joint)]
    if bare:
        return Switch("wheel", f"{listed(bare)} have no <collision> to roll on", setting)
    if any(one_directional(robot, wheel) for wheel in wheels):
        return Switch(
            "wheel",
            "solid wheels hold sideways where rollers would run",
            "model each roller as a body on its own hinge, or turn the contact's frame between "
            "mj_step1 and mj_step2",
        )
    kinds = sorted({kind for wheel in wheels for kind in _shapes(robot, wheel.joint)})
    drawn = (
        "hulls of meshes" if kinds == ["mesh"] else " and ".join(_plural(kind) for kind in kinds)
    )
    fault = f"wheels are {drawn} {2e3 * half:.3g} mm wide, which touch along a line and scrub"
    return Switch("wheel", fault, setting)


def _shapes(robot: Robot, joint: str) -> list[str]:
    """Return the kinds of the shapes that a wheel's joint carries."""
    links = links_below(robot, robot.description.joint[joint].child)
    return [shape.kind for name in links for shape in robot.description.link[name].collisions]


def _plural(kind: str) -> str:
    return f"{kind}es" if kind.endswith(("x", "h")) else f"{kind}s"


def _caster(robot: Robot) -> Iterator[Switch]:
    """Yield the switch of what slides over the ground."""
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
    fault = f"{listed(names)} {'drag' if len(names) > 1 else 'drags'} with friction"
    setting = 'set <geom condim="1" priority="1"/> there: they slide'
    if bare:
        have = "have" if len(bare) > 1 else "has"
        fault = f"{listed(bare)} {have} no <collision>, so nothing bears there"
        setting = f"draw them for collisions, too, and {setting.removesuffix(' there: they slide')}"
    yield Switch("caster", fault, setting)


def _inertia(robot: Robot) -> Iterator[Switch]:
    links = robot.description.links
    guessed = [link.name for link in links if link.mass is None and link.collisions]
    unphysical = [link.name for link in links if link_fault(link)]
    faults, settings = [], []
    if guessed:
        faults.append(f"{listed(guessed)} have no <inertial> and weigh 1000 kg/m³")
        settings.append('set <compiler inertiafromgeom="false"/>')
    if unphysical:
        faults.append(f"the inertias of {listed(unphysical)} are unphysical and get changed")
        settings.append("give the sum of the links fixed together to the body that moves")
    if robot.armature.any():
        faults.append("rotors have no inertia")
        settings.append('set <joint armature="..."/> to that of the <transmission>')
    if faults:
        yield Switch("inertia", "; ".join(faults), "; ".join(settings))


def _mimic(robot: Robot) -> Iterator[Switch]:
    followers = [swivel.joint for swivel in robot.drive.followers]
    if followers:
        yield Switch(
            "mimic",
            f"nothing holds {listed(followers)} to the common centre of rotation",
            _tie_setting(robot),
        )
    elif robot.mimics:
        yield Switch(
            "mimic",
            f"{listed([joint.name for joint in robot.mimics])} follow softly",
            f'set <equality><joint solref="{SOLREF}" solimp="{SOLIMP}"/></equality>',
        )


def _tie_setting(robot: Robot) -> str:
    """Return how followers are tied: by MuJoCo's equality, where it can."""
    ties = [
        f'<joint joint1="{name}" joint2="{robot.drive.steered[0].joint}" '
        f'polycoef="{" ".join(f"{c:.4g}" for c in polynomial)}"/>'
        for name, polynomial in tie_polynomials(robot).items()
    ]
    if ties:
        return f"set <equality>{''.join(ties)}</equality>"
    return "pull them by stiff springs to the angles that the others fix"


def _losses(robot: Robot) -> Iterator[Switch]:
    given = any(joint.damping or joint.friction for joint in robot.description.joints)
    if robot.losses is None and given:
        yield Switch(
            "losses",
            "joints lose by the file's <dynamics>, which the model leaves out",
            'set <joint damping="0" frictionloss="0"/>, or let the model lose as much',
        )
    elif robot.losses is not None:
        yield Switch(
            "losses",
            "joints lose by the file's <dynamics>, or nothing",
            'set <joint damping="..." frictionloss="..."/> to those of the model',
        )
