"""The stresses of a battery: each an axis with a ladder of levels around the nominal one.

A level is a change of a configuration that ``rpctl track --config`` takes, so that every cell of a
battery is the run of a file. The controller knows of none of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import UnknownNameError
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.simulation.noise import Noise
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.carried_load import CarriedLoad

ROLLING, CONTACT = "rolling", "contact"  # kinds of plants
RADIUS = "radius"  # the stress that lifts wheels off the ground, or supports

# A base that localises itself in a map with a lidar, and reads its wheels and joints by encoders.
LOCALISATION = Noise(
    position=0.01, heading=0.005, joints=0.0005, speed=0.01, turn_rate=0.01, joint_rates=0.005
)
Change = Callable[[Plant, Robot, float], Plant]
Reason = Callable[[Robot], str | None]


@dataclass(frozen=True)
class Stress:
    """One axis of a battery.

    Attributes:
        name: What it is called on the command line.
        unit: Of its levels, as they are shown.
        levels: From one end to the other, the nominal one among them.
        nominal: The level of a run that nothing stresses.
        summary: What a level is, in words.
        change: Returns the plant of a robot at a level; None: the level is the ground's friction.
        why_not: Returns why a robot has no such stress, a clause; None where it has.
        drawn: Ends of what combinations draw from; None: those of the levels.
        whole: Whether only whole numbers are drawn.
        needs_slip: Whether it means nothing where wheels cannot slip.
    """

    name: str
    unit: str
    levels: tuple[float, ...]
    nominal: float
    summary: str
    change: Change | None
    why_not: Reason = lambda robot: None
    drawn: tuple[float, float] | None = None
    whole: bool = False
    needs_slip: bool = False

    def apply(self, config: Config, robot: Robot, level: float) -> Config:
        """Return a configuration at a level.

        Args:
            config: That of a run.
            robot: Its robot.
            level: In the unit of the stress.
        """
        if self.change is None:
            return config.with_run(friction=level)
        return replace(config, plant=self.change(config.plant, robot, level))

    def draw(self, share: float) -> float:
        """Return the level at a share (0 to 1) of the way from one end to the other."""
        low, high = self.drawn or (min(self.levels), max(self.levels))
        level = low + share * (high - low)
        return float(round(level)) if self.whole else float(f"{level:.3g}")

    def text(self, level: float) -> str:
        """Return a level as it is shown, without the unit."""
        if self.drawn is not None and level == self.nominal:
            return "none"
        return f"{level:+g}" if min(self.levels) < 0.0 and level else f"{level:g}"


def _payload(plant: Plant, robot: Robot, level: float) -> Plant:
    link = "" if robot.end_effector is not None else robot.description.root
    return replace(plant, payload=CarriedLoad(link, level)) if level else plant


def _radii(plant: Plant, robot: Robot, level: float) -> Plant:
    return replace(plant, radii={"*": 1.0 + 0.01 * level}) if level else plant


def _noise(plant: Plant, robot: Robot, level: float) -> Plant:
    return replace(plant, noise=Noise(*(level * each for each in astuple(LOCALISATION))))


def _no_effort_limits(robot: Robot) -> str | None:
    limited = bool(np.isfinite(robot.effort_limits).any())
    return None if limited else "its file has no effort limits"


def _no_wheels(robot: Robot) -> str | None:
    return None if robot.drive.base_speeds else "its base is fixed"


def _no_losses(robot: Robot) -> str | None:
    found = robot.losses
    some = found is not None and bool(np.any(found.damping) or np.any(found.friction))
    return None if some else "its file has no damping or friction of joints"


STRESSES = {
    each.name: each
    for each in (
        Stress(
            "payload", "kg", (0.0, 0.5, 1.0, 2.0, 5.0), 0.0,
            "a mass at the end effector, or in the root link's origin of a robot without one",
            _payload,
        ),
        Stress(
            "friction", "", (1.0, 0.7, 0.5, 0.35, 0.2), FRICTION,
            "coefficient between wheels and ground", None, _no_wheels, needs_slip=True,
        ),
        Stress(
            "delay", "ms", (0.0, 5.0, 10.0, 20.0, 50.0), 0.0,
            "from a measurement to the efforts it leads to",
            lambda plant, robot, level: replace(plant, delay=1e-3 * level),
        ),
        Stress(
            RADIUS, "%", (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0), 0.0,
            "that all wheels' radii differ from their description", _radii, _no_wheels,
        ),
        Stress(
            "encoders", "bits", (0.0, 16.0, 14.0, 12.0, 10.0), 0.0,
            "a turn of wheels and revolute joints, whose rates are differences",
            lambda plant, robot, level: replace(plant, encoder_bits=round(level)),
            drawn=(10.0, 16.0), whole=True,
        ),
        Stress(
            "noise", "x", (0.0, 1.0, 2.0, 4.0), 0.0,
            "times 1 cm, 5 mrad, 1 cm/s and 10 mrad/s of the base, .5 and 5 mrad(/s) of joints",
            _noise,
        ),
        Stress(
            "effort", "x", (1.0, 0.75, 0.5), 1.0,
            "times the effort limits, at which the actuators saturate",
            lambda plant, robot, level: replace(plant, effort=level), _no_effort_limits,
        ),
        Stress(
            "slope", "deg", (0.0, 2.0, 5.0, 8.0), 0.0, "up along the reference's x axis",
            lambda plant, robot, level: replace(plant, slope=(math.radians(level), 0.0)),
        ),
        Stress(
            "slope-across", "deg", (0.0, 2.0, 5.0, 8.0), 0.0, "up along the reference's y axis",
            lambda plant, robot, level: replace(plant, slope=(0.0, math.radians(level))),
        ),
        Stress(
            "losses", "x", (0.0, 1.0, 2.0, 3.0), 1.0, "times the file's damping and friction",
            lambda plant, robot, level: replace(plant, losses=level), _no_losses,
        ),
    )
}  # fmt: skip


def stresses_by_name(names: Sequence[str]) -> tuple[Stress, ...]:
    """Return stresses in the order of the names; all of them if there are none.

    Raises:
        UnknownNameError: There is no such stress.
    """
    for name in names:
        if name not in STRESSES:
            raise UnknownNameError("stress", name, STRESSES)
    return tuple(STRESSES[name] for name in dict.fromkeys(names or STRESSES))


def left_out(robot: Robot, plant: str, stress: Stress) -> str | None:
    """Return why a stress means nothing to a robot on a plant, a clause; None if it does.

    Args:
        robot: The robot.
        plant: Kind of the plant.
        stress: The stress.
    """
    if stress.needs_slip and plant == ROLLING:
        return "its wheels cannot slip"
    return stress.why_not(robot)
