"""Load a ``Robot`` from a file or a catalogue name; every fault, and all left out, is named."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpctl.description.density import fill
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.meshes.paths import check_meshes
from rpctl.description.records import Description, Joint
from rpctl.description.urdf.reader import read
from rpctl.description.xacro.expansion import lines_explained
from rpctl.drive.controls import read_controls, vendor_findings
from rpctl.drive.detect import detect
from rpctl.drive.drive import DRIVE_TYPES, Drive, DriveSpec, Swivel, Wheel, read_drive
from rpctl.drive.suspensions import hold_passive
from rpctl.errors import DescriptionError, Finding, require_known, require_within
from rpctl.robot.build import build, check, set_armature
from rpctl.robot.grippers import Gripper, find_end_effector, find_grippers, freeze_grippers
from rpctl.robot.home import with_home
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.link_boxes import link_boxes
from rpctl.robot.load_settings import LoadKeywords, LoadSettings
from rpctl.robot.losses import find_losses
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern, matching
from rpctl.robot.sources import Source, find_source

if TYPE_CHECKING:
    from typing import Unpack  # of Python 3.11; never imported when it runs


MAX_POSITION = 1e6  # rad or m: no joint is locked farther from 0


def load(
    source: str | Path,
    drive: Drive | str | Path | None = None,
    **settings: Unpack[LoadKeywords],
) -> Robot:
    """Load a robot.

    Args:
        source: A URDF, a .xacro file (its expressions run in confinement), or a name of the
            catalogue or of robot_descriptions (``rpctl robots``).
        drive: The drive, its type (``"differential"``, ...; see ``Drive``), or a drive file (TOML);
            None: detect it.
        **settings: The following keyword arguments.
        lock: Joints to freeze in addition to the catalogue's: name patterns (``"hand_*"``), at
            position 0, or ``{pattern: position}``, rad or m.
        density: Density, kg/m³, for estimating the inertia of links without <inertial> from their
            shapes; None: no estimate.
        end_effector: Link to track; None takes the end of the longest chain of moving joints.
        strict: Whether warnings and assumptions about the drive are errors.
        package_dirs: Packages, or folders that contain packages at any depth, which ``package://``
            and ``$(find ...)`` search first; then they search the workspace around the file and
            ROS's paths.
        xacro_args: Arguments of a .xacro file, by name; ``"env:NAME"`` sets a variable for
            ``$(env NAME)``, which does not see the environment.
        ignore_missing_packages: Whether to skip includes from packages that are not found.
        home: Start posture of the arm: ``{joint: position}`` (rad or m), or words:
            ``"NAME=POSITION"``, a state of an SRDF (``"robot.srdf:home"``), ``"auto"`` for a
            posture from which the arm can work, or ``"zero"``. Missing joints are at 0, or well
            inside their limits if the arm can work from there.
        free: Name patterns of joints that move although they are frozen by default (those of
            grippers, suspensions and the catalogue), and of wheels that belong to an arm.
        losses: Whether the file's damping and friction count; False: the ideal robot of [MS21].
        root: ``"free"``: the root link can pitch, roll and rise, on two wheels; ``"planar"``: it
            stays level. None: free if the robot stands on two wheels only.
        armature: Whether the rotors of the file's transmissions count (I n² on M's diagonal), or
            ``{pattern: I n²}`` (kg·m²; kg for prismatic joints) for other joints.

    Raises:
        DescriptionError: The file cannot be used; the message names each fault with its line.
        ExpansionError, DriveError: A .xacro file cannot be expanded; no drive, or more than one,
            was found.
        UnknownNameError: A name is not known; the message suggests similar ones.
    """
    return load_robot(source, LoadSettings.of(drive, **settings))


def load_robot(source: str | Path, settings: LoadSettings) -> Robot:
    """Load a robot, as :func:`load` does.

    Args:
        source: Its file, or a name.
    """
    place = find_source(source)
    with lines_explained(place.path):
        return assemble(place, read(place.path, place.read_settings(settings)), settings)


def assemble(source: Source, description: Description, settings: LoadSettings) -> Robot:
    """Return the robot of a description that was read already.

    Raises:
        RpctlError: As of :func:`load`.
    """
    if settings.density is not None:
        description = fill(description, settings.density)
    tree, drive, grippers, findings = _body(source, description, settings)
    description, joints = tree.description, _arm_joints(tree, drive)
    model = build(tree, drive.leans)
    set_armature(description, model, settings.rotors)
    end_effector = settings.end_effector
    if end_effector is None:
        end_effector, choice = find_end_effector(tree, drive, joints, grippers)
        findings += choice
    else:
        require_known("link", [end_effector], description.link)
    robot = (LeaningRobot if drive.leans else Robot)(
        name=source.name or description.name,
        source=source.name or str(source.path.resolve()),
        description=description,
        model=model,
        drive=drive,
        locked=tree.locked,
        joints=joints,
        end_effector=end_effector,
        findings=findings,
        loaded_with=replace(  # with which the robot loads again, its home left to with_home
            settings,
            lock=dict(tree.locked),
            end_effector=end_effector,
            package_dirs=tuple(map(str, description.read_with.package_dirs)),
            xacro_args=dict(description.read_with.xacro_args),
            home={},
        ),
        losses=find_losses(description, model) if settings.losses else None,
    )
    at_home = with_home(robot, settings.home)
    _refuse_doubts(source.path, at_home.findings[len(robot.findings) :], settings)
    return at_home


def _body(
    source: Source, description: Description, settings: LoadSettings
) -> tuple[FrozenTree, Drive, tuple[Gripper, ...], tuple[Finding, ...]]:
    """Return what is locked of a robot before it has a model, its wheels, grippers, and remarks."""
    drive = source.drive if settings.drive is None else settings.drive
    given = drive if isinstance(drive, Drive) else _specification(drive)
    moving = [joint.name for joint in description.joints if joint.moving]
    released = frozenset(
        name for pattern in settings.free for name in matching(pattern, moving, "joint to free")
    )
    tree = FrozenTree(description, _locked(moving, source.lock, released, settings.lock))
    controls = read_controls(description)
    tree, held = hold_passive(tree, given.type, released)
    grippers = find_grippers(tree)
    tree, frozen = freeze_grippers(tree, grippers, settings.free)
    lines = description.mesh_lines
    meshes = check_meshes(lines, description.mesh_paths) if lines else []
    findings = (*description.findings, *meshes, *_massless_movers(tree))
    _refuse_doubts(source.path, findings, settings)
    check(tree)
    if isinstance(given, Drive):
        found = replace(given, declared=("drive",))
    else:
        found = detect(tree, given, controls, released, settings.root)
        doubts = [Finding("warning", None, doubt) for doubt in found.doubts]
        _refuse_doubts(source.path, doubts, settings)
    tree, idle = _with_motors(tree, found)
    differences = (*vendor_findings(found, controls), *idle, *left_out(tree, found))
    _refuse_doubts(source.path, differences, settings)
    return tree, found, grippers, (*findings, *held, *frozen, *differences)


def _with_motors(tree: FrozenTree, drive: Drive) -> tuple[FrozenTree, tuple[Finding, ...]]:
    """Return a robot without limits of 0 where motors drive, and what limits of 0 mean besides.

    Zero says that nothing drives a joint; a transmission, a plugin or a drive file that has a motor
    there outweighs it, for nobody means a motor that cannot push.
    """
    rolling: list[Wheel | Swivel] = [*drive.wheels, *drive.swivels]
    base = {each.joint for each in rolling if each.driven}
    steering = {swivel.joint for swivel in drive.swivels if not swivel.trails}
    idle = [j for j in tree.description.joints if tree.is_free(j) and not (j.effort or j.mimic)]
    driven = {joint.name for joint in idle} & (base | tree.description.actuated)
    findings = []
    for joint in idle:
        said = f'effort limit of joint "{joint.name}" is 0'
        if joint.name in driven:
            text = (
                f"{said}, but a transmission, plugin or drive file has a motor there: rpctl "
                "ignores the limit; give one above 0"
            )
            findings.append(Finding("warning", joint.line, text))
        elif joint.name in steering:
            text = (
                f"{said}: no motor steers with it; give one above 0, or set driven = true of its "
                "[[swivel]] in a drive file"
            )
            findings.append(Finding("warning", joint.line, text))
        elif all(joint.name != each.joint for each in rolling):
            text = (
                f"{said}: no motor drives it, so it coasts and no law tracks it; --lock "
                f"{joint.name} holds it, or give one above 0 if a motor does"
            )
            findings.append(Finding("info", joint.line, text))
    if rolling and not base:
        text = (
            "nothing drives the base; give effort limits above 0 to the joints of its driven "
            "wheels, or set driven = true of each [[wheel]] in a drive file"
        )
        line = tree.description.joint[rolling[0].joint].line
        findings.append(Finding("warning", line, text))
    joints = tuple(
        replace(joint, effort=math.inf) if joint.name in driven else joint
        for joint in tree.description.joints
    )
    return FrozenTree(replace(tree.description, joints=joints), tree.locked), tuple(findings)


def _arm_joints(tree: FrozenTree, drive: Drive) -> tuple[Joint, ...]:
    """Return the free joints that are no wheels, swivels or mimics, in file order."""
    rolling = {wheel.joint for wheel in drive.wheels} | {s.joint for s in drive.swivels}
    return tuple(
        joint
        for joint in tree.description.joints
        if tree.is_free(joint) and joint.mimic is None and joint.name not in rolling
    )


def _specification(source: str | None) -> DriveSpec:
    """Return the drive that the name of a type or a drive file declares; None declares nothing."""
    if source is None:
        return DriveSpec()
    if Path(source).suffix or "/" in source:
        return read_drive(source)
    require_known("drive", [source], DRIVE_TYPES)
    return DriveSpec(source)


def _refuse_doubts(path: Path, findings: Iterable[Finding], settings: LoadSettings) -> None:
    """Raise every warning as an error, if that is wanted."""
    doubts = [replace(f, severity="error") for f in findings if f.severity == "warning"]
    if doubts and settings.strict:
        raise DescriptionError(path, doubts)


def _locked(
    moving: Sequence[str],
    defaults: Iterable[str],
    released: Collection[str],
    given: Mapping[str, float],
) -> dict[str, float]:
    """Return the positions (rad or m) of the joints that are locked, by name.

    Args:
        moving: The names of all moving joints.
        defaults: Patterns of those that the catalogue freezes.
        released: Names that are taken out of the defaults, not out of what the user locks.
        given: What the user locks: positions by pattern.
    """
    frozen = {name for pattern in defaults for name in moving if fnmatchcase(name, pattern)}
    locked = dict.fromkeys((n for n in moving if n in frozen and n not in released), 0.0)
    for pattern, position in given.items():
        require_within(f"the position of {pattern}", [position], MAX_POSITION)
    return locked | by_pattern(given, moving, "joint to lock")


def _massless_movers(tree: FrozenTree) -> list[Finding]:
    """Return a warning for each link that a free joint moves and that has no <inertial>."""
    description = tree.description
    moved = (description.link[joint.child] for joint in description.joints if tree.is_free(joint))
    return [
        Finding(
            "warning",
            link.line,
            f'link "{link.name}" moves but has no <inertial>; rpctl treats it as massless; add '
            "one" + (" or estimate it with --density" if link.collisions or link.visuals else ""),
        )
        for link in moved
        if link.mass is None
    ]


COMMENT = re.compile(rb"<!--(.*?)-->", re.DOTALL)
LOOP = re.compile(  # of a comment that says that the tree was cut out of a mechanism
    rb"four.?bar|kinematic loop|closed kinematic|loop.?(joint|closure)|cut open",
    re.IGNORECASE,
)
TRACK = re.compile(r"(^|_)(track|tread|crawler|caterpillar)s?(_|\d|$)", re.IGNORECASE)
CUT_OPEN = (
    "a URDF is a tree, so the model cuts the loop open and its parts move independently; --lock "
    "their joints, or give the dependent ones a <mimic>"
)
WORLDS = ("world", "map", "odom", "ground", "ground_plane")  # root links that are no robot's
MAX_ABOVE_GROUND_M = 0.02  # m; what lies no higher above the ground than this stands on it


def left_out(tree: FrozenTree, drive: Drive) -> tuple[Finding, ...]:
    """Return what the file says of a robot and its model does not have, in findings."""
    return (*_springs(tree), *_loops(tree), *_robots(tree, drive), *_tracks(tree, drive))


def _springs(tree: FrozenTree) -> Iterator[Finding]:
    for joint in filter(tree.is_free, tree.description.joints):
        if joint.name in tree.description.sprung:
            yield Finding(
                "warning",
                tree.description.sprung[joint.name],
                f'joint "{joint.name}" has a spring, which the model ignores: it moves freely; '
                f"--lock {joint.name} holds it",
            )


def _loops(tree: FrozenTree) -> Iterator[Finding]:
    """Yield the joints that simulators add between links that move, or a comment on a loop."""
    description, told = tree.description, False
    for each in description.document().xpath(
        "gazebo/joint[parent and child] | loop_joint[link1 and link2]"
        " | mujoco/equality/*[@body1 and @body2]"
    ):
        pair = [
            str(end).split("::")[-1].strip()
            for end in each.xpath("*/@link | parent/text() | child/text() | @body1 | @body2")
        ]
        if not all(name in description.link for name in pair):
            continue
        above = [{joint.name for joint in tree.free_joints(name)} for name in pair]
        if above[0] != above[1]:
            text = f'joint "{each.get("name")}" closes a loop from "{pair[0]}" to "{pair[1]}"'
            told = True
            yield Finding("warning", each.sourceline, f"{text}; {CUT_OPEN}")
    arm = any(tree.is_free(joint) and not joint.endless for joint in description.joints)
    for comment in COMMENT.finditer(description.raw) if arm and not told else ():
        word = LOOP.search(comment[1])
        if word is not None:
            line = 1 + description.raw.count(b"\n", 0, comment.start(1) + word.start())
            said = word[0].decode("utf-8", "replace")
            yield Finding("warning", line, f'a comment speaks of a loop ("{said}"); {CUT_OPEN}')
            return


def _robots(tree: FrozenTree, drive: Drive) -> Iterator[Finding]:
    """Yield that a root link such as "world" holds several bases with wheels."""
    description = tree.description
    if description.root.lower() not in WORLDS:
        return
    rolling = {wheel.joint for wheel in drive.wheels}
    bases = [
        joint
        for joint in description.child_joints[description.root]
        if any(below.name in rolling for below in description.below(joint))
    ]
    if len(bases) > 1:
        names = ", ".join(f'"{joint.child}"' for joint in bases)
        yield Finding(
            "warning",
            bases[1].line,
            f'link "{description.root}" holds {len(bases)} bases with wheels ({names}): they move '
            "as one rigid robot; give each robot a file of its own",
        )


def _tracks(tree: FrozenTree, drive: Drive) -> Iterator[Finding]:
    """Yield the links that are called tracks, are fixed to the base and stand on the ground."""
    description = tree.description
    for name, pose in tree.rigid_links(description.root) if drive.wheels else ():
        link = description.link[name]
        if not (TRACK.search(name) and (link.collisions or link.visuals)):
            continue
        places = ((pose @ at, half) for at, half in link_boxes(description, name))
        bottoms = (float(at[2, 3] - np.abs(at[2, :3]) @ half) for at, half in places)
        if min(bottoms, default=math.inf) <= drive.ground + MAX_ABOVE_GROUND_M:
            yield Finding(
                "warning",
                link.line,
                f'link "{name}" is fixed and stands on the ground, like a track that cannot run; '
                f"the model ignores it and rolls on {drive.wheels[0].joint} and the others",
            )
