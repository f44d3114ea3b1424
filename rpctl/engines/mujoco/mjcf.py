"""A compiled MuJoCo model as MJCF: every number in full, every default left out.

MuJoCo's own writer rounds to six digits, so that what is read back is another robot. Numbers here
are the shortest that a double is read from again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from lxml import etree

from rpctl.engines.mujoco.library import mujoco_library
from rpctl.errors import RpctlError

JOINTS = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}
SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)  # MuJoCo's defaults
SIZES = {"plane": 3, "sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3}
NO_TURN = (1.0, 0.0, 0.0, 0.0)
OPTIONS: dict[str, float | tuple[float, ...]] = {  # attributes of <option>, and the defaults
    "timestep": 0.002, "gravity": (0.0, 0.0, -9.81), "impratio": 1.0, "tolerance": 1e-8,
    "iterations": 100, "ls_iterations": 50, "ls_tolerance": 0.01, "noslip_iterations": 0,
    "noslip_tolerance": 1e-6, "ccd_iterations": 35, "ccd_tolerance": 1e-6, "wind": (0.0, 0.0, 0.0),
    "density": 0.0, "viscosity": 0.0,
}  # fmt: skip
WORDS = {  # attributes of <option> that are words, their enumerations, and the defaults
    "integrator": ("mjtIntegrator", "mjINT_", "euler"),
    "cone": ("mjtCone", "mjCONE_", "pyramidal"),
    "jacobian": ("mjtJacobian", "mjJAC_", "auto"),
    "solver": ("mjtSolver", "mjSOL_", "newton"),
}
SPELLED = {"euler": "Euler", "newton": "Newton"}  # in capitals, as MJCF has them
FLAGS = (("disableflags", "mjtDisableBit", "mjDSBL_", "disable"),
         ("enableflags", "mjtEnableBit", "mjENBL_", "enable"))  # fmt: skip


@dataclass(frozen=True)
class Part:
    """An element that is added to a body or a section: a drawn shape, a sensor, a text.

    Attributes:
        tag: As MJCF calls it.
        attributes: As written.
    """

    tag: str
    attributes: dict[str, str]


def numbers(values: Iterable[float]) -> str:
    """Return numbers as MJCF has them, each in the fewest digits that it is read from again."""
    return " ".join(_number(value) for value in values)


def write_model(
    model: Any,
    drawn: dict[str, list[Part]],
    sections: dict[str, list[Part]],
    comment: str = "",
) -> Any:
    """Return the root element of a model's MJCF.

    Args:
        model: ``MjModel``.
        drawn: Shapes that are only drawn, lights and cameras, by the name of their body.
        sections: What else there is, by section: ``"asset"``, ``"sensor"``, ``"custom"`` …
        comment: What a reader is told at the top.

    Raises:
        RpctlError: The model has an element that is not written.
    """
    _require_written(model)
    mujoco = mujoco_library()
    root = etree.Element("mujoco", model=_name(model.names, 0))
    if comment:
        root.append(etree.Comment(comment))
    etree.SubElement(
        root, "compiler", angle="radian", autolimits="false", balanceinertia="false",
        boundmass="0", boundinertia="0", inertiafromgeom="false", fusestatic="false",
    )  # fmt: skip
    _write_options(root, model)
    for part in sections.get("statistic", ()):
        etree.SubElement(root, part.tag, part.attributes)
    _section(root, "visual", sections)
    _section(root, "asset", sections)
    elements = {0: etree.SubElement(root, "worldbody")}
    for body in range(model.nbody):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
        if body:
            parent = elements[int(model.body_parentid[body])]
            elements[body] = _write_body(parent, model, body, name)
        _write_shapes(elements[body], model, body)
        for part in drawn.get(name, ()):
            etree.SubElement(elements[body], part.tag, part.attributes)
    _write_pairs(root, model)
    _write_equalities(root, model)
    _write_actuators(root, model)
    for section in ("sensor", "keyframe", "custom"):
        _section(root, section, sections)
    return root


def to_bytes(root: Any) -> bytes:
    """Return a document as the bytes of a file."""
    etree.indent(root)
    return bytes(etree.tostring(root, encoding="utf-8", xml_declaration=False)) + b"\n"


def _require_written(model: Any) -> None:
    """Refuse what has no writer here."""
    counts = {
        "tendons": model.ntendon, "exclusions": model.nexclude,
        "height fields": model.nhfield, "soft bodies": model.nflex, "plugins": model.nplugin,
        "mocap bodies": model.nmocap,
    }  # fmt: skip
    for what, count in counts.items():
        if count:
            raise RpctlError(f"a model with {what} is not written as MJCF")


def _section(root: Any, name: str, sections: dict[str, list[Part]]) -> None:
    if sections.get(name):
        section = etree.SubElement(root, name)
        for part in sections[name]:
            etree.SubElement(section, part.tag, part.attributes)


def _write_options(root: Any, model: Any) -> None:
    mujoco, option = mujoco_library(), etree.SubElement(root, "option")
    for name, default in OPTIONS.items():
        _put(option, name, getattr(model.opt, name), default)
    for name, (kind, prefix, usual) in WORDS.items():
        word = getattr(mujoco, kind)(int(getattr(model.opt, name))).name
        word = word.removeprefix(prefix).lower()
        if word != usual:
            option.set(name, SPELLED.get(word, word))
    flags = etree.Element("flag")
    for bits, kind, prefix, state in FLAGS:
        for bit in getattr(mujoco, kind).__members__.values():
            if int(getattr(model.opt, bits)) & int(bit) and bit.name.startswith(prefix):
                flags.set(bit.name.removeprefix(prefix).lower(), state)
    if flags.attrib:
        option.append(flags)


def _write_body(parent: Any, model: Any, body: int, name: str) -> Any:
    """Return a body's element, with its inertia and joints."""
    element = etree.SubElement(parent, "body", name=name)
    _put(element, "pos", model.body_pos[body], (0.0, 0.0, 0.0))
    _put(element, "quat", model.body_quat[body], NO_TURN)
    _put(element, "gravcomp", model.body_gravcomp[body], 0.0)
    if model.body_mass[body]:
        inertial = etree.SubElement(element, "inertial", pos=numbers(model.body_ipos[body]))
        _put(inertial, "quat", model.body_iquat[body], NO_TURN)
        inertial.set("mass", _number(model.body_mass[body]))
        inertial.set("diaginertia", numbers(model.body_inertia[body]))
    first = int(model.body_jntadr[body])
    for joint in range(first, first + int(model.body_jntnum[body])):
        _write_joint(element, model, joint)
    return element


