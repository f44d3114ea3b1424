"""What a figure or a scene draws, as numbers."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from rpctl import Run
from rpctl.view.pages.page import LegendEntry, Section, render
from rpctl.view.plots.figures import tracking_figure
from tests.view.samples import numbers, unpack

Array = np.ndarray[Any, Any]


def panel(run: Run, name: str, number: int = 0) -> Axes:
    axes: Axes = tracking_figure(run, panels=[name]).axes[number]
    return axes


def curves(axes: Axes, colour: str | None = None) -> list[Array]:
    """Return the points (n, 2) of the curves of a panel, or of those of one colour."""
    return [
        np.column_stack(line.get_data())
        for line in axes.lines
        if np.size(line.get_xdata())
        and (colour is None or to_hex(line.get_color()) == colour.lower())
    ]


def labelled(axes: Axes) -> dict[str, Array]:
    """Return the points of the curves that the panel's own legend names."""
    return {
        str(line.get_label()): np.column_stack(line.get_data())
        for line in axes.lines
        if not str(line.get_label()).startswith("_") and np.size(line.get_xdata())
    }


def drawn_by(commands: Sequence[bytes]) -> dict[str, dict[str, Any]]:
    """Return the commands by the path that they are about, or by their type."""
    return {c["path"] or c["type"]: c for c in map(unpack, commands)}


def embedded(page: str) -> dict[str, Any]:
    """Return the data that a page carries, with its commands as bytes."""
    found = re.search(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found.group(1))
    data["commands"] = [base64.b64decode(each) for each in data["commands"]]
    return data


def trails(commands: Sequence[bytes]) -> dict[str, Array]:
    """Return the vertices (n, 3) of the trails by their nodes' names."""
    scene = drawn_by(commands)["/rpctl/trails"]["object"]
    geometries = {g["uuid"]: g["data"]["attributes"]["position"] for g in scene["geometries"]}
    return {
        node["name"]: numbers(geometries[node["geometry"]]["array"]).reshape(-1, 3)
        for node in scene["object"]["children"]
    }


def middles(vertices: Array, count: int) -> Array:
    """Return the path (count, 3) in the middle of a band or tube."""
    return np.asarray(vertices.reshape(count, -1, 3).mean(axis=1))


def path_distances(points: Array, path: Array) -> Array:
    """Return the distances (n,) of points from a path of straight pieces."""
    start, step = path[:-1], np.diff(path, axis=0)
    fraction = np.einsum("nij,ij->ni", points[:, None] - start, step) / (step**2).sum(axis=1)
    foot = start + np.clip(fraction, 0.0, 1.0)[..., None] * step
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


def tracks(commands: Sequence[bytes]) -> dict[str, tuple[Array, Array]]:
    """Return times (n,) and values (n, size) of every animated property."""
    (animation,) = drawn_by(commands)["set_animation"]["animations"]
    found = {}
    for track in animation["clip"]["tracks"]:
        times = numbers(track["times"])
        found[track["name"]] = times, numbers(track["values"]).reshape(len(times), -1)
    return found


def floats(text: str) -> Array:
    return np.frombuffer(base64.b64decode(text), "<f4").astype(float)


def panel_text(sections: Sequence[Section]) -> str:
    """Return a panel as its page has it."""
    return str(render("panel.html", panel=sections))


def legend_text(entries: Sequence[LegendEntry]) -> str:
    """Return a legend as its page has it."""
    return str(render("legend.html", legend=entries))
