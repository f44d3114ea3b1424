"""Build the ``pinocchio.Model`` of a robot; its inertia matrix must be positive definite."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import pinocchio as pin
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description
from rpctl.errors import DescriptionError, Finding, RpctlError, fault_at, require_within
from rpctl.files.caps import cap, how_to_raise
from rpctl.robot.coordinates import joint_entries
from rpctl.robot.patterns import matching

MIN_SCALED_EIGENVALUE = 1e-12  # of M with its diagonal scaled to one; below is rounding
POSTURES = 3  # configurations at which M is tried: the neutral one and random ones
POSTURE_SEED = 20210601  # of the random ones
UNLIMITED_REACH = 1.0  # m or rad; how far from neutral an unlimited joint is tried
DENSITY_OPTION = "--density KG_PER_M3"
MAX_ENGINE_MESSAGE = 300  # characters of what an engine prints that a message repeats


def check(tree: FrozenTree) -> None:
    """Refuse a robot of which no model can be built, before anything that takes time.

    Args:
        tree: The robot, with its locked joints.

    Raises:
        DescriptionError: Too many joints move, or joints move no mass.
    """
    free = [joint for joint in tree.description.joints if tree.is_free(joint)]
    most = cap("MAX_MOVING_JOINTS")
    if len(free) > most:
        raise fault_at(
            tree.description.path,
            free[most].line,
            f"{len(free)} moving joints; at most {most} are allowed (memory grows with their "
            f"cube); freeze some with --lock, or {how_to_raise('MAX_MOVING_JOINTS')}",
        )
    _require_mass(tree)


def build(tree: FrozenTree, leans: bool = False) -> pin.Model:
    """Return the model with a planar root, or a free-flyer, and the locked joints frozen.

    Args:
        tree: The robot, with its locked joints; :func:`check` has accepted it.
        leans: Whether the root link pitches, rolls and rises.

    Raises:
        DescriptionError: Its inertia matrix is not positive definite, or Pinocchio refuses it.
    """
    description = tree.description
    with _captured_stderr() as captured:
        try:
            root = pin.JointModelFreeFlyer() if leans else pin.JointModelPlanar()
            model = _model(tree, root)
        except Exception as error:  # whatever the engine raises, the file is to blame
            reason = f"{error} {captured()}".strip()[:MAX_ENGINE_MESSAGE]
            raise fault_at(
                description.path,
                None,
                f"Pinocchio rejects this robot: {reason}; correct or simplify it",
            ) from None
    names = list(model.names[2:])
    if len(set(names)) < len(names) or not set(names) <= description.joint.keys():
        raise fault_at(
            description.path,
            None,
            "Pinocchio reads other joints than the file names; give each joint a name of its own",
        )
    require_dynamics(description, model)
    return model


def _model(tree: FrozenTree, root: pin.JointModel) -> pin.Model:
    description, locked = tree.description, tree.locked
    if locked and description.joint.keys() & description.link.keys():
        # buildReducedModel refuses a link and a joint of one name; the file may have them.
        return pin.buildModelFromXML(_frozen_text(tree), root)
    full = pin.buildModelFromXML(description.xml, root)
    if not locked:
        return full
    at = pin.neutral(full)
    entries = joint_entries(full)
    for name, position in locked.items():
        entries[name].write(at, position)
    return pin.buildReducedModel(full, [full.getJointId(name) for name in locked], at)


def _frozen_text(tree: FrozenTree) -> str:
    """Return the document for the engines with the locked joints fixed where they are."""
    root = etree.fromstring(tree.description.xml)
    for element in root.findall("joint"):
        name = element.get("name")
        if name not in tree.locked:
            continue
        joint = tree.description.joint[name]
        pose = joint.motion(tree.locked[name])
        for child in element.xpath("origin | axis | limit | mimic"):
            element.remove(child)
        element.set("type", "fixed")
        texts = {"xyz": pose[:3, 3], "rpy": pin.rpy.matrixToRpy(pose[:3, :3])}
        values = {key: " ".join(map(repr, array.tolist())) for key, array in texts.items()}
        etree.SubElement(element, "origin", values)
    return str(etree.tostring(root, encoding="unicode"))


@contextmanager
def _captured_stderr() -> Iterator[Callable[[], str]]:
    """Keep what C code prints off the user's stderr; yields a function that returns it."""
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # there is no stderr
        yield lambda: ""
        return
    with tempfile.TemporaryFile() as file:

        def captured() -> str:
            file.seek(0)
            return " ".join(file.read(4 * MAX_ENGINE_MESSAGE).decode("utf-8", "replace").split())

        os.dup2(file.fileno(), 2)
        try:
            yield captured
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _require_mass(tree: FrozenTree) -> None:
    """Refuse a joint that moves no mass: the inertia matrix would be singular.

    Raises:
        DescriptionError: Naming each such joint and the links that lack an inertia.
    """
    faults, description = [], tree.description
    if not any(link.mass for link in description.links):
        root = description.link[description.root]
        text = "no link has a mass; give the links <inertial> elements, or estimate them with "
        faults.append(Finding("error", root.line, f"{text}{DENSITY_OPTION}"))
    for joint in filter(tree.is_free, description.joints):
        if any(description.link[below.child].mass for below in description.below(joint)):
            continue
        first = description.link[joint.child]
        lacking = "has no <inertial>" if first.mass is None else "has no mass"
        shown = first.mass is None and (first.collisions or first.visuals)
        estimate = f", estimate it with {DENSITY_OPTION}" if shown else ""
        text = (
            f'link "{first.name}" {lacking}, yet joint "{joint.name}" moves it; give its '
            f"<inertial> (mass, centre of mass, inertia){estimate}, or freeze it: --lock "
            f"{joint.name}"
        )
        faults.append(Finding("error", first.line, text))
    if faults:
        raise DescriptionError(description.path, faults)


