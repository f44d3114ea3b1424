"""How the simulated robot differs from the one that the controller knows, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

from rpctl.simulation.facts import RobotFacts
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
                f"Centre of mass of {name}": f"moved by {_vector(way)} m"
                for name, way in plant.centres.items()
            }
    if plant.track != 1.0:
        rows["Track"] = _times(plant.track)
    for pattern, damping in plant.damping.items():
        unit = " or ".join(DAMPING_UNITS[unit] for unit in _units(robot, pattern))
        rows[f"Damping of {pattern}"] = f"{damping:.6g} {unit} more"
    rows |= dict(_load_texts(plant)) | dict(_actuator_texts(plant, robot))
    return rows | dict(_sensor_texts(plant, robot))


def _times(scale: float) -> str:
    return f"{scale:.6g} times the model's"


def _load_texts(plant: Plant) -> Iterator[tuple[str, str]]:
    """Yield label and text of what the robot carries, of its ground and of what pushes it."""
    load = plant.payload
    if load.mass:
        place = f", {_vector(load.com)} m from its origin" if any(load.com) else ""
        yield "Payload", f"{load.mass:.6g} kg on {load.link or 'the end effector'}{place}"
    if any(plant.slope):
        along_x, along_y = plant.slope
        yield "Slope", f"rises by {along_x:.6g} rad along x and {along_y:.6g} rad along y"
    for k, each in enumerate(plant.wrenches, start=1):
        label = f"Push {k}" if len(plant.wrenches) > 1 else "Push"
        end = "to the end" if each.end is None else f"to {each.end:.6g} s"
        parts = [f"{_vector(each.force)} N"] if any(each.force) else []
        parts += [f"{_vector(each.moment)} N·m"] if any(each.moment) else []
        what = " and ".join(parts) or "nothing"
        yield label, f"{what} on {each.link}, from {each.start:.6g} s {end}"


def _actuator_texts(plant: Plant, robot: RobotFacts) -> Iterator[tuple[str, str]]:
    """Yield label and text of losses, and of what the actuators do with their commands."""
    if plant.losses != 1.0:
        yield "Losses of the joints", _times(plant.losses)
    if plant.effort != 1.0:
        yield "Saturation of efforts", f"at {plant.effort:.6g} times the model's limits"
    if plant.effort_lag:
        yield "Lag of efforts", f"{plant.effort_lag:.6g} s"
    for pattern, gap in plant.backlash.items():
        yield f"Backlash of {pattern}", f"{gap:.6g} {' or '.join(_units(robot, pattern))}"


def _sensor_texts(plant: Plant, robot: RobotFacts) -> Iterator[tuple[str, str]]:
    """Yield label and text of what is wrong with each measured quantity, and with its moment."""
    units = _units(robot, "*", wheels=False)
    for name, (label, unit) in NOISES.items():
        text = " or ".join(dict.fromkeys(unit.format(each) for each in units))
        if deviation := getattr(plant.noise, name):
            yield f"Noise of {label}", f"{deviation:.6g} {text}, standard deviation"
        if error := getattr(plant.sensor_bias, name):
            yield f"Constant error of {label}", f"{error:.6g} {text}"
    if plant.encoder_bits:
        yield "Encoders", f"{plant.encoder_bits} bits a turn, or a sliding joint's range"
    if plant.jitter:
        yield "Jitter of samples", f"{plant.jitter:.6g} s, standard deviation"


def _vector(entries: Sequence[float]) -> str:
    return f"({', '.join(f'{x:.6g}' for x in entries)})"


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
