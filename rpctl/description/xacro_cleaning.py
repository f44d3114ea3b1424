"""What is done to an expanded document: packages named portably, loose ends dropped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

FILE, PACKAGE = "file://", "package://"


def name_packages(document: Any, folders: Mapping[str, str]) -> None:
    """Write meshes by their package, ``package://``, instead of the folder that it lies in.

    So the text does not depend on where a workspace lies.

    Args:
        document: The document, changed in place.
        folders: Folders of packages by name.
    """
    longest = sorted(folders.items(), key=lambda each: -len(each[1]))
    for mesh in document.getElementsByTagName("mesh"):
        path = mesh.getAttribute("filename")
        if path.startswith(FILE + PACKAGE):  # $(find) of a package that is not there
            mesh.setAttribute("filename", path.removeprefix(FILE))
        plain = path.removeprefix(FILE)
        for name, folder in longest:
            if plain.startswith(f"{folder}/"):
                rest = plain.removeprefix(f"{folder}/")
                mesh.setAttribute("filename", f"{PACKAGE}{name}/{rest}")
                break


def drop_dangling(document: Any) -> list[str]:
    """Remove joints to links that are not there, and what hangs on links that are not there.

    Args:
        document: The document, changed in place.

    Returns:
        What was removed, in phrases.
    """
    robot, said = document.documentElement, []
    while (found := next(_dangling(robot), None)) is not None:
        joint, child, missing = found
        _remove(joint)
        if child == missing:
            said.append(f'joint "{joint.getAttribute("name")}", whose link "{missing}" is missing')
            continue
        links = _drop_below(robot, child)
        said.append(f'{", ".join(links)}, which hang on the missing link "{missing}"')
    joints = {joint.getAttribute("name") for joint in _children(robot, "joint")}
    for transmission in list(_children(robot, "transmission")):
        driven = [each.getAttribute("name") for each in _children(transmission, "joint")]
        if driven and not joints.intersection(driven):
            _remove(transmission)
            said.append(f'transmission "{transmission.getAttribute("name")}"')
    return said


def _dangling(robot: Any) -> Iterator[tuple[Any, str, str]]:
    """Yield the joints to or from a link that is not there: joint, its child, the link."""
    links = {link.getAttribute("name") for link in _children(robot, "link")}
    for joint in _children(robot, "joint"):
        parent, child = _end(joint, "parent"), _end(joint, "child")
        for link in (child, parent):
            if link and link not in links:
                yield joint, child, link
                break


def _drop_below(robot: Any, link: str) -> list[str]:
    """Remove a link and all that it carries; return the links' names."""
    names, queue = [], [link]
    while queue:
        name = queue.pop()
        names.append(name)
        for element in list(_children(robot, "link")):
            if element.getAttribute("name") == name:
                _remove(element)
        for joint in list(_children(robot, "joint")):
            if _end(joint, "parent") == name:
                queue.append(_end(joint, "child"))
                _remove(joint)
    return names


def _end(joint: Any, tag: str) -> str:
    return next((end.getAttribute("link") for end in _children(joint, tag)), "")


def _children(element: Any, tag: str) -> Iterator[Any]:
    return (child for child in list(element.childNodes) if child.nodeName == tag)


def _remove(element: Any) -> None:
    element.parentNode.removeChild(element)
