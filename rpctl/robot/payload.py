"""A robot that carries a load: a body fixed to one of its links, in the model and in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.records import Description
from rpctl.description.urdf import parse
from rpctl.errors import RpctlError, UnknownNameError, require_positive
from rpctl.robot.load_settings import Payload
from rpctl.robot.model import Robot

JOINT = "_joint"  # what the joint of a load is called behind the load's own name


def with_payload(
    robot: Robot,
    link: str,
    mass: float,
    com: Sequence[float] = (0.0, 0.0, 0.0),
    inertia: Sequence[Sequence[float]] | Array | None = None,
) -> Robot:
    """Return a robot that carries a load; ``verify`` proves its dynamics like any other's.

    The load is a link of its own, fixed to ``link``, in the description that all derivations read.

    Args:
        robot: The robot, which stays as it is.
        link: Name of the link that carries the load.
        mass: Of the load, kg.
        com: Its centre of mass (3,) in the link's frame, m.
        inertia: Its inertia (3, 3) about its centre of mass, along the link's axes, kg·m²; None: a
            point mass.

    Raises:
        RpctlError: The mass is not positive, or a number is missing or not finite.
        UnknownNameError: The link is not known.
    """
    if link not in robot.description.link:
        raise UnknownNameError("link", link, robot.description.link)
    require_positive("the payload's mass", mass)
    centre = np.array(com, dtype=float)
    about = np.zeros((3, 3)) if inertia is None else np.array(inertia, dtype=float)
    if centre.shape != (3,) or not np.isfinite(centre).all():
        raise RpctlError(f"the payload's centre of mass is {com}; give x, y, z in m")
    if about.shape != (3, 3) or not np.allclose(about, about.T) or _is_no_body(about):
        raise RpctlError("the payload's inertia is that of no body; give a symmetric (3, 3) matrix")
    description = _attached(robot.description, link, mass, centre, about)
    payload = Payload(link, mass, tuple(centre.tolist()), tuple(map(tuple, about.tolist())))
    settings = replace(robot.loaded_with, payloads=(*robot.loaded_with.payloads, payload))
    model = _loaded(robot.model, link, pin.Inertia(mass, centre, about))
    return replace(robot, description=description, model=model, loaded_with=settings)


def _is_no_body(inertia: Array) -> bool:
    """Return whether a matrix is none of a body's: each moment is at most the sum of the others."""
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9))


def _loaded(model: pin.Model, link: str, inertia: pin.Inertia) -> pin.Model:
    """Return a model whose link carries an inertia, which is given in the link's frame."""
    loaded = model.copy()
    frame = loaded.frames[loaded.getFrameId(link, pin.FrameType.BODY)]
    loaded.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    return loaded


def _attached(
    description: Description, link: str, mass: float, com: Array, inertia: Array
) -> Description:
    """Return a description with a further link, fixed to one of its links."""
    name = f"{link}_payload"
    while name in description.link or name + JOINT in description.joint:
        name += "_"
    raw = _with_body(description.raw, name, link, mass, com, inertia)
    read = parse(description.path, raw)
    xml = _with_body(description.xml.encode(), name, link, mass, com, inertia).decode()
    return replace(
        description,
        links=(*description.links, read.link[name]),
        joints=(*description.joints, read.joint[name + JOINT]),
        xml=xml,
        raw=raw,
    )


def _with_body(
    document: bytes, name: str, link: str, mass: float, com: Array, inertia: Array
) -> bytes:
    """Return a URDF with a further link of a mass, and the joint that fixes it, at its end."""
    root = etree.fromstring(document, etree.XMLParser(resolve_entities=False, no_network=True))
    space = etree.QName(root).namespace

    def add(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
        return etree.SubElement(parent, etree.QName(space, tag), attributes)

    inertial = add(add(root, "link", name=name), "inertial")
    add(inertial, "origin", xyz=" ".join(map(repr, com.tolist())))
    add(inertial, "mass", value=repr(float(mass)))
    rows, columns = np.triu_indices(3)
    moments = {
        f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertia[i, j]))
        for i, j in zip(rows, columns, strict=True)
    }
    add(inertial, "inertia", **moments)
    joint = add(root, "joint", name=name + JOINT, type="fixed")
    add(joint, "parent", link=link)
    add(joint, "child", link=name)
    return bytes(etree.tostring(root))
