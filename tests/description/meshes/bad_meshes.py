"""Meshes that are not what they should be: bombs, absurd numbers, headers that lie."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence

import numpy as np

TRIANGLE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
Points = Sequence[Sequence[float]]


def stl(points: Points, count: int | None = None) -> bytes:
    """Return a binary STL of triangles, three points (m) each; ``count``: what its header says."""
    corners = np.asarray(points, np.float32).reshape(-1, 3, 3)
    data = np.zeros(len(corners), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    data["v"] = corners
    return bytes(80) + struct.pack("<I", len(corners) if count is None else count) + data.tobytes()


def obj(points: Points, faces: Sequence[Sequence[int]]) -> bytes:
    """Return an OBJ; ``faces`` are as they are written, from 1."""
    lines = [f"v {' '.join(map(repr, point))}" for point in points]
    lines += [f"f {' '.join(map(str, face))}" for face in faces]
    return "\n".join([*lines, ""]).encode()


def ply(points: Points, faces: Sequence[Sequence[int]], comment: str = "made by hand") -> bytes:
    """Return a PLY in ASCII; ``faces`` count from 0."""
    head = ["ply", "format ascii 1.0", f"comment {comment}", f"element vertex {len(points)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    body = [" ".join(map(repr, point)) for point in points]
    body += [f"{len(face)} {' '.join(map(str, face))}" for face in faces]
    return "\n".join([*head, *body, ""]).encode()


def dae(
    points: Points = TRIANGLE,
    indices: Sequence[int] = (0, 1, 2),
    unit: str = "1",
    nodes: str = "",
    scene: str = '<node><instance_geometry url="#g"/></node>',
) -> bytes:
    """Return a DAE of one geometry, ``g``.

    Args:
        points: Its vertices.
        indices: Corners of its triangles, three each; other than three for all are one polygon.
        unit: What its unit is, m.
        nodes: Nodes of its library, ``library_nodes``.
        scene: Nodes of its scene.
    """
    values = " ".join(repr(value) for point in points for value in point)
    corners = " ".join(map(str, indices))
    if len(indices) == 3:
        faces = f'<triangles count="1">{{}}<p>{corners}</p></triangles>'
    else:
        faces = (
            f'<polylist count="1">{{}}<vcount>{len(indices)}</vcount><p>{corners}</p></polylist>'
        )
    faces = faces.format('<input semantic="VERTEX" source="#v" offset="0"/>')
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{unit}"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="{3 * len(points)}">{values}</float_array><technique_common>
<accessor source="#a" count="{len(points)}" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{faces}</mesh></geometry>
</library_geometries><library_nodes>{nodes}</library_nodes>
<library_visual_scenes><visual_scene id="s">{scene}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def dae_bomb(depth: int, width: int = 2) -> bytes:
    """Return a DAE whose triangle is shown ``width**depth`` times, by nodes within nodes."""
    nodes = ['<node id="n0"><instance_geometry url="#g"/></node>']
    for level in range(1, depth + 1):
        inner = f'<instance_node url="#n{level - 1}"/>' * width
        nodes.append(f'<node id="n{level}">{inner}</node>')
    return dae(nodes="".join(nodes), scene=f'<node><instance_node url="#n{depth}"/></node>')


def polygon(corners: int) -> list[tuple[float, float, float]]:
    """Return the corners of a regular polygon of radius 1 m."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    return [(float(np.cos(angle)), float(np.sin(angle)), 0.0) for angle in angles]


def glb(header: dict[str, object], binary: bytes = b"") -> bytes:
    """Return a GLB of a JSON header and its binary part."""
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def glb_triangle(**changes: object) -> dict[str, object]:
    """Return the header of a GLB with one triangle; its binary part is ``GLB_BINARY``."""
    header: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 48}],
    }
    return header | changes


GLB_BINARY = np.asarray(TRIANGLE, "<f4").tobytes() + np.arange(3, dtype="<u4").tobytes()
LOOP = '<node id="a"><instance_node url="#b"/></node><node id="b"><instance_node url="#a"/></node>'


def _scaled(factor: float) -> list[tuple[float, ...]]:
    return [tuple(factor * value for value in point) for point in TRIANGLE]


def _accessor(number: int, **changes: object) -> bytes:
    """Return a GLB of one triangle, one of whose accessors says something else."""
    accessors: list[dict[str, object]] = glb_triangle()["accessors"]  # type: ignore[assignment]
    accessors[number] |= changes
    return glb(glb_triangle(accessors=accessors), GLB_BINARY)


