"""The process that reads, draws and measures meshes: confined, with neither files nor environment.

Readers of meshes are large, and their input is other people's. What this process answers is
checked again by who asked.
"""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from rpctl.description.meshes.headers import MeshFaultError
from rpctl.description.meshes.jobs import (
    Answer,
    convex_hull,
    make_primitive,
    measure_solid,
    read_mesh,
    shade_mesh,
)
from rpctl.files.array_messages import pack, unpack
from rpctl.files.caps import how_to_raise
from rpctl.files.worker import Channel

Job = Callable[[Mapping[str, Any], Sequence[Any]], Answer]

JOBS: dict[str, Job] = {
    "read": read_mesh,
    "shade": shade_mesh,
    "primitive": make_primitive,
    "solid": measure_solid,
    "hull": convex_hull,
}
# Trimesh imports them if they are there. No job needs them, and pictures are not to be decoded.
UNUSED = ("PIL", "networkx", "shapely", "rtree", "jsonschema", "manifold3d", "mapbox_earcut")
LIBRARIES = ("scipy.spatial", "trimesh.creation", "collada", "lxml.etree", "fast_simplification")
MAX_REQUEST = 2**40  # bytes; who asks is trusted
WORDS = {  # for what the readers' errors mean
    IndexError: "a triangle refers to a missing vertex",
    KeyError: "it refers to a missing part",
    UnicodeDecodeError: "it is not text",
}


def prepare() -> None:
    """Import what the jobs need; nothing is found once the process is confined."""
    sys.modules.update(dict.fromkeys(UNUSED))  # type: ignore[arg-type]
    logging.disable()
    warnings.simplefilter("ignore")
    for name in LIBRARIES:
        with suppress(ImportError):  # a format that lacks its reader is refused when it comes
            import_module(name)


def main(channel: Channel, jobs: Mapping[str, Job] = JOBS) -> None:
    """Answer jobs, by name, until nobody asks any more."""
    while True:
        try:
            request = channel.receive(MAX_REQUEST)
        except EOFError:
            return
        channel.send(_answer(request, jobs))


def _answer(request: bytes, jobs: Mapping[str, Job]) -> bytes:
    """Return the message that answers one request: what was asked for, or its ``fault``."""
    try:
        head, arrays = unpack(request)
        return pack(*jobs[head["job"]](head, arrays))
    except MeshFaultError as error:
        return pack({"fault": str(error)})
    except MemoryError:
        return pack(
            {"fault": f"refused: it needs too much memory; {how_to_raise('MAX_MESH_MEMORY')}"}
        )
    except RecursionError:
        return pack({"fault": "refused: its parts are nested too deeply"})
    except Exception as error:  # readers of foreign formats fail in every way there is
        reason = next((text for kind, text in WORDS.items() if isinstance(error, kind)), None)
        return pack({"fault": f"not readable ({reason or type(error).__name__}); export it again"})