def _write_joint(body: Any, model: Any, joint: int) -> None:
    mujoco = mujoco_library()
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    kind, dof = JOINTS[int(model.jnt_type[joint])], int(model.jnt_dofadr[joint])
    if kind == "free":
        element = etree.SubElement(body, "freejoint")
        if name:
            element.set("name", name)
        return
    element = etree.SubElement(body, "joint", name=name, type=kind)
    _put(element, "pos", model.jnt_pos[joint], (0.0, 0.0, 0.0))
    element.set("axis", numbers(model.jnt_axis[joint]))
    if model.jnt_limited[joint]:
        element.set("limited", "true")
        element.set("range", numbers(model.jnt_range[joint]))
    for name in ("damping", "armature", "frictionloss"):
        _put(element, name, np.ravel(getattr(model, f"dof_{name}")[dof])[0], 0.0)
    _put(element, "stiffness", np.ravel(model.jnt_stiffness[joint])[0], 0.0)
    _put(element, "solreflimit", model.jnt_solref[joint], SOLREF)
    _put(element, "solimplimit", model.jnt_solimp[joint], SOLIMP)
    _put(element, "solreffriction", model.dof_solref[dof], SOLREF)
    _put(element, "solimpfriction", model.dof_solimp[dof], SOLIMP)


def _write_shapes(element: Any, model: Any, body: int) -> None:
    """Write a body's geoms and sites."""
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]) == body:
            _write_geom(element, model, geom)
    mujoco = mujoco_library()
    for site in range(model.nsite):
        if int(model.site_bodyid[site]) == body:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_SITE, site)
            found = etree.SubElement(element, "site", name=name)
            _put(found, "pos", model.site_pos[site], (0.0, 0.0, 0.0))
            _put(found, "quat", model.site_quat[site], NO_TURN)
            found.set("group", "4")


