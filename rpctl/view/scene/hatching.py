"""The hatched paint of what stands in for a missing mesh: stripes along planes x + y + z = c.

The place of a vertex in the stripes is linear in its coordinates, so that any triangles carry
them, without seams, and every face of a box shows diagonals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rpctl.view.scene import threejs

HATCH = "hatch"
STRIPE_RATIO = 0.025  # of the robot's size: from one stripe to the next
LIGHT, DARK = (240, 241, 244), (150, 160, 173)  # colours of the ground and of the stripes
DARK_RATIO = 0.3  # of the distance between two stripes: how wide a stripe is
TEXELS = 64  # of a stripe and the gap beside it
SMOOTH_TEXELS = 2.0  # of a stripe's edge
REPEAT, LINEAR = 1000, 1006  # three.js: RepeatWrapping, LinearFilter
RGBA_FORMAT, UNSIGNED_BYTES = 1023, 1009  # three.js: RGBAFormat, UnsignedByteType


def coordinates(vertices: NDArray[np.float32], size: float) -> threejs.Json:
    """Return the places of vertices in the stripes as a vertex attribute.

    Args:
        vertices: (n, 3), m.
        size: Of the robot, m.
    """
    along = vertices.sum(axis=1, dtype=float) / (np.sqrt(3.0) * STRIPE_RATIO * size)
    return threejs.attribute(np.column_stack([along, np.zeros(len(along))]).astype(np.float32))


def image() -> threejs.Json:
    """Return one stripe and the gap beside it as pixels: no file that would be loaded later."""
    place = np.arange(TEXELS) + 0.5
    edge = np.minimum(place, TEXELS - place) - 0.5 * (1.0 - DARK_RATIO) * TEXELS
    share = np.clip(0.5 + edge / SMOOTH_TEXELS, 0.0, 1.0)[:, None]
    rgb = np.rint((1.0 - share) * LIGHT + share * DARK)
    pixels = np.column_stack([rgb, np.full(TEXELS, 255)]).astype(np.uint8)
    data = {"type": "Uint8Array", "data": threejs.typed(pixels), "width": TEXELS, "height": 1}
    return {"uuid": HATCH, "url": data}


def texture() -> threejs.Json:
    """Return the stripes as a texture, which is repeated."""
    return {
        "uuid": HATCH,
        "image": HATCH,
        "wrap": [REPEAT, REPEAT],
        "minFilter": LINEAR,
        "magFilter": LINEAR,
        "format": RGBA_FORMAT,
        "type": UNSIGNED_BYTES,
    }
