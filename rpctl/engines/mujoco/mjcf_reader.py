"""MJCF from others, read strictly, and its content as a table of plain values.

A check reads one file: no entities, no elements that read or generate others. Meshes, textures and
materials are removed before MuJoCo compiles the model.

The table has names instead of indices, so that whitespace, comments, the order of attributes,
defaults and classes do not matter. It takes all fields of ``MjModel`` with a known prefix, except
those that follow from others, so that it also contains fields that a new MuJoCo adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from rpctl.arrays import Array
from rpctl.equivalence.contact.mujoco_body import mujoco_library, muted
from rpctl.errors import DescriptionError, Finding, RpctlError, one_line
from rpctl.files.caps import cap, how_to_raise, read_input

Value = str | list[float | str]  # value of a field: a word, or numbers and names
Fields = dict[str, Value]
Table = dict[str, dict[str, Fields]]  # by kind and name; names in the order of the model

POLYNOMIAL = 5  # coefficients of a tie of joints or tendons
COMPILER_ONLY = ("sameframe", "bvhadr", "bvhnum", "plugin", "user", "rbound", "aabb", "invweight0")
DERIVED = {  # fields without content of their own: addresses, counts, and what MuJoCo computes
    "body": (
        "rootid", "weldid", "jntnum", "jntadr", "dofnum", "dofadr", "treeid", "geomnum",
        "geomadr", "simple", "subtreemass", "margin", "contype", "conaffinity", "inertia", "iquat",
    ),
    "jnt": ("qposadr", "dofadr", "plasticadr", "actuatorid"),
    "dof": (
        "bodyid", "jntid", "parentid", "treeid", "Madr", "simplenum", "M0", "length",
    ),
    "geom": ("dataid",),
    "actuator": (
        "actadr", "actnum", "acc0", "length0", "lengthrange", "historyadr", "history", "ctrladr",
        "ctrlnum", "outadr", "outnum",
    ),
    "sensor": ("adr", "dim", "datatype", "needstage", "historyadr", "history"),
    "tendon": ("adr", "num", "treenum", "treeid", "length0", "plasticadr", "actuatorid"),
    "site": ("dataid",),
    "cam": ("mat0", "pos0", "poscom0", "targetbodyid"),
    "light": ("dir0", "pos0", "poscom0", "targetbodyid", "texid"),
    "pair": ("signature",),
    "eq": ("objtype",),
}  # fmt: skip
REFERENCES = {  # fields that are indices, and of what kind
    "parentid": "body", "bodyid": "body", "geom1": "geom", "geom2": "geom",
}  # fmt: skip
TYPED_REFERENCES = {"objid": "objtype", "refid": "reftype"}  # whose kind is in another field
TIED = ("obj1id", "obj2id")  # of equalities: joints, tendons, or what their objects' type says
TRANSMISSIONS = {"JOINT": "joint", "JOINTINPARENT": "joint", "TENDON": "tendon", "SITE": "site",
                 "BODY": "body"}  # fmt: skip
COUNTED = ("flex", "hfield", "plugin", "tuple", "userdata", "plastic")
PREFIXES = {  # kind, as MJCF calls it, and the prefixes of its fields
    "body": "body", "joint": "jnt", "geom": "geom", "equality": "eq", "actuator": "actuator",
    "tendon": "tendon", "sensor": "sensor", "pair": "pair", "exclude": "exclude", "site": "site",
    "camera": "cam", "light": "light", "key": "key",
}  # fmt: skip
ROOT = "mujoco"
A_FILE = "an MJCF file that `rpctl export` wrote"
NOT_READ = {  # elements that a check refuses, and what they do
    "include": "reads another file",
    "model": "reads another file",
    "attach": "takes parts of another model",
    "plugin": "runs foreign code",
    "extension": "runs foreign code",
    "replicate": "makes copies",
    "composite": "makes elements",
    "flexcomp": "makes elements",
    "flex": "is a soft body",
    "skin": "is only drawn",
    "hfield": "is ground that is not flat",
}
COUNTS = ("nsample", "nkey", "nuserdata", "memory")  # attributes for which MuJoCo allocates memory
MAX_DIGITS = 4  # of such an attribute
DRAWN_ASSETS = ("texture", "material", "mesh")


@dataclass(frozen=True)
class _NamedModel:
    """A compiled model, with functions that name its elements."""

    mujoco: Any
    model: Any

    @property
    def polynomials(self) -> tuple[int, int]:
        """The types of equalities whose data are the coefficients of a polynomial."""
        kinds = self.mujoco.mjtEq
        return int(kinds.mjEQ_JOINT), int(kinds.mjEQ_TENDON)

    def name(self, kind: str, index: int) -> str:
        """Return the name of an element, or its number if it has none."""
        if index < 0:
            return ""
        object_type = getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        return self.mujoco.mj_id2name(self.model, object_type, index) or f"number {index + 1}"

    def typed_name(self, kind: int, index: int) -> str:
        """Return the name of an element, given MuJoCo's number of its kind."""
        word = str(self.mujoco.mjtObj(kind).name).removeprefix("mjOBJ_").lower()
        kind_word = {"xbody": "body", "unknown": ""}.get(word, word)
        return self.name(kind_word, index) if kind_word and index >= 0 else ""

    def tied_name(self, equality: int, kind: int, index: int) -> str:
        """Return the name of an element of an equality, given MuJoCo's numbers."""
        word = str(self.mujoco.mjtEq(equality).name).removeprefix("mjEQ_").lower()
        known = word in ("joint", "tendon")
        return self.name(word, index) if known else self.typed_name(kind, index)


