"""The inertia of rotors, which turn n times as fast as their joints: I n² on M's diagonal."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase

import pinocchio as pin

from rpctl.description.records import Description
from rpctl.errors import RpctlError, UnknownNameError, require_within
from rpctl.robot.coordinates import joint_entries


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
        matching = [name for name in names if fnmatchcase(name, pattern)]
        if not matching:
            raise UnknownNameError("joint", pattern, names)
        found.update(dict.fromkeys(matching, float(inertia)))
    for name, inertia in found.items():
        model.armature[model.joints[model.getJointId(name)].idx_v] = inertia
