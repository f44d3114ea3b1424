"""Small ROS workspaces for tests: packages at any depth, robots that include from one another."""

from __future__ import annotations

from pathlib import Path

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
LINK = (
    '<link name="{}"><inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
    'ixz="0" iyz="0"/></inertial></link>'
)


def link(name: str, mass: str = "1") -> str:
    """Return a link with an inertia."""
    return LINK.format(name, mass)


def fixed(name: str, parent: str, child: str) -> str:
    """Return a fixed joint."""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="fixed">{ends}</joint>'


def write(path: Path, text: str) -> Path:
    """Write a file, its folders first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def package(folder: Path, name: str | None = None) -> Path:
    """Make a folder a package, called as it is or otherwise."""
    write(folder / "package.xml", f"<package><name>{name or folder.name}</name></package>")
    return folder


def xacro(path: Path, *lines: str) -> Path:
    """Write a file of xacro; the first of the lines is its second."""
    return write(path, "\n".join([f'<robot name="r" {XACRO}>', *lines, "</robot>", ""]))
