"""A law on one robot as a ROS 2 package: a chainable controller of ros2_control in C++."""

from __future__ import annotations

import json
import math
import re
import secrets
import shutil
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from rpctl import __version__
from rpctl.arrays import Array
from rpctl.control import estimation, safeguards, sampling
from rpctl.control.bandwidth import USUAL_PERIOD, knowing_delay
from rpctl.control.controller import Controller, ControllerOutput
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.output_groups import MAX_DEAD_TIME
from rpctl.control.twist_law import BaseLaw
from rpctl.control.velocity_output import OUTPUTS
from rpctl.derive.law_program import LawProgram, law_program, law_sheet
from rpctl.derive.program import Operations, program
from rpctl.derive.text import rendered
from rpctl.derive.write import c_estimate, c_law, c_source, closed_laws, comment, identifier
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_known, require_positive
from rpctl.files.writing import UNFINISHED, make_folder
from rpctl.reference.motion import ReferenceState, row_of
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import Robot

TEMPLATES = "ros2_control"
PLACE = "PACKAGE"  # in paths of templates: the package's name
DECLARED = re.compile(  # of C: types, and heads of functions
    r"^(typedef struct \{.*?^\} \w+;|(?:void|int) \w+\([^)]*\)(?=\s*\{))", re.DOTALL | re.MULTILINE
)
SAMPLES = 200
MAX_DRAWS = 20  # for each sample: a singular steering angle, or a limit of speed, makes one useless
TOLERANCE = 1e-10  # of commands, relative to the largest: a compiler may contract a b + c


@dataclass(frozen=True)
class Ros2Package:
    """A package that is written.

    Attributes:
        name: Of the package, and of the controller.
        folder: Where it is.
        operations: What a sample costs.
    """

    name: str
    folder: Path
    operations: Operations


def package_name(robot: Robot) -> str:
    """Return the name of a robot's package, as ROS wants it: a to z, digits, single underscores."""
    return re.sub("_+", "_", identifier(robot.name).lower()).strip("_") + "_controller"


def export_ros2_control(
    robot: Robot,
    folder: str | Path,
    kinematic: Any = "unified",
    dynamic: Any = "paper",
    period: float = USUAL_PERIOD,
    output: str = "effort",
    delay: float | None = None,
    rates: str | None = None,
) -> Ros2Package:
    """Write a ROS 2 package with a law as a controller of ros2_control, whole or not at all.

    Its README lists interfaces, topics and parameters, and what of it no ROS machine has run.

    Args:
        robot: The robot; its base moves.
        folder: Where; it must not be there.
        kinematic: The name of a law that is a formula (``"unified"``, ``"own.py:MyLaw"``), or
            such a law with settings of its own.
        dynamic: ``"paper"``, or that law with settings of its own.
        period: Control period, s.
        output: ``"effort"``, or ``"velocity"`` for motors that take speeds.
        delay: As of :class:`rpctl.Controller`, s: what the parameter of that name is unless it is
            set, and the gains that it leaves, which are compiled in.
        rates: As of :class:`rpctl.Controller`: what the parameter is unless it is set.

    Raises:
        RpctlError: The laws have no closed form, the base is fixed, or the folder cannot be made.
        UnknownNameError: A law or the output is not known.
    """
    require_known("output", [output], OUTPUTS)
    require_positive("period", period)
    require_known("kind of rates", [rates or "measured"], estimation.RATES)
    longest = MAX_DEAD_TIME if output == "effort" else 0.0
    if not 0.0 <= (delay or 0.0) <= longest:
        raise RpctlError(f"delay is {delay:g} s; give a time from 0 to {longest:g} s")
    folder = Path(folder)
    if folder.exists() or folder.is_symlink():
        raise RpctlError(f"{folder}: is there already; remove it, or give another --out")
    closed = closed_laws(robot, kinematic, dynamic)
    law, efforts = (knowing_delay(each, period, delay) for each in closed)
    if not robot.drive.base_speeds:
        raise RpctlError(f"{robot.name}: its base is fixed; joint_trajectory_controller moves arms")
    made = law_program(law_sheet(robot, law, efforts, period))
    estimate = c_estimate(made, output == "effort")
    sources = {"law": c_law(made), "model": c_source(robot), "estimate": estimate.text}
    lines = _samples(robot, law, efforts, made, output, delay)
    context = _context(made, output, type(law).__name__, "".join(sources.values()))
    context |= {"delay": delay or 0.0, "told": delay is not None, "rates": rates or "automatic"}
    context |= {"step": estimate.operations, "samples": (SAMPLES, len(lines))}
    texts = {path: rendered(template, context, quoted=json.dumps) for template, path in _paths()}
    texts |= {f"src/{file}.c": text for file, text in sources.items()}
    texts["test/samples.txt"] = "".join(lines)
    name = str(context["package"])
    _write(folder, {path.replace(PLACE, name): text for path, text in texts.items()})
    return Ros2Package(name, folder, made.operations)


