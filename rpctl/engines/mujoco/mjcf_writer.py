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
Attributes = dict[str, float | tuple[float, ...]]  # and their defaults in MuJoCo
SOLVER: Attributes = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}
SIZES = {"plane": 3, "sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3}
NO_TURN = (1.0, 0.0, 0.0, 0.0)
PLACE: Attributes = {"pos": (0.0, 0.0, 0.0), "quat": NO_TURN}
GEOM: Attributes = {
    **PLACE, "contype": 1, "conaffinity": 1, "condim": 3, "priority": 0,
    "friction": (1.0, 0.005, 0.0001), **SOLVER, "solmix": 1.0, "margin": 0.0, "gap": 0.0,
    "group": 0,
}  # fmt: skip
OPTIONS: Attributes = {
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
    root = etree.Element("mujoco", model=model.names.partition(b"\0")[0].decode("utf-8", "replace"))
    if comment:
        root.append(etree.Comment(comment))
    etree.SubElement(
        root, "compiler", angle="radian", autolimits="false", balanceinertia="false",
        boundmass="0", boundinertia="0", inertiafromgeom="false", fusestatic="false",
    )  # fmt: skip
    _write_options(root, model)
    for name in ("visual", "asset"):
        _section(root, name, sections)
    _Writer(model).write(root, drawn)
    for name in ("sensor", "keyframe", "custom"):
        _section(root, name, sections)
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


class _Writer:
    """Writes the elements of a model, each by the names and defaults of its attributes."""

    def __init__(self, model: Any) -> None:
        self._model, self._mujoco = model, mujoco_library()

    def write(self, root: Any, drawn: dict[str, list[Part]]) -> None:
        """Add bodies, contact pairs, equalities and actuators to the root element."""
        elements = {0: etree.SubElement(root, "worldbody")}
        for body in range(self._model.nbody):
            name = self._name("body", body)
            if body:
                parent = elements[int(self._model.body_parentid[body])]
                elements[body] = self._body(parent, body, name)
            self._shapes(elements[body], body)
            for part in drawn.get(name, ()):
                etree.SubElement(elements[body], part.tag, part.attributes)
        for tag, count, write in (
            ("contact", self._model.npair, self._pair),
            ("equality", self._model.neq, self._equality),
            ("actuator", self._model.nu, self._motor),
        ):
            section = etree.SubElement(root, tag) if count else None
            for index in range(count):
                write(section, index)

    def _name(self, kind: str, index: int) -> str:
        object_type = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        return self._mujoco.mj_id2name(self._model, object_type, int(index)) or ""

    def _named(self, parent: Any, tag: str, kind: str, index: int) -> Any:
        """Return a new element with its name, if it has one."""
        name = self._name(kind, index)
        return etree.SubElement(parent, tag, {"name": name} if name else {})

    def _fields(self, element: Any, prefix: str, index: int, defaults: Attributes) -> None:
        """Set the attributes that are called as the model's fields, where they are no default."""
        for name, default in defaults.items():
            _put(element, name, getattr(self._model, f"{prefix}_{name}")[index], default)

    def _body(self, parent: Any, body: int, name: str) -> Any:
        """Return a body's element, with its inertia and joints."""
        model, element = self._model, etree.SubElement(parent, "body", name=name)
        self._fields(element, "body", body, PLACE | {"gravcomp": 0.0})
        if model.body_mass[body]:
            inertial = etree.SubElement(element, "inertial", pos=numbers(model.body_ipos[body]))
            _put(inertial, "quat", model.body_iquat[body], NO_TURN)
            inertial.set("mass", _number(model.body_mass[body]))
            inertial.set("diaginertia", numbers(model.body_inertia[body]))
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            self._joint(element, joint)
        return element

    def _joint(self, body: Any, joint: int) -> None:
        model = self._model
        kind, dof = JOINTS[int(model.jnt_type[joint])], int(model.jnt_dofadr[joint])
        if kind == "free":
            self._named(body, "freejoint", "joint", joint)
            return
        element = self._named(body, "joint", "joint", joint)
        element.set("type", kind)
        _put(element, "pos", model.jnt_pos[joint], (0.0, 0.0, 0.0))
        element.set("axis", numbers(model.jnt_axis[joint]))
        if model.jnt_limited[joint]:
            element.set("limited", "true")
            element.set("range", numbers(model.jnt_range[joint]))
        for name in ("damping", "armature", "frictionloss"):
            _put(element, name, np.ravel(getattr(model, f"dof_{name}")[dof])[0], 0.0)
        _put(element, "stiffness", np.ravel(model.jnt_stiffness[joint])[0], 0.0)
        for what, prefix, index in (("limit", "jnt", joint), ("friction", "dof", dof)):
            for name, default in SOLVER.items():
                _put(element, name + what, getattr(model, f"{prefix}_{name}")[index], default)

    def _shapes(self, element: Any, body: int) -> None:
        """Write a body's geoms and sites."""
        model = self._model
        for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
            self._geom(element, geom)
        for index in np.flatnonzero(model.site_bodyid == body).tolist():
            site = self._named(element, "site", "site", index)
            self._fields(site, "site", index, PLACE)
            site.set("group", "4")

    def _geom(self, parent: Any, geom: int) -> None:
        model = self._model
        kind = self._mujoco.mjtGeom(int(model.geom_type[geom])).name
        kind = kind.removeprefix("mjGEOM_").lower()
        if kind not in SIZES:
            raise RpctlError(f"a geom of the kind {kind} is not written as MJCF")
        element = self._named(parent, "geom", "geom", geom)
        element.set("type", kind)
        element.set("size", numbers(model.geom_size[geom][: SIZES[kind]]))
        self._fields(element, "geom", geom, GEOM)
        colour = np.array([_decimal(value) for value in model.geom_rgba[geom]])
        _put(element, "rgba", colour, (0.5, 0.5, 0.5, 1.0))

    def _pair(self, section: Any, index: int) -> None:
        """Write a pair of geoms that touch, with its own friction and hardness."""
        model, element = self._model, self._named(section, "pair", "pair", index)
        for end in ("geom1", "geom2"):
            element.set(end, self._name("geom", getattr(model, f"pair_{end}")[index]))
        element.set("condim", str(int(model.pair_dim[index])))
        for name in ("friction", "solref", "solreffriction", "solimp"):
            element.set(name, numbers(getattr(model, f"pair_{name}")[index]))
        self._fields(element, "pair", index, {"margin": 0.0, "gap": 0.0})

    def _equality(self, section: Any, index: int) -> None:
        model = self._model
        if int(model.eq_type[index]) != int(self._mujoco.mjtEq.mjEQ_JOINT):
            raise RpctlError("an equality that is not of joints is not written as MJCF")
        element, first = (
            etree.SubElement(section, "joint"),
            self._name("joint", model.eq_obj1id[index]),
        )
        element.set("name", self._name("equality", index) or first)
        element.set("joint1", first)
        if int(model.eq_obj2id[index]) >= 0:
            element.set("joint2", self._name("joint", model.eq_obj2id[index]))
        element.set("polycoef", numbers(model.eq_data[index][:5]))
        self._fields(element, "eq", index, SOLVER)

    def _motor(self, section: Any, index: int) -> None:
        model, element = self._model, self._named(section, "motor", "actuator", index)
        element.set("joint", self._name("joint", model.actuator_trnid[index][0]))
        self._fields(element, "actuator", index, {"gear": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)})
        for what in ("ctrl", "force"):
            if getattr(model, f"actuator_{what}limited")[index]:
                element.set(f"{what}limited", "true")
                limits = getattr(model, f"actuator_{what}range")[index]
                element.set(f"{what}range", numbers(limits))


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
