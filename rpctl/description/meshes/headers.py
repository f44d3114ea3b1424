"""What a mesh file promises, before any of it is read: how many triangles, in how many pieces.

A few bytes can name a piece a million times. It is counted here from the file's structure, so that
no reader has to find out by doing.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rpctl.files.caps import how_to_raise

GLB_HEAD, JSON_CHUNK = 20, b"JSON"  # bytes before a GLB's JSON, and what they end in
DAE_PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
UNIT_RANGE = (1e-7, 1e7)  # m: a DAE's unit; beyond it no part of a robot has sensible numbers
PLY_ELEMENT = re.compile(rb"^element\s+(\w+)\s+(-?\d+)\s*$", re.MULTILINE)
OBJ_ZERO = re.compile(rb"^f[ \t](?:[^\n]*[ \t])?0(?=[/\s])", re.MULTILINE)
STL_HEAD, STL_TRIANGLE = 84, 50  # bytes of a binary STL
MAX_DEPTH = 256  # of nodes in nodes


class MeshFaultError(Exception):
    """What is wrong with a mesh file, and how to mend it."""


class Size(NamedTuple):
    """How much a mesh file shows."""

    parts: int
    triangles: int


def check_header(kind: str, content: bytes, most: Size) -> Size | None:
    """Return what a file promises, where its header tells; refuse more than it may, or has.

    Args:
        kind: Its ending, without the dot.

    Raises:
        MeshFaultError: It does.
    """
    size = CHECKS[kind](content)
    if size is not None:
        require_within(size, most)
    return size


def require_within(size: Size, most: Size) -> None:
    """Refuse a file that shows more than it may.

    Raises:
        MeshFaultError: It does.
    """
    for count, cap, what, name in (
        (size.triangles, most.triangles, "triangles", "MAX_MESH_TRIANGLES"),
        (size.parts, most.parts, "parts", "MAX_MESH_PARTS"),
    ):
        if count > cap:
            said = f"{count:,}" if count < 1e15 else "more than can be counted"
            raise MeshFaultError(
                f"refused: it shows {said} {what}, but at most {cap:,} are allowed; "
                f"{how_to_raise(name)}"
            )


def _check_dae(content: bytes) -> Size:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    try:
        root: Any = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise MeshFaultError(f"not readable: not XML ({error.msg}); export it again") from None
    _require_unit(root)
    nodes = {n.get("id"): n for n in root.iter("{*}node") if n.get("id")}
    geometries = {g.get("id"): _dae_geometry(g) for g in root.iter("{*}geometry")}
    known: dict[Any, Size] = {}

    def count(node: Any, above: tuple[Any, ...]) -> Size:
        if node in above or len(above) > MAX_DEPTH:
            raise MeshFaultError(
                "refused: its nodes contain each other in a loop, or are nested too deeply"
            )
        if node not in known:
            sizes = [count(inner, (*above, node)) for inner in node.iterchildren("{*}node")]
            for each in node.iterchildren("{*}instance_node"):
                target = nodes.get(each.get("url", "")[1:])
                sizes += [] if target is None else [count(target, (*above, node))]
            for each in node.iterchildren("{*}instance_geometry"):
                sizes.append(geometries.get(each.get("url", "")[1:], Size(0, 0)))
            known[node] = Size(sum(s.parts for s in sizes), sum(s.triangles for s in sizes))
        return known[node]

    scenes = [count(scene, ()) for scene in root.iter("{*}visual_scene")]
    return Size(sum(s.parts for s in scenes), sum(s.triangles for s in scenes))


def _require_unit(root: Any) -> None:
    """Refuse a DAE whose unit is no length."""
    for unit in root.iter("{*}unit"):
        text = unit.get("meter", "1")
        try:
            metres = float(text)
        except ValueError:
            metres = math.nan
        if not UNIT_RANGE[0] <= metres <= UNIT_RANGE[1]:
            raise MeshFaultError(
                f'refused: its unit is "{text}" m; write a length, as <unit meter="0.001"/> for mm'
            )


def _dae_geometry(geometry: Any) -> Size:
    """Return the size of a geometry; polygons may have fewer triangles than is counted here."""
    parts = triangles = 0
    for primitive in geometry.iter(*(f"{{*}}{name}" for name in DAE_PRIMITIVES)):
        texts = [p.text or "" for p in primitive.iterchildren("{*}p")]
        if any("-" in text for text in texts):
            raise MeshFaultError("refused: a triangle names a vertex below 0; export it again")
        offsets = [int(each.get("offset", 0)) for each in primitive.iterchildren("{*}input")]
        corners = sum(len(text.split()) for text in texts) // (max(offsets, default=0) + 1)
        triangles += corners // 3 if primitive.tag.endswith("triangles") else corners
        parts += 1
    return Size(parts, triangles)


def _check_glb(content: bytes) -> Size:
    length = int.from_bytes(content[12:16], "little")
    if content[:4] != b"glTF" or content[16:GLB_HEAD] != JSON_CHUNK:
        raise MeshFaultError("not readable: not a GLB of version 2; export it again")
    try:
        return _glb_size(json.loads(content[GLB_HEAD : GLB_HEAD + length]))
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise MeshFaultError(
            f"not readable: its header is damaged ({type(error).__name__}); export it again"
        ) from None


def _glb_size(header: Mapping[str, Any]) -> Size:
    """Return the size of all instances of a GLB's meshes."""
    counts = [int(accessor["count"]) for accessor in header.get("accessors", [])]
    if any(count < 0 for count in counts):
        raise ValueError
    meshes = []
    for mesh in header.get("meshes", []):
        primitives = mesh["primitives"]
        corners = [p.get("indices", p["attributes"].get("POSITION")) for p in primitives]
        triangles = sum(counts[each] // 3 for each in corners if each is not None)
        vertices = [p["attributes"].get("POSITION") for p in primitives]
        # A vertex costs as much as a triangle, whether or not one needs it.
        triangles = max(triangles, sum(counts[v] // 3 for v in vertices if v is not None))
        meshes.append(Size(len(primitives), triangles))
    shown = [meshes[node["mesh"]] for node in header.get("nodes", []) if "mesh" in node]
    shown = shown or meshes
    return Size(
        sum(size.parts for size in shown) + len(header.get("nodes", [])),
        sum(size.triangles for size in shown),
    )


def _check_ply(content: bytes) -> Size | None:
    head, end, body = content.partition(b"end_header")
    if not end:
        raise MeshFaultError("not readable: its header is not that of a PLY; export it again")
    counts = {name: int(count) for name, count in PLY_ELEMENT.findall(head)}
    for name, count in counts.items():
        if not 0 <= count <= len(body):  # an element has a byte at least
            raise MeshFaultError(
                f'refused: its header promises {count} of "{name.decode()}", and {len(body)} bytes '
                "follow; export it again"
            )
    return Size(0, max(counts.get(b"face", 0), counts.get(b"vertex", 0) // 3))


def _check_stl(content: bytes) -> Size | None:
    count = int.from_bytes(content[STL_HEAD - 4 : STL_HEAD], "little")
    if len(content) == STL_HEAD + STL_TRIANGLE * count:
        return Size(1, count)
    if b"facet" not in content[:2048].lower() and len(content) >= STL_HEAD:
        raise MeshFaultError(
            f"refused: its header promises {count} triangles, which do not match its length; "
            "export it again"
        )
    return None


def _check_obj(content: bytes) -> None:
    if OBJ_ZERO.search(content):
        raise MeshFaultError("refused: a face names vertex 0, and an OBJ counts from 1")


CHECKS: dict[str, Callable[[bytes], Size | None]] = {
    "dae": _check_dae,
    "glb": _check_glb,
    "ply": _check_ply,
    "stl": _check_stl,
    "obj": _check_obj,
}
