"""A tricycle with an arm, and a log of it written by hand: every figure of it is known on paper.

Actual, desired and reference differ everywhere, and so do any two columns: whoever takes one for
another is found.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import rpctl
from rpctl import Robot, Run
from rpctl.arrays import Array
from rpctl.simulation.config import Config
from rpctl.simulation.loop.recorder import FELT
from rpctl.simulation.run.facts import GroundFacts, RobotFacts, reference_wheels
from rpctl.simulation.run.log import Log
from tests import urdf
from tests.runs import vary

WHEEL = 'cylinder radius="0.1" length="0.04"'


def _link(name: str, mass: float, shape: str, at: str = "", rpy: str = "") -> str:
    inertia = urdf.inertial(mass, (0.02, 0.03, 0.04))
    return urdf.link(name, inertia, urdf.shape(shape, "visual", at, rpy))


def _joint(name: str, kind: str, parent: str, xyz: str, axis: str, limit: str = "") -> str:
    return urdf.joint(name, kind, (parent, name.removesuffix("_joint")), xyz, axis, limit)


STEER, SWING, SLIDE = (
    urdf.limit(*values) for values in ((-0.5, 0.6, 15, 3), (-1.0, 1.5, 20, 2), (-0.1, 0.4, 80, 0.5))
)
DRIVEN = '<limit effort="40" velocity="5"/>'
TRICYCLE = urdf.robot(
    "golden",
    _link("base", 20.0, 'box size="0.9 0.4 0.1"', "0.2 0 0.1"),
    _link("left_wheel", 1.0, WHEEL, rpy=urdf.ROUND),
    _link("right_wheel", 1.5, WHEEL, rpy=urdf.ROUND),
    _link("steer", 0.5, 'box size="0.05 0.05 0.2"'),
    _link("front_wheel", 1.0, WHEEL, rpy=urdf.ROUND),
    _link("swing", 2.0, 'box size="0.4 0.06 0.06"', "0.2 0 0"),
    _link("slide", 1.0, 'box size="0.1 0.1 0.1"', "0.05 0 0"),
    _joint("left_wheel_joint", "continuous", "base", "-0.1 0.3 0.05", "0 1 0", DRIVEN),
    _joint("right_wheel_joint", "continuous", "base", "-0.1 -0.3 0.05", "0 1 0"),
    _joint("steer_joint", "revolute", "base", "0.7 0 0.25", "0 0 1", STEER),
    _joint("front_wheel_joint", "continuous", "steer", "0 0 -0.2", "0 1 0"),
    _joint("swing_joint", "revolute", "base", "0.1 0.05 0.45", "0 0 1", SWING),
    _joint("slide_joint", "prismatic", "swing", "0.4 0 0", "1 0 0", SLIDE),
)

TIMES: Array = 0.1 * np.arange(6.0)  # s
COUNT = len(TIMES)
QUASI_VELOCITIES = ("v", "steer_joint", "swing_joint", "slide_joint")
ACTUATORS = ("left_wheel_joint", "right_wheel_joint", "steer_joint", "swing_joint", "slide_joint")
EFFORT_LIMITS = (40.0, np.inf, 15.0, 20.0, 80.0)
VELOCITY_LIMITS = (5.0, np.inf, 3.0, 2.0, 0.5)
CONTACTS = ("front_wheel_joint", "left_wheel_joint", "right_wheel_joint")
CONTACT_POINTS = ((0.7, 0.0), (-0.1, 0.3), (-0.1, -0.3))
BOUND_LIMITS = (("left_wheel_joint", "effort"), ("slide_joint", "upper"))
WALL_TIME = 0.25  # s: half of the time that is simulated

# Longitudinal and lateral error, m: distances of 5, 0.5, 0.5, 0.13, 0.1 and 0.05 m.
BASE_ERRORS = ((3.0, 4.0), (-0.3, 0.4), (0.3, -0.4), (0.05, 0.12), (-0.06, -0.08), (0.03, -0.04))
HEADING_ERRORS = (0.9, -0.7, 0.5, -0.3, 0.2, -0.1)
SWING_ERRORS = (1.0, -0.5, 0.2, 0.1, -0.3, 0.2)  # rad
SLIDE_ERRORS = (-0.04, 0.03, 0.01, 0.005, 0.02, -0.01)  # m
# From the end effector to its reference, m: distances of 0.7, 0.3, 0.07, 0.03, 0.07 and 0.03 m.
TIP_ERRORS = (
    (0.2, 0.3, 0.6),
    (0.1, -0.2, 0.2),
    (0.02, 0.03, -0.06),
    (0.01, 0.02, 0.02),
    (0.02, -0.03, 0.06),
    (-0.01, 0.02, -0.02),
)
EFFORTS = (  # N·m, of the slide N; the largest share of a limit is 16 of 20
    (12.0, -50.0, 3.0, 4.0, 40.0),
    (-30.0, 20.0, -2.0, -16.0, 60.0),
    (10.0, 10.0, 1.0, 8.0, -56.0),
    (8.0, 5.0, -1.5, 6.0, 50.0),
    (6.0, -4.0, 0.5, 5.0, 45.0),
    (4.0, 3.0, -0.25, 4.5, 42.0),
)
WORK = (0.0, 1.0, -1.0, 3.0, 2.0, 4.0)  # J: swings over 5
LOST = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)  # J, by damping and friction
ENERGY_GAPS = (0.0, 0.1, -0.2, 0.05, 0.0, 0.1)  # J, of the energy to the work
TIP_MARGINS = (0.3, 0.25, 0.125, 0.15, 0.2, 0.28)  # m
SLIP_RATIOS = (0.1, 0.2, 0.15, 0.4, 0.3, 0.05)


ZMP_OFFSET_M: Array = np.array([0.05, -0.02])  # from P to the zero-moment point, m


def load_tricycle(folder: Path) -> Robot:
    """Return the tricycle, whose arm turns and slides.

    P is 0.1 m behind the root link, the ground 0.05 m below it, the front wheel 0.8 m ahead of P.
    """
    path = folder / "golden.urdf"
    path.write_text(TRICYCLE, encoding="utf-8")
    return rpctl.load(path)


def golden_run(robot: Robot) -> Run:
    """Return the log of the tricycle, written by hand."""
    k = np.arange(float(COUNT))
    q = np.array([_configuration(robot, *row) for row in _actual(k)])
    q_ref = np.array([_configuration(robot, *row) for row in _reference(k)])
    ee = _tips(robot, q)
    wheel_force = 1.0 + k[:, None] + 10.0 * np.array([1.0, -2.0, 3.0])  # N; front, left, right
    arrays: dict[str, Any] = {
        "t": TIMES,
        "q": q,
        "q_ref": q_ref,
        "nu": _speeds(k, 0.5),
        "nu_d": _speeds(k, 20.0),
        "nu_ref": _speeds(k, -7.0),
        "tau": np.array(EFFORTS),
        "rates": np.outer(k - 2.0, [0.5, -3.0, 0.7, -0.4, 0.1]),
        "base": np.array([robot.base_pose(row) for row in q]),
        "base_ref": np.array([robot.base_pose(row) for row in q_ref]),
        "joints": np.array([robot.joint_positions(row) for row in q]),
        "joints_ref": np.array([robot.joint_positions(row) for row in q_ref]),
        "steering": np.array([[robot.joint_position(row, "steer_joint")] for row in q]),
        "others": np.outer(k - 2.0, [0.05, 0.1]),  # beside the robot's own: a flap and a wheel
        "other_rates": np.outer(2.0 - k, [0.3, 0.5]),
        "e": np.column_stack([BASE_ERRORS, HEADING_ERRORS, SWING_ERRORS, SLIDE_ERRORS]),
        "ee": ee,
        "ee_ref": ee + TIP_ERRORS,
        "ee_angle": 0.01 * (6.0 - k),
        "energy": 10.0 + np.array(WORK) - np.array(LOST) + ENERGY_GAPS,
        "work": np.array(WORK),
        "lost": np.array(LOST),
        "nu_cmd": np.empty((COUNT, 0)),  # efforts are sent
        "constraint_residual": 1e-9 * np.array([1.0, 2.0, 3.0, 2.5, 1.5, 0.5]),
        "wheel_force": wheel_force,
        "axle_force": np.column_stack([6.0 + k, -4.0 - 2.0 * k]),  # of both rear wheels; front
        "contact_load": np.column_stack([80.0 + k, 60.0 + 0.0 * k, 120.0 - k]),
        "zmp": np.array([robot.base_pose(row)[:2] + ZMP_OFFSET_M for row in q]),
        "tip_margin": np.array(TIP_MARGINS),
        "slip_ratio": np.array(SLIP_RATIOS),
        "load_range": np.empty((COUNT, 0)),  # three contacts: statics tell each load
        "slip_range": np.empty((COUNT, 0)),
        "wheels_ref": np.zeros((COUNT, 4)),
        "turns": np.zeros(COUNT),
        **dict.fromkeys(FELT, np.empty((COUNT, 0))),  # wheels that roll
        "active_limits": np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0, 0], [1, 0]], float),
    }
    return Run(
        log=Log(arrays, BOUND_LIMITS),
        bound_limits=BOUND_LIMITS,
        robot=_robot_facts(robot),
        ground=GroundFacts(CONTACTS, CONTACT_POINTS, ((1, 2), (0,)), (), friction=0.7, wheels=3),
        config=Config(),
        controller_model=None,
        kinematic_report={"softened": 3.0},
        notes=(),
        certificate=None,
        wall_time=WALL_TIME,
    )


def part(run: Run, samples: slice | Array, shift: float = 0.0, t: Any = None) -> Run:
    """Return some samples of a run, later by a time that no page should tell, or at other times."""
    arrays: dict[str, Any] = {n: a[samples] for n, a in run.log.arrays().items()}
    return vary(run, **{**arrays, "t": arrays["t"] + shift if t is None else t})


def beside_its_path(run: Run) -> Run:
    """Return the run with P 20 mm to the left of a straight path and, soon, a sample late.

    The reference drives 0.1 m from sample to sample, so P is 0.1 s and 0.1 m behind.
    """
    x = 0.1 * np.arange(COUNT)
    reference = np.column_stack([x, 0.0 * x, 0.0 * x])
    beside = reference[[0, 0, 1, 2, 3, 4]] + np.array([0.0, 0.02, 0.0])
    return vary(run, base=beside, base_ref=reference)


def speeds(first: float, slope: float) -> Array:
    """Return a quasi-velocity of the log (K,), or what its reference or law asks of it."""
    return np.asarray(first + slope * np.arange(COUNT))


def _robot_facts(robot: Robot) -> RobotFacts:
    return RobotFacts(
        name=robot.name,
        source=robot.source,
        urdf_sha256=robot.description.sha256,
        locked={},
        drive=robot.drive,
        density=None,
        package_dirs=(),
        xacro_args={},
        ignore_missing_packages=False,
        home={},
        free=(),
        payloads=(),
        losses=True,
        armature=None,
        quasi_velocities=QUASI_VELOCITIES,
        actuators=ACTUATORS,
        joint_names=("swing_joint", "slide_joint"),
        units=("rad", "m"),
        effort_limits=EFFORT_LIMITS,
        velocity_limits=VELOCITY_LIMITS,
        lower_limits=(-1.0, -0.1),
        upper_limits=(1.5, 0.4),
        steering_names=("steer_joint",),
        steering_limits=((-0.5, 0.6),),
        other_names=("flap_joint", "idle_wheel_joint"),
        other_limits=((-0.3, 0.4, 2.5), (-math.inf, math.inf, 6.0)),
        end_effector="slide",
        urdf="",
        file_sha256=robot.description.sha256,
        nq=robot.nq,
        wheels_ref=reference_wheels(robot),
        rebuilds=False,
    )


def _actual(k: Array) -> Array:
    """Return x, y, heading, wheels (left, right, front), steering, arm of the robot, a row each."""
    return np.column_stack(
        [0.2 * k, 0.03 * k**2, 0.3 * k, 1.1 * k, 0.9 * k, -0.7 * k, 0.1 * k, 0.2 * k, 0.05 * k]
    )


def _reference(k: Array) -> Array:
    """Return the same of the reference robot: elsewhere, its joints elsewhere as well."""
    return np.column_stack(
        [
            0.3 * k + 0.5,
            0.4 - 0.05 * k,
            -0.2 * k - 0.1,
            0.5 * k,
            0.4 * k,
            0.3 * k,
            -0.05 * k - 0.1,
            0.6 - 0.3 * k,
            0.35 - 0.06 * k,
        ]
    )


def _configuration(robot: Robot, x: float, y: float, theta: float, *positions: float) -> Array:
    names = ("left_wheel_joint", "right_wheel_joint", "front_wheel_joint", "steer_joint")
    joints = dict(zip((*names, "swing_joint", "slide_joint"), positions, strict=True))
    return robot.configuration(x, y, theta, joints=joints)


def _tips(robot: Robot, q: Array) -> Array:
    data = robot.model.createData()
    frame = robot.model.getFrameId("slide", pin.FrameType.BODY)
    places = []
    for row in q:
        pin.forwardKinematics(robot.model, data, row)
        places.append(pin.updateFramePlacement(robot.model, data, frame).translation.copy())
    return np.array(places)


def _speeds(k: Array, first: float) -> Array:
    """Return quasi-velocities (K, 4); any two columns and any two starts give other numbers."""
    return np.column_stack([first + 0.1 * k, first - 0.2 * k, first + 0.37 * k, first - 0.55 * k])
