"""What Drake does with a robot by default, and what mends it, in Drake's own words."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.supports import find_supports
from rpctl.engines.drake.world import DEFAULT_FRICTION, DEFAULT_STEP, MENDED_STEP, STIFFNESS
from rpctl.engines.edited_urdf import edged_wheels, other_shapes
from rpctl.engines.switches import Switch
from rpctl.robot.model import Robot

ROUNDING = 1e-9  # by which moments may miss the triangle inequality, of the largest


def drake_switches(robot: Robot) -> tuple[Switch, ...]:
    """Return the switches that mean something in Drake, of a robot."""
    found = [
        Switch(
            "friction",
            f"its coefficient of friction is {DEFAULT_FRICTION:g}",
            "register the ground with CoulombFriction(MU/(2 − MU), MU/(2 − MU)), for of a pair it"
            " takes the harmonic mean",
        ),
        Switch(
            "timestep",
            f"its step is {1e3 * DEFAULT_STEP:g} ms",
            f"set MultibodyPlantConfig.time_step={MENDED_STEP:g}",
        ),
        Switch(
            "softness",
            "its contacts are springs of 1e6 N/m",
            f"set SceneGraphConfig.default_proximity_properties.point_stiffness={STIFFNESS:g}",
        ),
        *_inertia(robot),
        *_losses(robot),
    ]
    if edged_wheels(robot):
        fault = "a cylinder touches the ground at one point, which leaps from edge to edge"
        setting = "give the wheels <drake:ellipsoid> as <collision>"
        found.append(Switch("wheel", fault, setting))
    if find_supports(robot).parts:
        fault = "its supports hold the ground with friction"
        setting = "write <drake:mu_static value='0'/> and <drake:mu_dynamic value='0'/> into theirs"
        found.append(Switch("caster", fault, setting))
    if robot.drive.followers:
        fault = "nothing ties the swivels that one rod steers"
        found.append(Switch("mimic", fault, "add a constraint between them"))
    if other_shapes(robot):
        fault = "shapes besides wheels and supports collide with the ground and with each other"
        setting = "exclude them with CollisionFilterDeclaration().ExcludeWithin(…)"
        found.append(Switch("collisions", fault, setting))
    return tuple(found)


def _inertia(robot: Robot) -> tuple[Switch, ...]:
    """Return the switch of inertias for a file with one that Drake does not take as it is."""
    wrong = [link.name for link in robot.description.links if not _physical(link.inertia)]
    faults = [f"it puts a ball of water in place of {wrong[0]}'s inertia"] if wrong else []
    settings = ["write inertias that fulfil the triangle inequality"] if wrong else []
    guessed = robot.description.estimated_links
    if guessed:
        faults.append(f"{guessed[0]} weighs nothing")
        settings.append("write <inertial> for each link")
    if robot.armature.any():
        faults.append("it leaves out rotors")
        settings.append("call JointActuator.set_default_rotor_inertia")
    if not faults:
        return ()
    return (Switch("inertia", " and ".join(faults), " and ".join(settings)),)


def _physical(inertia: Array) -> bool:
    """Whether a body can have an inertia (3, 3): no moment exceeds the sum of the others."""
    moments = np.linalg.eigvalsh(inertia)
    slack = ROUNDING * float(np.abs(moments).max())
    return bool(moments[0] >= -slack and moments[2] <= moments[0] + moments[1] + slack)


def _losses(robot: Robot) -> tuple[Switch, ...]:
    """Return the switch of losses for a file that has any."""
    dry = [joint.name for joint in robot.description.joints if joint.friction]
    damped = [joint.name for joint in robot.description.joints if joint.damping]
    if not dry and not damped:
        return ()
    fault = (
        f"it leaves out the dry friction of {dry[0]}"
        if dry
        else f"it damps {damped[0]} as its file says, and the robot has no losses"
    )
    setting = "call joint.SetDamping(context, d + f/|rate|) at each step"
    return (Switch("losses", fault, setting if dry else "call joint.set_default_damping(0)"),)
