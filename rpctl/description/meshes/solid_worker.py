"""The process that measures the bodies that meshes enclose, and their hulls; it starts slowly."""

from __future__ import annotations

from rpctl.description.meshes import worker as mesh_worker
from rpctl.description.meshes.jobs import convex_hull, measure_solid
from rpctl.files.worker import Channel


def prepare() -> None:
    """Import what hulls need; nothing is found once the process is confined."""
    mesh_worker.prepare(mesh_worker.UNUSED, ("scipy.spatial", "trimesh"))


def main(channel: Channel) -> None:
    """Answer jobs until nobody asks any more."""
    mesh_worker.main(channel, {"solid": measure_solid, "hull": convex_hull})
