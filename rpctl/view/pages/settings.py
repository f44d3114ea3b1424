"""The settings of a run in words: reference, laws, plant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from fnmatch import fnmatchcase
from pathlib import PurePath
from typing import Any

from rpctl.control.approach import Approach
from rpctl.control.error import Leash
from rpctl.control.unregistered import name_of, settings_of
from rpctl.simulation.merits.obstacles import OBSTACLE_SETTINGS
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.run.facts import RobotFacts
from rpctl.simulation.run.run import Run
from rpctl.view.scene.obstacles import obstacle_texts

JOINTS = "joints: "  # how the sentence on the joints' gains begins
JOINTS_LABEL = "Joints"  # of that sentence, too long for a row
NESTED_LAWS = ("base", "inner", "fallback")  # laws within laws
SHOWN_WITHIN = ("leash", "approach", "joint_horizon", "joint_horizon_dyn", "midpoint")
SETTING_LABELS = {
    "reference": "Reference",
    "kinematic": "Kinematic law",
    "dynamic": "Dynamic law",
    "base": "Law of the base",
    "inner": "Law within",
    "horizon": "Horizon h, s",
    "horizon_dyn": "Horizon h₁, s",
    "beta": "β",
    "steps": "Steps N",
    "dt": "Step, s",
    "period": "Time from solve to solve, s",
    "end_effector_radius": "End effector's radius, m",
    "base_radius": "Base's radius, m",
    "leash": "Leash, m",
    "bound": "Leash (m, rad)",
    "approach": "Approach from (m, rad)",
    "joint_horizon": "Joints' horizon h, s",
    "joint_horizon_dyn": "Joints' horizon h₁, s",
    "joint_gain": "Joints' gain k, 1/s",
    "midpoint": "M, h of the period's middle",
    "body_clearance": "Links keep clear by, m",
    "computing_time": "Computing time, s",
    "dropped": "Samples dropped, of 1",
    "lag": "Lag, s",
    "dead_time": "Dead time, s",
    "delay": "Delay, s",
    "smooth": "Reference smoothed by, m",
    "retime": "Reference retimed",
    "lever": "Lever, m",
    "damping": "Damping, m/s",
    "gain": "Gain k, 1/s",
    "softened": "Solves with a softened bound",
    "largest_lag": "Reference read late by, s",
    "duration": "Duration, s",
    "control_period": "Control period, s",
    "plant_step": "Integration step, s",
    "smoothing": "Smoothing ω₀, rad/s",
    "initial_error": "Initial error (m, m, rad)",
}
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


def setting_texts(run: Run) -> dict[str, str]:
    """Return the settings of a run as texts by their labels."""
    rows: dict[str, str] = {}
    for key, settings in _setting_groups(run):
        for name, value in settings:
            if name in NESTED_LAWS and is_dataclass(value):
                value = name_of(value)
            if isinstance(value, Leash | Approach):
                name = "bound" if isinstance(value, Leash) else name
                value = (value.distance, value.heading)
            if value in (None, ()) or isinstance(value, Mapping) or is_dataclass(value):
                continue
            if name not in OBSTACLE_SETTINGS:
                text = SETTING_LABELS.get(name, name.replace("_", " ").capitalize())
                rows[f"{text} ({key})" if text in rows else text] = setting_text(value)
        rows |= obstacle_texts(getattr(run.config, key)) if key in ("kinematic", "dynamic") else {}
        rows |= variation_texts(run.config.plant, run.robot) if key == "plant" else {}
    return rows


def _within(law: object) -> list[tuple[str, object]]:
    """Return the settings of a law within a law that a reader looks for."""
    inner = [getattr(law, name, None) for name in ("base", "inner")]
    found = [pair for each in inner if is_dataclass(each) for pair in settings_of(each).items()]
    return [(name, value) for name, value in found if name in SHOWN_WITHIN]


def _setting_groups(run: Run) -> Iterator[tuple[str, Sequence[tuple[str, object]]]]:
    """Yield the settings of a run, name and value, in groups, in the order that is shown."""
    settings, plant, output = run.config.run, run.config.plant, run.config.output
    for key in ("reference", "duration", "initial_error"):
        yield key, [(key, getattr(settings, key))]
    laws = ("kinematic",) if output is not None else ("kinematic", "dynamic")
    for key in laws:
        law = getattr(run.config, key)
        yield key, [(key, name_of(law)), *settings_of(law).items(), *_within(law)]
    if output is not None:
        own = [(f"lag of {name}", lag) for name, lag in output.lags.items()]
        times = [("lag", output.lag), *own, ("dead_time", output.dead_time)]
        yield "output", [("output", "velocity"), *times]
    joints = [each for each in run.law_sentences if each.startswith(JOINTS)]
    yield "joints", [("joints", each.removeprefix(JOINTS)) for each in joints]
    for key in ("control_period", "plant_step"):
        yield key, [(key, getattr(settings, key))]
    yield "run", [("smooth", settings.smooth), ("retime", settings.retime or None)]
    biases = [(f"bias of {name}", bias) for name, bias in plant.tau_bias.items()]
    biases += [(f"friction of {name}", each) for name, each in plant.joint_friction.items()]
    late = [("lag", plant.lag), *((f"lag of {name}", lag) for name, lag in plant.lags.items())]
    late.append(("dead_time", plant.dead_time))
    names = ("delay", "dropped", "computing_time")
    late += [(name, getattr(plant, name) or None) for name in names]
    yield "plant", [*biases, *late, ("believed", run.controller_model)]
    yield "kinematic_report", [*run.kinematic_report.items()]


def setting_text(value: Any) -> str:
    """Return a setting as text; of a file only its name, as reports are passed on."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(setting_text(item) for item in value)
    text = str(value)
    return PurePath(text).name if PurePath(text).is_absolute() else text


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
