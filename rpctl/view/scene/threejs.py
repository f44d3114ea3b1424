"""three.js objects as meshcat sends them: JSON with typed arrays, packed with MessagePack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import NDArray

Json = dict[str, Any]

STILL = 1e-6  # m and entries of a quaternion: what moves less stands still
ARRAY_TYPES = {  # NumPy type: (its name in three.js, MessagePack extension of the viewer)
    "int8": ("Int8Array", 0x11),
    "uint8": ("Uint8Array", 0x12),
    "uint16": ("Uint16Array", 0x14),
    "uint32": ("Uint32Array", 0x16),
    "float32": ("Float32Array", 0x17),
}
# What nodes, materials and textures hold, by their entry, and the list of it in a command
HELD = {"geometry": "geometries", "material": "materials", "map": "textures", "image": "images"}


def typed(array: NDArray[Any]) -> Any:
    """Return an array as a typed array of the viewer, row after row."""
    return umsgpack.Ext(ARRAY_TYPES[array.dtype.name][1], np.ascontiguousarray(array).tobytes())


def attribute(array: NDArray[Any], normalized: bool = False) -> Json:
    """Return a vertex attribute from an array (n, size)."""
    return {
        "itemSize": array.shape[1],
        "type": ARRAY_TYPES[array.dtype.name][0],
        "array": typed(array),
        "normalized": normalized,
    }


def geometry(attributes: Mapping[str, Json], index: NDArray[Any] | None = None) -> Json:
    """Return a ``BufferGeometry``; ``index`` holds the corners of its triangles.

    Args:
        attributes: Vertex attributes by name.
        index: Triangles (n, 3), as indices of vertices; None if vertices are listed in order.
    """
    data: Json = {"attributes": dict(attributes)}
    if index is not None:
        small = index.size == 0 or index.max() < 2**16
        corners = index.reshape(-1).astype(np.uint16 if small else np.uint32)
        data["index"] = {"type": ARRAY_TYPES[corners.dtype.name][0], "array": typed(corners)}
    return {"type": "BufferGeometry", "data": data}


def node(kind: str, name: str, pose: NDArray[np.float64] | None = None, **entries: Any) -> Json:
    """Return an object of the scene graph, which holds its geometry, its material and its children.

    Args:
        kind: Its class in three.js.
        name: Of the object.
        pose: Matrix (4, 4) at which it is fixed, which may mirror; None: it can be moved.
        entries: The rest of it.
    """
    found = {"uuid": name, "type": kind, "name": name, **entries}
    if pose is not None:
        found |= {"matrix": pose.T.reshape(-1).tolist(), "matrixAutoUpdate": False}
    return found


def colour(rgb: Sequence[float]) -> int:
    """Return 0xRRGGBB of a colour, each in [0, 1]."""
    red, green, blue = (round(255.0 * min(max(float(part), 0.0), 1.0)) for part in rgb[:3])
    return red << 16 | green << 8 | blue


def set_object(path: str, root: Json) -> bytes:
    """Return the command that places an object, with its children, at a path.

    Geometries, materials, textures and images are listed once, whatever holds them. Pixels stand in
    the command: files would be loaded later than the animation.
    """
    lists: dict[str, list[Json]] = {kind: [] for kind in HELD.values()}
    known: dict[bytes, str] = {}

    def listed(entry: Json) -> Json:
        """Return an entry with names in the place of what it holds."""
        found = dict(entry)
        for key in [key for key in HELD if key in entry]:
            held = listed(entry[key])
            kind, content = HELD[key], pack(held)
            if content not in known:
                known[content] = f"{kind}-{len(lists[kind])}"
                lists[kind].append({"uuid": known[content], **held})
            found[key] = known[content]
        if "children" in entry:
            found["children"] = [listed(child) for child in entry["children"]]
        return found

    scene: Json = {"metadata": {"version": 4.5, "type": "Object"}, "object": listed(root)}
    scene |= {kind: entries for kind, entries in lists.items() if entries}
    return pack({"type": "set_object", "path": path, "object": scene})


def set_group(path: str, name: str, children: Sequence[Json]) -> bytes:
    """Return the command that places a group of objects at a path."""
    return set_object(path, node("Group", name, children=list(children)))


def set_animation(path: str, tracks: Sequence[Json]) -> bytes:
    """Return the command that animates the nodes below a path; the times of tracks are in s."""
    animation = {"path": path, "clip": {"fps": 1, "name": "run", "tracks": list(tracks)}}
    options = {"play": True, "repetitions": 1}
    return pack(
        {"type": "set_animation", "animations": [animation], "options": options, "path": ""}
    )


def motion_tracks(name: str, times: NDArray[Any], motion: NDArray[Any]) -> list[Json]:
    """Return the tracks of a node's position and quaternion; of one that stands still its first.

    Args:
        name: The node.
        times: Of the frames (n,), s.
        motion: Its poses (n, 7): position, m, and quaternion x, y, z, w.
    """
    tracks = []
    for key, kind, values in (
        ("position", "vector3", motion[:, :3]),
        ("quaternion", "quaternion", motion[:, 3:]),
    ):
        count = len(times) if np.ptp(values, axis=0).max() > STILL else 1
        shown = {"times": times[:count], "values": values[:count]}
        arrays = {what: typed(each.astype(np.float32)) for what, each in shown.items()}
        tracks.append({"name": f"{name}.{key}", "type": kind, **arrays})
    return tracks


def pack(command: Json) -> bytes:
    """Return a command as MessagePack."""
    return bytes(umsgpack.packb(command))
