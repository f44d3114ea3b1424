"""One self-contained HTML file that plays a run; it needs no server and no network."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from rpctl.errors import RpctlError
from rpctl.files import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize
from rpctl.view.panel import legend, panel, subtitle
from rpctl.view.scene import Scene, build_scene

MESHCAT_SCRIPT = "viewer/dist/main.min.js"


def write_report(
    run: Run,
    path: str | Path,
    *,
    robot: Robot | None = None,
    scene: Scene | None = None,
    summary: Mapping[str, Any] | None = None,
) -> Path:
    """Write the report of a run: one HTML file, there whole or not at all.

    Args:
        run: The run.
        path: The file.
        robot: Its robot, where it is loaded already.
        scene: Its scene, where it is built already.
        summary: Its figures of merit; None computes them.

    Returns:
        The path.

    Raises:
        RpctlError: The robot of the run cannot be loaded, or meshcat lacks its viewer.
    """
    if scene is None:
        scene = build_scene(robot or run.load_robot(), run)
    html = render(run, scene, summarize(run) if summary is None else summary)
    return write_atomically(path, html.encode())


def render(run: Run, scene: Scene, summary: Mapping[str, Any]) -> str:
    """Return the report as HTML."""
    meshcat, script = _meshcat(), _asset("report.js")
    name = escape(run.robot)
    return Template(_asset("template.html")).substitute(
        policy=_policy(meshcat, script),
        title=f"{name} · rpctl",
        css=_asset("report.css"),
        name=name,
        subtitle=subtitle(run),
        scene_label=f"{name} following its reference, in three dimensions",
        duration=f"{scene.duration:.6f}",
        legend=legend(run),
        panel=panel(run, summary, scene.notes),
        figure=_figure(run),
        data=_data(scene),
        meshcat=meshcat,
        script=script,
    )


def embed(value: Any) -> str:
    """Return JSON that can stand inside a ``<script>``: no ``<``, so nothing ends it early."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _data(scene: Scene) -> str:
    return embed(
        {
            "duration": scene.duration,
            "frames": len(scene.times),
            "lower": scene.lower.tolist(),
            "upper": scene.upper.tolist(),
            "hull": np.round(scene.hull, 3).tolist(),
            "start": scene.start.tolist(),
            "follow": scene.follow,
            "origin": scene.origin.tolist(),
            "commands": [base64.b64encode(command).decode() for command in scene.commands],
        }
    )


def _figure(run: Run) -> str:
    """Return the tracking plots for light and for dark pages."""
    from rpctl.view.plots import tracking_image

    light, dark = (
        "data:image/png;base64," + base64.b64encode(tracking_image(run, dark=dark)).decode()
        for dark in (False, True)
    )
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{dark}">'
        f'<img src="{light}" alt="Plots: paths, tracking errors, speeds and efforts"></picture>'
    )


def _policy(*scripts: str) -> str:
    """Return a policy under which only these scripts run, and nothing is fetched from anywhere."""
    digests = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"
    )


def _asset(name: str) -> str:
    return files("rpctl.view").joinpath("assets", name).read_text(encoding="utf-8")


def _meshcat() -> str:
    """Return meshcat's viewer; the package is found, not imported (it would load IPython)."""
    found = find_spec("meshcat")
    folders = found.submodule_search_locations if found else None
    for folder in folders or ():
        file = Path(folder) / MESHCAT_SCRIPT
        if file.is_file():
            return file.read_text(encoding="utf-8").replace("</script", "<\\/script")
    raise RpctlError(f"meshcat or its {MESHCAT_SCRIPT} is not there; run: pip install meshcat")