def _write_geom(element: Any, model: Any, geom: int) -> None:
    mujoco = mujoco_library()
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    if kind not in SIZES:
        raise RpctlError(f"a geom of the kind {kind} is not written as MJCF")
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    found = etree.SubElement(element, "geom", {"name": name} if name else {})
    found.set("type", kind)
    found.set("size", numbers(model.geom_size[geom][: SIZES[kind]]))
    _put(found, "pos", model.geom_pos[geom], (0.0, 0.0, 0.0))
    _put(found, "quat", model.geom_quat[geom], NO_TURN)
    for name, default in (("contype", 1), ("conaffinity", 1), ("condim", 3), ("priority", 0)):
        _put(found, name, getattr(model, f"geom_{name}")[geom], default)
    _put(found, "friction", model.geom_friction[geom], (1.0, 0.005, 0.0001))
    _put(found, "solref", model.geom_solref[geom], SOLREF)
    _put(found, "solimp", model.geom_solimp[geom], SOLIMP)
    for name, usual in (("solmix", 1.0), ("margin", 0.0), ("gap", 0.0)):
        _put(found, name, getattr(model, f"geom_{name}")[geom], usual)
    _put(found, "group", model.geom_group[geom], 0)
    _put(
        found, "rgba", np.array([_decimal(c) for c in model.geom_rgba[geom]]), (0.5, 0.5, 0.5, 1.0)
    )


def _write_pairs(root: Any, model: Any) -> None:
    """Write the pairs of geoms that touch, each with its own friction and hardness."""
    mujoco, section = mujoco_library(), etree.Element("contact")
    geom = mujoco.mjtObj.mjOBJ_GEOM
    for index in range(model.npair):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_PAIR, index)
        found = etree.SubElement(section, "pair", {"name": name} if name else {})
        for end in ("geom1", "geom2"):
            found.set(
                end, mujoco.mj_id2name(model, geom, int(getattr(model, f"pair_{end}")[index]))
            )
        found.set("condim", str(int(model.pair_dim[index])))
        found.set("friction", numbers(model.pair_friction[index]))
        found.set("solref", numbers(model.pair_solref[index]))
        found.set("solreffriction", numbers(model.pair_solreffriction[index]))
        found.set("solimp", numbers(model.pair_solimp[index]))
        for name in ("margin", "gap"):
            _put(found, name, getattr(model, f"pair_{name}")[index], 0.0)
    if len(section):
        root.append(section)


def _write_equalities(root: Any, model: Any) -> None:
    mujoco = mujoco_library()
    section = etree.Element("equality")
    joint = mujoco.mjtObj.mjOBJ_JOINT
    for index in range(model.neq):
        if int(model.eq_type[index]) != int(mujoco.mjtEq.mjEQ_JOINT):
            raise RpctlError("an equality that is not of joints is not written as MJCF")
        found = etree.SubElement(section, "joint")
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index)
        first = mujoco.mj_id2name(model, joint, int(model.eq_obj1id[index]))
        found.set("name", name or first)
        found.set("joint1", first)
        if int(model.eq_obj2id[index]) >= 0:
            found.set("joint2", mujoco.mj_id2name(model, joint, int(model.eq_obj2id[index])))
        found.set("polycoef", numbers(model.eq_data[index][:5]))
        _put(found, "solref", model.eq_solref[index], SOLREF)
        _put(found, "solimp", model.eq_solimp[index], SOLIMP)
    if len(section):
        root.append(section)


def _write_actuators(root: Any, model: Any) -> None:
    mujoco = mujoco_library()
    section = etree.Element("actuator")
    for index in range(model.nu):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index)
        joint = int(model.actuator_trnid[index][0])
        target = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        found = etree.SubElement(section, "motor", name=name, joint=target)
        _put(found, "gear", model.actuator_gear[index], (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        if model.actuator_ctrllimited[index]:
            found.set("ctrllimited", "true")
            found.set("ctrlrange", numbers(model.actuator_ctrlrange[index]))
        if model.actuator_forcelimited[index]:
            found.set("forcelimited", "true")
            found.set("forcerange", numbers(model.actuator_forcerange[index]))
    if len(section):
        root.append(section)


def _put(element: Any, name: str, value: Any, default: float | Sequence[float]) -> None:
    """Set an attribute that is not the default."""
    values, usual = np.atleast_1d(value), np.atleast_1d(default)
    if values.shape != usual.shape or (values != usual).any():
        element.set(name, numbers(values))


def _number(value: Any) -> str:
    """Return a number in the fewest digits that it is read from again."""
    number = float(value)
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _decimal(value: Any) -> float:
    """Return a number of single precision as its shortest decimal."""
    return float(str(np.float32(value)))


def _name(names: bytes, start: int) -> str:
    """Return the name that begins at a place of a model's names."""
    return names[start:].partition(b"\0")[0].decode("utf-8", "replace")
