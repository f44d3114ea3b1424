"""How the simulated robot differs from the one that the controller knows, in words."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase

from rpctl.simulation.facts import RobotFacts
from rpctl.simulation.noise import Noise
from rpctl.simulation.plant import Plant

DAMPING_UNITS = {"rad": "N·m·s/rad", "m": "N·s/m"}  # by the unit of a joint's position
SCALES = {"masses": "Mass", "inertias": "Inertia", "radii": "Radius"}
NOISES = {  # what is measured, and in what; {0}: as the joints' positions
    "position": ("position, x and y", "m"),
    "heading": ("heading", "rad"),
    "joints": ("joints' positions", "{0}"),
    "speed": ("speed", "m/s"),
    "turn_rate": ("turning rate", "rad/s"),
    "joint_rates": ("joints' rates", "{0}/s"),
}


def variation_texts(plant: Plant, robot: RobotFacts) -> dict[str, str]:
    """Return what a plant varies of its robot and of what is measured as texts by their labels.

    Args:
        plant: The plant; what it leaves as the controller knows it has no text.
        robot: The robot, which knows the units of its joints.
    """
    rows: dict[str, str] = {}
    for field, label in SCALES.items():
        rows |= {f"{label} of {name}": _times(s) for name, s in getattr(plant, field).items()}
        if field == "masses":
            rows |= {
                f"Centre of mass of {name}": f"moved by ({', '.join(f'{x:.6g}' for x in way)}) m"
                for name, way in plant.centres.items()
            }
    if plant.track != 1.0:
        rows["Track"] = _times(plant.track)
    for pattern, damping in plant.damping.items():
        unit = " or ".join(DAMPING_UNITS[unit] for unit in _units(robot, pattern))
        rows[f"Damping of {pattern}"] = f"{damping:.6g} {unit} more"
    return rows | dict(_noise_texts(plant.noise, robot))


def _times(scale: float) -> str:
    return f"{scale:.6g} times the model's"


def _noise_texts(noise: Noise, robot: RobotFacts) -> Iterator[tuple[str, str]]:
    """Yield label and standard deviation of each measured quantity that has noise."""
    units = _units(robot, "*", wheels=False)
    for name, (label, unit) in NOISES.items():
        if deviation := getattr(noise, name):
            text = " or ".join(dict.fromkeys(unit.format(each) for each in units))
            yield f"Noise of {label}", f"{deviation:.6g} {text}, standard deviation"


def _units(robot: RobotFacts, pattern: str, wheels: bool = True) -> list[str]:
    """Return the units of the positions of the joints that match; all where none is known.

    Args:
        robot: The robot.
        pattern: Of names of joints.
        wheels: Whether wheels are among the joints.
    """
    known = dict(zip(robot.joint_names, robot.units, strict=True))
    known |= dict.fromkeys(robot.steering_names, "rad")
    if wheels:
        known |= dict.fromkeys((wheel.joint for wheel in robot.drive.wheels), "rad")
    found = {unit for name, unit in known.items() if fnmatchcase(name, pattern)}
    return [unit for unit in DAMPING_UNITS if unit in found or not found]
