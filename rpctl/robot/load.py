"""``load``: from a file or a name to a ``Robot``, with every fault named."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pinocchio as pin

from rpctl.errors import DescriptionError, Finding, UnknownNameError
from rpctl.robot import catalog
from rpctl.robot.description import Description, Joint
from rpctl.robot.drive import FIXED, Drive, detect
from rpctl.robot.model import Robot
from rpctl.robot.urdf import read

SINGULAR = 1e-12  # least eigenvalue of M with its diagonal scaled to one; below is rounding


def load(
    source: str | Path,
    drive: Drive | None = None,
    lock: Iterable[str] | Mapping[str, float] = (),
    end_effector: str | None = None,
) -> Robot:
    """Load a robot.

    Args:
        source: A URDF path or a catalogue name (``rpctl robots``).
        drive: The drive; None finds it.
        lock: Joints to freeze: name patterns (``"hand_*"``), at position 0, or ``{pattern:
            position}`` (rad or m). They add to those that the catalogue freezes.
        end_effector: Link to track; None takes the end of the longest chain of moving joints.

    Raises:
        DescriptionError: The file cannot be used; every fault is named with its line.
        DriveError: No drive was found, or more than one.
        UnknownNameError: A name is not known; the nearest are suggested.
    """
    path, entry = _resolve(source)
    description = read(path)
    locked = _locked(description, entry.lock if entry else (), lock)
    if drive is None:
        fixed = entry is not None and entry.base == "fixed"
        drive = FIXED if fixed else detect(description, locked)
    model, findings = _build(description, locked)
    _require_inertia(description, model)
    wheels = {wheel.joint for wheel in drive.wheels}
    joints = tuple(
        joint
        for joint in description.joints
        if joint.moving
        and joint.mimic is None
        and joint.name not in wheels
        and joint.name not in locked
    )
    if end_effector is not None and end_effector not in description.link:
        raise UnknownNameError("link", end_effector, description.link)
    return Robot(
        name=entry.name if entry else description.name,
        source=entry.name if entry else str(path.resolve()),
        description=description,
        model=model,
        drive=drive,
        locked=locked,
        joints=joints,
        end_effector=end_effector or _tip(description, joints),
        findings=description.findings + findings,
    )


def _resolve(source: str | Path) -> tuple[Path, catalog.Entry | None]:
    """Return the file of a path or a catalogue name; a bare word is a name if it can be one."""
    path = Path(source)
    if isinstance(source, Path) or path.suffix or "/" in source:
        return path, None
    if path.is_file() and source not in catalog.names():
        return path, None
    entry = catalog.find(source)
    return entry.path, entry


def _locked(
    description: Description,
    defaults: Iterable[str],
    lock: Iterable[str] | Mapping[str, float],
) -> dict[str, float]:
    wanted = dict.fromkeys(defaults, 0.0)
    if isinstance(lock, str):
        lock = (lock,)
    wanted.update(lock if isinstance(lock, Mapping) else dict.fromkeys(lock, 0.0))
    moving = [joint.name for joint in description.joints if joint.moving]
    locked: dict[str, float] = {}
    for pattern, position in wanted.items():
        names = [name for name in moving if fnmatchcase(name, pattern)]
        if not names and pattern not in defaults:
            raise UnknownNameError("joint to lock", pattern, moving)
        locked.update(dict.fromkeys(names, float(position)))
    return locked


def _build(
    description: Description, locked: dict[str, float]
) -> tuple[pin.Model, tuple[Finding, ...]]:
    """Return the model with a planar root and the locked joints frozen, and what was noticed."""
    _require_mass(description, locked)
    full = pin.buildModelFromXML(description.xml, pin.JointModelPlanar())
    if not locked:  # buildReducedModel refuses a link and a joint of one name; do without it
        return full, _ignored_losses(description)
    at = pin.neutral(full)
    for name, position in locked.items():
        joint = full.joints[full.getJointId(name)]
        two = joint.nq == 2
        at[joint.idx_q : joint.idx_q + joint.nq] = (
            (math.cos(position), math.sin(position)) if two else (position,)
        )
    model = pin.buildReducedModel(full, [full.getJointId(name) for name in locked], at)
    return model, _ignored_losses(description)


def _ignored_losses(description: Description) -> tuple[Finding, ...]:
    lossy = [j for j in description.joints if j.moving and (j.damping or j.friction)]
    if not lossy:
        return ()
    text = f"damping and friction of {len(lossy)} joints are left out: rigid bodies, no losses"
    return (Finding("info", lossy[0].line, text),)


def _require_mass(description: Description, locked: dict[str, float]) -> None:
    """Refuse a joint that moves no mass: the inertia matrix would be singular.

    Raises:
        DescriptionError: Naming each such joint and the links that lack an inertia.
    """
    faults = []
    for joint in description.joints:
        if not joint.moving or joint.name in locked:
            continue
        carried, edge = [], [joint.child]
        while edge:
            link = edge.pop()
            carried.append(link)
            edge.extend(below.child for below in description.child_joints[link])
        masses = [description.link[name].mass for name in carried]
        if any(masses):
            continue
        first = description.link[joint.child]
        lacking = "has no <inertial>" if first.mass is None else "has no mass"
        faults.append(
            Finding(
                "error",
                first.line,
                f'link "{first.name}" {lacking}, yet joint "{joint.name}" moves it; give its '
                "<inertial> (mass, centre of mass, inertia), or freeze the joint with --lock "
                f"{joint.name}",
            )
        )
    if not any(link.mass for link in description.links):
        root = description.link[description.root]
        text = "no link has a mass; dynamics need <inertial> elements"
        faults.insert(0, Finding("error", root.line, text))
    if faults:
        raise DescriptionError(description.path, faults)


def _require_inertia(description: Description, model: pin.Model) -> None:
    """Refuse a robot whose inertia matrix is not positive definite: its forces say no motion.

    Raises:
        DescriptionError: Naming the joint that can move without a force.
    """
    M = pin.crba(model, model.createData(), pin.neutral(model))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(scale[:, None] * M * scale)
    if values[0] > SINGULAR:
        return
    index = int(np.abs(vectors[:, 0]).argmax())
    names = ("root", *model.names[2:])
    joint = next(n for n, j in zip(names, model.joints[1:], strict=True) if index < j.idx_v + j.nv)
    line = description.joint[joint].line if joint in description.joint else None
    text = (
        f'the inertia matrix is not positive definite: joint "{joint}" moves links of no or '
        "negative inertia; correct their <inertial>"
    )
    raise DescriptionError(description.path, [Finding("error", line, text)])


def _tip(description: Description, joints: tuple[Joint, ...]) -> str | None:
    """Return the link at the end of the longest arm: past its last joint, up to a fork."""
    names = {joint.name for joint in joints}

    def length(joint: Joint) -> int:
        return sum(above.name in names for above in description.chain(joint.child))

    if not joints:
        return None
    link = max(joints, key=length).child
    while len(description.child_joints[link]) == 1:
        (below,) = description.child_joints[link]
        link = below.child
    return link
