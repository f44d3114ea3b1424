"""Whether a robot stands at home on level ground, what bears it, and what holds its joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import ActuationError
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot

MIN_MARGIN = 0.02  # of the distance between the outermost contacts: a nudge takes as much
LEANS = "a bicycle leans, which the planar model ignores: something must hold it upright"
BALANCES = "it leans on two wheels: only a law that balances it holds it upright"


@dataclass(frozen=True)
class Standing:
    """A robot at rest at home.

    Attributes:
        fault: Why it does not stand, in words; empty if it does, or if that is not known.
        unknown: Why it is not known whether it stands, in words; empty if it is known.
        margin: How far inside the support polygon its centre of mass is, seen from above, m;
            negative outside; None where that is not known.
        least: The margin that it has to have, m.
        weakest: The contact that bears least.
        load: What that one bears, N.
    """

    fault: str
    unknown: str
    margin: float | None
    least: float
    weakest: str
    load: float


def stand_at_home(dynamics: ReducedDynamics) -> Standing | None:
    """Return how a robot stands at home, or None for a fixed base.

    Args:
        dynamics: Its dynamics.
    """
    robot = dynamics.robot
    if isinstance(robot, LeaningRobot):
        return _on_its_wheels(robot)
    contacts = find_contacts(dynamics)
    if contacts is None:
        return None
    if contacts.supports.unknown or robot.drive.type == "bicycle":
        unknown = contacts.notes[0] if contacts.supports.unknown else LEANS
        return Standing("", unknown, None, 0.0, "", 0.0)
    if not contacts.balanced:
        fault = f"only {', '.join(contacts.names)} touch the ground, on one line"
        return Standing(fault, "", None, 0.0, "", 0.0)
    tau = holding_at_home(dynamics)
    tau = np.zeros(len(robot.actuators)) if tau is None else tau
    ground = ground_reaction(dynamics, contacts, _home(robot), np.zeros(robot.dof), tau)
    points = contacts.points
    least = MIN_MARGIN * float(np.hypot(*(points[:, None] - points[None]).T).max())
    weakest = int(ground.load.argmin())
    name, load, margin = contacts.names[weakest], float(ground.load[weakest]), ground.tip_margin
    fault = ""
    if margin < 0.0:
        fault = f"its centre of mass lies {-margin:.3g} m outside the support polygon of " \
            f"{', '.join(contacts.names)}"  # fmt: skip
    elif margin < least:
        fault = f"its centre of mass lies {margin:.3g} m inside the support polygon, less than " \
            f"{least:.2g} m"  # fmt: skip
    elif name in robot.actuators and load <= contacts.floor:
        fault = f"{name} carries no load: it is driven, but does not touch the ground"
    return Standing(fault, "", margin, least, name, load)


def _on_its_wheels(robot: LeaningRobot) -> Standing:
    """Return how a robot stands that a law balances: no law helps beyond the ends of its axle."""
    q = _home(robot)
    points = robot.contacts(q)
    com = pin.centerOfMass(robot.model, robot.model.createData(), q)[:2]
    length = math.dist(*points)
    first = float((points[1] - com) @ (points[1] - points[0])) / length  # times the weight: moment
    margin, weakest = min((first, 0), (length - first, 1))
    if margin >= 0.0:
        return Standing("", BALANCES, None, 0.0, "", 0.0)
    names = [wheel.joint for wheel in robot.drive.wheels]
    fault = (
        f"its centre of mass lies {-margin:.3g} m beyond {names[1 - weakest]}: it lifts "
        f"{names[weakest]}"
    )
    load = margin / length * robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
    return Standing(fault, "", margin, 0.0, names[weakest], load)


def holding_at_home(dynamics: ReducedDynamics) -> Array | None:
    """Return what holds a robot's joints at home (n_act,), N·m or N; None where a motor is missing.

    Args:
        dynamics: Its dynamics.
    """
    q, still = _home(dynamics.robot), np.zeros(dynamics.robot.dof)
    try:
        return dynamics.efforts(q, dynamics.inverse(q, still, still))
    except ActuationError:
        return None


def _home(robot: Robot) -> Array:
    return robot.configuration(joints=dict(zip(robot.joint_names, robot.home, strict=True)))
