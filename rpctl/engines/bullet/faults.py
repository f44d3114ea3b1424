"""What PyBullet does with a robot by default, and the function and argument that mend it."""

from __future__ import annotations

from rpctl.dynamics.supports import find_supports
from rpctl.engines.bullet.world import DEFAULT_STEP, MENDED_STEP, SOLVER_ITERATIONS
from rpctl.engines.edited_urdf import edged_wheels, other_shapes
from rpctl.engines.switches import Switch
from rpctl.robot.model import Robot


def bullet_switches(robot: Robot) -> tuple[Switch, ...]:
    """Return the switches that mean something in PyBullet, of a robot."""
    found = [*_material(robot), *_solver()]
    if edged_wheels(robot):
        fault = "its wheels meet the plane with their width, and scrub"
        setting = "give the wheels <sphere> as <collision>, of the wheels' radius"
        found.append(Switch("wheel", fault, setting))
    if find_supports(robot).parts:
        fault = "its supports hold the ground with friction"
        found.append(
            Switch("caster", fault, "call changeDynamics(body, support, lateralFriction=0)")
        )
    if robot.mimics or robot.drive.followers:
        fault = "it leaves mimic joints and tie rods loose"
        setting = "call createConstraint(…, jointType=JOINT_GEAR) and changeConstraint(gearRatio=…)"
        found.append(Switch("mimic", fault, setting))
    if other_shapes(robot):
        fault = "shapes besides wheels and supports can touch the plane"
        setting = "call setCollisionFilterPair(body, plane, link, -1, 0) for them"
        found.append(Switch("collisions", fault, setting))
    return tuple(found)


def _material(robot: Robot) -> list[Switch]:
    """Return what concerns friction, inertia and losses."""
    massless = [link.name for link in robot.description.links if link.mass is None]
    root = robot.description.link[robot.description.root]
    guess = "it guesses inertias from collision shapes"
    if massless:
        guess += f", lets {massless[0]}, which has none, weigh 1 kg"
    if root.mass == 0.0:
        guess += f", nails the robot to the world since {root.name} weighs nothing"
    setting = "load it with flags=URDF_USE_INERTIA_FROM_FILE"
    if massless or root.mass == 0.0:
        setting += ", the root's own mass in <inertial>, and mass 0 where a fixed link has none"
    return [
        Switch(
            "losses",
            "a velocity motor holds each joint still, and the bodies of all links are braked by"
            " damping .04",
            "call setJointMotorControl2(body, joint, VELOCITY_CONTROL, force=0) and"
            " changeDynamics(body, link, linearDamping=0, angularDamping=0)",
        ),
        Switch("inertia", guess, setting),
        Switch(
            "friction",
            "its coefficient of friction is .5",
            "call changeDynamics(body, wheel, lateralFriction=MU)",
        ),
    ]


def _solver() -> list[Switch]:
    """Return what concerns steps and the solver.

    The pyramid that stands for the cone lies along the world's axes: it is right while nothing
    slips, and steers what slips towards them.
    """
    return [
        Switch(
            "cone",
            "its implicit friction cone lets the wheels of an axle push against each other until"
            " they slip",
            "call setPhysicsEngineParameter(enableConeFriction=0)",
        ),
        Switch(
            "timestep",
            f"its step is {1e3 * DEFAULT_STEP:.2g} ms",
            f"call setTimeStep(1/{round(1.0 / MENDED_STEP)})",
        ),
        Switch(
            "softness",
            "its solver stops after 50 iterations",
            f"call setPhysicsEngineParameter(numSolverIterations={SOLVER_ITERATIONS},"
            " solverResidualThreshold=1e-12)",
        ),
    ]
