"""The plants by name, as ``--plant`` and :func:`rpctl.track` take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rpctl.errors import UnknownNameError
from rpctl.robot.model import Robot
from rpctl.simulation.plant import Plant

PLANTS = ("ideal", "perturbed", "slipping", "contact")
MASS_RATIO = 1.1  # of what the controller takes the masses for: a battery, a tool, a payload
ROLLING_RESISTANCE = 0.02  # of the weight: a rubber tyre on carpet; hard floors take half
DELAY_S = 0.005  # s: a fieldbus and a drive's own loop


def plant_by_name(name: str, robot: Robot, given: Plant | None = None) -> Plant:
    """Return the plant of a name.

    Args:
        name: ``"ideal"``: the controller's model itself. ``"perturbed"``: it, with differences.
            ``"slipping"``: on tyres; ``"contact"``: in MuJoCo.
        robot: The robot.
        given: The differences; of a perturbed plant without any, those of :func:`perturbed_plant`.

    Raises:
        UnknownNameError: There is no such plant.
    """
    given = given or Plant()
    if name == "ideal":
        return Plant()
    if name == "perturbed":
        rolling = replace(given, kind="rolling")
        return perturbed_plant(robot) if rolling == Plant() else rolling
    if name not in PLANTS:
        raise UnknownNameError("plant", name, PLANTS)
    return replace(given, kind=name)


def perturbed_plant(robot: Robot) -> Plant:
    """Return a plant that is heavier than its controller knows, rolls less freely and acts late.

    The driven wheels share the rolling resistance of the robot's weight.

    Args:
        robot: The robot.
    """
    wheels = [wheel for wheel in robot.drive.wheels if wheel.joint in robot.actuators]
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    weight = mass * float(np.linalg.norm(robot.model.gravity.linear))
    friction = {
        wheel.joint: float(ROLLING_RESISTANCE * weight * wheel.radius / len(wheels))
        for wheel in wheels
    }
    return Plant(delay=DELAY_S, joint_friction=friction, masses={"*": MASS_RATIO})