def _paths() -> list[tuple[str, str]]:
    """Return each template with the path of what is made of it."""
    root, found = files("rpctl.derive") / "templates" / TEMPLATES, []
    folders = [("", root)]
    for path, folder in folders:
        for each in folder.iterdir():
            if each.is_dir():
                folders.append((f"{path}{each.name}/", each))
            else:
                made = f"{path}{each.name}".removesuffix(".jinja")
                found.append((f"{TEMPLATES}/{path}{each.name}", made))
    return sorted(found)


def _context(made: LawProgram, output: str, law: str, sources: str) -> dict[str, Any]:
    """Return what the templates say."""
    robot, package = made.law.robot, package_name(made.law.robot)
    limits = robot.velocity_limits if output == "velocity" else robot.effort_limits
    return {
        "version": __version__,
        "package": package,
        "guard": package.upper(),
        "name": identifier(robot.name),
        "title": comment(robot.name),
        "law": law,
        "operations": made.operations,
        "declared": [f"{text.removesuffix(';')};" for text in DECLARED.findall(sources)],
        "settings": made.law.settings,
        "dof": robot.dof,
        "actuators": robot.actuators,
        "joints": robot.joint_names,
        "positions": made.positions,
        "joint_positions": [made.positions.index(name) for name in robot.joint_names],
        "model_positions": [made.positions.index(name) for name in program(robot).positions],
        "limits": np.where(limits > 0.0, limits, math.inf).tolist(),
        "infinity": math.inf,
        "root": robot.description.root,
        "point": [*map(float, robot.drive.point), float(robot.drive.heading)],
        "sideways": robot.drive.omnidirectional,
        "steered": bool(robot.drive.steered),
        "velocity": output == "velocity",
        "output": output,
        "period": made.law.period,
        "rate": round(1.0 / made.law.period),
        "estimation": estimation,
        "safeguards": safeguards,
        "sampling": sampling,
        "longest_delay": MAX_DEAD_TIME,
        "sent": math.ceil((MAX_DEAD_TIME + sampling.LONGEST_SILENCE) / made.law.period) + 2,
        "finest": estimation.LatticeWatch(ReducedDynamics(robot), made.law.period).finest.tolist(),
        "tolerance": TOLERANCE,
    }


