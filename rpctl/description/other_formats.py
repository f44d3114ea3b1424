"""Formats that are given in a URDF's place, known by their first bytes or their root element."""

from __future__ import annotations

import re

UNPACK = "unpack it and give the .urdf inside"
EXPORT = "export the robot as URDF"
GIVE = "give the .urdf"
MAGIC = (
    (b"\x89PNG", "a PNG picture", GIVE),
    (b"\xff\xd8\xff", "a JPEG picture", GIVE),
    (b"GIF8", "a GIF picture", GIVE),
    (b"%PDF", "a PDF", GIVE),
    (b"PK\x03\x04", "a ZIP archive", UNPACK),
    (b"\x1f\x8b", "a gzip archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"7z\xbc\xaf", "a 7z archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"\x7fELF", "a program", GIVE),
    (b"glTF", "a glTF mesh", GIVE),
    (b"PXR-USDC", "USD", EXPORT),
)
BEGINNINGS = (
    (r"\{|\[", "JSON", GIVE),
    (r"(?i)<!doctype\s+html|<html\b", "HTML, a page", "download the raw file"),
    (r"version https://git-lfs", "a Git LFS pointer", "run `git lfs pull`"),
    (r"\d{3}: [A-Z][a-z]+", "a server's error message", "download the file anew"),
    (r"solid\b", "an STL mesh", GIVE),
    (r"ply\b", "a PLY mesh", GIVE),
    (r"#usda\b", "USD", EXPORT),
    (r"#VRML\b", "VRML", EXPORT),
    (r"%YAML|---\s", "YAML", GIVE),
)
ROOTS = {
    "sdf": ("SDF", EXPORT),
    "gazebo": ("SDF", EXPORT),
    "world": ("SDF", EXPORT),
    "model": ("SDF", EXPORT),
    "mujoco": ("MJCF", EXPORT),
    "mujocoinclude": ("MJCF", EXPORT),
    "COLLADA": ("COLLADA, a mesh", GIVE),
    "html": ("HTML, a page", "download the raw file"),
    "svg": ("an SVG picture", GIVE),
    "launch": ("a ROS launch file", GIVE),
    "package": ("a ROS package's manifest", GIVE),
}


def foreign_bytes(data: bytes) -> str | None:
    """Return what a binary file is, and the way out; None where it is nothing known."""
    for magic, kind, fix in MAGIC:
        if data.startswith(magic):
            return f"this is {kind}, not URDF; {fix}"
    return None


def foreign_text(beginning: str) -> str | None:
    """Return what a text is that begins so, and the way out; None where it is nothing known."""
    for pattern, kind, fix in BEGINNINGS:
        if re.match(pattern, beginning):
            return f"this is {kind}, not URDF; {fix}"
    return None


def foreign_root(name: str) -> str | None:
    """Return what an XML file is whose root element has this name; None for a URDF."""
    if name.rpartition(":")[2] == "robot":
        return None
    if name in ROOTS:
        kind, fix = ROOTS[name]
        return f"this is {kind}, not URDF; {fix}"
    return f"the root element is <{name[:60]}>; a URDF's is <robot>"
