"""Mesh files as the view draws them: the robot's own, found and read in one way."""

from rpctl.robot.mesh_files import Surface, read
from rpctl.robot.mesh_paths import MeshError, resolve

__all__ = ["MeshError", "Surface", "read", "resolve"]