def tabulate(model: Any) -> Table:
    """Return the table of a compiled model (``MjModel``)."""
    of = _NamedModel(mujoco_library(), model)
    table: Table = {"option": {"option": _option(of)}, "model": {"model": _rest(of)}}
    for kind, prefix in PREFIXES.items():
        arrays = _arrays(of, prefix)
        table[kind] = {
            of.name(kind, index): {name: _value(of, name, index, arrays) for name in arrays}
            for index in range(min(map(len, arrays.values()), default=0))
        }
    for index, fields in enumerate(table["joint"].values()):
        fields |= _degree_of_freedom(of, index)
    for index, fields in enumerate(table["body"].values()):
        fields["inertia"] = _inertia(of, index)
    return table


def _numbers(value: Any) -> list[float | str]:
    """Return numbers of any shape as a list."""
    return [*np.asarray(value, dtype=float).ravel().tolist()]


def _arrays(of: _NamedModel, prefix: str) -> dict[str, Any]:
    """Return the model's arrays for a kind, by field name without prefix."""
    left_out = {*COMPILER_ONLY, *DERIVED.get(prefix, ())}
    found = {}
    for attribute in dir(of.model):
        name = attribute.removeprefix(f"{prefix}_")
        if name != attribute and name not in left_out:
            array = getattr(of.model, attribute)
            if isinstance(array, np.ndarray):
                found[name] = array
    return found


def _value(of: _NamedModel, name: str, index: int, arrays: Mapping[str, Any]) -> Value:
    """Return a field of an element: numbers, or names where the field is a reference."""
    entry = arrays[name][index]
    if name in REFERENCES:
        return of.name(REFERENCES[name], int(entry))
    if name in TIED:
        return of.tied_name(int(arrays["type"][index]), int(of.model.eq_objtype[index]), int(entry))
    if name in TYPED_REFERENCES:
        return of.typed_name(int(arrays[TYPED_REFERENCES[name]][index]), int(entry))
    if name == "data" and int(arrays["type"][index]) in of.polynomials:
        return _numbers(entry[:POLYNOMIAL])  # the rest has no meaning, and differs between versions
    if name == "trnid":
        word = str(of.mujoco.mjtTrn(int(arrays["trntype"][index])).name).removeprefix("mjTRN_")
        return of.name(TRANSMISSIONS.get(word, "site"), int(entry[0]))
    if name == "matid":
        return of.name("material", int(entry))
    return _numbers(entry)


def _degree_of_freedom(of: _NamedModel, index: int) -> Fields:
    """Return a joint's damping, friction, rotor inertia and spring reference."""
    start = int(of.model.jnt_dofadr[index])
    place = int(of.model.jnt_qposadr[index])
    fields: Fields = {name: _numbers(array[start]) for name, array in _arrays(of, "dof").items()}
    fields["ref"] = [float(of.model.qpos0[place])]
    fields["springref"] = [float(of.model.qpos_spring[place])]
    return fields


