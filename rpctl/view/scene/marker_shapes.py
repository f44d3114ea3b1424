"""The shapes and the paint that markers are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.libraries import library
from rpctl.view.scene import threejs

AXIS_COLOURS = (
    (0.86, 0.20, 0.18),
    (0.18, 0.62, 0.22),
    (0.16, 0.42, 0.86),
)  # x red, y green, z blue
MASS_COLOUR, TOTAL_MASS_COLOUR, CONTACT_COLOUR, ROLLER_COLOUR, POINT_COLOUR = (
    0xE8A33D,
    0x6B3FA0,
    0x0072B2,
    0xCC4B9B,
    0x009E73,
)


def geometries() -> list[threejs.Json]:
    """Return axes, ball, disc, arrow and bar, each about 1 m long."""
    creation = library("trimesh.creation")

    ball = creation.icosphere(subdivisions=2)
    disc = creation.cylinder(1.0, 0.02, sections=32)
    return [
        threejs.geometry("marker-axes", *_axes()),
        _geometry("marker-ball", ball.vertices, ball.faces),
        _geometry("marker-disc", disc.vertices, disc.faces),
        _geometry("marker-arrow", *_flat([(0, 0.05), (0.7, 0.05), (0.7, 0.14), (1.0, 0.0)])),
        _geometry("marker-bar", *_flat([(-1.0, 0.045), (1.0, 0.045), (1.0, 0.0)])),
    ]


def materials() -> list[threejs.Json]:
    """Return the paint of each kind of marker, all seen through the robot."""
    seen = {"transparent": True, "depthTest": False, "depthWrite": False, "side": 2}
    flat = {"type": "MeshBasicMaterial", **seen}
    ball = {"type": "MeshLambertMaterial", "opacity": 0.7, **seen}
    return [
        {"uuid": "marker-axes", "vertexColors": 2, **flat},
        {"uuid": "marker-mass", "color": MASS_COLOUR, "emissive": 0x503000, **ball},
        {"uuid": "marker-whole", "color": TOTAL_MASS_COLOUR, "emissive": 0x201040, **ball},
        {"uuid": "marker-contact", "color": CONTACT_COLOUR, "opacity": 0.85, **flat},
        {"uuid": "marker-roller", "color": ROLLER_COLOUR, "opacity": 0.85, **flat},
        {"uuid": "marker-point", "color": POINT_COLOUR, "opacity": 0.85, **flat},
    ]


def _axes() -> tuple[dict[str, threejs.Json], NDArray[np.int64]]:
    """Return three thin boxes along the axes, each in its colour, and their triangles."""
    creation = library("trimesh.creation")

    vertices, colours, faces = [], [], []
    for axis, colour in enumerate(AXIS_COLOURS):
        edges, middle = np.full(3, 0.05), np.zeros(3)
        edges[axis], middle[axis] = 1.0, 0.5
        box = creation.box(edges)
        faces.append(box.faces + len(box.vertices) * axis)
        vertices.append(box.vertices + middle)
        colours.append(np.tile(np.rint(255.0 * np.array(colour)), (len(box.vertices), 1)))
    attributes = {
        "position": threejs.attribute(np.concatenate(vertices).astype(np.float32)),
        "color": threejs.attribute(np.concatenate(colours).astype(np.uint8), normalized=True),
    }
    return attributes, np.concatenate(faces)


def _geometry(uuid: str, vertices: Array, faces: NDArray[np.int64]) -> threejs.Json:
    unit = np.asarray(vertices, float)
    lengths = np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-9)
    attributes = {
        "position": threejs.attribute(unit.astype(np.float32)),
        "normal": threejs.attribute((unit / lengths).astype(np.float32)),
    }
    return threejs.geometry(uuid, attributes, np.asarray(faces))


def _flat(upper: list[tuple[float, float]]) -> tuple[Array, NDArray[np.int64]]:
    """Return a level figure that is its own mirror image about the x axis, from its upper edge."""
    edge = np.array(upper)
    outline = np.concatenate([edge, edge[::-1] * [1.0, -1.0]])
    count = len(edge)
    faces = []
    for k in range(count - 1):
        a, b, c, d = k, k + 1, 2 * count - 2 - k, 2 * count - 1 - k
        faces += [(a, b, c), (a, c, d)]
    return np.column_stack([outline, np.zeros(len(outline))]), np.array(faces)
