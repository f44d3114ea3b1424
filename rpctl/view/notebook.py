"""A run as notebooks show it: one line, and its scene in a frame of its own."""

from __future__ import annotations

import base64
import html
import re
import zlib
from pathlib import PurePath
from string import Template

import numpy as np

from rpctl.errors import RpctlError
from rpctl.simulation.run import Run
from rpctl.view.pages.page import asset, escape, policy
from rpctl.view.pages.scene_page import player
from rpctl.view.scene.scene import build_scene

ASPECT = 16.0 / 9.0
MAX_WIDTH_PX = 960  # pixels, at most
IFRAME = Template(
    "<p>$summary</p>"
    '<iframe title="$title" sandbox="allow-scripts" srcdoc="$page" style="width: 100%; '
    'max-width: ${width}px; aspect-ratio: $aspect; border: 1px solid #d5d9de; border-radius: 8px">'
    "</iframe>"
)
PACKED_PAGE = Template(
    '<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" '
    'content="$policy"><script type="text/plain" id="packed">$packed</script>'
    "<script>$script</script>"
)
CONTROLS = """<div class="bar" role="group" aria-label="Timeline">
<button type="button" id="play"></button>
<input type="range" id="slider" min="0" value="0" step="any" aria-label="Time">
<output id="clock" for="slider"></output>
</div>"""


def show(run: Run) -> str:
    """Return a run as HTML for a notebook: one line of text, and its scene with controls.

    Where the robot cannot be loaded any more, the reason stands in the place of the scene.
    """
    summary = escape(_summary_line(run))
    try:
        scene = build_scene(run.load_robot(), run)
    except RpctlError as error:
        return f"<p>{summary}</p><p>The scene cannot be drawn: {escape(str(error))}</p>"
    page = player(scene, run.robot.name, ASPECT, asset("notebook.js"), CONTROLS)
    return IFRAME.substitute(
        summary=summary,
        title=escape(run.robot.name),
        page=html.escape(pack(page)),
        width=MAX_WIDTH_PX,
        aspect=f"{ASPECT:.4f}",
    )


def _summary_line(run: Run) -> str:
    """Return what the run is, and how well it ended, in one line."""
    errors = []
    if run.robot.drive.wheels:
        errors.append(f"base {1e3 * np.hypot(*run.log.e[-1, :2]):.3g} mm")
    if run.robot.end_effector is not None:
        errors.append(
            f"end effector {1e3 * np.linalg.norm(run.log.ee_ref[-1] - run.log.ee[-1]):.3g} mm"
        )
    reference = PurePath(run.config.run.reference).name  # no folder of this machine
    duration = run.t[-1] - run.t[0]
    return f"{run.robot.name}, {reference}, {duration:.4g} s; final error: {', '.join(errors)}"


def pack(page: str) -> str:
    """Return a page that unpacks itself, at half the size: notebooks store their outputs."""
    script = asset("unpack.js")
    inner = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    packed = base64.b64encode(zlib.compress(page.encode(), level=9)).decode()
    return PACKED_PAGE.substitute(policy=policy(script, *inner), packed=packed, script=script)