def _inertia(of: _NamedModel, body: int) -> list[float | str]:
    """Return a body's inertia about its centre of mass, in the body's axes: xx yy zz xy xz yz."""
    R = np.zeros(9)
    of.mujoco.mju_quat2Mat(R, of.model.body_iquat[body])
    axes: Array = R.reshape(3, 3)
    full = axes @ np.diag(of.model.body_inertia[body]) @ axes.T
    return [float(full[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def _rest(of: _NamedModel) -> Fields:
    """Return what else affects the motion: counts of further elements, and tendon paths."""
    found: Fields = {
        name: [float(getattr(of.model, f"n{name}"))]
        for name in COUNTED
        if hasattr(of.model, f"n{name}")
    }
    ways = (of.model.wrap_type, of.model.wrap_objid, of.model.wrap_prm)
    found["wraps"] = [float(number) for way in ways for number in way]
    found["meaninertia"] = [float(of.model.stat.meaninertia)]
    return found


def _option(of: _NamedModel) -> Fields:
    """Return the options of the simulation."""
    found: Fields = {}
    for name in dir(of.model.opt):
        value = getattr(of.model.opt, name)
        if not name.startswith("_") and isinstance(value, int | float | np.ndarray):
            found[name] = _numbers(value)
    return found


@dataclass(frozen=True)
class StrictMjcf:
    """An MJCF file, read and compiled without meshes, textures and materials.

    Attributes:
        path: The file.
        model: ``MjModel``, with a ball in the place of each mesh.
        table: The content of the file, with the names of meshes and the attributes of assets.
        texts: The custom texts, by name.
    """

    path: Path
    model: Any = field(repr=False)
    table: Table = field(repr=False)
    texts: dict[str, str] = field(repr=False)


def read_mjcf(path: str | Path) -> StrictMjcf:
    """Return an MJCF file.

    Raises:
        RpctlError: The file cannot be opened, is not MJCF, or MuJoCo refuses it.
    """
    return parse_mjcf(read_input(path, "MAX_BYTES", A_FILE), path)


def parse_mjcf(data: bytes, path: str | Path) -> StrictMjcf:
    """Return an MJCF file, given its bytes.

    Raises:
        RpctlError: They are not MJCF, or MuJoCo refuses it.
    """
    root = _parsed(data, path)
    for element in root.iter():
        why = NOT_READ.get(element.tag) or _greed(element)
        if why:
            fault = f"<{element.tag}> {why}, so `rpctl check` refuses it"
            raise _fault(path, f"{fault}; expand it, or export again", element)
    texts = {text.get("name", ""): text.get("data", "") for text in root.iterfind("custom/text")}
    mujoco = mujoco_library()
    try:
        with muted():
            spec = mujoco.MjSpec.from_string(etree.tostring(root, encoding="unicode"))
            drawn = _without_pictures(spec, mujoco)
            model = spec.compile()
    except (ValueError, RuntimeError, TypeError) as error:
        reason = one_line(" ".join(str(error).split()))
        raise _fault(path, f"MuJoCo refuses it: {reason}") from None
    table = tabulate(model)
    meshes = {int(geom.id): mesh for geom, mesh in drawn}
    for index, fields in enumerate(table["geom"].values()):
        fields["mesh"] = meshes[index]
    table["asset"] = _assets(root)
    return StrictMjcf(Path(path), model, table, texts)


def _greed(element: Any) -> str:
    """Return a phrase if an element requests much memory, else nothing."""
    words = {name: text for name, text in element.items() if name in COUNTS}
    if element.tag == "size":
        words |= dict(element.items())
    greedy = (text for text in words.values() if not (text.isdigit() and len(text) <= MAX_DIGITS))
    return "requests memory" if any(greedy) else ""


def _parsed(data: bytes, path: str | Path) -> Any:
    """Return the root element of a file's bytes, without comments."""
    if data.count(b"<") > 2 * cap("MAX_ELEMENTS"):
        raise _fault(path, f"too many elements; {how_to_raise('MAX_ELEMENTS')}")
    parser = etree.XMLParser(
        encoding="utf-8",  # as MuJoCo reads every file: UTF-7 would hide elements
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        reason = one_line(str(getattr(error, "msg", None) or error))
        raise _fault(path, f"not well-formed XML: {reason}; give {A_FILE}", error) from None
    if root.getroottree().docinfo.doctype:
        raise _fault(path, "a DOCTYPE is not part of MJCF; remove it", root)
    if root.tag != ROOT:
        raise _fault(path, f"its root is <{one_line(str(root.tag))}>; give {A_FILE}", root)
    return root


def _without_pictures(spec: Any, mujoco: Any) -> list[tuple[Any, str]]:
    """Remove meshes, materials and textures from a model; return each geom and its mesh's name.

    A small ball replaces each mesh. A mesh that collides shows as a difference of the tables,
    because rpctl exports none.
    """
    drawn = []
    for geom in spec.geoms:
        drawn.append((geom, str(geom.meshname)))
        if geom.meshname or geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            geom.meshname, geom.type, geom.size = "", mujoco.mjtGeom.mjGEOM_SPHERE, [1e-3] * 3
        geom.material = ""
    for owner in (*spec.sites, *spec.tendons):
        owner.material = ""
    for light in spec.lights:
        light.texture = ""
    for asset in (*spec.meshes, *spec.materials, *spec.textures):
        spec.delete(asset)
    return drawn


def _assets(root: Any) -> dict[str, Fields]:
    """Return the attributes of textures, materials and meshes, by kind and name."""
    found: dict[str, Fields] = {}
    for element in root.iterfind("asset/*"):
        if element.tag in DRAWN_ASSETS:
            name = element.get("name") or element.get("file") or element.get("type") or ""
            found[f"{element.tag} {name}"] = {key: str(text) for key, text in element.items()}
    return found


def _fault(path: str | Path, message: str, at: Any = None) -> RpctlError:
    """Return the refusal of a file, with the line of an element or of a syntax error."""
    line = getattr(at, "sourceline", None) or getattr(at, "lineno", None)
    return DescriptionError(path, [Finding("error", line, message)])