def require_dynamics(description: Description, model: pin.Model) -> None:
    """Raise unless the inertia matrix is positive definite in a few postures.

    Forces determine no accelerations otherwise.

    Raises:
        DescriptionError: Naming the joint that can move without a force.
    """
    data, rng = model.createData(), np.random.default_rng(POSTURE_SEED)
    for q in _postures(description, model, rng):
        v = rng.normal(size=model.nv)
        M = pin.crba(model, data, q)
        diagonal = np.diag(M)
        if not np.isfinite(M).all() or diagonal.min() <= 0:
            index = int(np.argmin(np.where(np.isfinite(diagonal), diagonal, -np.inf)))
            raise _no_dynamics(description, model, index)
        scale = 1.0 / np.sqrt(diagonal)
        values, vectors = np.linalg.eigh(scale[:, None] * M * scale)
        if not values[0] > MIN_SCALED_EIGENVALUE:
            raise _no_dynamics(description, model, int(np.abs(vectors[:, 0]).argmax()))
        rates = pin.aba(model, data, q, v, np.zeros(model.nv))
        if not np.isfinite(rates).all():
            raise _no_dynamics(description, model, int(np.argmin(np.isfinite(rates))))


def _postures(
    description: Description, model: pin.Model, rng: np.random.Generator
) -> Iterator[Array]:
    """Yield the neutral configuration and random ones within the limits."""
    entries = joint_entries(model)
    yield pin.neutral(model)
    for _ in range(POSTURES - 1):
        q = pin.neutral(model)
        for name, entry in entries.items():
            entry.write(q, rng.uniform(*description.joint[name].span(UNLIMITED_REACH)))
        yield q


def _no_dynamics(description: Description, model: pin.Model, index: int) -> DescriptionError:
    names = ("root", *model.names[2:])
    joints = list(model.joints)[1:]
    joint = next(n for n, j in zip(names, joints, strict=True) if index < j.idx_v + j.nv)
    line = description.joint[joint].line if joint in description.joint else None
    return fault_at(
        description.path,
        line,
        f'the inertia matrix is not positive definite: joint "{joint}" moves links of no '
        "or negative inertia; correct their <inertial>",
    )


def set_armature(
    description: Description, model: pin.Model, given: Mapping[str, float] | None
) -> None:
    """Set the rotors' inertias in a model, in place.

    A rotor counts with its spin about the joint alone; that it also turns with the links before it
    is in their inertias, as the file has them.

    Args:
        description: The robot's file, whose transmissions tell of rotors.
        model: Of the robot, with a planar root.
        given: I n² by pattern of joint names, kg·m² or kg; the last that matches counts, before
            what the file tells. None leaves out all rotors.

    Raises:
        UnknownNameError: No moving joint has such a name.
        RpctlError: An inertia is negative or not finite, or there is none at all.
    """
    if given is None:
        return
    names = tuple(joint_entries(model))
    found = {name: description.rotors[name] for name in names if name in description.rotors}
    if not (given or found):
        raise RpctlError(
            f"{description.path}: no <transmission> gives the inertia of a rotor of a joint that "
            "moves; give it as --armature PATTERN=KG_M2"
        )
    for pattern, inertia in given.items():
        require_within(f"the armature of {pattern}", [inertia])
        if not inertia >= 0.0:
            raise RpctlError(f"the armature of {pattern} is {inertia:g}; give 0 or more, in kg m2")
        found |= dict.fromkeys(matching(pattern, names, "joint"), float(inertia))
    for name, inertia in found.items():
        model.armature[model.joints[model.getJointId(name)].idx_v] = inertia