def _samples(
    robot: Robot,
    law: BaseLaw,
    efforts: PaperDynamic,
    made: LawProgram,
    output: str,
    delay: float | None,
) -> list[str]:
    """Return lines of samples: what is measured and asked for, and what the controller sends.

    Where efforts are sent, as many follow of a robot that is stuck, and whose rates are estimated.

    Raises:
        RpctlError: The controller has no answer at most states.
    """
    dynamics, rng, lines = ReducedDynamics(robot), np.random.default_rng(0), list[str]()
    state = _reference_near(robot, robot.random_configuration(rng), rng)
    given: dict[str, Any] = {
        "kinematic": replace(law, approach=None),
        "dynamic": efforts,
        "period": made.law.period,
        "compiled": False,
    }
    controller = Controller(robot, lambda t: state, **given)
    for k in range(MAX_DRAWS * SAMPLES):
        q, nu = robot.random_configuration(rng), 0.1 * rng.normal(size=robot.dof)
        state = _reference_near(robot, q, rng)
        controller.reset()  # no sample goes on from another
        sent = controller.step(k * made.law.period, q, nu)
        if sent.status == "ok":
            commands = expected_commands(dynamics, made.law.period, output, q, sent)
            lines.append(_line(numbers_of(dynamics, made, q, nu, state), commands))
        if len(lines) == SAMPLES:
            break
    else:
        raise RpctlError(
            f"{robot.name}: the law answers at {len(lines)} of {MAX_DRAWS * SAMPLES} random "
            "states, too few to prove a controller; rpctl track shows why"
        )
    controller = Controller(
        robot, lambda t: state, **given, delay=delay, rates="estimated",
        guards=safeguards.Guards(effort_rate=1e9),  # efforts beyond the limits are compared, too
    )  # fmt: skip
    nu = np.zeros(robot.dof)
    for k in range(SAMPLES if output == "effort" else 0):
        sent = controller.step(k * made.law.period, q, nu)
        lines.append(_line(numbers_of(dynamics, made, q, nu, state), sent.efforts))
    return lines


def numbers_of(
    dynamics: ReducedDynamics, made: LawProgram, q: Array, nu: Array, state: ReferenceState
) -> Array:
    """Return a sample as the package reads it: root pose, positions, rates, reference."""
    robot, row, n = dynamics.robot, row_of(state), 3 * len(dynamics.robot.joints)
    positions = [robot.joint_position(q, name) for name in made.positions]
    rates, base, arm, direction = dynamics.actuation(q).T @ nu, *np.split(row, [9, 9 + n])
    return np.concatenate([read_root(q), positions, rates, base, direction, arm])


def expected_commands(
    dynamics: ReducedDynamics, period: float, output: str, q: Array, sent: ControllerOutput
) -> Array:
    """Return the commands (n_act,) that the package sends where a controller sends efforts."""
    robot, command = dynamics.robot, sent.command
    if output == "effort":
        return np.clip(sent.efforts, -robot.effort_limits, robot.effort_limits)
    speeds = command.nu_d + 0.5 * period * command.nu_d_dot
    found, limits = dynamics.actuation(q).T @ speeds, robot.velocity_limits
    base = slice(0, len(found) - len(robot.joints))
    found[base] /= max(1.0, *np.abs(found[base] / limits[base]))
    return np.clip(found, -limits, limits)


def _line(*parts: Array) -> str:
    return " ".join(f"{number:.17g}" for number in np.concatenate(parts)) + "\n"


def _reference_near(robot: Robot, q: Array, rng: np.random.Generator) -> ReferenceState:
    """Return a reference that a robot at q could have."""
    twist, twist_dot = rng.normal(size=(2, 3)) * [0.5, 0.3 * robot.drive.omnidirectional, 0.4]
    pose = robot.base_pose(q) + rng.normal(size=3) * [0.05, 0.05, 0.1]
    _, rates, accelerations = arm = 0.1 * rng.normal(size=(3, len(robot.joints)))
    joints = robot.joint_positions(q) + arm[0]
    return ReferenceState(pose, twist, twist_dot, joints, rates, accelerations)


def _write(folder: Path, texts: dict[str, str]) -> None:
    """Write a folder of files, whole or not at all."""
    unfinished = folder.with_name(f".{folder.name}.{secrets.token_hex(8)}{UNFINISHED}")
    try:
        for path, text in texts.items():
            make_folder((unfinished / path).parent)
            (unfinished / path).write_text(text, encoding="utf-8")
        unfinished.rename(folder)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
