"""MJCF of others, read strictly: one file, no entities, no elements that read or make others.

What only a picture shows (meshes, textures, materials) is taken out before MuJoCo compiles the
model: a check needs no file but the one it checks.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lxml import etree

from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.muted import muted
from rpctl.engines.mujoco.table import Fields, Table, tabulate
from rpctl.errors import DescriptionError, Finding, RpctlError, one_line
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.opening import read_input

ROOT = "mujoco"
A_FILE = "an MJCF file that `rpctl export` wrote"
NOT_READ = {  # elements that a check does not read, and what they do
    "include": "reads another file",
    "model": "reads another file",
    "attach": "takes parts of another model",
    "plugin": "runs code of others",
    "extension": "runs code of others",
    "replicate": "makes copies",
    "composite": "makes elements",
    "flexcomp": "makes elements",
    "flex": "is a soft body",
    "skin": "is drawn only",
    "hfield": "is ground of another kind",
}
COUNTS = ("nsample", "nkey", "nuserdata", "memory")  # of numbers that MuJoCo keeps room for
MAX_DIGITS = 4  # of such a count
DRAWN_ASSETS = ("texture", "material", "mesh")


@dataclass(frozen=True)
class StrictMjcf:
    """An MJCF file, read and compiled without what only a picture shows.

    Attributes:
        path: The file.
        model: ``MjModel``; a mesh is a ball in it.
        table: What the file means, with the names of meshes and the attributes of assets.
        texts: The custom texts, by name.
    """

    path: Path
    model: Any = field(repr=False)
    table: Table = field(repr=False)
    texts: dict[str, str] = field(repr=False)


def read_mjcf(path: str | Path) -> StrictMjcf:
    """Return an MJCF file.

    Raises:
        RpctlError: It cannot be opened, is no MJCF, or MuJoCo refuses it.
    """
    return parse_mjcf(read_input(path, "MAX_BYTES", A_FILE), path)


def parse_mjcf(data: bytes, path: str | Path) -> StrictMjcf:
    """Return the MJCF file that some bytes are.

    Args:
        data: The bytes.
        path: Where they lie, for messages.

    Raises:
        RpctlError: They are no MJCF, or MuJoCo refuses it.
    """
    root = _parsed(data, path)
    for element in root.iter():
        why = NOT_READ.get(element.tag) or _greed(element)
        if why:
            fault = f"<{element.tag}> {why}: a check does not read it"
            raise _fault(path, f"{fault}; write out what it stands for, or export again", element)
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
    """Return how an element asks for more memory than its text has, or nothing."""
    words = {name: text for name, text in element.items() if name in COUNTS}
    if element.tag == "size":
        words |= dict(element.items())
    greedy = (text for text in words.values() if not (text.isdigit() and len(text) <= MAX_DIGITS))
    return "asks for memory" if any(greedy) else ""


def _parsed(data: bytes, path: str | Path) -> Any:
    """Return the root element of a file's bytes, without comments."""
    if data.count(b"<") > 2 * cap("MAX_ELEMENTS"):
        raise _fault(path, f"too many elements; {how_to_raise('MAX_ELEMENTS')}")
    parser = etree.XMLParser(
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
    """Take meshes, materials and textures out of a model; return each geom and its mesh's name.

    A mesh becomes a small ball in its place. One that collides is a change of the table's, too:
    rpctl exports no such.
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
    """Return the attributes of what pictures show, by kind and name."""
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
