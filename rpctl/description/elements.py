"""Links of a URDF as records, and names of elements that are misspelt."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

import numpy as np

from rpctl.description.findings import Findings
from rpctl.description.inertial import read_inertial
from rpctl.description.records import Link
from rpctl.description.shapes import Colours, read_shapes

CHILDREN = {
    "robot": ("link", "joint", "material", "gazebo", "transmission", "sensor", "ros2_control"),
    "link": ("inertial", "visual", "collision", "contact", "self_collision_checking", "sensor"),
    "joint": (
        "origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration",
        "safety_controller",
    ),
    "inertial": ("origin", "mass", "inertia"),
}  # fmt: skip
MIN_SPELLING_LIKENESS = 0.75  # least likeness (0 to 1) of a misspelt name


def read_link(findings: Findings, element: Any, colours: Colours) -> Link:
    """Return the record of a <link>; ``colours`` are the robot's named materials."""
    mass, com, inertia = read_inertial(findings, element)
    visuals = read_shapes(findings, element, "visual", colours)
    collisions = read_shapes(findings, element, "collision", colours)
    for array in (com, inertia):
        array.setflags(write=False)
    name, line = element.get("name", ""), element.sourceline
    return Link(name, line, mass, com, np.asarray(inertia), visuals, collisions)


def note_misspelt(findings: Findings, root: Any) -> None:
    """Note elements whose names are nearly those of URDF: they would be left out silently."""
    for parent in (root, *root.findall("link"), *root.findall("joint"), *root.iter("inertial")):
        known = CHILDREN[parent.tag]
        for child in parent:
            tag = str(child.tag)
            if tag in known:
                continue
            near = get_close_matches(tag[:60], known, n=1, cutoff=MIN_SPELLING_LIKENESS)
            if near:
                text = f"<{tag}> in <{parent.tag}> is not URDF, it is left out; "
                findings.warn(child, f"{text}did you mean <{near[0]}>?")
