"""Load a ``Robot`` from a file or a catalogue name; every fault is named."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

from rpctl.description.density import fill
from rpctl.description.expansion import lines_explained
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.mesh_checks import check_meshes
from rpctl.description.records import Description, Joint
from rpctl.description.urdf import read
from rpctl.drive.controller_files import read_controls
from rpctl.drive.detect import detect
from rpctl.drive.drive import Drive
from rpctl.drive.drive_file import DRIVE_TYPES, DriveSpec, read_drive
from rpctl.drive.plugins import SimulatorTags
from rpctl.drive.suspensions import hold_passive
from rpctl.drive.vendor import vendor_findings
from rpctl.errors import DescriptionError, Finding, UnknownNameError, require_within
from rpctl.robot.armature import set_armature
from rpctl.robot.build import build, check
from rpctl.robot.end_effector import find_end_effector
from rpctl.robot.grippers import find_grippers, freeze_grippers
from rpctl.robot.home import with_home
from rpctl.robot.load_settings import LoadSettings
from rpctl.robot.losses import find_losses
from rpctl.robot.model import Robot
from rpctl.robot.names import find_source
from rpctl.robot.source import Source

MAX_POSITION = 1e6  # rad or m: no joint is locked farther from 0


def load(
    source: str | Path,
    drive: Drive | str | Path | None = None,
    lock: Iterable[str] | Mapping[str, float] = (),
    density: float | None = None,
    end_effector: str | None = None,
    strict: bool = False,
    package_dirs: Iterable[str | Path] = (),
    xacro_args: Mapping[str, object] | None = None,
    ignore_missing_packages: bool = False,
    home: str | Mapping[str, float] | Iterable[str] | None = None,
    free: Iterable[str] = (),
    losses: bool = True,
    armature: bool | Mapping[str, float] = False,
) -> Robot:
    """Load a robot.

    Args:
        source: A URDF path, a .xacro that becomes one (its expressions are run; what
            confines them: :func:`rpctl.description.expansion.expand`), or a name (``rpctl
            robots``): of the catalogue, or of robot_descriptions (``"fetch_description"``) if
            that package is installed and its cache filled.
        drive: The drive, its type (``"differential"``, ``"car-like"``, ...; see ``Drive``), or a
            drive file (TOML); None finds it.
        lock: Joints to freeze: name patterns (``"hand_*"``), at position 0, or ``{pattern:
            position}`` (rad or m). They add to those that the catalogue freezes.
        density: kg/m³ from which the shapes of links without <inertial> estimate their inertias;
            None leaves these links massless, or refuses them where a joint moves nothing else.
        end_effector: Link to track; None takes the end of the longest chain of moving joints,
            before its gripper.
        strict: Whether warnings are errors, and so are assumptions about the drive.
        package_dirs: Packages, or folders that hold packages, where ``package://`` and
            ``$(find ...)`` look first, at any depth (``~/ws/src``); the workspace around the file,
            ROS_PACKAGE_PATH and AMENT_PREFIX_PATH come after them.
        xacro_args: Values of the arguments (``<xacro:arg>``) of a .xacro, by name; ``"env:NAME"``
            is a variable for its ``$(env NAME)``, which sees none of the environment's.
        ignore_missing_packages: Whether what a .xacro includes from packages that are not found
            is left out.
        home: The posture of the arm that references start from: ``{joint: position}`` (rad or m),
            or words: ``"NAME=POSITION"``, a state of an SRDF (``"robot.srdf:home"``), ``"auto"``
            for a posture to work from, ``"zero"``. Joints left out are at 0, or the nearest
            position well inside their limits; where the arm is near a singular posture there, it
            takes one to work from.
        free: Name patterns of joints that are frozen by default and that are to move: those of
            grippers and of passive suspensions, and those that the catalogue freezes; and joints
            that look like wheels and are an arm's.
        losses: Whether the damping and friction of ``<dynamics>`` are part of the model; False is
            the ideal robot of [MS21].
        armature: Whether the rotors that the file's transmissions tell of turn with their joints
            (I n² on the diagonal of M), or ``{pattern: I n²}`` (kg·m², or kg where the joint
            slides) for the others.

    Raises:
        DescriptionError: The file cannot be used; every fault is named with its line.
        ExpansionError: A .xacro cannot be expanded.
        DriveError: No drive was found, or more than one.
        UnknownNameError: A name is not known; the nearest are suggested.
    """
    found = find_source(source)
    settings = found.read_settings(package_dirs, xacro_args, ignore_missing_packages)
    with lines_explained(found.path):
        description = read(found.path, settings)
        return assemble(
            found, description, drive, lock, density, end_effector, strict, home, free, losses,
            armature,
        )  # fmt: skip


def assemble(
    found: Source,
    description: Description,
    drive: Drive | str | Path | None = None,
    lock: Iterable[str] | Mapping[str, float] = (),
    density: float | None = None,
    end_effector: str | None = None,
    strict: bool = False,
    home: str | Mapping[str, float] | Iterable[str] | None = None,
    free: Iterable[str] = (),
    losses: bool = True,
    armature: bool | Mapping[str, float] = False,
) -> Robot:
    """Return the robot of a description that was read already; :func:`load` has the arguments.

    Args:
        found: What the description was read from.
        description: The description.
        drive: The drive; None finds it.
        lock: Joints to freeze.
        density: For links without inertia, kg/m³.
        end_effector: Link to track.
        strict: Whether warnings are errors.
        home: The posture of the arm that references start from.
        free: Patterns of joints that are not frozen by default.
        losses: Whether damping and friction are part of the model.
        armature: Of the rotors.

    Raises:
        RpctlError: As of :func:`load`.
    """
    path = found.path
    free = (free,) if isinstance(free, str) else tuple(free)
    asked = drive if drive is None or isinstance(drive, Drive) else str(drive)
    if density is not None:
        description = fill(description, density)
    tree = FrozenTree(description, _locked(description, found.lock, lock, free))
    given = _given(found.drive if drive is None else drive)
    tags, released = read_controls(description), _released(description, free)
    tree, held = hold_passive(tree, given.type, tags, released)
    grippers = find_grippers(tree)
    tree, frozen = freeze_grippers(tree, grippers, free)
    findings = (*description.findings, *check_meshes(description), *_massless_movers(tree))
    if strict:
        _refuse_doubts(path, findings)
    check(tree)
    drive = _drive(tree, given, strict, tags, released)
    differences = vendor_findings(drive, tags)
    if strict:
        _refuse_doubts(path, differences)
    model, joints = build(tree), _arm_joints(tree, drive)
    rotors = None if armature is False else {} if armature is True else dict(armature)
    set_armature(description, model, rotors)
    choice: tuple[Finding, ...] = ()
    if end_effector is None:
        end_effector, choice = find_end_effector(tree, drive, joints, grippers)
    elif end_effector not in description.link:
        raise UnknownNameError("link", end_effector, description.link)
    robot = Robot(
        name=found.name or description.name,
        source=found.name or str(path.resolve()),
        description=description,
        model=model,
        drive=drive,
        locked=tree.locked,
        joints=joints,
        end_effector=end_effector,
        findings=(*findings, *held, *frozen, *differences, *choice),
        loaded_with=LoadSettings(density, free=free, drive=asked, losses=losses, armature=rotors),
        losses=find_losses(description, model) if losses else None,
    )
    at_home = with_home(robot, home)
    if strict:
        _refuse_doubts(path, at_home.findings[len(robot.findings) :])
    return at_home


def _drive(
    tree: FrozenTree,
    given: Drive | DriveSpec,
    strict: bool,
    tags: SimulatorTags,
    free: Collection[str],
) -> Drive:
    """Return the drive that a user gives, or the one that is found; ``strict`` refuses doubts."""
    if isinstance(given, Drive):
        return replace(given, declared=("drive",))
    drive = detect(tree, given, tags, free)
    if strict:
        doubts = [Finding("warning", None, doubt) for doubt in drive.doubts]
        _refuse_doubts(tree.description.path, doubts)
    return drive


def _given(source: Drive | str | Path | None) -> Drive | DriveSpec:
    """Return the drive that a user gives, or what they say of it."""
    return source if isinstance(source, Drive) else _specification(source)


def _released(description: Description, free: Iterable[str]) -> frozenset[str]:
    """Return the names of the moving joints that patterns of ``free`` match."""
    moving = [joint.name for joint in description.joints if joint.moving]
    return frozenset(n for pattern in free for n in moving if fnmatchcase(n, pattern))


def _arm_joints(tree: FrozenTree, drive: Drive) -> tuple[Joint, ...]:
    """Return the free joints that are no wheels, swivels or mimics, in file order."""
    rolling = _rolling(drive)
    return tuple(
        joint
        for joint in tree.description.joints
        if tree.is_free(joint) and joint.mimic is None and joint.name not in rolling
    )


def _rolling(drive: Drive) -> set[str]:
    """Return the joints of wheels and swivels."""
    return {wheel.joint for wheel in drive.wheels} | {swivel.joint for swivel in drive.swivels}


def _specification(source: str | Path | None) -> DriveSpec:
    """Return the drive that the name of a type or a drive file declares; None declares nothing."""
    if source is None:
        return DriveSpec()
    if isinstance(source, str) and not Path(source).suffix and "/" not in source:
        if source not in DRIVE_TYPES:
            raise UnknownNameError("drive", source, DRIVE_TYPES)
        return DriveSpec(source)
    return read_drive(source)


def _refuse_doubts(path: Path, findings: Iterable[Finding]) -> None:
    """Raise every warning as an error."""
    doubts = [replace(f, severity="error") for f in findings if f.severity == "warning"]
    if doubts:
        raise DescriptionError(path, doubts)


def _locked(
    description: Description,
    defaults: Iterable[str],
    lock: Iterable[str] | Mapping[str, float],
    free: Iterable[str],
) -> dict[str, float]:
    """Return the positions (rad or m) of the joints that the patterns match, by name.

    Patterns of ``free`` take joints out of the defaults, not out of what the user locks.
    """
    moving = [joint.name for joint in description.joints if joint.moving]
    released = {name for pattern in free for name in _matching(moving, pattern, "joint to free")}
    frozen = {name for pattern in defaults for name in moving if fnmatchcase(name, pattern)}
    locked = dict.fromkeys((name for name in moving if name in frozen - released), 0.0)
    if isinstance(lock, str):
        lock = (lock,)
    wanted = lock if isinstance(lock, Mapping) else dict.fromkeys(lock, 0.0)
    for pattern, position in wanted.items():
        require_within(f"the position of {pattern}", [position], MAX_POSITION)
        names = _matching(moving, pattern, "joint to lock")
        locked.update(dict.fromkeys(names, float(position)))
    return locked


def _matching(names: Sequence[str], pattern: str, kind: str) -> list[str]:
    """Return the names that a pattern matches.

    Raises:
        UnknownNameError: There are none.
    """
    found = [name for name in names if fnmatchcase(name, pattern)]
    if not found:
        raise UnknownNameError(kind, pattern, names)
    return found


def _massless_movers(tree: FrozenTree) -> list[Finding]:
    """Return a warning for each link that a free joint moves and that has no <inertial>."""
    description = tree.description
    moved = (description.link[joint.child] for joint in description.joints if tree.is_free(joint))
    return [
        Finding(
            "warning",
            link.line,
            f'link "{link.name}" moves but has no <inertial>; it is taken as massless, give it'
            + (" or estimate it with --density" if link.collisions or link.visuals else ""),
        )
        for link in moved
        if link.mass is None
    ]
