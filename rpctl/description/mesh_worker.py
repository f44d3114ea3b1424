"""The process that reads meshes: confined, with neither files nor an environment.

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

from rpctl.description.mesh_headers import MeshFaultError
from rpctl.description.mesh_jobs import Answer, measure_solid, read_mesh, shade_mesh
from rpctl.files.array_messages import pack, unpack
from rpctl.files.caps import how_to_raise
from rpctl.files.worker import Channel

JOBS: dict[str, Callable[[Mapping[str, Any], Sequence[Any]], Answer]] = {
    "read": read_mesh,
    "shade": shade_mesh,
    "solid": measure_solid,
}
# Trimesh imports them if they are there. No job needs them, and pictures are not to be decoded.
UNUSED = ("PIL", "networkx", "shapely", "rtree", "jsonschema", "manifold3d", "mapbox_earcut")
LIBRARIES = ("trimesh", "collada", "lxml.etree", "scipy.sparse", "scipy.spatial",
             "fast_simplification")  # fmt: skip
MAX_REQUEST = 2**40  # bytes; who asks is trusted
WORDS = {  # for what the readers' errors mean
    IndexError: "a triangle names a vertex that is not there",
    KeyError: "a part that it names is not there",
    UnicodeDecodeError: "it is no text",
}


def prepare() -> None:
    """Import what the jobs need; nothing is found once the process is confined."""
    sys.modules.update(dict.fromkeys(UNUSED))  # type: ignore[arg-type]
    logging.disable()
    warnings.simplefilter("ignore")
    for name in LIBRARIES:
        with suppress(ImportError):  # a format that lacks its reader is refused when it comes
            import_module(name)


def main(channel: Channel) -> None:
    """Answer jobs until nobody asks any more."""
    while True:
        try:
            request = channel.receive(MAX_REQUEST)
        except EOFError:
            return
        channel.send(_answer(request))


def _answer(request: bytes) -> bytes:
    """Return the message that answers one request: what was asked for, or its ``fault``."""
    try:
        head, arrays = unpack(request)
        return pack(*JOBS[head["job"]](head, arrays))
    except MeshFaultError as error:
        return pack({"fault": str(error)})
    except MemoryError:
        fault = f"refused: it needs too much memory; {how_to_raise('MAX_MESH_MEMORY')}"
        return pack({"fault": fault})
    except RecursionError:
        return pack({"fault": "refused: its parts hold each other too deeply"})
    except Exception as error:  # readers of foreign formats fail in every way there is
        reason = next((text for kind, text in WORDS.items() if isinstance(error, kind)), None)
        return pack({"fault": f"not readable ({reason or type(error).__name__}); export it again"})
