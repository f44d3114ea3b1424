"""Export of a robot as an MJCF file that contains its URDF, and the check of such a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.engines.mujoco.certificate import MjcfCertificate
from rpctl.engines.mujoco.check import MjcfCheck, check_file, read_certified, same_model
from rpctl.engines.mujoco.export import MjcfExport, write_mjcf
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.errors import RpctlError
from rpctl.files.records import read_record, to_plain
from rpctl.robot.model import Robot
from rpctl.simulation.run.facts import RobotFacts, robot_facts
from rpctl.simulation.run.header import require_plain
from rpctl.simulation.run.run import load_robot


def export_mjcf(
    robot: Robot,
    path: str | Path,
    *,
    friction: float = FRICTION,
    wheel_width: float | None = None,
    meshes: bool = True,
    settings: ContactSettings | None = None,
) -> MjcfExport:
    """Write a robot as MJCF: motors with limits, wheels and casters that roll, sensors, visuals.

    MuJoCo reads the file back, and the model is compared with the reduced model and run before the
    file is written; with the certificate in the file, :func:`check_mjcf` can verify it again.

    Args:
        robot: The robot.
        path: The file; meshes go into the folder ``NAME_meshes`` beside it.
        friction: Coefficient of friction between wheels and ground.
        wheel_width: Width of cylindrical wheels, m, which scrub in turns; None: crowned wheels,
            which touch the ground at one point and roll like the model's.
        meshes: Whether to write visual meshes.
        settings: Contact settings; they replace ``wheel_width``.

    Returns:
        The comparisons; ``written`` is False if a row failed, and then no file is written.

    Raises:
        RpctlError: MuJoCo is not installed or cannot model the robot, or the file cannot be
            written.
    """
    if settings is None:
        shape = "crowned" if wheel_width is None else "cylinder"
        settings = ContactSettings(wheel_shape=shape, wheel_width=wheel_width)
    return write_mjcf(robot, Path(path), friction, settings, meshes, to_plain(robot_facts(robot)))


def check_mjcf(
    path: str | Path, robot: Robot | None = None, *, package_dirs: Sequence[str | Path] = ()
) -> MjcfCheck:
    """Verify an exported file again, and name what was edited in it.

    The robot is built from the URDF in the file. Of the files that it names, only the robot's own
    file is opened, if it is unchanged.

    Args:
        path: The file.
        robot: The robot to compare with; None: the robot in the file.
        package_dirs: Packages, or folders that contain packages, of the robot in the file.

    Returns:
        The comparisons and the edits; ``passed`` says whether the certificate holds.

    Raises:
        RpctlError: rpctl did not export this file.
    """
    file, certificate = read_certified(path)
    if robot is not None:
        return check_file(file, certificate, robot, given=True)
    kept, why = _kept_robot(certificate, package_dirs)
    found = check_file(file, certificate, kept)
    return found if kept is not None else replace(found, notes=(*found.notes, why))


def _kept_robot(
    certificate: MjcfCertificate, package_dirs: Sequence[str | Path]
) -> tuple[Robot | None, str]:
    """Return the robot that a file holds, or None and why it is not known."""
    if not certificate.facts:
        return None, "the file does not contain its robot; give the robot with --robot"
    try:
        robot = load_robot(_facts(dict(certificate.facts)), package_dirs)
    except RpctlError as fault:
        return None, f"the robot in the file cannot be loaded: {fault}"
    if not same_model(robot, certificate):
        return None, (
            "the robot was varied after it was loaded, and the file does not record how; rpctl "
            "compares only the numbers in the file"
        )
    return robot, ""


def _facts(plain: dict[str, Any]) -> RobotFacts:
    """Return the facts that plain values are.

    Raises:
        RpctlError: They are none.
    """
    faults = require_plain({"robot": plain})
    facts = None if faults else read_record(RobotFacts, plain, "robot", faults)
    faults += [] if facts is None else facts.faults()
    if facts is None or faults:
        raise RpctlError("; ".join(faults))
    return facts