LYING_PLY = ply(TRIANGLE, [(0, 1, 2)]).replace(b"vertex 3", b"vertex 4000000000")
MANY = "but at most 1,000,000 are allowed; to allow it, set RPCTL_MAX_MESH_TRIANGLES"
BAD: dict[str, tuple[bytes, str]] = {  # by name: what the file holds, and what is said of it
    "bomb.dae": (dae_bomb(18), "refused: it shows 262,144 parts"),
    "wide.dae": (dae_bomb(5, 16), f"refused: it shows 1,048,576 triangles, {MANY}"),
    "deep.dae": (dae_bomb(200), "it shows more than can be counted triangles"),
    "nested.dae": (
        dae(scene="<node>" * 400 + "</node>" * 400),
        "in a loop, or are nested too deeply",
    ),
    "loop.dae": (dae(nodes=LOOP, scene='<node><instance_node url="#a"/></node>'), "in a loop"),
    "zero.dae": (dae(unit="0"), 'its unit is "0" m; write a length'),
    "negative.dae": (dae(unit="-1"), 'its unit is "-1" m'),
    "infinite.dae": (dae(unit="inf"), 'its unit is "inf" m'),
    "nan.dae": (dae(unit="nan"), 'its unit is "nan" m'),
    "huge.dae": (dae(unit="1e300"), 'its unit is "1e300" m'),
    "tiny.dae": (dae(unit="1e-300"), 'its unit is "1e-300" m'),
    "words.dae": (dae(unit="mm"), 'its unit is "mm" m'),
    "below.dae": (dae(indices=(0, 1, -1)), "a triangle names a vertex below 0"),
    "out.dae": (dae(indices=(0, 1, 9)), "no triangles with valid vertices"),
    "far.dae": (
        dae(points=_scaled(1e30)),
        "its vertices reach 1e+30 m; at most 1e+09 m are allowed",
    ),
    "over.dae": (dae(points=_scaled(1e300)), "with valid vertices"),
    "broken.dae": (dae()[:-100], "not XML"),
    "far.stl": (stl(_scaled(3e38)), "its vertices reach 3e+38 m"),
    "nan.stl": (stl([(float("nan"), 0, 0), *TRIANGLE[1:]]), "vertices are not numbers"),
    "point.stl": (stl([(1, 1, 1)] * 3), "is degenerate: its only triangle has no area"),
    "line.stl": (stl([(0, 0, 0), (0.1, 0.1, 0.1), (0.3, 0.3, 0.3)] * 2), "all of its 2 triangles"),
    "count.stl": (stl(TRIANGLE, 2**32 - 1), "its header promises 4294967295 triangles"),
    "short.stl": (stl(TRIANGLE)[:-1], "its header promises 1 triangles"),
    "empty.stl": (stl([]), "has no triangles"),
    "far.obj": (obj(_scaled(1e300), [(1, 2, 3)]), "its vertices reach 1e+300 m"),
    "out.obj": (obj(TRIANGLE, [(1, 2, 9)]), "a triangle refers to a missing vertex"),
    "zero.obj": (obj(TRIANGLE, [(0, 1, 2)]), "names vertex 0, and an OBJ counts from 1"),
    "points.obj": (obj(TRIANGLE, []), "has no triangles"),
    "out.ply": (ply(TRIANGLE, [(0, 1, 9)]), "a triangle names vertex 9 of 3 (from 0)"),
    "below.ply": (ply(TRIANGLE, [(0, 1, -1)]), "a triangle names vertex -1 of 3 (from 0)"),
    "points.ply": (ply(TRIANGLE, []), "has no triangles, only 3 points"),
    "count.ply": (LYING_PLY, 'its header promises 4000000000 of "vertex", and'),
    "none.ply": (b"ply\n", "its header is not that of a PLY"),
    "count.glb": (_accessor(0, count=2**31), f"it shows 715,827,882 triangles, {MANY}"),
    "zeros.glb": (_accessor(0, bufferView=None, count=2**30), "it shows 357,913,941 triangles"),
    "below.glb": (_accessor(0, count=-3), "its header is damaged"),
    "text.glb": (b"glTF" + bytes(40), "not a GLB of version 2"),
    "loop.glb": (glb(glb_triangle(nodes=[{"children": [0]}]), GLB_BINARY), "has no triangles"),
}
